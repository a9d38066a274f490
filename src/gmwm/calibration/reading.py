"""Read one recording for a calibration: measure its axes, inspect it, and regress its axes on conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import OptionError
from gmwm.base.threads import in_threads
from gmwm.calibration.data import chosen_axes
from gmwm.calibration.measurement import Measured, measured_recording
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.several import Part, Together, measured_together, pair_of_axis
from gmwm.files.readers.streams import Stream
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.regression.conditions import NOTHING, Conditions
from gmwm.measuring.regression.result import Regression
from gmwm.recording.signals import Imu, Signal

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
) -> tuple[dict[str, Measured], Inspection | None, tuple[object, ...], dict[str, Conditions]]:
    """Measure and inspect one recording.

    Parameters
    ----------
    data : Imu, Signal, Stream, or mapping of axis to Measured
        The recording, or data without a recording.
    chosen : mapping of axis to Measured or None
        The axes to calibrate, with their data if they are in memory.
    options : CalibrationOptions
    threads, scheduler, workers
        As in `calibrate`.
    read : callable
        Function that is called with a description while the recording is read.

    Returns
    -------
    items : dict of axis to Measured
        The measured data of each axis.
    inspection : Inspection or None
        The inspection; None without a recording.
    findings : tuple of object
        The findings of `recording_additions`.
    conditions : dict of axis to Conditions
        The conditions whose effect is removed, with the regression of each axis.

    Raises
    ------
    OptionError
        If worker processes are asked for and `data` is not a Stream, or if `against` needs samples that are not there.
    """
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
        return dict(measured.axes), measured.inspection, measured.findings, dict.fromkeys(chosen, conditions)
    items, found = {}, {}
    for axis, item in chosen.items():
        if item is not None:
            found[axis] = _conditions_of(axis, item, asked)
            items[axis] = found[axis].without(axis, item) if isinstance(item, Signal) else item
    return items, None, (), found


def _conditions_of(axis: str, item: Measured, asked: Asked) -> Conditions:
    """Return the conditions, with the regression, of one axis of data without a recording."""
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
        The classical and the robust wavelet variance, the spectrum, and the conditions.
    comparisons : int
        Number of axes that are tested together for outliers.
    """

    axis: str
    part: Part
    comparisons: int

    @property
    def regression(self) -> Regression | None:
        """The regression whose effect is removed from the axis; None if no effect is removed."""
        return self.part.conditions.applied(self.axis)

    def measured(self, options: CalibrationOptions) -> Together:
        """Return the wavelet variance that `calibrate` would fit, its spectrum and the outlier test.

        Parameters
        ----------
        options : CalibrationOptions
            Options of this axis.

        Raises
        ------
        DataError
            If the axis is constant.
        """
        return measured_together(self.axis, {"": self.part}, options, comparisons=self.comparisons)


def axes_data(
    recording: Imu | Stream, options: CalibrationOptions, *, progress: Callable[[str], None] = lambda _: None
) -> dict[str, AxisData]:
    """Measure all axes of a recording in the same way as `calibrate`, without choosing models."""
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
