"""Search for the noise model of one axis: first among slow processes, then with terms that the spectrum shows.

1. All models within `SLOW` are ranked, and accepted if the goodness-of-fit test does, unless a GM term is so fast that
it may be a filter. 2. Lines become sinusoids, wide peaks oscillators (`peaks`). 3. If all are rejected, an ARMA process
with known coefficients describes the sensor's filter (`fast_part`), of higher order, with the wide peaks, if the
largest model misses the curve by over `STATED_MISFIT`. All terms stay linear in their scales, so optima are proved.
Without a spectrum, it is an AR(2) of the wavelet variance. 4. Last, an unresolved slow oscillation is sought there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix
from gmwm.base.errors import GmwmError, ModelError
from gmwm.base.lazy import scipy
from gmwm.choosing.selection import fast_part
from gmwm.choosing.selection.api import begin_ranking, rank_models, with_equivalent
from gmwm.choosing.selection.ranking import SEARCH_PVALUE, SLOW, Entry, Exit, Ranking, RankingOptions, SearchStep
from gmwm.choosing.selection.structure import freedom, largest_within, without_values
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.estimation.model_error import Distance, having_error, model_error, nearly_fitted
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import drawn_covariance, settle
from gmwm.fitting.estimation.solver import solve_near
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.covariance import Design
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.spectrum.short_memory import HIGHEST_ORDER, SpectralShape
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import Lagged
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model, ModelLike, as_model
from gmwm.theory.processes.noise import QN, RW, WN
from gmwm.theory.processes.oscillator import OSC
from gmwm.theory.processes.parameter import Fixed

SMALL_RESIDUAL = 0.1
"""Share of the residual of smooth processes up to which the residual with the best oscillator of a grid is small enough
for a fit. Accurate curves need it, because the grid is coarse (tests/selection/test_search.py)."""
STATED_MISFIT = 0.0075
"""Relative model error up to which a shape of low order is used, 0.4 % of N (tests/selection/test_search.py)."""
LOW_ORDER = 2
"""Largest first orders p and q of a shape: a low-pass filter of two poles, or an average of three samples."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelChoice:
    """The models fitted to one axis, and the choice. `ranking` was compared last, except for the equivalent models at
    the places `others`; `wavelet_variance` includes the uncertainty of the `shape` at high frequencies but not the
    relative `error` of the model."""

    ranking: Ranking
    wavelet_variance: WaveletVariance
    error: float
    tried: tuple[str, ...]
    steps: tuple[SearchStep, ...]
    shape: SpectralShape | None = None
    others: Iterable[int] = ()

    @property
    def band(self) -> Mapping[str, float]:
        """Relative errors of f_b, f_r and Q_r of the shape, which take longer than a fit."""
        return {} if self.shape is None else fast_part.band_errors(self.shape, self.wavelet_variance.rate)

    @property
    def completed(self) -> ModelChoice:
        """The choice with all equivalent models. The search needs only the recommended ones until it ends."""
        return replace(self, ranking=with_equivalent(self.ranking, self.others), others=())

    @property
    def with_error(self) -> WaveletVariance:
        """The wavelet variance with the model error included in its covariance."""
        return having_error(self.wavelet_variance, self.error)

    def after(self, *steps: SearchStep) -> ModelChoice:
        """Return the choice with these steps before its own."""
        return replace(self, steps=(*steps, *self.steps))


def search(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: RankingOptions, *,
    check: Callable[[], None] = lambda: None,
) -> ModelChoice:  # fmt: skip
    """Search for the noise model of one axis, as the module describes; `check` may raise to stop it."""
    choice = _from_spectrum(wv, spectrum, options, check)
    if _is_accepted(choice.ranking) and choice.error <= STATED_MISFIT:
        return choice.completed
    check()
    return (_with_oscillation(choice, spectrum, options, check) or choice).completed


def _with_oscillation(
    choice: ModelChoice, spectrum: PowerSpectrum | None, options: RankingOptions, check: Callable[[], None]
) -> ModelChoice | None:
    """Return the choice with a damped oscillator fitted beside other terms; None if the test rejects it, or it is
    small."""
    wv, terms = choice.wavelet_variance, choice.ranking.recommended.fit.model.processes
    required = [
        term for term in without_values(Model(terms)).processes if term.nonlinear_parameters() and term.shape_is_fixed
    ]
    # A shape that was fitted to the wavelet variance does not include white and quantization noise.
    shaped = spectrum is not None and any(isinstance(term, Lagged) for term in required)
    slow = Model((*as_model("2*GM + FN + RW" if shaped else "2*GM + WN + QN + FN + RW").processes, *required))
    # The spectrum shows faster oscillations, or they belong to the shape at high frequencies.
    fastest = wv.rate / (2 * math.pi * fast_part.FAST)
    enough = freedom(slow) + len(OSC().parameters) <= len(wv)
    start = _oscillator_of_grid(wv, choice.ranking.recommended.fit, required, fastest) if enough else None
    if start is None:
        return None
    try:
        # A search elsewhere with the last weights may find a line that other weights contradict.
        settled = settle(
            Model((*slow.processes, start)), wv, options.weighting, certify=False, fixed=STATED_MISFIT,
            first=solve_near, search=False,
        )  # fmt: skip
    except GmwmError:
        return None
    fit = Fit.of(settled, wv, options.weighting)
    oscillator = next(p for p in fit.model.processes if p.name == OSC.name and not p.shape_is_fixed)
    bound = Distance.of(fit).surely
    if oscillator.scale == 0 or bound < SEARCH_PVALUE or oscillator.value("frequency") > fastest:
        return None
    # An oscillation that is a smaller part of every level may as well be an error of the model of a few per cent.
    least_part = 0.1
    if np.max(oscillator.wavelet_variance(wv.levels, wv.rate, wv.filter) / fit.implied) < least_part:
        return None
    held = OSC(frequency=Fixed(oscillator.value("frequency")), quality=Fixed(oscillator.value("quality")))
    curve = fast_part.with_oscillator_error(wv, fit, [held])
    family = fast_part.BESIDE if shaped else SLOW
    other = _within_family(family, curve, options, required=(*required, held), check=check, entered="oscillation")
    pvalue, before = other.ranking.recommended.pvalue, choice.ranking.recommended.pvalue
    if not _is_accepted(other.ranking) and (before is None or pvalue is None or pvalue < before):
        return None
    return other.after(
        *(replace(step, left="rejected" if step.left == "last" else step.left, used=False) for step in choice.steps)
    )


def _oscillator_of_grid(wv: WaveletVariance, fit: Fit, required: Sequence[Process], fastest: float) -> OSC | None:
    """Return the oscillator of a grid (up to `fastest`, Hz) that best explains the variance beside smooth and required
    processes, with the weights of `fit`; None if none is near enough."""
    used = usable_levels(wv)
    design = Design.of(wv).only(used)
    try:
        root = square_root(precision(drawn_covariance(fit.model, design, wv.variance[used])))
    except GmwmError:
        return None
    (branch,) = GM.search(wv.samples, wv.rate)
    smooth = [(type(process), process.nonlinear[None]) for process in (WN(), QN(), RW(), *required)]
    smooth.append((GM, branch.values(np.linspace(branch.low, branch.high, 96))))
    octaves = np.arange(math.log2(wv.rate / wv.samples), math.log2(fastest) + 0.125, 0.125)
    peaks = np.array([(f, q) for f in np.exp2(octaves) for q in (0.7, 1.0, 1.6, 3.0, 7.0, 20.0, 80.0)])
    rows, oscillators = (
        np.concatenate([kind.shape(values, design.levels, wv.rate, design.filter) for kind, values in kinds]) @ root.T
        for kinds in (smooth, [(OSC, peaks)])
    )
    target = root @ wv.variance[used]
    table = np.ascontiguousarray(np.concatenate([_unit(rows), np.zeros((1, target.size))]))
    weights, least = _core.nonnegative_least_squares(target, table[:-1])
    distances, oscillators = np.full(len(peaks), least), _unit(oscillators)
    # The others get no weight (Karush-Kuhn-Tucker).
    for k in np.flatnonzero(oscillators @ (target - weights @ table[:-1]) > 0).tolist():
        table[-1] = oscillators[k]
        distances[k] = _core.nonnegative_least_squares(target, table)[1]
    nearest = int(np.argmin(distances))
    if distances[nearest] > max(scipy.special.chdtri(target.size, SEARCH_PVALUE), SMALL_RESIDUAL * least):
        return None
    frequency, quality = peaks[nearest].tolist()
    return OSC(frequency=frequency, quality=quality)


def _unit(rows: Matrix) -> Matrix:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)


def _from_spectrum(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: RankingOptions, check: Callable[[], None]
) -> ModelChoice:
    """Return the choice of steps 1 to 3 of the module."""
    general, bound = _slow_fit(wv, spectrum, options)
    slow = SearchStep(family=general.model.structure, entered="slow", bound=bound, left="all-rejected")
    if bound >= SEARCH_PVALUE:
        ranking, others = begin_ranking(SLOW, wv, options, progress=lambda *_: check())
        slow = _with_result(replace(slow, left="rejected"), ranking)
        if _is_accepted(ranking):
            slow = replace(slow, left="accepted", used=True)
            choice = _as_sampled(
                ModelChoice(
                    ranking=ranking, wavelet_variance=wv, error=0.0, tried=(SLOW,), steps=(slow,), others=others
                )
            )
            return _with_filter(choice, _SlowWithPeaks((), wv, general), spectrum, options, check=check)
    check()
    if spectrum is None:
        # A shape that was fitted to the wavelet variance does not include white and quantization noise.
        part = fast_part.autoregression(wv, options)
        entered: Entry = "shape" if part.terms else "nothing-shown"
        choice = _within_family(SLOW, wv, options, required=part.terms, check=check, entered=entered)
        return (_after_slow(choice) if part.terms else choice).after(slow)
    steps, peaks = [slow], _SlowWithPeaks((), wv, general)
    for bumps, order in (
        (fast_part.oscillating(spectrum.bumps), LOW_ORDER),
        (fast_part.narrow_bumps(spectrum), HIGHEST_ORDER),
    ):
        terms = fast_part.peak_terms(spectrum, wv, bumps)
        if terms != peaks.terms:
            peaks = _SlowWithPeaks.of(terms, general, wv, options)
            bound = Distance.of(peaks.fit).surely
            if terms and bound >= SEARCH_PVALUE:
                choice = _within_family(SLOW, peaks.curve, options, required=terms, check=check, entered="lines")
                return _after_slow(choice).after(*steps)
            if terms:
                family = peaks.fit.model.structure
                steps.append(SearchStep(family=family, entered="lines", bound=bound, left="all-rejected"))
            check()
        shaped = _with_shape(peaks, spectrum, options, order=order, check=check)
        if not isinstance(shaped, ModelChoice):
            steps += shaped
        elif order == HIGHEST_ORDER or _is_accepted(shaped.ranking):
            return shaped.after(*steps)
        else:
            steps += _left(shaped)
    choice = _within_family(SLOW, peaks.curve, options, required=peaks.terms, check=check, entered="nothing-shown")
    return choice.after(*steps)


def _after_slow(choice: ModelChoice) -> ModelChoice:
    return replace(choice, tried=(SLOW, *choice.tried))


def _left(choice: ModelChoice) -> tuple[SearchStep, ...]:
    """Return the steps of a choice that another family follows: one that the test accepts is left for a filter."""
    *before, last = choice.steps
    left: Exit = "filter-possible" if _is_accepted(choice.ranking) else "rejected"
    return *before, replace(last, left=left, used=False)


class _SlowWithPeaks(NamedTuple):
    """Terms of the peaks of a spectrum, the data with their uncertainty, and the fit of slow processes with them."""

    terms: tuple[Process, ...]
    curve: WaveletVariance
    fit: Fit

    @classmethod
    def of(cls, terms: tuple[Process, ...], slow: Fit, wv: WaveletVariance, options: RankingOptions) -> _SlowWithPeaks:
        """Fit the slow processes with these terms; `slow` is the fit without them."""
        if not terms:
            return cls((), wv, slow)
        largest = largest_within(SLOW, wv, terms)
        fit = nearly_fitted(largest, wv, options.weighting)
        curve = fast_part.with_oscillator_error(wv, fit, terms)
        return cls(terms, curve, fit if curve is wv else nearly_fitted(largest, curve, options.weighting))


def _with_shape(
    peaks: _SlowWithPeaks, spectrum: PowerSpectrum, options: RankingOptions, *, order: int, check: Callable[[], None],
    entered: Entry = "shape",
) -> ModelChoice | tuple[SearchStep, ...]:  # fmt: skip
    """Return the choice with the peaks and the shape of fewest coefficients, up to `order`, that is accepted or misses
    the curve by at most `STATED_MISFIT`; else the steps that say why not, or none if the spectrum shows nothing."""

    def ranked(part: fast_part.FastPart, judged: _JudgedFamily) -> ModelChoice:
        choice = _within_family(
            fast_part.BESIDE, part.wavelet_variance, options, required=part.terms, check=check, entered=entered,
            judged=judged,
        )  # fmt: skip
        return replace(_after_slow(choice), shape=part.shape)

    # p-value of the largest model for larger shapes first, to save rankings; least error of a rejected model, which is
    # only measured until a shape is good enough.
    close, least_error = 0.05, 0.001
    simplest, last, shaped = None, None, None
    for part in fast_part.fast_parts(peaks.fit, peaks.curve, spectrum, peaks.terms, order=order, check=check):
        wv = part.wavelet_variance
        fit = nearly_fitted(largest_within(fast_part.BESIDE, wv, part.terms), wv, options.weighting)
        # Terms of the largest model may follow a wrong shape, so each of its parameters counts.
        pvalue = Distance.of(fit).pvalue
        misses = pvalue < SEARCH_PVALUE and simplest is None
        error = model_error(fit) if misses else least_error if pvalue < close else 0.0
        last, shaped = (part, _JudgedFamily(fit, pvalue, error)), None
        if not error:
            shaped = ranked(*last)
            recommended = shaped.ranking.recommended.fit
            if _is_accepted(shaped.ranking) and (part.is_largest or not _has_filter(recommended)):
                return shaped
            last = part, last[1]._replace(error=max(model_error(recommended), least_error))
        if simplest is None and last[1].error <= STATED_MISFIT:
            simplest = last
    while simplest is not None:
        part, judged = simplest
        shaped = ranked(part, judged)
        recommended = shaped.ranking.recommended.fit
        error = model_error(recommended)
        incomplete = order == LOW_ORDER and _has_filter(recommended)
        if not incomplete and (_is_accepted(shaped.ranking) or error <= judged.error):
            return shaped
        simplest = None if incomplete or error > STATED_MISFIT else (part, judged._replace(error=error))
        last = part, judged._replace(error=error)
    if last is None:
        return ()
    if order == HIGHEST_ORDER:
        return ranked(*last)
    if shaped is not None:
        return _left(shaped)
    family, bound, error = last[1].fit.model.structure, last[1].bound, last[1].error
    return (SearchStep(family=family, entered=entered, bound=bound, model_error=error, left="all-rejected"),)


def _slow_fit(wv: WaveletVariance, spectrum: PowerSpectrum | None, options: RankingOptions) -> tuple[Fit, float]:
    """Return the fit of slow processes, and its p-value's bound. A dominant line (dither) leaves levels without noise;
    it is then fitted too, with bound 0."""
    try:
        general = nearly_fitted(largest_within(SLOW, wv), wv, options.weighting)
        return general, Distance.of(general).surely
    except ModelError:
        lines = () if spectrum is None else fast_part.peak_terms(spectrum, wv, fast_part.narrow_bumps(spectrum))
        if not lines:
            raise
        return nearly_fitted(largest_within(SLOW, wv, lines), wv, options.weighting), 0.0


def _with_filter(
    choice: ModelChoice, peaks: _SlowWithPeaks, spectrum: PowerSpectrum | None, options: RankingOptions, *,
    check: Callable[[], None],
) -> ModelChoice:  # fmt: skip
    """Return the choice with the shape of a filter if a term may describe one, and the test accepts the shape."""
    if spectrum is None or not _has_filter(choice.ranking.recommended.fit):
        return choice
    (slow,) = choice.steps
    steps: list[SearchStep] = []
    for order in (LOW_ORDER, HIGHEST_ORDER):
        shaped = _with_shape(peaks, spectrum, options, order=order, check=check, entered="filter")
        if not isinstance(shaped, ModelChoice):
            steps += shaped
        elif _is_accepted(shaped.ranking):
            return shaped.after(replace(slow, left="filter-possible", used=False), *steps)
        else:
            steps += _left(shaped)
    return replace(choice, steps=(replace(slow, left="filter-possible" if steps else slow.left), *steps))


def _with_result(step: SearchStep, ranking: Ranking) -> SearchStep:
    """Return a step with the recommended model of its family."""
    return replace(step, recommended=ranking.label(ranking.recommended), pvalue=ranking.recommended.pvalue)


def _as_sampled(choice: ModelChoice) -> ModelChoice:
    """Add the uncertainty of flicker noise near half the sampling rate to the covariance of the data of every fit."""
    wv = fast_part.with_sampling_error(choice.wavelet_variance, choice.ranking.recommended.fit)
    if wv is choice.wavelet_variance:
        return choice
    curve = having_error(wv, choice.error)
    candidates = (
        replace(candidate, fit=replace(candidate.fit, wavelet_variance=curve))
        for candidate in choice.ranking.candidates
    )
    return replace(choice, ranking=replace(choice.ranking, candidates=tuple(candidates)), wavelet_variance=wv)


def _is_accepted(ranking: Ranking) -> bool:
    pvalue = ranking.recommended.pvalue
    return pvalue is None or pvalue >= SEARCH_PVALUE


def _has_filter(fit: Fit) -> bool:
    """Return whether a term is so fast that it may describe the low-pass filter of the sensor."""
    return any(
        process.scale > 0 and not process.shape_is_fixed and fast_part.acts_as_filter(process, fit)
        for process in fit.model.processes
    )


class _JudgedFamily(NamedTuple):
    """The fit of the largest model of a family, the upper bound of the p-value of its models, and its model error."""

    fit: Fit
    bound: float
    error: float

    @classmethod
    def of(cls, largest: Model, wv: WaveletVariance, weighting: str) -> _JudgedFamily:
        """Fit and test the largest model; the error is 0 if the test may accept one of its models."""
        fit = nearly_fitted(largest, wv, weighting)
        bound = Distance.of(fit).surely
        return cls(fit, bound, model_error(fit) if bound < SEARCH_PVALUE else 0.0)


def within_family(
    family: ModelLike, wv: WaveletVariance, options: RankingOptions, *, required: Sequence[Process] = (),
    check: Callable[[], None] = lambda: None, entered: Entry = "within",
) -> ModelChoice:  # fmt: skip
    """Rank all models within a largest one plus `required` terms, with its model error, without terms of zero power."""
    return _within_family(family, wv, options, required=required, check=check, entered=entered).completed


def _within_family(
    family: ModelLike, wv: WaveletVariance, options: RankingOptions, *, required: Sequence[Process] = (),
    check: Callable[[], None] = lambda: None, entered: Entry = "within", judged: _JudgedFamily | None = None,
) -> ModelChoice:  # fmt: skip
    general, bound, error = judged or _JudgedFamily.of(largest_within(family, wv, required), wv, options.weighting)
    check()
    # If a required term of the largest model has no power, the others need not be ranked with it.
    supported = _supported_terms(required, general)
    if len(supported) < len(required):
        return _within_family(family, wv, options, required=supported, check=check, entered=entered)
    curve = having_error(wv, error)
    ranking, others = begin_ranking(family, curve, options, required=required, progress=lambda *_: check())
    supported = _supported_terms(required, ranking.recommended.fit)
    family_name = general.model.structure
    step = SearchStep(family=family_name, entered=entered, bound=bound, model_error=error, left="terms-absent")
    step = _with_result(step, ranking)
    if len(supported) < len(required):
        choice = _within_family(family, wv, options, required=supported, check=check, entered="without-absent-terms")
        return choice.after(step)
    return _only_choice(ranking, wv, step, tried=(family_name,), others=others)


def given_model(model: Model, wv: WaveletVariance, options: RankingOptions) -> ModelChoice:
    """Return the result for a single given model, with its model error."""
    _, bound, error = _JudgedFamily.of(without_values(model), wv, options.weighting)
    ranking = rank_models([model], having_error(wv, error), options)
    step = SearchStep(family=model.structure, entered="model", bound=bound, model_error=error, left="last")
    return _only_choice(ranking, wv, _with_result(step, ranking), tried=())


def _only_choice(
    ranking: Ranking, wv: WaveletVariance, step: SearchStep, *, tried: tuple[str, ...], others: Iterable[int] = ()
) -> ModelChoice:
    """Return the choice from the last family."""
    reason: Exit = "model-error" if step.model_error else "accepted" if _is_accepted(ranking) else "last"
    step = replace(step, left=reason, used=True)
    return _as_sampled(
        ModelChoice(
            ranking=ranking, wavelet_variance=wv, error=step.model_error, tried=tried, steps=(step,), others=others
        )
    )


def given_curve(model: Model, wv: WaveletVariance, weighting: str) -> WaveletVariance:
    """Return the wavelet variance with the model error of a single model, like `given_model` but without a ranking."""
    error = _JudgedFamily.of(without_values(model), wv, weighting).error
    near = nearly_fitted(model, having_error(wv, error), weighting)
    return having_error(fast_part.with_sampling_error(wv, near), error)


def _supported_terms(required: Sequence[Process], fit: Fit) -> Sequence[Process]:
    """Return the required terms except those whose power is estimated as zero."""
    zero = {(p.name, *p.nonlinear) for p in fit.model.processes if p.shape_is_fixed and p.scale == 0}
    return [p for p in required if (p.name, *p.nonlinear) not in zero]
