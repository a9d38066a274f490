"""Search for the model of one axis, controlled by the data: first the slow noise, then what the spectrum shows.

1. Every sum within the slow family is ranked. If the test accepts the recommended one, the search ends, unless it has a
   Gauss-Markov term that is so fast that it may describe a filter.
2. Otherwise the spectrum gives the lines, as sinusoids of known frequency, and the shape of the noise at high
   frequencies, as an ARMA process of known coefficients: the sensor's own filter and its resonances. Both are linear in
   their scales, so that every fit keeps its certificate. Without a spectrum, an AR(2) is fitted to the wavelet
   variance.
3. The model error is estimated from the largest of these models, and every sum within it is ranked again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gmwm._arrays import Vector
from gmwm.errors import GmwmError
from gmwm.estimation.result import Fit
from gmwm.inference.model_error import Distance, having_error, model_error, nearly_fitted
from gmwm.processes.base import Process
from gmwm.processes.model import Model, ModelLike, as_model
from gmwm.processes.noise import WN
from gmwm.processes.parameter import Fixed
from gmwm.processes.sinusoid import SIN
from gmwm.selection.api import rank_models, select_within
from gmwm.selection.options import RankingOptions
from gmwm.selection.ranking import Candidate, Ranking
from gmwm.selection.shape_error import band_errors, process_of, with_sampling_error, with_shape_error
from gmwm.selection.structure import freedom, nested, without_drift, without_values
from gmwm.spectrum.result import PowerSpectrum
from gmwm.spectrum.short_memory import SpectralShape, short_memory
from gmwm.variance.result import WaveletVariance

SLOW = "4*GM + WN + QN + FN + RW + DR"
"""The family of models that is tried first (docs/validation/selection.md)."""
BESIDE = "4*GM + FN + RW + DR"
"""Terms that are combined with the noise at high frequencies, which already contains white and quantization noise."""
REJECTED = 0.002
"""p-value of the goodness-of-fit test below which the search continues. Two true models of a thousand have one."""
FEWEST = 24
"""Smallest number of frequencies for a shape at high frequencies; with fewer, the spectrum is not used."""
MIXED = 0.5
"""Share of slow noise in the density above which a frequency is not used for the shape at high frequencies."""
FAST = 20.0
"""Correlation time (samples) up to which a Gauss-Markov term is treated as noise at high frequencies. The corner of its
density is at 1/126 of the rate; the shape is fitted to the density above this frequency."""
FELT = 0.003
"""Share of the wavelet variance of a level from which a line enters the model: the relative standard error of the first
levels of 10^6 samples is 0.2 % (tests/selection/test_search.py)."""
MOST_FREE = 1
"""Largest number of lines, the strongest ones, whose power is fitted. Other lines have the power that the spectrum
shows."""
FILTERED = 3.0
"""Correlation time (samples) up to which a Gauss-Markov term describes the sensor's low-pass filter. A filter is not
exactly of this form, and N is then wrong by 0.5 % while the test accepts the model (docs/validation/sensors.md)."""
MEMORY = 2000.0
"""Correlation time (samples) of an AR(2) beyond which it is a line and not a shape at high frequencies."""
NARROW = 0.002
"""Width of a bump, relative to the sampling rate, below which it is treated as a line: half the width of the narrowest
ARMA peak here, see `gmwm.spectrum.short_memory.POLE`."""
AROUND = 8
"""Distance from a line, in resolutions, within which the spectrum is not used for the shape (tests/selection/
test_search.py)."""
_ROUNDS = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class Searched:
    """The result of a search.

    Attributes
    ----------
    ranking : Ranking
        The models that were compared last.
    wavelet_variance : WaveletVariance
        The data, with the covariance that the uncertainty of the shape at high frequencies adds.
    error : float
        Relative model error τ, in addition to it.
    tried : tuple of str
        The families that were tried, in order.
    band : mapping of str to float
        Relative standard errors of the bandwidth f_b, the resonance frequency f_r and the quality factor Q_r of a
        shape from the spectrum.
    """

    ranking: Ranking
    wavelet_variance: WaveletVariance
    error: float
    tried: tuple[str, ...]
    band: Mapping[str, float] = field(default_factory=dict)

    @property
    def with_error(self) -> WaveletVariance:
        """Return the data with the model error."""
        return having_error(self.wavelet_variance, self.error)


def search(
    wv: WaveletVariance,
    spectrum: PowerSpectrum | None,
    options: RankingOptions,
    *,
    check: Callable[[], None] = lambda: None,
) -> Searched:
    """Search for the model of one axis; the module docstring describes the steps.

    Parameters
    ----------
    wv : WaveletVariance
    spectrum : PowerSpectrum or None
        The spectrum of the same recording, if there is one.
    options : RankingOptions
    check : function, optional
        Called between steps; it may raise to end the search.
    """
    general = nearly_fitted(_largest(SLOW, wv), wv, options.weighting)
    if Distance.of(general).surely >= REJECTED:
        ranking = select_within(SLOW, wv, options, progress=lambda *_: check())
        if _accepted(ranking):
            found = _as_sampled(Searched(ranking=ranking, wavelet_variance=wv, error=0.0, tried=(SLOW,)))
            if spectrum is None or not _filtered(ranking.recommended.fit):
                return found
            shown = _required(general, wv, spectrum, (), options=options, check=check)
            if not shown.terms:
                return found
            shaped = shown.searched(BESIDE, options, check)
            return shaped if _accepted(shaped.ranking) else found
    check()
    lines = () if spectrum is None else _lines(spectrum, wv)
    if lines:
        with_lines = nearly_fitted(_largest(SLOW, wv, lines), wv, options.weighting)
        if Distance.of(with_lines).surely >= REJECTED:
            return within_family(SLOW, wv, options, required=lines, check=check, tried=(SLOW,))
    shown = _required(general, wv, spectrum, lines, options=options, check=check)
    if not shown.terms:
        return within_family(SLOW, wv, options, check=check)
    # A shape that was fitted to the curve does not contain the white and quantization noise.
    return shown.searched(SLOW if spectrum is None else BESIDE, options, check)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """The terms that the spectrum shows, the data with the uncertainty of their shape, and the uncertainty of its
    band."""

    wavelet_variance: WaveletVariance
    terms: tuple[Process, ...]
    band: Mapping[str, float] = field(default_factory=dict)

    def searched(self, beside: str, options: RankingOptions, check: Callable[[], None]) -> Searched:
        """Rank every sum within a family, combined with these terms."""
        found = within_family(
            beside, self.wavelet_variance, options, required=self.terms, check=check, tried=(SLOW,)
        )  # fmt: skip
        return replace(found, band=self.band)


def _as_sampled(found: Searched) -> Searched:
    """Add the uncertainty of flicker noise near half the sampling rate to the data of every fit."""
    wv = with_sampling_error(found.wavelet_variance, found.ranking.recommended.fit)
    if wv is found.wavelet_variance:
        return found
    curve = having_error(wv, found.error)

    def moved(candidate: Candidate) -> Candidate:
        return replace(candidate, fit=replace(candidate.fit, wavelet_variance=curve))

    ranking = replace(found.ranking, candidates=tuple(map(moved, found.ranking.candidates)))
    return replace(found, ranking=ranking, wavelet_variance=wv)


def _accepted(ranking: Ranking) -> bool:
    pvalue = ranking.recommended.pvalue
    return pvalue is None or pvalue >= REJECTED


def _filtered(fit: Fit) -> bool:
    """Return whether a term has such a short correlation time that it describes the sensor's low-pass filter."""
    rate = fit.wavelet_variance.rate
    times = [process.correlation_time(rate) for process in fit.model.processes if process.scale > 0]
    return any(time is not None and 0 < time * rate <= FILTERED for time in times)


def within_family(
    family: ModelLike,
    wv: WaveletVariance,
    options: RankingOptions,
    *,
    required: Sequence[Process] = (),
    check: Callable[[], None] = lambda: None,
    tried: tuple[str, ...] = (),
) -> Searched:
    """Rank every sum within a family, with the model error of its largest sum."""
    whole = _largest(family, wv, required)
    error = _error_of(whole, wv, options.weighting)
    check()
    ranking = select_within(family, having_error(wv, error), options, required=required, progress=lambda *_: check())
    supported = _supported(required, ranking.recommended.fit)
    if len(supported) < len(required):
        return within_family(family, wv, options, required=supported, check=check, tried=tried)
    return _as_sampled(Searched(ranking=ranking, wavelet_variance=wv, error=error, tried=(*tried, whole.structure)))


def given_model(model: Model, wv: WaveletVariance, options: RankingOptions) -> Searched:
    """Return the ranking of a single model, with its model error."""
    error = _error_of(without_values(model), wv, options.weighting)
    ranking = rank_models([model], having_error(wv, error), options)
    return _as_sampled(Searched(ranking=ranking, wavelet_variance=wv, error=error, tried=()))


def given_curve(model: Model, wv: WaveletVariance, weighting: str) -> WaveletVariance:
    """Return the data with the model error of a single model, as `given_model` does but without a ranking."""
    error = _error_of(without_values(model), wv, weighting)
    near = nearly_fitted(model, having_error(wv, error), weighting)
    return having_error(with_sampling_error(wv, near), error)


def _error_of(model: Model, wv: WaveletVariance, weighting: str) -> float:
    """Return the model error of a model; 0 if the test accepts it."""
    general = nearly_fitted(model, wv, weighting)
    return model_error(general) if Distance.of(general).surely < REJECTED else 0.0


def _supported(required: Sequence[Process], fit: Fit) -> Sequence[Process]:
    """Return the required terms without lines whose power is estimated as zero."""
    zero = {p.value("frequency") for p in fit.model.processes if isinstance(p, SIN) and p.scale == 0}
    return [p for p in required if not (isinstance(p, SIN) and p.value("frequency") in zero)]


def _largest(family: ModelLike, wv: WaveletVariance, required: Sequence[Process] = ()) -> Model:
    """Return the largest sum of a family, with the required terms, that has at most as many parameters as levels."""
    optional = without_drift(without_values(as_model(family)), [wv])
    whole = Model((*optional.processes, *required))
    if freedom(whole) <= len(wv):
        return whole
    sums = (Model((*part.processes, *required)) for part in nested(optional))
    return next((model for model in sums if freedom(model) <= len(wv)), Model(tuple(required)) if required else whole)


def _required(
    general: Fit,
    wv: WaveletVariance,
    spectrum: PowerSpectrum | None,
    lines: tuple[Process, ...],
    *,
    options: RankingOptions,
    check: Callable[[], None],
) -> _Shown:
    """Return the terms that the spectrum shows; without a spectrum, an AR(2) that fits the curve."""
    if spectrum is None:
        shape = _fitted_shape(wv, options)
        return _Shown(wavelet_variance=wv, terms=() if shape is None else (shape,))
    shape, found, known = None, None, general
    for _ in range(_ROUNDS):
        check()
        found = _shape(spectrum, known, wv.rate, shape)
        if found is None:
            break
        shape = process_of(found)
        whole = _largest(BESIDE, wv, (shape, *lines))
        known = nearly_fitted(whole, wv, options.weighting)
    if shape is None or found is None:
        return _Shown(wavelet_variance=wv, terms=(WN(), *lines) if lines else ())
    return _Shown(
        wavelet_variance=with_shape_error(wv, known, found, shape), terms=(shape, *lines),
        band=band_errors(found, wv.rate),
    )  # fmt: skip


def _fitted_shape(wv: WaveletVariance, options: RankingOptions) -> Process | None:
    """Return an AR(2) fitted to the wavelet variance together with slow noise, with its coefficients fixed."""
    try:
        whole = Model.parse("AR(2) + 2*GM + QN + RW")
        fit = nearly_fitted(whole, wv, options.weighting)
    except GmwmError:
        return None
    process = next(p for p in fit.model.processes if p.name == "AR(2)")
    memory = process.correlation_time(wv.rate)
    if process.scale == 0 or memory is None or memory * wv.rate > MEMORY:
        return None
    names = [p.name for p in process.nonlinear_parameters()]
    held = {name: Fixed(process.value(name)) for name in names}
    return process.with_values(**held, **{process.scale_parameter().name: None})


def _peaks(spectrum: PowerSpectrum) -> list[tuple[float, float, float]]:
    """Return frequency (Hz), power (u²) and width (Hz) of the lines, and of bumps that are too narrow for an ARMA
    process."""
    found = [(line.frequency, line.amplitude**2 / 2, line.width) for line in spectrum.lines]
    for bump in spectrum.bumps:
        if bump.width < NARROW * spectrum.rate:
            # The integral of a Lorentz peak above its surroundings.
            found.append((bump.frequency, math.pi / 2 * bump.density * (1 - 1 / bump.height) * bump.width, bump.width))
    return found


def _lines(spectrum: PowerSpectrum, wv: WaveletVariance) -> tuple[Process, ...]:
    """Return sinusoids of known frequency for the lines that matter at some level, the strongest ones."""
    found = []
    for frequency, power, _ in _peaks(spectrum):
        process = SIN(frequency=Fixed(frequency), power=Fixed(power))
        share = process.wavelet_variance(wv.levels, wv.rate, wv.filter) / np.where(wv.variance > 0, wv.variance, np.inf)
        if share.max() >= FELT:
            found.append((float(share.max()), process))
    found.sort(key=lambda pair: -pair[0])
    free = [SIN(frequency=Fixed(process.value("frequency"))) for _, process in found[:MOST_FREE]]
    return (*free, *(process for _, process in found[MOST_FREE:]))


def _shape(spectrum: PowerSpectrum, known: Fit, rate: float, before: Process | None) -> SpectralShape | None:
    """Fit the noise at high frequencies in addition to the slow terms of a fit."""
    smooth = spectrum.smoothed() if spectrum.frequencies[0] == 0 else spectrum
    frequencies, density = smooth.frequencies, smooth.density * rate / 2
    slow = _slow_density([p for p in known.model.processes if type(p) is not type(before)], frequencies, rate)
    used = (frequencies > rate / (2 * math.pi * FAST)) & (density > 0)
    for frequency, _, width in _peaks(spectrum):
        used &= np.abs(frequencies - frequency) > max(AROUND * spectrum.resolution, 4 * width)
    mixed = np.flatnonzero(used & (slow <= MIXED * density))
    used &= frequencies >= frequencies[mixed[0]] if mixed.size else False
    if np.count_nonzero(used) < FEWEST:
        return None
    return short_memory(frequencies[used], density[used], smooth.degrees_of_freedom[used], rate=rate, known=slow[used])


def _slow_density(processes: Sequence[Process], frequencies: Vector, rate: float) -> Vector:
    """Return the density per sample (n,) of those processes that are slow."""
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
