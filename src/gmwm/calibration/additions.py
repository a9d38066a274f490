"""Additions to a calibration: what applications compute from the samples of the recordings, found in one registry."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit
    from gmwm.recording.signals import Signal

GROUP = "gmwm.additions"  # group of the entry points through which other packages register additions
ENTRY_POINTS = (
    "gmwm.applications.several.cross:SharedNoiseAddition",
    "gmwm.applications.monitor.baseline:BaselineAddition",
)
"""Entry points of the package itself. They are loaded like those of other packages, after the core."""


class AxisAddition:
    """A value that `calibrate` computes for each axis from its fit and its first samples.

    A subclass overrides `of_axis`. The value is in `AxisCalibration.additions` and, as the result of `to_dict`, in
    calibration.json, both under `name`.

    Attributes
    ----------
    name : str
        Name of the addition and its key in the document of an axis.
    beginning : int
        Number of samples at the beginning of each recording that `of_axis` needs.
    """

    name: ClassVar[str]
    beginning: ClassVar[int] = 0

    def of_axis(self, fit: Fit, beginnings: Sequence[Signal]) -> Any:
        """Compute the value of one axis; None if there is none.

        Parameters
        ----------
        fit : Fit
            The fit of the recommended model.
        beginnings : sequence of Signal
            The first `beginning` samples, or more, of each recording. Isolated wrong samples and knocks are replaced.
            The effect of conditions such as the temperature is not removed.
        """
        raise NotImplementedError

    def summary(self, values: Mapping[str, Any]) -> str:
        """Return a paragraph for the summary of a calibration, from the values by axis; "" for none."""
        return ""

    def to_dict(self, value: Any) -> Any:
        """Return a value as dicts, lists, numbers and strings for JSON."""
        return value

    def from_dict(self, content: Any) -> Any:
        """Restore a value from `content`, the result of `to_dict`."""
        return content


class RecordingAddition:
    """A finding about all axes of a recording in memory, which `calibrate` reports as remarks on the recording.

    A subclass overrides all methods."""

    def needs(self, axes: Sequence[str]) -> bool:
        """Return whether the addition needs the samples of a recording with these axes."""
        raise NotImplementedError

    def of_recording(self, signals: Iterable[tuple[str, Signal]], *, threads: int | None = None) -> Any:
        """Compute the finding from all samples of the calibrated axes.

        Parameters
        ----------
        signals : iterable of (axis, Signal)
            Isolated wrong samples and knocks are replaced, the effect of conditions is removed, and short gaps are
            filled. An axis is joined from its batches when it is read.
        threads : int, optional
            Number of axes that are processed at the same time.
        """
        raise NotImplementedError

    def remarks(self, finding: Any, axes: Collection[str], size: float) -> Iterator[Remark]:
        """Yield remarks on a finding.

        Parameters
        ----------
        finding : object
            The result of `of_recording`.
        axes : collection of str
            The calibrated axes without motion or knocks that were not replaced.
        size : float
            Significance level for this recording.
        """
        raise NotImplementedError


@cache
def _registry() -> tuple[AxisAddition | RecordingAddition, ...]:
    """Return all additions. The entry points are loaded at the first call, in a calibration or when one is read."""
    registry: list[AxisAddition | RecordingAddition] = []

    def admit(name: str, kind: type[AxisAddition | RecordingAddition]) -> None:
        if not issubclass(kind, AxisAddition | RecordingAddition):
            raise TypeError(f"{name} must be a subclass of AxisAddition or RecordingAddition; got {kind!r}")
        addition = kind()
        names = {other.name for other in registry if isinstance(other, AxisAddition)}
        if isinstance(addition, AxisAddition) and addition.name in names:
            raise ValueError(f"an addition with the name {addition.name!r} exists")
        registry.append(addition)

    for entry_point in ENTRY_POINTS:
        module, _, name = entry_point.partition(":")
        admit(name, getattr(import_module(module), name))
    admit_guests(GROUP, admit)
    return tuple(registry)


def axis_additions() -> tuple[AxisAddition, ...]:
    """Return the additions to each axis."""
    return tuple(addition for addition in _registry() if isinstance(addition, AxisAddition))


def recording_additions() -> tuple[RecordingAddition, ...]:
    """Return the additions to each recording."""
    return tuple(addition for addition in _registry() if isinstance(addition, RecordingAddition))
