"""Read one recording for a calibration: the measurements of its axes, its inspection, and its conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gmwm._threads import in_threads
from gmwm.calibration.data import chosen_axes
from gmwm.calibration.measurement import Measured, measured_recording
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.several import Part, Together, measured_together, pair_of_axis
from gmwm.errors import OptionError
from gmwm.inspection import Inspection
from gmwm.joint.result import SharedNoise
from gmwm.readers.streams import Stream
from gmwm.regression.against import Asked
from gmwm.regression.conditions import NOTHING, Conditions
from gmwm.regression.result import Regression
from gmwm.signals import Imu, Signal

if TYPE_CHECKING:
    from distributed import Client


def inspected(
    data: Any,
    chosen: Mapping[str, Measured | None],
    options: CalibrationOptions,
    threads: int | None,
    scheduler: str | Client | None,
    workers: int | None,
    read: Callable[[str], None],
) -> tuple[dict[str, Measured], Inspection | None, tuple[SharedNoise, ...], dict[str, Conditions]]:
    """Return the measured data of each axis, the inspection of a recording, the noise that its axes share, and the
    conditions of each axis."""
    asked = options.conditions
    if not isinstance(data, Stream) and (scheduler is not None or workers is not None):
        name = "workers" if scheduler is None else "scheduler"
        raise OptionError(
            f"{name} can be given for a stream only",
            argument=name,
            advice="Pass a stream: `calibrate(gmwm.stream(path), …)`.",
        )
    if isinstance(data, Imu | Stream):
        conditions = Conditions.of_recording(data, asked, threads=threads, curves=True)
        measured = measured_recording(
            data, tuple(chosen), options, threads=threads, scheduler=scheduler, workers=workers, progress=read,
            conditions=conditions,
        )  # fmt: skip
        return dict(measured.axes), measured.inspection, measured.shared, dict.fromkeys(chosen, conditions)
    items, found = {}, {}
    for axis, item in chosen.items():
        if item is not None:
            found[axis] = _conditions_of(axis, item, asked)
            items[axis] = found[axis].without(axis, item) if isinstance(item, Signal) else item
    return items, None, (), found


def _conditions_of(axis: str, item: Measured, asked: Asked) -> Conditions:
    """Return the conditions of one axis for data without a recording."""
    if isinstance(item, Signal):
        return Conditions.of({axis: item}, asked, None)
    if asked.terms:
        raise OptionError(
            f"against needs the samples; {axis} is a {type(item).__name__}",
            argument="against",
            advice="Pass signals, or leave {--against} out.",
        )
    return NOTHING


@dataclass(frozen=True, kw_only=True, eq=False)
class AxisData:
    """The measurements of one axis of a recording, before a model is chosen.

    Attributes
    ----------
    axis : str
    part : Part
        The classical and the robust curve, the spectrum, and the conditions.
    comparisons : int
        Number of axes that are tested together for outliers.
    """

    axis: str
    part: Part
    comparisons: int

    @property
    def regression(self) -> Regression | None:
        """The regression on the conditions whose effect is removed; None if none is removed."""
        return self.part.conditions.applied(self.axis)

    def measured(self, options: CalibrationOptions) -> Together:
        """Return the curve that `calibrate` fits with the options of this axis, its spectrum and the test for outliers.

        Raises
        ------
        DataError
            If the axis is constant.
        """
        return measured_together(self.axis, {"": self.part}, options, comparisons=self.comparisons)


def axes_data(
    recording: Imu | Stream, options: CalibrationOptions, *, progress: Callable[[str], None] = lambda _: None
) -> dict[str, AxisData]:
    """Measure all axes of a recording as `calibrate` does, without choosing a model."""
    items, _, _, conditions = inspected(
        recording, chosen_axes(recording, None), options, threads=None, scheduler=None, workers=None, read=progress
    )  # fmt: skip
    pairs = in_threads(lambda _, item: pair_of_axis(item, options), items)
    return {
        axis: AxisData(
            axis=axis, part=Part(item=pair, raw=None, conditions=conditions[axis]), comparisons=len(pairs)
        )
        for axis, pair in pairs.items()
    }  # fmt: skip
