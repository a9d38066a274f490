"""Search for the noise model of one axis: first among slow processes, then with terms that the spectrum shows.

1. All models within the family `SLOW` are ranked. If the goodness-of-fit test accepts the recommended model, the search
ends, unless a Gauss-Markov term is so fast that it may describe a filter in the sensor. 2. Otherwise, three kinds of
terms are taken from the spectrum. Spectral lines become sinusoids of known frequency. Lines with a width and other
peaks become damped oscillators of known frequency and quality; if slow processes with them do not fit, wide peaks
belong to the shape. The shape of the noise at high
frequencies, which the filter and the resonances of the sensor cause, becomes an ARMA process with known coefficients.
All are linear in their unknown scales, so the global optimum of every fit can still be proved. Without a spectrum, an
AR(2) process is fitted to the wavelet variance. 3. The model error is estimated from the largest of these models, and
all models within it are ranked again. 4. If the test still rejects all of them, a slow oscillation that the spectrum
does not resolve is looked for in the wavelet variance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import GmwmError, ModelError
from gmwm.choosing.selection.api import rank_models, select_within
from gmwm.choosing.selection.ranking import SLOW, Ranking, RankingOptions
from gmwm.choosing.selection.search_steps import Entry, Exit, SearchStep
from gmwm.choosing.selection.shape_error import (
    acts_as_filter,
    band_errors,
    process_of,
    with_oscillator_error,
    with_sampling_error,
    with_shape_error,
)
from gmwm.choosing.selection.structure import freedom, nested_models, without_drift, without_values
from gmwm.fitting.estimation.goodness import usable_levels
from gmwm.fitting.estimation.model_error import Distance, having_error, model_error, nearly_fitted
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import drawn_covariance
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.covariance import Design
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.resonance import resonance_of
from gmwm.measuring.spectrum.result import PowerSpectrum
from gmwm.measuring.spectrum.short_memory import SpectralShape, short_memory
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import Lagged
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model, ModelLike, as_model
from gmwm.theory.processes.noise import QN, WN
from gmwm.theory.processes.oscillator import CRITICAL, OSC, SHARPEST
from gmwm.theory.processes.parameter import Fixed
from gmwm.theory.processes.sinusoid import SIN
from gmwm.theory.processes.walk import RW

BESIDE = "4*GM + FN + RW + DR"
"""General model that is combined with a shape at high frequencies. The shape includes white and quantization noise."""
REJECTED = 0.002
"""The search continues if the p-value of the goodness-of-fit test is below this level. A true model has such a p-value
in 2 of 1000 recordings."""
FEWEST = 24
"""Smallest number of frequencies to which a shape at high frequencies is fitted. With fewer, no shape is fitted."""
MIXED = 0.5
"""The shape at high frequencies is fitted above the first frequency at which slow noise is at most this share of the
spectral density."""
FAST = 20.0
"""A Gauss-Markov term with a correlation time up to this value (samples) counts as noise at high frequencies. With this
value, the corner frequency of its spectral density is 1/126 of the sampling rate. The shape is fitted to the density
above this frequency."""
FELT = 0.003
"""A spectral line enters the model if it is at least this share of the wavelet variance at some level. For comparison,
the relative standard error at the first levels is 0.2 % for 10^6 samples (tests/selection/test_search.py)."""
MOST_FREE = 1
"""Number of the strongest lines whose power is fitted. The power of other lines is fixed at the value from the
spectrum."""
MOST_OSCILLATORS = 8
"""Largest number of oscillators. More bumps are those of a comb filter, which belong to the shape."""
MEMORY = 2000.0
"""An AR(2) process with a longer correlation time (samples) describes a spectral line, not a shape at high
frequencies."""
SMALL_RESIDUAL = 0.1
"""Share of the residual of smooth processes up to which the residual with the best oscillator of a grid is small enough
for a fit. Accurate curves need it, because the grid is coarse (tests/selection/test_search.py)."""
NARROW = 0.002
"""A spectral peak that is narrower than this, relative to the sampling rate, is treated as a line. The value is half
the width of the narrowest peak that the fitted ARMA processes can have; see `gmwm.spectrum.short_memory.POLE`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModelChoice:
    """The models that were fitted to one axis, and the choice among them. `ranking` has the models that were compared
    last. The covariance of `wavelet_variance` includes the uncertainty of the shape at high frequencies, but not the
    relative model error `error`. `tried` are the general models, and `band` the relative standard errors of f_b, f_r
    and Q_r of a shape from the spectrum."""

    ranking: Ranking
    wavelet_variance: WaveletVariance
    error: float
    tried: tuple[str, ...]
    steps: tuple[SearchStep, ...]
    band: Mapping[str, float] = field(default_factory=dict)

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
    if _is_accepted(choice.ranking) and not choice.error:
        return choice
    check()
    return _with_oscillation(choice, options, check) or choice


def _with_oscillation(choice: ModelChoice, options: RankingOptions, check: Callable[[], None]) -> ModelChoice | None:
    """Return the choice with a damped oscillator that is fitted to the wavelet variance, beside the terms that the
    spectrum shows; None if the test rejects it too."""
    wv, terms = choice.wavelet_variance, choice.ranking.recommended.fit.model.processes
    required = [
        term for term in without_values(Model(terms)).processes if term.nonlinear_parameters() and _is_held(term)
    ]
    shaped = any(isinstance(term, Lagged) for term in required)
    model = Model((*as_model("2*GM + RW" if shaped else "2*GM + WN + QN + RW").processes, OSC(), *required))
    # The spectrum shows faster oscillations, or they belong to the shape at high frequencies.
    fastest = wv.rate / (2 * math.pi * FAST)
    if freedom(model) > len(wv) or not _can_oscillate(wv, choice.ranking.recommended.fit, required, fastest):
        return None
    try:
        fit = nearly_fitted(model, wv, options.weighting)
    except GmwmError:
        return None
    oscillator = next(process for process in fit.model.processes if process.name == OSC.name and not _is_held(process))
    bound = Distance.of(fit).surely
    if oscillator.scale == 0 or bound < REJECTED or oscillator.value("frequency") > fastest:
        return None
    held = OSC(frequency=Fixed(oscillator.value("frequency")), quality=Fixed(oscillator.value("quality")))
    curve = with_oscillator_error(wv, fit, [held])
    family = BESIDE if shaped else SLOW
    return within_family(
        family, curve, options, required=(*required, held), check=check, entered="oscillation"
    ).after(*(replace(step, used=False) for step in choice.steps))  # fmt: skip


def _can_oscillate(wv: WaveletVariance, fit: Fit, required: Sequence[Process], fastest: float) -> bool:
    """Return whether one oscillator of a grid, up to the frequency `fastest` (Hz), may explain the wavelet variance
    beside any sum of smooth and required processes. Weights are those of a fit. A fit of an oscillator to a curve
    without one takes a hundred times longer."""
    from scipy.special import chdtri

    used = usable_levels(wv)
    design = Design.of(wv).only(used)
    try:
        root = square_root(precision(drawn_covariance(fit.model, design, wv.variance[used])))
    except GmwmError:
        return True
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
    least = _core.nonnegative_least_squares(target, table[:-1])[1]
    limit = max(chdtri(target.size, REJECTED), SMALL_RESIDUAL * least)
    for oscillator in _unit(oscillators):
        table[-1] = oscillator
        if _core.nonnegative_least_squares(target, table)[1] <= limit:
            return True
    return False


def _unit(rows: Matrix) -> Matrix:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return rows / np.where(length > 0, length, 1.0)


def _is_held(process: Process) -> bool:
    """Return whether every parameter is fixed that changes the shape of the wavelet variance."""
    return all(process.is_fixed(parameter.name) for parameter in process.nonlinear_parameters())


def _from_spectrum(
    wv: WaveletVariance, spectrum: PowerSpectrum | None, options: RankingOptions, check: Callable[[], None]
) -> ModelChoice:
    """Return the choice of steps 1 to 3 of the module."""
    general, bound = _slow_fit(wv, spectrum, options)
    slow = SearchStep(family=general.model.structure, entered="slow", bound=bound, left="all-rejected")
    if bound >= REJECTED:
        ranking = select_within(SLOW, wv, options, progress=lambda *_: check())
        slow = _with_result(replace(slow, left="rejected"), ranking)
        if _is_accepted(ranking):
            slow = replace(slow, left="accepted", used=True)
            choice = _as_sampled(
                ModelChoice(ranking=ranking, wavelet_variance=wv, error=0.0, tried=(SLOW,), steps=(slow,))
            )
            if spectrum is None or not _has_filter(ranking.recommended.fit):
                return choice
            shown = _required_terms(general, wv, spectrum, (), options=options, check=check)
            return _with_filter(choice, shown.choice(BESIDE, options, check, "filter")) if shown.terms else choice
    check()
    steps, lines, curve, slow_fit = [slow], tuple[Process, ...](), wv, general
    for lines in _sets_of_peaks(spectrum, wv):
        curve, slow_fit = wv, general
        if not lines:
            continue
        largest = _largest(SLOW, wv, lines)
        with_lines = nearly_fitted(largest, wv, options.weighting)
        curve = with_oscillator_error(wv, with_lines, lines)
        if curve is not wv:  # the flanks of oscillators do not belong to the shape at high frequencies
            slow_fit = with_lines = nearly_fitted(largest, curve, options.weighting)
        bound = Distance.of(with_lines).surely
        if bound >= REJECTED:
            choice = within_family(SLOW, curve, options, required=lines, check=check, entered="lines")
            return replace(choice, tried=(SLOW, *choice.tried)).after(*steps)
        steps.append(SearchStep(family=largest.structure, entered="lines", bound=bound, left="all-rejected"))
        check()
    wv = curve
    shown = _required_terms(slow_fit, wv, spectrum, lines, options=options, check=check)
    if not shown.terms:
        return within_family(SLOW, wv, options, check=check, entered="nothing-shown").after(*steps)
    # A shape that was fitted to the wavelet variance does not include white and quantization noise.
    return shown.choice(SLOW if spectrum is None else BESIDE, options, check, "shape").after(*steps)


def _slow_fit(wv: WaveletVariance, spectrum: PowerSpectrum | None, options: RankingOptions) -> tuple[Fit, float]:
    """Return the fit of the family of slow processes, and the upper bound of its p-value. A line that dominates the
    wavelet variance, as of a dither motion, leaves no noise at some levels; it is then fitted too, and the bound is 0.
    """
    try:
        general = nearly_fitted(_largest(SLOW, wv), wv, options.weighting)
    except ModelError:
        lines = () if spectrum is None else _peaks(spectrum, wv, _narrow_bumps(spectrum))
        if not lines:
            raise
        return nearly_fitted(_largest(SLOW, wv, lines), wv, options.weighting), 0.0
    return general, Distance.of(general).surely


def _with_filter(choice: ModelChoice, shaped: ModelChoice) -> ModelChoice:
    """Return the choice with the shape of a filter if the test accepts it, otherwise the choice of slow processes."""
    (slow,) = choice.steps
    slow = replace(slow, left="filter-possible", used=not _is_accepted(shaped.ranking))
    if _is_accepted(shaped.ranking):
        return shaped.after(slow)
    return replace(choice, steps=(slow, *(replace(step, left="rejected", used=False) for step in shaped.steps)))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """Terms that the spectrum shows, the data with the uncertainty of the shape, and the errors of its band."""

    wavelet_variance: WaveletVariance
    terms: tuple[Process, ...]
    band: Mapping[str, float] = field(default_factory=dict)

    def choice(self, beside: str, options: RankingOptions, check: Callable[[], None], entered: Entry) -> ModelChoice:
        """Rank all models within a general one, with these terms added to each."""
        choice = within_family(
            beside, self.wavelet_variance, options, required=self.terms, check=check, entered=entered
        )  # fmt: skip
        return replace(choice, band=self.band, tried=(SLOW, *choice.tried))


def _with_result(step: SearchStep, ranking: Ranking) -> SearchStep:
    """Return a step with the recommended model of its family."""
    return replace(step, recommended=ranking.label(ranking.recommended), pvalue=ranking.recommended.pvalue)


def _as_sampled(choice: ModelChoice) -> ModelChoice:
    """Add the uncertainty of flicker noise near half the sampling rate to the covariance of the data of every fit."""
    wv = with_sampling_error(choice.wavelet_variance, choice.ranking.recommended.fit)
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
    return pvalue is None or pvalue >= REJECTED


def _has_filter(fit: Fit) -> bool:
    """Return whether a term is so fast that it may describe the low-pass filter of the sensor."""
    return any(process.scale > 0 and acts_as_filter(process, fit) for process in fit.model.processes)


def within_family(
    family: ModelLike, wv: WaveletVariance, options: RankingOptions, *, required: Sequence[Process] = (),
    check: Callable[[], None] = lambda: None, entered: Entry = "within",
) -> ModelChoice:  # fmt: skip
    """Rank all models within a largest one plus `required` terms, with its model error, without lines of zero power."""
    largest = _largest(family, wv, required)
    bound, error, general = _bound_and_error(largest, wv, options.weighting)
    check()
    # If the largest model has a line without power, the others need not be ranked with it.
    supported = _supported_terms(required, general)
    if len(supported) < len(required):
        return within_family(family, wv, options, required=supported, check=check, entered=entered)
    ranking = select_within(family, having_error(wv, error), options, required=required, progress=lambda *_: check())
    supported = _supported_terms(required, ranking.recommended.fit)
    step = SearchStep(family=largest.structure, entered=entered, bound=bound, model_error=error, left="lines-absent")
    step = _with_result(step, ranking)
    if len(supported) < len(required):
        choice = within_family(
            family, wv, options, required=supported, check=check, entered="without-absent-lines"
        )  # fmt: skip
        return choice.after(step)
    return _only_choice(ranking, wv, step, tried=(largest.structure,))


def given_model(model: Model, wv: WaveletVariance, options: RankingOptions) -> ModelChoice:
    """Return the result for a single given model, with its model error."""
    bound, error, _ = _bound_and_error(without_values(model), wv, options.weighting)
    ranking = rank_models([model], having_error(wv, error), options)
    step = SearchStep(family=model.structure, entered="model", bound=bound, model_error=error, left="last")
    return _only_choice(ranking, wv, _with_result(step, ranking), tried=())


def _only_choice(ranking: Ranking, wv: WaveletVariance, step: SearchStep, *, tried: tuple[str, ...]) -> ModelChoice:
    """Return the choice from the last family."""
    reason: Exit = "model-error" if step.model_error else "accepted" if _is_accepted(ranking) else "last"
    step = replace(step, left=reason, used=True)
    return _as_sampled(
        ModelChoice(ranking=ranking, wavelet_variance=wv, error=step.model_error, tried=tried, steps=(step,))
    )


def given_curve(model: Model, wv: WaveletVariance, weighting: str) -> WaveletVariance:
    """Return the wavelet variance with the model error of a single model, like `given_model` but without a ranking."""
    _, error, _ = _bound_and_error(without_values(model), wv, weighting)
    near = nearly_fitted(model, having_error(wv, error), weighting)
    return having_error(with_sampling_error(wv, near), error)


def _bound_and_error(model: Model, wv: WaveletVariance, weighting: str) -> tuple[float, float, Fit]:
    """Return the upper bound of the p-value of a model, its relative model error, 0 if accepted, and its fit."""
    general = nearly_fitted(model, wv, weighting)
    bound = Distance.of(general).surely
    return bound, model_error(general) if bound < REJECTED else 0.0, general


def _supported_terms(required: Sequence[Process], fit: Fit) -> Sequence[Process]:
    """Return the required terms except lines whose power is estimated as zero."""
    zero = {(p.name, *p.nonlinear) for p in fit.model.processes if isinstance(p, SIN | OSC) and p.scale == 0}
    return [p for p in required if not isinstance(p, SIN | OSC) or (p.name, *p.nonlinear) not in zero]


def _largest(family: ModelLike, wv: WaveletVariance, required: Sequence[Process] = ()) -> Model:
    """Return the largest model within `family` plus the required terms with at most one parameter for each level."""
    optional = without_drift(without_values(as_model(family)), [wv])
    largest = Model((*optional.processes, *required))
    if freedom(largest) <= len(wv):
        return largest
    sums = (Model((*part.processes, *required)) for part in nested_models(optional))
    return next((model for model in sums if freedom(model) <= len(wv)), Model(tuple(required)) if required else largest)


def _required_terms(
    general: Fit, wv: WaveletVariance, spectrum: PowerSpectrum | None, lines: tuple[Process, ...], *,
    options: RankingOptions, check: Callable[[], None],
) -> _Shown:  # fmt: skip
    """Return the terms that the spectrum shows. Without a spectrum, fit an AR(2) process to the wavelet variance."""
    if spectrum is None:
        shape = _fitted_shape(wv, options)
        return _Shown(wavelet_variance=wv, terms=() if shape is None else (shape,))
    shape, spectral_shape, slow = None, None, general
    # Number of times that the shape at high frequencies and the slow terms are fitted in turn.
    for _ in range(2):
        check()
        spectral_shape = _shape(spectrum, slow, wv.rate, shape)
        if spectral_shape is None:
            break
        shape = process_of(spectral_shape)
        largest = _largest(BESIDE, wv, (shape, *lines))
        slow = nearly_fitted(largest, wv, options.weighting)
    if shape is None or spectral_shape is None:
        return _Shown(wavelet_variance=wv, terms=(WN(), *lines) if lines else ())
    return _Shown(
        wavelet_variance=with_shape_error(wv, slow, spectral_shape, shape), terms=(shape, *lines),
        band=band_errors(spectral_shape, wv.rate),
    )  # fmt: skip


def _fitted_shape(wv: WaveletVariance, options: RankingOptions) -> Process | None:
    """Fit an AR(2) with slow noise, and return it with fixed coefficients; None if it is no shape at high
    frequencies."""
    try:
        general = Model.parse("AR(2) + 2*GM + QN + RW")
        fit = nearly_fitted(general, wv, options.weighting)
    except GmwmError:
        return None
    process = next(p for p in fit.model.processes if p.name == "AR(2)")
    memory = process.correlation_time(wv.rate)
    if process.scale == 0 or memory is None or memory * wv.rate > MEMORY:
        return None
    names = [p.name for p in process.nonlinear_parameters()]
    held = {name: Fixed(process.value(name)) for name in names}
    return process.with_values(**held, **{process.scale_parameter().name: None})


def _sets_of_peaks(spectrum: PowerSpectrum | None, wv: WaveletVariance) -> Iterator[tuple[Process, ...]]:
    """Yield the processes of the lines with all bumps, and with those that are too narrow for an ARMA process."""
    if spectrum is None:
        return
    every = [bump for bump in spectrum.bumps if CRITICAL < bump.quality < SHARPEST]
    narrow = _narrow_bumps(spectrum)
    if len(every) > len(narrow):
        yield _peaks(spectrum, wv, every)
    yield _peaks(spectrum, wv, narrow)


def _narrow_bumps(spectrum: PowerSpectrum) -> list[Bump]:
    """Return the bumps that are too narrow for an ARMA process."""
    return [
        bump for bump in spectrum.bumps if bump.width < NARROW * spectrum.rate and CRITICAL < bump.quality < SHARPEST
    ]


def _peaks(spectrum: PowerSpectrum, wv: WaveletVariance, bumps: Sequence[Bump]) -> tuple[Process, ...]:
    """Return sinusoids for the lines and oscillators for these bumps that are large enough at some level, the strongest
    first. A line with a width is an oscillator. Their frequency and quality are fixed, and so is the power of all but
    the strongest of each kind.
    """
    peaks: list[Line | Bump] = [*spectrum.lines, *bumps]
    below = np.where(wv.variance > 0, wv.variance, np.inf)
    sinusoids, oscillators = list[tuple[float, Process]](), list[tuple[float, Process]]()
    for peak in peaks:
        process = _of_peak(peak)
        share = float((process.wavelet_variance(wv.levels, wv.rate, wv.filter) / below).max())
        if share < FELT:
            continue
        others = [other for other in peaks if other is not peak]
        resonance = resonance_of(spectrum, peak, others)
        if resonance is not None and CRITICAL < resonance.quality < SHARPEST:
            process = OSC(*map(Fixed, resonance))
        (oscillators if isinstance(process, OSC) else sinusoids).append((share, process))
    return (*_strongest(sinusoids), *list(_strongest(oscillators))[:MOST_OSCILLATORS])


def _of_peak(peak: Line | Bump) -> Process:
    """Return a sinusoid for a line, and an oscillator for a bump."""
    if isinstance(peak, Line):
        return SIN(frequency=Fixed(peak.frequency), power=Fixed(peak.amplitude**2 / 2))
    # The power is the integral of a Lorentz peak above the surrounding density.
    power = math.pi / 2 * peak.density * (1 - 1 / peak.height) * peak.width
    return OSC(frequency=Fixed(peak.frequency), quality=Fixed(peak.quality), sigma2=Fixed(power))


def _strongest(processes: list[tuple[float, Process]]) -> Iterator[Process]:
    """Yield the processes, the one with the largest share first, with free power for the first."""
    for place, (_, process) in enumerate(sorted(processes, key=lambda item: -item[0])):
        yield process.with_values(**{process.scale_parameter().name: None}) if place < MOST_FREE else process


def _shape(spectrum: PowerSpectrum, known: Fit, rate: float, before: Process | None) -> SpectralShape | None:
    """Fit a shape to the high frequencies that slow terms do not explain; None if too few frequencies can be used."""
    smooth = spectrum.smoothed() if spectrum.frequencies[0] == 0 else spectrum
    frequencies, density = smooth.frequencies, smooth.density * rate / 2
    slow = _slow_density([p for p in known.model.processes if type(p) is not type(before)], frequencies, rate)
    used = (frequencies > rate / (2 * math.pi * FAST)) & (density > 0)
    peaks: list[Line | Bump] = [*spectrum.lines, *_narrow_bumps(spectrum)]
    for peak in peaks:
        # Frequencies within this distance from a line, in units of the frequency resolution, are not used for the shape
        # (tests/selection/test_search.py).
        used &= np.abs(frequencies - peak.frequency) > max(8 * spectrum.resolution, 4 * peak.width)
    mixed = np.flatnonzero(used & (slow <= MIXED * density))
    used &= frequencies >= frequencies[mixed[0]] if mixed.size else False
    if np.count_nonzero(used) < FEWEST:
        return None
    return short_memory(frequencies[used], density[used], smooth.degrees_of_freedom[used], rate=rate, known=slow[used])


def _slow_density(processes: Sequence[Process], frequencies: Vector, rate: float) -> Vector:
    """Return the spectral density (n,) of all slow processes together, multiplied by the sampling rate."""
    total = np.zeros(frequencies.size)
    for process in processes:
        if process.scale == 0 or process.line(rate) is not None:
            continue
        time = process.correlation_time(rate)
        if time is not None and time * rate <= FAST:
            continue
        with np.errstate(divide="ignore"):
            total += process.psd(frequencies, rate) * rate if process.has("psd") else 0.0
    return total
