"""Fit and judge each measured axis, and put the axes of one or several recordings together to a calibration."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm.base.arrays import as_whole_number
from gmwm.base.errors import DataError, GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.base.helpers import Helpers
from gmwm.base.remarks import Remark
from gmwm.base.reporting import Progress
from gmwm.base.text import counted
from gmwm.base.threads import in_threads, return_memory
from gmwm.base.units import by_sensor, sensor_of
from gmwm.calibration.additions import axis_additions, recording_additions
from gmwm.calibration.averaging import WALK, averaged_datasheet, averaged_intervals, is_walk, with_band
from gmwm.calibration.data import AxisInput, Recordings
from gmwm.calibration.findings import LEAST_SCALES, PLANNED_ERROR, TEST_SIZE, prepare_remarks
from gmwm.calibration.measure import MeasuredAxis, measure
from gmwm.calibration.number_verdicts import with_verdict_limits
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.passes import Execution
from gmwm.calibration.recording_findings import recording_remarks
from gmwm.calibration.recording_info import Recording, of_recording
from gmwm.calibration.rest import bias_at_rest
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.choosing.datasheets import Datasheet, datasheet, model_datasheet, with_limits
from gmwm.choosing.selection.search import ModelChoice, given_curve, given_model, search, within_family
from gmwm.choosing.selection.shared_form import with_shared_form
from gmwm.fitting.estimation.goodness import GoodnessOfFit, usable_levels
from gmwm.fitting.estimation.model_error import nearly_fitted, relative_misfit
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import settle
from gmwm.fitting.inference.planning import CERTAIN_ERROR, relative_errors
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Streamed
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import RW

if TYPE_CHECKING:
    from distributed import Client

STAGES = ("measured", "model chosen", "fitted")
"""Names of the steps of the calibration of one axis, as the progress callback gets them."""


def calibrate_axis(measured: MeasuredAxis, choice: ModelChoice, options: CalibrationOptions) -> AxisCalibration:
    """Fit the chosen model of an axis, and compute its numbers and their uncertainty."""
    options = options.of_axis(measured.axis)
    curve, level, ranking = measured.curve(options), options.confidence, choice.ranking
    best, wv = ranking.recommended.fit, choice.wavelet_variance
    fit = final_fit(best.model, choice.with_error, options.weighting)
    sheet = sheet_of(fit, measured.spectrum, level, choice)
    raw = measured.raw_curve(options)
    means = list(measured.means.values())
    axis = AxisCalibration(
        fit=fit, intervals=averaged_intervals(fit, fit.confidence_intervals(level), sheet),
        # The choice has tested the best model, unless it allows for a model error.
        test=_test(best if best.wavelet_variance is wv else replace(fit, wavelet_variance=wv)),
        datasheet=with_limits(sheet, fit), ranking=ranking, verdict=measured.verdict(robust=curve.robust),
        needed=needed_lengths(_as_one_recording(fit), options.weighting), spectrum=measured.spectrum,
        misfit=relative_misfit(fit), model_error=choice.error, tried=choice.tried, search=choice.steps,
        regression=measured.regression, left_in=None if raw is None else _left_in(fit, raw, options),
        rest=bias_at_rest(fit, ranking, means, level=level) if means else None,
    )  # fmt: skip
    # The cached values behind these are computed here, where axes are processed in parallel.
    _ = fit.replicates, ranking.remarks
    prepare_remarks(measured.axis, axis)
    return axis


def sheet_of(fit: Fit, spectrum: PowerSpectrum | None, level: float, choice: ModelChoice | None) -> Datasheet:
    """Return the numbers of a fit, whose intervals include the uncertainty of the choice of its model, if any."""
    sheet, lines = model_datasheet(fit, level), () if spectrum is None else spectrum.lines
    if choice is None:
        return with_band(sheet, {}, lines, level)
    return with_band(averaged_datasheet(sheet, choice.ranking, level), choice.band, lines, level)


def additions_to(fit: Fit, beginnings: Sequence[Signal]) -> dict[str, Any]:
    """Return what applications compute from the fit of an axis and the first samples of its recordings."""
    values = {item.name: item.of_axis(fit, beginnings) for item in axis_additions()}
    return {name: value for name, value in values.items() if value is not None}


def choose_model(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: CalibrationOptions, *,
    check: Callable[[], None] = lambda: None,
) -> ModelChoice:  # fmt: skip
    """Search the model of an axis, compare those within a largest one, or use the user's; `check` may raise to stop."""
    require_scales(wv)
    if options.models:
        return given_model(options.general, wv, options.ranking)
    if options.searched:
        # The covariance of a robust estimate of a sinusoid is unknown.
        return search(wv, None if wv.robust else spectrum, options.ranking, check=check)
    return within_family(options.general, wv, options.ranking, check=check)


def final_fit(model: Model, wv: WaveletVariance, weighting: str) -> Fit:
    """Fit a model until its weights converge, certified; remarks replace warnings, whose filters threads share."""
    return Fit.of(settle(model, wv, weighting, certify=True), wv, weighting)


def given_fit(model: Model, wv: WaveletVariance, options: CalibrationOptions) -> Fit:
    """Fit a given model in the same way as `calibrate` does for its argument `models`, without a ranking."""
    return final_fit(model, given_curve(model, wv, options.weighting), options.weighting)


def _left_in(fit: Fit, raw: WaveletVariance, options: CalibrationOptions) -> float | None:
    """Return K (SI) of the curve with the effect of conditions, from a model with a walk; None if unknown."""
    walks = any(is_walk(process, fit.wavelet_variance.rate) for process in fit.model.processes)
    model = fit.model if walks else Model((*fit.model.processes, RW()))
    try:
        raw_fit = nearly_fitted(model, raw, options.weighting)
        entry = datasheet(raw_fit, options.confidence).get(WALK)
    except GmwmError:
        return None
    return None if entry is None else entry.value


def require_scales(wv: WaveletVariance) -> None:
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


def needed_lengths(fit: Fit, weighting: Literal["diagonal", "optimal"]) -> dict[str, float | None]:
    """Return lengths (s) that give parameters with relative errors above 50 % one of 20 %: doubled up to ten times,
    then infinite; None if a term acts as a simpler process, as theory cannot predict its error."""
    shares = np.sqrt(np.diag(fit.sandwich.relative)).tolist()
    poor = [name for name, share in zip(fit.sandwich.names, shares, strict=True) if share > CERTAIN_ERROR]
    if not poor or fit.diagnostics.acts_as:
        return dict.fromkeys(poor)
    terms = [(term, p) for term, p in fit.model.by_term.items() if p.scale > 0]
    model = Model(tuple(process for _, process in terms))
    label = {new: old for new, (old, _) in zip(model.terms, terms, strict=True)}
    samples, rate = fit.wavelet_variance.samples, fit.wavelet_variance.rate

    @cache
    def errors_after(doublings: int) -> dict[str, float]:
        names, errors = relative_errors(model, samples << doublings, rate, weighting)
        parts = [name.partition(".") for name in names]
        return {f"{label[term]}.{name}": error for (term, _, name), error in zip(parts, errors.tolist(), strict=True)}

    def needed(name: str, error: float) -> float:
        low, high, at = 1, 11, 0  # at most 1024 times the length (tests/calibration/test_calibrate.py)
        while low < high:
            # Half as long a recording has a relative error that is larger by a factor near √2.
            ahead = math.ceil(2 * math.log2(error / PLANNED_ERROR)) if 0 < error < math.inf else high
            at = min(max(at + ahead, low), high - 1)
            error = errors_after(at).get(name, math.inf)
            low, high = (low, at) if error <= PLANNED_ERROR else (at + 1, high)
        return math.inf if low > 10 else (samples << low) / rate

    return {name: needed(name, share) for name, share in zip(fit.sandwich.names, shares, strict=True) if name in poor}


Data = Imu | Signal | Streamed | Mapping[str, AxisInput]  # data of one recording
Several = Sequence[Imu] | Sequence[Signal] | Sequence[Streamed] | Mapping[str, Imu | Streamed]
"""Data of several recordings of one unit."""


Work = MeasuredAxis | ModelChoice | AxisCalibration  # what is known of an axis before the next step of its calibration


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

    def work(axis: str, item: Work) -> Work | GmwmError:
        try:
            if isinstance(item, MeasuredAxis):
                return choose(axis, item)
            run = (helpers or Helpers()).run
            if isinstance(item, AxisCalibration):
                return replace(item, additions=run(additions_to, item.fit, beginnings.pop(axis)))
            result = run(calibrate_axis, replace(items[axis], beginnings={}), item, options)
        except OptionError:
            raise
        except GmwmError as error:
            return error
        steps.step(axis, STAGES[2])
        return result

    beginnings = {axis: list(item.beginnings.values()) for axis, item in items.items() if item.beginnings}
    choices: dict[str, ModelChoice] = {}
    searched = by_sensor(items)  # axes whose search has not ended

    def further(axis: str, result: Work | GmwmError) -> dict[str, Work]:
        """Return the choices of a sensor after its last search, as its axes are fitted while others are searched, and
        each fitted axis: short work at the end occupies all processes."""
        if isinstance(result, AxisCalibration):
            return {axis: result} if axis in beginnings else {}
        of_sensor = searched[sensor_of(axis)]
        if of_sensor.pop(axis, None) is None:
            return {}
        if isinstance(result, ModelChoice):
            choices[axis] = result
        alike = {name: choices[name] for name in items if name in choices and sensor_of(name) == sensor_of(axis)}
        return {} if of_sensor else {**with_shared_form(alike)}

    return_memory()  # of the stage before, which needed other sizes of arrays
    try:
        results = in_threads(work, dict[str, Work](items), threads=threads, more=further)
    except BaseException:
        steps.stop()
        raise
    return_memory()
    axes = {axis: result for axis, result in results.items() if isinstance(result, AxisCalibration)}
    failed |= {axis: result for axis, result in results.items() if isinstance(result, GmwmError)}
    failed = {axis: failed[axis] for axis in measured if axis in failed}
    if not axes:
        axis, error = next(iter(failed.items()))
        raise error.at(f"no axis can be calibrated; {axis}") from error
    verdicts = {axis: item.verdicts for axis, item in items.items()}
    descriptions = {name: Recording.of(of_parts[0]) for name, of_parts in inspections.items() if of_parts}
    curves = {axis for of_axes in recordings.curves.values() for axis in of_axes}  # only samples can be inspected
    calibration = Calibration(
        axes=axes,
        failed=dict(recordings.missing) | {axis: error.reason for axis, error in failed.items()},
        settings=options,
        source=recordings.source,
        recording_remarks=tuple(
            dict.fromkeys(
                (
                    *_recording_remarks(inspections, axes, verdicts, findings),
                    *(Remark.of("not-inspected", axis) for axis in axes if axis in curves),
                )
            )
        ),
        recording=descriptions.get(""),
        recordings={name: item for name, item in descriptions.items() if name},
    )
    return with_verdict_limits(calibration)


def _recording_remarks(
    inspections: Mapping[str, Sequence[Inspection]], axes: Mapping[str, AxisCalibration],
    verdicts: Mapping[str, Mapping[str, Verdict]], findings: Mapping[str, Sequence[Sequence[object]]],
) -> Iterator[Remark]:  # fmt: skip
    """Yield remarks from inspections, outlier tests and additions; those not on all recordings name theirs."""
    by_recording: dict[str, list[Remark]] = {}
    for name, of_parts in inspections.items():
        remarks = by_recording[name] = []
        still = [axis for axis in axes if not (name in verdicts[axis] and verdicts[axis][name].contaminated)]
        parts = [tuple(recording_remarks(inspection, axes)) for inspection in of_parts]
        for inspection, part, of_part in zip(of_parts, parts, findings[name], strict=True):
            for remark in part:
                # Another part, for example with a warm-up, has another share of lost samples.
                other = not remark.subject and any(
                    remark.code in {r.code for r in others} and remark not in others for others in parts
                )
                remarks += [remark.about(axis) for axis in inspection.axes] if other else [remark]
            for addition, finding in zip(recording_additions(), of_part, strict=False):
                if finding is not None:
                    remarks += addition.remarks(finding, still, TEST_SIZE / len(inspections))
    for name, remarks in by_recording.items():
        for remark in remarks:
            if all(remark in others for others in by_recording.values()):
                yield remark
            else:
                yield remark.about(of_recording(remark.subject, name))


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
