"""Calibrate recordings: choose and fit the noise model of every axis, and compute its numbers and their uncertainty."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm.base.errors import GmwmError, OptionError
from gmwm.base.helpers import Helpers
from gmwm.base.remarks import Remark
from gmwm.base.threads import in_threads
from gmwm.calibration.additions import recording_additions
from gmwm.calibration.calibrate_axis import STAGES, calibrate_axis
from gmwm.calibration.data import AxisInput, Recordings
from gmwm.calibration.findings import SIZE
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.calibration.passes import Run
from gmwm.calibration.recording_findings import recording_remarks
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.files.readers.streams import Stream
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.against import AUTO, Against
from gmwm.recording.options import as_whole_number
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import ModelLike
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    from distributed import Client

Data = Imu | Signal | Stream | Mapping[str, AxisInput]
"""Data of one recording."""
Several = Sequence[Imu] | Sequence[Signal] | Sequence[Stream] | Mapping[str, Imu | Stream]
"""Data of several recordings of one unit."""
Progress = Callable[[int, int, str], None]
"""Progress callback. Its arguments are the number of finished steps, the total number of steps, and a description of
the last step."""


def calibrate(
    data: Data | Several,
    within: ModelLike = SEARCHED,
    *,
    robust: Literal["auto"] | bool = "auto",
    weighting: Literal["diagonal", "optimal"] = "optimal",
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95,
    efficiency: float = 0.6,
    draws: int = 1000,
    rng: int | np.random.Generator = 0,
    against: Against = AUTO,
    gravity: float | None = None,
    tilt: float | None = None,
    axes: str | Sequence[str] | None = None,
    models: Mapping[str, ModelLike] | None = None,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Calibrate every axis of an inertial sensor: choose a noise model, fit it and compute its datasheet numbers.

    For each axis, the function estimates the wavelet variance, selects a model, fits it, certifies the optimum, and
    computes confidence intervals, a goodness-of-fit test and the numbers of a datasheet. An axis that cannot be
    calibrated is listed in `failed`; the others are not affected.

    Parameters
    ----------
    data : Imu, Signal, Stream; a list of these; or mapping of axis to Signal, WaveletVariance or a pair of these
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
    axes : str or sequence of str, optional
        The axes to calibrate; "gyro" and "accel" mean all axes of a sensor. Default: all axes.
    models : mapping of axis or sensor to Model, Process or str, optional
        Models that are fitted without comparing them with others, such as {"gyro_x": "2*GM + WN", "accel": "WN + RW"}.
        gmwm chooses the models of the other axes.
    threads : int, optional
        Number of axes that are calibrated at the same time. Default: the number of processors.
    scheduler, workers : optional
        Processes that read a stream in parallel: the address or client of a Dask scheduler, or a number of local
        processes. The fits run in the calling process.
    progress : function of (done, all, text), optional
        Function that is called after each step, and repeatedly while a stream is read, by one thread at a time.

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
        within=within,
        robust=robust,
        weighting=weighting,
        criterion=criterion,
        confidence=confidence,
        efficiency=efficiency,
        draws=draws,
        seed=as_seed(rng),
        against=against,
        gravity=gravity,
        tilt=tilt,
        axes=axes,
        models={} if models is None else models,
    )
    return calibrate_recording(data, options, threads=threads, scheduler=scheduler, workers=workers, progress=progress)


def calibrate_recording(
    data: Data | Several,
    options: CalibrationOptions,
    *,
    threads: int | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    helpers: Helpers | None = None,
) -> Calibration:
    """Calibrate one or several recordings like `calibrate`, with options that are already validated.

    The axes are also calibrated in helper processes, if there are any.
    """
    if threads is not None:
        as_whole_number(threads, "threads", 1)
    recordings = Recordings.of(data, options)
    steps = _Progress(len(recordings.axes) * len(STAGES), progress)
    run = Run(threads=threads, scheduler=scheduler, workers=workers, progress=steps.read)
    measured, inspections, findings = measure(recordings, options, run)

    def work(axis: str, item: MeasuredAxis | GmwmError) -> AxisCalibration | GmwmError:
        try:
            if isinstance(item, GmwmError):
                raise item
            advance = partial(steps.step, axis)
            if helpers is None:
                return calibrate_axis(item, options, advance=advance, check=steps.check)
            advance(STAGES[0])
            calibration = helpers.run(calibrate_axis, item, options)
            for stage in STAGES[1:]:
                advance(stage)
            return calibration
        except OptionError:
            raise
        except GmwmError as error:
            return error

    try:
        results = in_threads(work, measured, threads=threads)
    except BaseException:
        steps.stop()
        raise
    axes = {axis: item for axis, item in results.items() if isinstance(item, AxisCalibration)}
    failed = {axis: item for axis, item in results.items() if isinstance(item, GmwmError)}
    if not axes:
        axis, error = next(iter(failed.items()))
        raise error.at(f"no axis can be calibrated; {axis}") from error
    verdicts = {axis: item.verdicts for axis, item in measured.items() if isinstance(item, MeasuredAxis)}
    descriptions = {name: Recording.of(inspection) for name, inspection in inspections.items()}
    single = recordings.by_name.get("")
    source = single.source if isinstance(single, Imu | Stream) else ""
    return Calibration(
        axes=axes,
        failed=dict(recordings.missing) | {axis: error.reason for axis, error in failed.items()},
        settings=options,
        source=source if single is not None else ", ".join(recordings.by_name),
        recording_remarks=tuple(dict.fromkeys(_recording_remarks(inspections, axes, verdicts, findings))),
        recording=descriptions.get(""),
        recordings={name: item for name, item in descriptions.items() if name},
    )


def _recording_remarks(
    inspections: Mapping[str, Inspection],
    axes: Mapping[str, AxisCalibration],
    verdicts: Mapping[str, Mapping[str, Verdict]],
    findings: Mapping[str, Sequence[object]],
) -> Iterator[Remark]:
    """Yield the remarks on the recordings from their inspections, outlier tests and additions.

    If a remark does not apply to all recordings, its subject names the recording.
    """
    found = {}
    for name, inspection in inspections.items():
        own = [of[name] for of in verdicts.values() if name in of]
        found[name] = list(recording_remarks(inspection, axes, own))
        still = [axis for axis in axes if not (name in verdicts[axis] and verdicts[axis][name].contaminated)]
        for addition, finding in zip(recording_additions(), findings[name], strict=False):
            if finding is not None:
                found[name] += addition.remarks(finding, still, SIZE / len(inspections))
    for name, remarks in found.items():
        for remark in remarks:
            if all(remark in others for others in found.values()):
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
