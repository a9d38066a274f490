"""Calibrate a recording: a noise model, its numbers and their uncertainty for every axis."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm._text import counted
from gmwm._threads import in_threads
from gmwm.calibration.averaging import WALK, averaged_datasheet, averaged_intervals, is_walk, with_band
from gmwm.calibration.baselines import with_baselines
from gmwm.calibration.choice import chosen_model, final_fit
from gmwm.calibration.data import chosen_axes, common_axes, named, require_axes, require_one
from gmwm.calibration.findings import LEAST_SCALES, SIZE, WANTED
from gmwm.calibration.measurement import Measured
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.calibration.reading import inspected
from gmwm.calibration.recording_findings import recording_remarks, shared_remarks
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.rest import means_of, with_rest
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.several import Part, measured_together, regression_of, worst
from gmwm.datasheets import datasheet
from gmwm.errors import DataError, GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.estimation.result import Fit
from gmwm.inference.goodness import GoodnessOfFit, usable_levels
from gmwm.inference.model_error import nearly_fitted, relative_misfit
from gmwm.inference.planning import SEEN, relative_errors
from gmwm.inspection import Inspection
from gmwm.joint.result import SharedNoise
from gmwm.options import as_whole_number
from gmwm.outliers import Verdict
from gmwm.processes.model import Model, ModelLike
from gmwm.processes.validation import as_seed
from gmwm.processes.walk import RW
from gmwm.readers.streams import Stream
from gmwm.regression.against import AUTO, Against
from gmwm.remarks import Remark
from gmwm.signals import Imu, Signal
from gmwm.variance.result import WaveletVariance

STAGES = ("measured", "model chosen", "fitted", "judged")
"""Names of the steps of one axis, as `progress` reports them."""
LONGER = 10
"""Largest number of doublings of the recording length that `needed` tries: a factor of 1024
(tests/calibration/test_calibrate.py)."""

if TYPE_CHECKING:
    from distributed import Client

Data = Imu | Signal | Stream | Mapping[str, Measured]
"""One recording."""
Several = Sequence[Imu] | Sequence[Signal] | Sequence[Stream] | Mapping[str, Imu | Stream]
"""Several recordings of one unit."""
Progress = Callable[[int, int, str], None]
"""Progress callback: called with the number of finished steps, the number of all steps, and a description of the last
step."""


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
    data : Imu, Signal, Stream; a list of these; or mapping of axis to Signal, WaveletVariance or Pair
        A recording of a sensor at rest, or a list (or a mapping of name to Imu or Stream) of several recordings of one
        unit. Several recordings get one model and one fit for each axis, to the mean of their curves; intervals include
        the spread between them. `calibration.axes[axis].replicates` compares them. The result is the same
        for a recording in memory and a Stream, which is read in bounded memory: twice if it has more than 2.1 million
        samples, and once more for its temperature. Only for a recording in memory, a remark names axes that share noise
        (see `cross`). If the effect of a condition is removed, the first 0.5 million
        samples are read again for the baseline of `Monitor`.
    within : "auto", or Model, Process or str
        "auto" searches for the model: first within slow noise processes, white and quantization noise; if the test
        rejects these, with what the spectrum shows, the filter of the sensor, resonances and lines. Otherwise the
        largest model; all models made of some of its terms are compared.
    robust : "auto", False or True
        Whether the robust wavelet variance, which outliers do not affect, is fitted. "auto" uses it for axes with
        knocks or motion that raise the classical curve, at the 5 % level for all axes together (see `contamination`).
        Heavy tails are not outliers: the classical curve is fitted, and its covariance includes them. Isolated wrong
        samples are replaced before any curve is measured. With a sinusoid in `within`, "auto"
        always uses the classical estimate, because the robust estimate of a sinusoid differs from its theory. A
        WaveletVariance is fitted as it is.
    weighting, criterion, draws, rng
        As in `select`. The settings record the integer seed; for a Generator, the seed drawn from it.
    confidence : float
        Confidence level of the intervals, and of the set of models that `select` considers equivalent.
    efficiency : float
        Efficiency of the robust wavelet variance under Gaussian noise, relative to the classical one.
    against : "auto", "none", str, (N,) array, or mapping of name to array
        Conditions whose effect is removed before the noise is measured. "auto": the temperature of the recording, for
        each axis that follows it at the 5 % level. Text names the temperature or time with options, for example
        "temperature:2,lag", "time:3" or "warmup"; a mapping has further covariates. See docs/howto/temperature.md.
    gravity : float, optional
        Local gravity (m/s²), for the bias at rest of the accelerometers; by default 9.806 ± 0.016, the range at sea
        level.
    tilt : float, optional
        Largest angle (°) between the vertical and the accelerometer axis next to it. Without it, only the bias of the
        vertical axis is computed.
    axes : str or sequence of str, optional
        The axes to calibrate, or "gyro" or "accel" for all axes of a sensor; all axes by default.
    models : mapping of axis or sensor to Model, Process or str, optional
        Models that are fitted without a choice, such as {"gyro_x": "2*GM + WN", "accel": "WN + RW"}. gmwm chooses the
        models of the other axes.
    threads : int, optional
        Number of axes that are calibrated at the same time; by default the number of processors.
    scheduler, workers : optional
        Processes that read a stream in parallel: the address or client of a Dask scheduler, or a number of local
        processes. The fits run in this process.
    progress : function of (done, all, text), optional
        Called after each step, and repeatedly while a stream is read, from one thread at a time.

    Returns
    -------
    Calibration
        A mapping of axis to the recommended Fit, with rankings, datasheets, remarks and a verdict.

    Raises
    ------
    OptionError
        If an argument is not allowed.
    DataError, ModelError
        If no axis can be calibrated, for example because the recording has fewer than 64 samples without a gap, which
        are fewer than four usable scales.

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
) -> Calibration:
    """Calibrate a recording with validated options, as `calibrate` does."""
    if threads is not None:
        as_whole_number(threads, "threads", 1)
    recordings = named(data)
    several = len(recordings) > 1
    if several:
        require_one(options, scheduler=scheduler, workers=workers)
    chosen = {name: chosen_axes(one, options.wanted) for name, one in recordings.items()}
    axes, missing = common_axes(chosen)
    require_axes(options.models, axes)
    steps = _Progress(len(axes) * len(STAGES), progress)
    parts: dict[str, dict[str, Part]] = {axis: {} for axis in axes}
    inspections: dict[str, Inspection] = {}
    shared: dict[str, tuple[SharedNoise, ...]] = {}
    for name, recording in recordings.items():
        own = {axis: chosen[name][axis] for axis in axes}
        items, inspection, shared[name], conditions = inspected(
            recording, own, options=options, threads=threads, scheduler=scheduler, workers=workers,
            read=partial(_read, steps, name),
        )  # fmt: skip
        for axis, item in items.items():
            parts[axis][name] = Part(item=item, raw=own[axis], conditions=conditions[axis])
        if inspection is not None:
            inspections[name] = inspection

    verdicts: dict[str, dict[str, Verdict]] = {axis: {} for axis in axes}

    def work(axis: str, of: dict[str, Part]) -> AxisCalibration | GmwmError:
        try:
            return _Axis(
                name=axis, parts=of, options=options.of_axis(axis), together=len(parts), steps=steps,
                verdicts=verdicts[axis],
            ).calibrated()  # fmt: skip
        except OptionError:
            raise
        except GmwmError as error:
            return error

    try:
        found = in_threads(work, parts, threads=threads)
    except BaseException:
        steps.stop()
        raise
    done = {axis: one for axis, one in found.items() if isinstance(one, AxisCalibration)}
    failed = {axis: one for axis, one in found.items() if isinstance(one, GmwmError)}
    if not done:
        axis, error = next(iter(failed.items()))
        raise error.at(f"no axis can be calibrated; {axis}") from error
    described = {name: Recording.of(inspection) for name, inspection in inspections.items()}
    one = recordings.get("")
    source = one.source if isinstance(one, Imu | Stream) else ""
    return Calibration(
        axes=with_baselines(with_rest(done, means_of(recordings, inspections), options), parts, recordings, threads),
        failed=missing | {axis: error.reason for axis, error in failed.items()},
        settings=options,
        source=", ".join(recordings) if several else source,
        recording_remarks=tuple(dict.fromkeys(_recording_remarks(inspections, done, verdicts, shared))),
        recording=None if several else described.get(""),
        recordings=described if several else {},
    )


def _recording_remarks(
    inspections: Mapping[str, Inspection],
    axes: Mapping[str, AxisCalibration],
    verdicts: Mapping[str, Mapping[str, Verdict]],
    shared: Mapping[str, Sequence[SharedNoise]],
) -> Iterator[Remark]:
    """Yield the remarks of the inspections. The subject names the recording unless all recordings have the same
    remark."""
    found = {}
    for name, inspection in inspections.items():
        own = [of[name] for of in verdicts.values() if name in of]
        found[name] = list(recording_remarks(inspection, axes, own))
        still = [axis for axis in axes if not (name in verdicts[axis] and verdicts[axis][name].contaminated)]
        found[name] += shared_remarks(shared[name], still, SIZE / len(inspections))
    for name, remarks in found.items():
        for remark in remarks:
            if all(remark in others for others in found.values()):
                yield remark
            else:
                yield remark.about(f"{remark.subject} in {name}" if remark.subject else name)


def _read(steps: _Progress, name: str, text: str) -> None:
    """Report the progress of reading one of several recordings."""
    steps.read(f"{name}: {text}" if name else text)


class _Progress:
    """Progress of several threads. It reports one step at a time, and stops all threads on request."""

    def __init__(self, steps: int, progress: Progress | None) -> None:
        self.steps, self.progress = steps, progress
        self.done = 0
        self.lock = threading.Lock()
        self.stopped = threading.Event()

    def stop(self) -> None:
        """Request that every thread ends before its next step."""
        self.stopped.set()

    def check(self) -> None:
        """End the work of this thread if a stop is requested."""
        if self.stopped.is_set():
            raise KeyboardInterrupt

    def read(self, text: str) -> None:
        """Report progress of reading, before the first step."""
        if self.progress is not None:
            self.progress(self.done, self.steps, text)

    def step(self, axis: str, stage: str) -> None:
        """Report a finished step of an axis."""
        self.check()
        with self.lock:
            self.done += 1
            if self.progress is not None:
                self.progress(self.done, self.steps, f"{axis}: {stage}")


@dataclass(frozen=True, kw_only=True)
class _Axis:
    """The calibration of one axis."""

    name: str
    parts: Mapping[str, Part]
    options: CalibrationOptions
    together: int
    steps: _Progress
    verdicts: dict[str, Verdict]

    def calibrated(self) -> AxisCalibration:
        """Calibrate the axis, and report each stage."""
        options, stages = self.options, iter(STAGES)
        measured = measured_together(self.name, self.parts, options, comparisons=self.together)
        wv, spectrum = measured.wv, measured.spectrum
        self.verdicts.update(measured.verdicts)
        _require_scales(wv)
        self.steps.step(self.name, next(stages))
        found = chosen_model(wv, spectrum, options, check=self.steps.check)
        ranking, wv = found.ranking, found.with_error
        self.steps.step(self.name, next(stages))
        fit = final_fit(ranking.recommended.model, wv, options.weighting)
        self.steps.step(self.name, next(stages))
        level = options.confidence
        sheet = with_band(averaged_datasheet(datasheet(fit, level), ranking, level), found.band, level)
        axis = AxisCalibration(
            fit=fit,
            intervals=averaged_intervals(fit, fit.confidence_intervals(level), sheet),
            test=_test(replace(fit, wavelet_variance=found.wavelet_variance)),
            datasheet=sheet,
            ranking=ranking,
            verdict=worst(measured.verdicts.values()),
            needed=needed(replace(fit, wavelet_variance=replace(wv, recordings={})), options.weighting),
            spectrum=spectrum,
            misfit=relative_misfit(fit),
            model_error=found.error,
            tried=found.tried,
            regression=regression_of(self.name, self.parts),
            left_in=None if measured.raw is None else self._left_in(fit, measured.raw),
        )
        _ = fit.replicates  # computed here, where axes are in parallel
        self.steps.step(self.name, next(stages))
        return axis

    def _left_in(self, fit: Fit, raw: WaveletVariance) -> float | None:
        """Return K (SI) of the model with a random walk if the effect of the conditions is not removed; None if
        unknown."""
        walks = any(is_walk(process, fit.wavelet_variance.rate) for process in fit.model.processes)
        model = fit.model if walks else Model((*fit.model.processes, RW()))
        try:
            left = nearly_fitted(model, raw, self.options.weighting)
            entry = datasheet(left, self.options.confidence).get(WALK)
        except GmwmError:
            return None
        return None if entry is None else entry.value


def _require_scales(wv: WaveletVariance) -> None:
    """Raise an error if a curve has so few usable scales that no model can be chosen."""
    scales = int(np.count_nonzero(usable_levels(wv)))
    if scales < LEAST_SCALES:
        raise DataError(
            f"{counted(wv.samples, 'sample')} are too short for a calibration: "
            f"{counted(scales, 'scale')} can be used, and at least {LEAST_SCALES} are needed",
            argument="data",
            got=wv.samples,
            advice="Record for several hours, or fit one model to the short curve with {gmwm fit}.",
        )


def _test(fit: Fit) -> GoodnessOfFit | None:
    try:
        return fit.goodness_of_fit()
    except (MissingTheoryError, ModelError):
        return None


def needed(fit: Fit, weighting: Literal["diagonal", "optimal"]) -> dict[str, float | None]:
    """Return the recording length (s) for a relative standard error of 20 %, for each parameter whose error exceeds 50
    %.

    The length of the recording is doubled up to ten times. The result is infinite if 1024 times the length does not
    suffice, and None if a term acts as a simpler process, so that the theory cannot predict its standard error.
    """
    shares = zip(fit.sandwich.names, np.sqrt(np.diag(fit.sandwich.relative)).tolist(), strict=True)
    poor = [name for name, share in shares if share > SEEN]
    if not poor or fit.diagnostics.acts_as:
        return dict.fromkeys(poor)
    kept = [(term, p) for term, p in zip(fit.model.terms, fit.model.processes, strict=True) if p.scale > 0]
    model = Model(tuple(process for _, process in kept))
    label = {new: old for new, (old, _) in zip(model.terms, kept, strict=True)}
    found: dict[str, float | None] = dict.fromkeys(poor, math.inf)
    for doubling in range(1, LONGER + 1):
        samples = fit.wavelet_variance.samples << doubling
        names, errors = relative_errors(model, samples, fit.wavelet_variance.rate, weighting)
        for name, error in zip(names, errors.tolist(), strict=True):
            term, _, parameter = name.partition(".")
            own = f"{label[term]}.{parameter}"
            if found.get(own) == math.inf and error <= WANTED:
                found[own] = samples / fit.wavelet_variance.rate
        if math.inf not in found.values():
            break
    return found
