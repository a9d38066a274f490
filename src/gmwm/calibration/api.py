"""Calibrate recordings: choose and fit the noise model of every axis, and compute its numbers and their uncertainty."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal, TypeVar

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.helpers import Helpers
from gmwm.base.remarks import Remark
from gmwm.base.reporting import Progress
from gmwm.base.threads import in_threads
from gmwm.calibration.additions import recording_additions
from gmwm.calibration.calibrate_axis import STAGES, calibrate_axis, choose_model
from gmwm.calibration.data import AxisInput, Recordings
from gmwm.calibration.findings import TEST_SIZE
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.number_verdicts import with_limits
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.calibration.passes import Execution
from gmwm.calibration.recording_findings import recording_remarks
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.selection.search import ModelChoice
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.against import AUTO, Against
from gmwm.recording.batches import Streamed
from gmwm.recording.options import as_whole_number
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import ModelLike
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    import numpy as np
    from distributed import Client

    from gmwm.base.reporting import Progress
    from gmwm.calibration.result import Calibration

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


def calibrate(
    data: Data | Several, within: ModelLike = SEARCHED, *, robust: Literal["auto"] | bool = "auto",
    weighting: Literal["diagonal", "optimal"] = "optimal", criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95, efficiency: float = 0.6, draws: int = 1000, rng: int | np.random.Generator = 0,
    against: Against = AUTO, gravity: float | None = None, tilt: float | None = None,
    warmup: Literal["omit", "keep"] = "omit",
    axes: str | Sequence[str] | None = None, models: Mapping[str, ModelLike] | None = None,
    repeated: Literal["auto", "keep"] = "auto", threads: int | None = None,
    scheduler: str | Client | None = None, workers: int | None = None, progress: Progress | Literal[True] | None = None,
) -> Calibration:  # fmt: skip
    """Calibrate every axis of an inertial sensor: choose a noise model, fit it and compute its datasheet numbers.

    For each axis, the function estimates the wavelet variance, selects a model, fits it, certifies the optimum given
    the filter and the lines taken from the spectrum, and computes confidence intervals, a goodness-of-fit test and the
    numbers of a datasheet. An axis that cannot be calibrated is listed in `failed`; the others are not affected.

    Parameters
    ----------
    data : Imu, Signal, Stream or data frame; a list of these; or mapping of axis to Signal, WaveletVariance or a pair
        A recording of a sensor at rest, or a list (or a mapping of name to Imu or Stream) of several recordings of one
        unit. For several recordings, each axis has one model, which is fitted to the mean of their curves, and the
        intervals include the spread between them; `calibration.axes[axis].replicates` compares the recordings. A Stream
        gives the same result as a recording in memory, but is read in chunks: twice if it has more than 2.1 million
        samples, once more for its temperature, and once more up to 0.5 million samples for the baseline of `Monitor` if
        the effect of a condition is removed. Only for a recording in memory, a remark names axes that share noise (see
        `cross`).
    within : "auto", or Model, Process or str
        With "auto", gmwm searches for the model. It starts with slow noise processes, white noise and quantization
        noise. If the goodness-of-fit test rejects these, it adds what the spectrum shows: the filter of the sensor,
        resonances and lines. Any other value is the largest model; all models made of some of its terms are compared.
    robust : "auto", False or True
        Whether the robust wavelet variance, which outliers hardly affect, is fitted. "auto" uses it for axes on which
        knocks or motion raise the classical curve, at the 5 % level for all axes together (see `contamination`). Heavy
        tails are not outliers: the classical curve is fitted, and its covariance includes the effect of the tails.
        Isolated wrong samples are replaced before any curve is computed. If `within` has a sinusoid, "auto" always uses
        the classical estimate, because the robust estimate of a sinusoid differs from its theory. If the data are a
        WaveletVariance, it is fitted unchanged.
    weighting, criterion, draws, rng
        As in `select`. The settings of the result contain the integer seed; for a Generator, a seed drawn from it.
    confidence : float
        Confidence level of the intervals, and of the set of models that `select` considers equivalent.
    efficiency : float
        Efficiency of the robust wavelet variance under Gaussian noise, relative to the classical one.
    against : "auto", "none", str, (N,) array, or mapping of name to array
        Conditions whose effect is removed before the noise is estimated. "auto" removes the effect of the temperature
        of the recording from each axis that follows it at the 5 % level. A string names the temperature or time with
        options, for example "temperature:2,lag", "time:3" or "warmup". An array or a mapping has other covariates. See
        docs/howto/temperature.md.
    gravity : float, optional
        Local gravity (m/s²), which determines the bias at rest of the accelerometers. Default: 9.806 ± 0.016, the range
        at sea level.
    tilt : float, optional
        Largest possible angle (°) between the vertical and the accelerometer axis closest to it. Without it, only the
        bias of the vertical accelerometer is computed.
    warmup : "omit" or "keep"
        With "omit", the beginning of an Imu or Stream is left out if a warm-up there raises K by more than its
        uncertainty, and if at least half of the recording is left. A remark and the summary say so.
    axes : str or sequence of str, optional
        The axes to calibrate; "gyro" and "accel" mean all axes of a sensor. Default: all axes.
    models : mapping of axis or sensor to Model, Process or str, optional
        Models that are fitted without comparing them with others, such as {"gyro_x": "2*GM + WN", "accel": "WN + RW"}.
        gmwm chooses the models of the other axes.
    repeated : "auto" or "keep"
        With "auto", faults of the logger are undone, as `gmwm.inspect` describes. With "keep", all values are used as
        they are.
    threads : int, optional
        Number of axes that are calibrated at the same time. Default: the number of processors.
    scheduler, workers : optional
        Processes that read a stream in parallel: the address or client of a Dask scheduler, or a number of local
        processes. The fits run in the calling process.
    progress : True, or function of (done, all, text), optional
        True shows a progress bar, also in a notebook. A function is called after each step, and repeatedly while a
        stream is read, by one thread at a time. The logger "gmwm" gets each step at the level INFO.

    Returns
    -------
    Calibration
        A mapping of axis to the recommended Fit, with rankings, datasheets, remarks and a verdict.

    Raises
    ------
    OptionError
        If an argument is not allowed.
    DataError, ModelError
        If no axis can be calibrated, for example because the recording has fewer than 64 samples without a gap and thus
        fewer than four usable scales.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), Wavelet-variance-based estimation for composite stochastic
    processes, JASA 108, 1021-1030.

    Examples
    --------
    >>> from gmwm import simulate
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=100_000, rng=1)
    >>> calibration = calibrate(imu, within="GM + WN + RW")
    >>> calibration["gyro_x"].model.structure
    'WN + RW'
    """
    options = CalibrationOptions(
        within=within, robust=robust, weighting=weighting, criterion=criterion, confidence=confidence,
        efficiency=efficiency, draws=draws, seed=as_seed(rng), against=against, gravity=gravity, tilt=tilt,
        warmup=warmup, axes=axes,
        models={} if models is None else models,
        repeated=repeated,
    )  # fmt: skip
    from gmwm.base.reporting import reported

    with reported(progress, "calibrating") as show:
        return calibrate_recording(data, options, threads=threads, scheduler=scheduler, workers=workers, progress=show)
