"""Calibrate the axes of one or several recordings, and put the results together."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.helpers import Helpers
from gmwm.base.remarks import Remark
from gmwm.base.reporting import Progress
from gmwm.base.threads import in_threads, return_memory
from gmwm.calibration.additions import recording_additions
from gmwm.calibration.calibrate_axis import STAGES, calibrate_axis, choose_model
from gmwm.calibration.data import AxisInput, Recordings
from gmwm.calibration.findings import TEST_SIZE
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.number_verdicts import with_limits
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.passes import Execution
from gmwm.calibration.recording_findings import recording_remarks
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.outliers import Verdict
from gmwm.recording.batches import Streamed
from gmwm.recording.options import as_whole_number
from gmwm.recording.signals import Imu, Signal

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
Item = TypeVar("Item")

Data = Imu | Signal | Streamed | Mapping[str, AxisInput]
"""Data of one recording."""
Several = Sequence[Imu] | Sequence[Signal] | Sequence[Streamed] | Mapping[str, Imu | Streamed]
"""Data of several recordings of one unit."""


def calibrate_recording(
    data: Data | Several, options: CalibrationOptions, *, threads: int | None = None,
    scheduler: str | Client | None = None, workers: int | None = None, progress: Progress | None = None,
    helpers: Helpers | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate like `calibrate`, with options that are already validated, and in helper processes if there are any."""
    if threads is not None:
        as_whole_number(threads, "threads", 1)
    recordings = Recordings.of(data, options)
    steps = _Progress(len(recordings.axes) * len(STAGES), progress)
    run = Execution(threads=threads, scheduler=scheduler, workers=workers, progress=steps.read)
    measured, inspections, findings = measure(recordings, options, run)

    failed = {axis: item for axis, item in measured.items() if isinstance(item, GmwmError)}
    items = {axis: item for axis, item in measured.items() if isinstance(item, MeasuredAxis)}

    def choose(axis: str, item: MeasuredAxis) -> ModelChoice:
        steps.step(axis, STAGES[0])
        of_axis = options.of_axis(axis)
        curve, spectrum = item.curve(of_axis), item.spectrum
        if helpers is None:
            choice = choose_model(curve, spectrum, of_axis, check=steps.check)
        else:
            choice = helpers.run(choose_model, curve, spectrum, of_axis)
        steps.step(axis, STAGES[1])
        return choice

    def calibrated(axis: str, choice: ModelChoice) -> AxisCalibration:
        result = (helpers or Helpers()).run(calibrate_axis, items[axis], choice, options)
        steps.step(axis, STAGES[2])
        return result

    try:
        choices = with_shared_form(_results(choose, items, failed, threads))
        axes = _results(calibrated, choices, failed, threads)
    except BaseException:
        steps.stop()
        raise
    failed = {axis: failed[axis] for axis in measured if axis in failed}
    if not axes:
        axis, error = next(iter(failed.items()))
        raise error.at(f"no axis can be calibrated; {axis}") from error
    verdicts = {axis: item.verdicts for axis, item in items.items()}
    descriptions = {name: Recording.of(of_parts[0]) for name, of_parts in inspections.items() if of_parts}
    calibration = Calibration(
        axes=axes,
        failed=dict(recordings.missing) | {axis: error.reason for axis, error in failed.items()},
        settings=options,
        source=recordings.source,
        recording_remarks=tuple(
            dict.fromkeys(
                (*_recording_remarks(inspections, axes, verdicts, findings), *_not_inspected(recordings, axes))
            )
        ),
        recording=descriptions.get(""),
        recordings={name: item for name, item in descriptions.items() if name},
    )
    return with_limits(calibration)


def _results(
    work: Callable[[str, Item], T], items: Mapping[str, Item], failed: dict[str, GmwmError], threads: int | None
) -> dict[str, T]:
    """Call a function for each axis in threads, and return the results; errors of axes are added to `failed`."""

    def result_or_error(axis: str, item: Item) -> T | GmwmError:
        try:
            return work(axis, item)
        except OptionError:
            raise
        except GmwmError as error:
            return error

    return_memory()  # of the stage before, which needed other sizes of arrays
    results = in_threads(result_or_error, items, threads=threads)
    failed.update({axis: item for axis, item in results.items() if isinstance(item, GmwmError)})
    return {axis: item for axis, item in results.items() if not isinstance(item, GmwmError)}


def _not_inspected(recordings: Recordings, axes: Mapping[str, AxisCalibration]) -> list[Remark]:
    """Return remarks on the axes that the user gave as curves, because only samples can be inspected."""
    given = {axis for curves in recordings.curves.values() for axis in curves}
    return [Remark.of("not-inspected", axis) for axis in axes if axis in given]


def _recording_remarks(
    inspections: Mapping[str, Sequence[Inspection]], axes: Mapping[str, AxisCalibration],
    verdicts: Mapping[str, Mapping[str, Verdict]], findings: Mapping[str, Sequence[Sequence[object]]],
) -> Iterator[Remark]:  # fmt: skip
    """Yield the remarks on the recordings from inspections, outlier tests and additions. Remarks that do not apply to
    all recordings name theirs."""
    by_recording: dict[str, list[Remark]] = {}
    for name, of_parts in inspections.items():
        remarks = by_recording[name] = []
        recording_verdicts = [of[name] for of in verdicts.values() if name in of]
        still = [axis for axis in axes if not (name in verdicts[axis] and verdicts[axis][name].contaminated)]
        for inspection, of_part in zip(of_parts, findings[name], strict=True):
            remarks += recording_remarks(inspection, axes, recording_verdicts)
            for addition, finding in zip(recording_additions(), of_part, strict=False):
                if finding is not None:
                    remarks += addition.remarks(finding, still, TEST_SIZE / len(inspections))
    for name, remarks in by_recording.items():
        for remark in remarks:
            if all(remark in others for others in by_recording.values()):
                yield remark
            else:
                yield remark.about(f"{remark.subject} in {name}" if remark.subject else name)


class _Progress:
    """Progress of the threads of a calibration. It reports one step at a time, and it can stop all threads."""

    def __init__(self, steps: int, progress: Progress | None) -> None:
        self.steps, self.progress = steps, progress
        self.done = 0
        self.lock = threading.Lock()
        self.stopped = threading.Event()

    def stop(self) -> None:
        """Make every thread stop before its next step."""
        self.stopped.set()

    def check(self) -> None:
        """Raise KeyboardInterrupt in this thread if `stop` was called."""
        if self.stopped.is_set():
            raise KeyboardInterrupt

    def read(self, text: str) -> None:
        """Report the progress of reading, which is not a step of its own."""
        if self.progress is not None:
            self.progress(self.done, self.steps, text)

    def step(self, axis: str, stage: str) -> None:
        """Report a finished step of an axis."""
        self.check()
        with self.lock:
            self.done += 1
            if self.progress is not None:
                self.progress(self.done, self.steps, f"{axis}: {stage}")
