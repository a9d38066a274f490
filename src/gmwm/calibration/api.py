"""Calibrate recordings: choose and fit the noise model of every axis, and compute its numbers and their uncertainty."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from gmwm.applications.several.result import SharedNoise
from gmwm.base.errors import DataError, GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.base.helpers import Helpers
from gmwm.base.remarks import Remark
from gmwm.base.text import counted
from gmwm.base.threads import in_threads
from gmwm.calibration.averaging import WALK, averaged_datasheet, averaged_intervals, is_walk, with_band
from gmwm.calibration.baselines import kept_samples, with_baseline, with_baselines
from gmwm.calibration.choice import chosen_model, final_fit
from gmwm.calibration.data import chosen_axes, common_axes, named, require_axes, require_one
from gmwm.calibration.findings import LEAST_SCALES, SIZE, WANTED
from gmwm.calibration.measurement import Measured
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.calibration.reading import inspected
from gmwm.calibration.recording_findings import recording_remarks, shared_remarks
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.rest import Means, means_of, with_rest
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.several import Part, Together, measured_together, regression_of, worst
from gmwm.choosing.datasheets import datasheet
from gmwm.files.readers.streams import Stream
from gmwm.fitting.estimation.goodness import GoodnessOfFit, usable_levels
from gmwm.fitting.estimation.model_error import nearly_fitted, relative_misfit
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.inference.planning import SEEN, relative_errors
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.regression.against import AUTO, Against
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_whole_number
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model, ModelLike
from gmwm.theory.processes.validation import as_seed
from gmwm.theory.processes.walk import RW

STAGES = ("measured", "model chosen", "fitted", "judged")
"""Names of the steps of the calibration of one axis, as the progress callback gets them."""
LONGER = 10
"""Number of times that `needed` doubles the recording length at most, which is a factor of 1024
(tests/calibration/test_calibrate.py)."""

if TYPE_CHECKING:
    from distributed import Client

Data = Imu | Signal | Stream | Mapping[str, Measured]
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
    data : Imu, Signal, Stream; a list of these; or mapping of axis to Signal, WaveletVariance or Pair
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
    means = Means.of_axes(axes, means_of(recordings, inspections), options)

    def work(axis: str, of: dict[str, Part]) -> AxisCalibration | GmwmError:
        try:
            own = options.of_axis(axis)
            measured = measured_together(axis, of, own, comparisons=len(parts))
            verdicts[axis].update(measured.verdicts)
            _require_scales(measured.wv)
            one = _Axis(measured=measured, options=own, regression=regression_of(axis, of))
            advance = partial(steps.step, axis)
            advance(STAGES[0])
            samples = kept_samples(axis, of)
            if helpers is None:
                return _completed(one.calibrated(advance, steps.check), samples, means[axis], own.confidence)
            found = helpers.run(_calibrated, one, samples, means[axis])
            for stage in STAGES[1:]:
                advance(stage)
            return found
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
        axes=with_baselines(done, parts, recordings, threads),
        failed=missing | {axis: error.reason for axis, error in failed.items()},
        settings=options,
        source=", ".join(recordings) if several else source,
        recording_remarks=tuple(dict.fromkeys(_recording_remarks(inspections, done, verdicts, shared))),
        recording=None if several else described.get(""),
        recordings=described if several else {},
    )


def _calibrated(axis: _Axis, samples: Sequence[Signal], means: Means) -> AxisCalibration:
    """Calibrate an axis, and compute its baseline from these samples and its bias from these means."""
    return _completed(axis.calibrated(), samples, means, axis.options.confidence)


def _completed(found: AxisCalibration, samples: Sequence[Signal], means: Means, level: float) -> AxisCalibration:
    return with_baseline(with_rest(found, means, level), samples)


def _recording_remarks(
    inspections: Mapping[str, Inspection],
    axes: Mapping[str, AxisCalibration],
    verdicts: Mapping[str, Mapping[str, Verdict]],
    shared: Mapping[str, Sequence[SharedNoise]],
) -> Iterator[Remark]:
    """Yield the remarks on the recordings from their inspections, outlier tests and shared noise.

    If a remark does not apply to all recordings, its subject names the recording.
    """
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
    """Report the progress of reading the recording `name`; "" for a single recording."""
    steps.read(f"{name}: {text}" if name else text)


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


@dataclass(frozen=True, kw_only=True)
class _Axis:
    """The work of calibrating one axis whose curve is measured.

    Attributes
    ----------
    measured : Together
        The curve, the spectrum and the outlier tests of the axis.
    options : CalibrationOptions
        Options of this axis.
    regression : Regression or None
        The effect of the conditions that was removed.
    """

    measured: Together
    options: CalibrationOptions
    regression: Regression | None

    def calibrated(
        self, advance: Callable[[str], None] = lambda _: None, check: Callable[[], None] = lambda: None
    ) -> AxisCalibration:
        """Choose the model, fit it, and judge the fit.

        Parameters
        ----------
        advance : function
            Called with the name of each finished stage.
        check : function
            Called often. It may raise to end the work.
        """
        measured, options = self.measured, self.options
        found = chosen_model(measured.wv, measured.spectrum, options, check=check)
        ranking, wv = found.ranking, found.with_error
        advance(STAGES[1])
        fit = final_fit(ranking.recommended.model, wv, options.weighting)
        advance(STAGES[2])
        level = options.confidence
        sheet = with_band(averaged_datasheet(datasheet(fit, level), ranking, level), found.band, level)
        axis = AxisCalibration(
            fit=fit,
            intervals=averaged_intervals(fit, fit.confidence_intervals(level), sheet),
            test=_test(replace(fit, wavelet_variance=found.wavelet_variance)),
            datasheet=sheet,
            ranking=ranking,
            verdict=worst(measured.verdicts.values()),
            needed=needed(_as_one_recording(fit), options.weighting),
            spectrum=measured.spectrum,
            misfit=relative_misfit(fit),
            model_error=found.error,
            tried=found.tried,
            regression=self.regression,
            left_in=None if measured.raw is None else self._left_in(fit, measured.raw),
        )
        # The cached values behind these are computed here, where axes are processed in parallel.
        _ = fit.replicates, ranking.remarks
        advance(STAGES[3])
        return axis

    def _left_in(self, fit: Fit, raw: WaveletVariance) -> float | None:
        """Return K (SI) that the axis would have if the effect of the conditions were not removed; None if unknown.

        The model is fitted to the curve `raw`, from which the effect is not removed. If it has no random walk, one is
        added.
        """
        walks = any(is_walk(process, fit.wavelet_variance.rate) for process in fit.model.processes)
        model = fit.model if walks else Model((*fit.model.processes, RW()))
        try:
            left = nearly_fitted(model, raw, self.options.weighting)
            entry = datasheet(left, self.options.confidence).get(WALK)
        except GmwmError:
            return None
        return None if entry is None else entry.value


def _require_scales(wv: WaveletVariance) -> None:
    """Raise a DataError if a wavelet variance has too few usable scales to choose a model."""
    scales = int(np.count_nonzero(usable_levels(wv)))
    if scales < LEAST_SCALES:
        raise DataError(
            f"{counted(wv.samples, 'sample')} are too short for a calibration: "
            f"{counted(scales, 'scale')} can be used, and at least {LEAST_SCALES} are needed",
            argument="data",
            got=wv.samples,
            advice="Record for several hours, or fit one model to the short curve with {gmwm fit}.",
        )


def _as_one_recording(fit: Fit) -> Fit:
    """Return a fit whose standard errors do not include the spread between recordings."""
    wv = fit.wavelet_variance
    return replace(fit, wavelet_variance=replace(wv, recordings={})) if wv.recordings else fit


def _test(fit: Fit) -> GoodnessOfFit | None:
    try:
        return fit.goodness_of_fit()
    except (MissingTheoryError, ModelError):
        return None


def needed(fit: Fit, weighting: Literal["diagonal", "optimal"]) -> dict[str, float | None]:
    """Return the recording length (s) that each poorly known parameter needs for a relative standard error of 20 %.

    These are the parameters whose relative standard error exceeds 50 %. The length of the recording is doubled up to
    ten times. The result is infinite if even 1024 times the length is not enough. It is None if the data cannot
    distinguish a term from a simpler process, because theory then cannot predict the standard error.
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
