"""White noise N and random walk K of a fit for a filter that has only these two numbers, with confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector, as_number
from gmwm.base.errors import DataError, MissingTheoryError, ModelError, OptionError
from gmwm.base.lazy import once_per_result
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.bias import UNBOUNDED_HALF_WIDTH, FitCurve, sensitivity
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.datasheets.filter_numbers import (
    LEAST_PERIODS,
    MOST_PERIODS,
    CurveRatio,
    FilterGain,
    FilterNumbers,
    FilterPrediction,
    filter_numbers,
    resonances_of,
    samples_in,
)
from gmwm.choosing.datasheets.limits import hidden, measurable
from gmwm.fitting.estimation.conditions_fit import ConditionsFit
from gmwm.fitting.estimation.intervals import upper_reach
from gmwm.fitting.estimation.result import GIVEN, Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process

if TYPE_CHECKING:
    from polars import DataFrame

MISFIT_ERRORS = 3.0
"""Number of standard errors between model and measurement from which the measurement is used. In a fit of the true
model, a level exceeds it with a probability of 0.3 %. Pinned by tests/test_effective_noise.py."""


def curve_ratio(fit: Fit) -> CurveRatio | None:
    """Return the factor from a model's density to the measured one, 1 within `MISFIT_ERRORS`; None if always 1."""
    return once_per_result(fit, "ratio", (), lambda: _curve_ratio(fit))


def _curve_ratio(fit: Fit) -> CurveRatio | None:
    fit = fit.without_lags
    wv = fit.wavelet_variance
    lines = np.zeros(len(wv))
    for process in fit.model.processes:
        if process.scale != 0 and process.oscillation() is not None:
            lines += process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    # Where oscillations prevail, a small error of their shape is a large one of the noise below them.
    usable = (wv.variance > 2 * lines) & (fit.implied > 2 * lines) & (wv.lower > 0)
    measured, implied = np.log(wv.variance[usable]), np.log(fit.implied[usable])
    limit = np.where(implied > measured, np.log(wv.upper[usable]), np.log(wv.lower[usable]))
    error = np.abs(limit - measured) / NormalDist().inv_cdf((1 + wv.confidence) / 2)
    if np.any(lines > 0):  # the power of an oscillation varies more than that of broad noise with the same variance
        error = np.maximum(error, np.sqrt(np.diag(fit.sandwich.sampling.wavelet)[usable]))
    outside = np.abs(implied - measured) > MISFIT_ERRORS * error
    if not np.any(outside):
        return None
    noise = np.log((wv.variance - lines)[usable] / (fit.implied - lines)[usable])
    logs, errors = np.zeros(len(wv)), np.zeros(len(wv))
    logs[usable], errors[usable] = np.where(outside, noise, 0.0), np.where(outside, error, 0.0)
    return CurveRatio(np.asarray(wv.levels, dtype=np.float64), logs, errors)


DEFAULT_HORIZON_S = 1.0
"""Default horizon (s): N agrees with σ(1 s) within 3 % for white noise with flicker or a walk. For flicker and GM of ≥
100 s, the next minute is predicted at most 8 % worse than with the best K (docs/validation/filter.md)."""

TRUE_CLAIM = (0.8, 1.3)
"""Ratios of stated to real error that count as true, a convention (tests/exporters/test_quality.py)."""

WHITE, WALK = 0.5, -0.5  # powers of time in the units of N and K

TITLES = {"N": ("white noise density of a filter", WHITE), "K": ("random walk of a filter", WALK)}


@dataclass(frozen=True)
class Use:
    """The horizon (s) of a filter or simulator, and its own flicker parameter, which the two numbers then exclude."""

    horizon: float = DEFAULT_HORIZON_S
    flicker: str = ""

    def contains(self, process: Process, rate: float) -> bool:
        """Return whether the two numbers include a process: not an oscillation with a period above three horizons."""
        frequency = process.oscillation()
        noise = process.line(rate) is None  # `FilterPrediction` chooses among sinusoids
        slow = noise and frequency is not None and frequency * self.horizon < LEAST_PERIODS
        return not slow and not (self.flicker and is_flicker(process, rate))


def effective_noise(fit: Fit, horizon: float = DEFAULT_HORIZON_S, level: float = 0.95) -> dict[str, Entry]:
    """Compute the white noise N and the random walk K with which a filter predicts the noise of a fit best.

    The filter predicts the mean of the noise over the next T seconds. N and K make the error of the prediction as small
    as possible, and the error that the filter states equal to the real error; see `filter_numbers`. They depend only on
    the spectrum of the model, so that models with the same curve have the same numbers. White noise plus a random walk
    gives the coefficients of its terms for every T. The noise includes quantization noise, a drift, and sinusoids with
    a period between T/10 and 3 T. It leaves out other sinusoids, and oscillations with a period longer than 3 T.

    At scales where the model differs from the measured wavelet variance by more than three standard errors, the
    spectrum of the model is multiplied by the ratio of the two variances, and the interval includes the numbers of the
    model itself. The interval of N also includes N without oscillations faster than 10/T: their flanks below 1/T are
    extrapolated, and a disturbance whose frequency wanders has none.

    The intervals come from the derivatives of N and K with respect to the parameters of the model (implicit function
    theorem) and the covariance of the estimates.

    Parameters
    ----------
    fit : Fit
    horizon : float
        Horizon T (s).
    level : float
        Confidence level, from 0.5 to below 1.

    Returns
    -------
    mapping of "N" and "K" to Entry
        A number that may be zero is an upper limit. If a filter without the number predicts best, its value is the
        limit of this noise in a fit that adds it to the model, so that the value is never zero. The value is infinite
        if the data give no limit.

    Raises
    ------
    OptionError
        If `fit` is not a Fit, `horizon` is not a positive time, or `level` is out of range.
    MissingTheoryError
        If the wavelet variance of a process is unknown.

    Examples
    --------
    >>> import gmwm
    >>> truth = gmwm.GM(beta=50.0, sigma2=1e-6) + gmwm.RW(gamma2=1e-10)
    >>> fit = gmwm.fit("GM + RW", gmwm.Signal(truth.simulate(100_000, 100.0, rng=2), 100.0, "rad/s"))
    >>> found = effective_noise(fit, horizon=10.0)
    >>> found["N"].low < 2.02e-4 < found["N"].high
    True
    """
    if not isinstance(fit, Fit):
        raise OptionError(
            f"fit must be a Fit, because limits need data; got {type(fit).__name__}", argument="fit", got=fit,
            advice="Pass `gmwm.fit(model, data)`, or an axis of a calibration.",
        )  # fmt: skip
    level = as_confidence(level, "level")
    use = Use(checked_horizon(horizon))
    return limited(fit, filter_entries(fit, use, level), use.horizon, level)


def claim(fit: Fit, white: float, walk: float, time: float) -> float:
    """Return the error that a filter with N and K states for the mean over the next `time` seconds, over its error."""
    return once_per_result(fit, "claim", (white, walk, time), lambda: _claim(fit, white, walk, time))


def _claim(fit: Fit, white: float, walk: float, time: float) -> float:
    rate = fit.wavelet_variance.rate
    samples, gain = samples_in(time, rate), FilterGain(walk / (white * rate))
    real = FilterPrediction.of(fit.model.processes, rate, samples, curve_ratio(fit)).error(gain)[0]
    return math.sqrt(white**2 * rate * gain.claim(samples)[0] / real)


def true_times(fits: Sequence[Fit], white: float, walk: float) -> tuple[float, float]:
    """Return the times (s, from 1 s) between which a filter's stated error is true (`TRUE_CLAIM`) for the axis with the
    largest real error; infinite if true up to 1000 s, or a tenth of a shorter recording; both if never true."""
    wv = fits[0].wavelet_variance
    times = [
        t for t in (1.0, 2, 5, 10, 20, 30, 60, 100, 150, 200, 300, 500, 700, 1000) if 10 * t * wv.rate <= wv.samples
    ]
    claims = ((time, min(claim(fit, white, walk, time) for fit in fits)) for time in times)
    since = next((time for time, share in claims if TRUE_CLAIM[0] <= share <= TRUE_CLAIM[1]), None)
    false = next((time for time, share in claims if not TRUE_CLAIM[0] <= share <= TRUE_CLAIM[1]), math.inf)
    until = math.inf if false == math.inf else max(time for time in times if time < false)
    # With the upper limit of K, the stated error can be too large at all times.
    return (math.inf, math.inf) if since is None and times else (since or 1.0, until)


def changes_by_curve(fit: Fit) -> dict[str, float]:
    """Return the factor, at least 1, by which the measured curve changes N and K of the model; {} if it does not."""
    (numbers, of_model), _ = _numbers(fit, Use())
    pairs = {symbol: (getattr(numbers, symbol), getattr(of_model, symbol)) for symbol in TITLES}
    return {
        symbol: max(here / there, there / here)
        for symbol, (here, there) in pairs.items()
        if here != there and here * there > 0
    }


def checked_horizon(horizon: float) -> float:
    """Return a time horizon (s) as float. Raises an OptionError if it is not positive and finite."""
    return as_number(horizon, "horizon", lambda time: time > 0, "a positive time (s)")


def limited(fit: Fit, entries: Mapping[str, Entry], horizon: float, level: float) -> dict[str, Entry]:
    """Return N and K with upper limits, from a fit with this noise added, where they may be zero.

    N includes slow noise at K's limit, with the Allan variance K² T/3 (walk) or K N ln 2 (flicker noise) at T."""
    numbers = {symbol: _limited(fit, entry, level) for symbol, entry in entries.items()}
    white, walk = numbers["N"], numbers["K"]
    absent = walk.upper_only and not entries["K"].value
    if absent and walk.high and white.high and not white.held and math.isfinite(walk.high):
        slow = walk.high * max(walk.high * horizon / 3, white.high * math.log(2))
        numbers["N"] = replace(white, high=math.sqrt(white.high**2 + horizon * slow))
    return numbers


def _limited(fit: Fit, entry: Entry, level: float) -> Entry:
    if not entry.upper_only or fit.weighting == GIVEN:
        return entry
    try:
        high = max(entry.high or 0.0, hidden(fit, entry, level))
    except DataError:
        high = math.inf
    return measurable(replace(entry, value=entry.value or high, low=0.0, high=high), fit)


def filter_entries(fit: Fit, use: Use, level: float) -> dict[str, Entry]:
    """Compute N and K without fits for upper limits; a number is zero, and a limit, if a filter without it is best."""
    numbers, errors = _numbers(fit, use)
    z, entries = NormalDist().inv_cdf((1 + level) / 2), {}
    ends = [] if errors is None else _numbers_at_ends(fit, use, z)
    for symbol, (title, power) in TITLES.items():
        unit, factor = noise_unit(power, fit.wavelet_variance.unit)
        value, *others = (factor * float(getattr(each, symbol)) for each in (*numbers, *ends))
        low: float | None = value
        high: float | None = value
        upper_only = value == 0
        if errors is None:
            low = high = None
        elif value > 0:
            reach = errors[symbol]
            upper_only = z * min(reach.scales, reach.all) >= 1 or min(others[1:], default=value) == 0
            total, own = 0.5 * z * reach.all, 0.5 * z * reach.own
            below, above = (math.exp(min(d, UNBOUNDED_HALF_WIDTH)) for d in (total, upper_reach(total, own, 0.5)))
            least, most = min(value, others[0]), max(value, others[0])
            if symbol == "N":
                without = [factor * white for white in _white_without(fit, use, numbers[0])]
                least, most = min(least, *without), max(most, *without)
            low, high = min(least / below, *others), max(most * above, *others)
            if upper_only:
                low, high = 0.0, max(most * math.sqrt(1 + z * reach.all), *others)
        entries[symbol] = Entry(
            symbol=symbol, title=title, value=value, low=low, high=high, unit=unit, upper_only=upper_only,
            held=errors is not None and errors[symbol].held,
        )  # fmt: skip
    return entries


def _numbers_at_ends(fit: Fit, use: Use, z: float) -> list[FilterNumbers]:
    """Return the numbers at the ends of a poorly known region, where the best filter can be another one."""
    ends = FitCurve.of(fit).ends(z)
    return once_per_result(fit, "ends", (use, z), lambda: [_at(fit, use, curve_ratio(fit), end) for end in ends])


def _white_without(fit: Fit, use: Use, numbers: FilterNumbers) -> tuple[float, float]:
    """Return N without the oscillations faster than `MOST_PERIODS` in the horizon, and without ramps, which are those
    of one recording, if there is other noise: beside a ramp, the best filter has a smaller N, and a larger K."""
    rate = fit.wavelet_variance.rate
    processes = [p for p in fit.model.processes if p.scale > 0 and use.contains(p, rate)]

    def without(left_out: Sequence[Process]) -> float:
        absent = {process: process.with_values(**{process.scale_parameter().name: 0.0}) for process in left_out}
        return _at(fit, use, curve_ratio(fit), absent).N if 0 < len(absent) < len(processes) else numbers.N

    fast = [p for p in processes if (p.oscillation() or 0.0) * use.horizon > MOST_PERIODS]
    ramps = [p for p in processes if is_ramp(p, rate)]
    return once_per_result(fit, "white without", use, lambda: (without(fast), without(ramps)))


def _at(fit: Fit, use: Use, ratio: CurveRatio | None, end: Mapping[Process, Process] | None = None) -> FilterNumbers:
    """Return the numbers of a fit with the processes of `end` in the place of its own; see `filter_numbers`."""
    wv, moved = fit.wavelet_variance, end or {}
    together = [process for process in fit.model.processes if use.contains(process, wv.rate)]
    processes = [moved.get(process, process) for process in together]
    # A recording has too few parts to show that a slower filter predicts better, so K is zero
    # (tests/test_effective_noise.py).
    slowest = wv.samples / 10.0
    shared = resonances_of(together, wv.rate)
    return filter_numbers(processes, wv.rate, use.horizon, ratio=ratio, slowest=slowest, shared=shared)


@dataclass(frozen=True)
class _Error:
    """Standard errors of ln N² or ln K² by all parameters, without the spread between recordings (`own`), and by scales
    only: a number may be zero if both are large, because the error of a correlation time alone does not make it
    doubtful. `held` if no parameter was estimated."""

    all: float
    own: float
    scales: float
    held: bool

    def with_curve(self, symbol: str, numbers: FilterNumbers, moved: Sequence[FilterNumbers]) -> _Error:
        """Return the errors with those of the measured levels, from the numbers after a change of each by one error."""
        value = getattr(numbers, symbol)
        if value == 0:
            return self
        curve = math.hypot(*(2 * (getattr(each, symbol) / value - 1) for each in moved))
        every, own, scales = (math.hypot(error, curve) for error in (self.all, self.own, self.scales))
        return replace(self, all=every, own=own, scales=scales)


def _numbers(fit: Fit, use: Use) -> tuple[tuple[FilterNumbers, FilterNumbers], dict[str, _Error] | None]:
    """Return N and K of the data and of the model itself, and their standard errors; None if there are none."""
    return once_per_result(fit, "filter numbers", use, lambda: _compute_numbers(fit, use))


def _compute_numbers(fit: Fit, use: Use) -> tuple[tuple[FilterNumbers, FilterNumbers], dict[str, _Error] | None]:
    ratio = curve_ratio(fit)
    numbers = _at(fit, use, ratio)
    of_model = numbers if ratio is None else _at(fit, use, None)
    try:
        ratios = () if ratio is None else ratio.moved()
        moved = [_at(fit, use, each) for each in ratios]
        errors = _errors(fit, numbers, use, ratio)
        return (numbers, of_model), {symbol: e.with_curve(symbol, numbers, moved) for symbol, e in errors.items()}
    except (MissingTheoryError, ModelError):
        return (numbers, of_model), None


def _errors(fit: Fit, numbers: FilterNumbers, use: Use, ratio: CurveRatio | None) -> dict[str, _Error]:
    """Return the standard errors of ln N² and ln K². With u = ln w, ∂J/∂u = 0 gives du/dθ = −(∂²J/∂u∂θ)/(∂²J/∂u²), and
    N² C(u) = J gives d ln N²/dθ = (∂J/∂θ)/J − (C'/C) du/dθ, d ln K²/dθ = d ln N²/dθ + 2 du/dθ."""
    # Step of ln w in the second derivative of the prediction error, whose relative error is about _STEP².
    step = 1e-3
    gain, samples = numbers.gain, numbers.samples
    curve, own = FitCurve.of(fit), FitCurve.of(fit, sampling=True)
    rate = curve.design.rate
    shared = resonances_of([process for process in fit.model.processes if use.contains(process, rate)], rate)

    def of(process: Process) -> Vector:
        if not use.contains(process, rate):
            return np.zeros(2)
        return np.array(FilterPrediction.of([process], rate, samples, ratio, shared=shared).error(gain))

    error = numbers.prediction.error(gain)[0]
    if error == 0:
        return dict.fromkeys(TITLES, _Error(0.0, 0.0, 0.0, held=False))
    changes = np.array([sensitivity(p, name, of) for p, name in curve.moving]).reshape(-1, 2)
    before, after = (
        numbers.prediction.error(FilterGain(gain.bandwidth * math.exp(sign * step)))[1] for sign in (-1.0, 1.0)
    )
    curvature = (after - before) / (2 * step)
    moves = -changes[:, 1] / curvature if numbers.N > 0 and numbers.K > 0 else np.zeros(len(changes))
    claim, slope = gain.claim(samples)
    white = changes[:, 0] / error - slope / claim * moves
    # None is the scale of a term estimated as zero.
    scales = np.array([name is None or name == p.scale_parameter().name for p, name in curve.moving], dtype=np.bool_)
    held = not curve.moving
    return {
        symbol: _Error(curve.error(change), own.error(change), curve.error(np.where(scales, change, 0.0)), held)
        for symbol, change in (("N", white), ("K", white + 2 * moves))
    }


def is_flicker(process: Process, rate: float) -> bool:
    """Return whether a process has a flat Allan deviation, because a datasheet number of it has no power of time."""
    return any(number.signal_power and number.time_power == 0 for number in process.physical(rate)) and (
        process.oscillation() is None and process.correlation_time(rate) in (None, math.inf)
    )


def numbers_at(
    fit: ConditionsFit, conditions: Sequence[float] | None = None, *, horizon: float = DEFAULT_HORIZON_S
) -> DataFrame:  # fmt: skip
    """Compute the white noise N and the random walk K of a filter, and correlation times, at values of a condition.

    A program that measures the condition interpolates in this table, and changes N, K and T_c of its filter with it.

    Parameters
    ----------
    fit : ConditionsFit
        Fit to recordings at known conditions, or to one recording during which the condition moves.
    conditions : sequence of float, optional
        Values of the condition within the range of the data; those of the curves by default.
    horizon : float
        Horizon (s) of N and K; see `effective_noise`.

    Returns
    -------
    polars.DataFrame
        Columns: the condition; N in the unit of the signal per √Hz; K in this unit per √s; "T_c of …" (s) of each
        Gauss-Markov term.

    Raises
    ------
    OptionError
        If a condition is outside the range of the data, or the horizon is not a positive time.

    Examples
    --------
    >>> import numpy as np, gmwm
    >>> rng = np.random.default_rng(1)
    >>> recordings = {c: gmwm.Signal(s * rng.normal(size=20_000), 100.0) for c, s in ((0.0, 1.0), (2.0, 3.0))}
    >>> fit = gmwm.fit("WN", recordings, varies={"WN": "1 + rate**2"})
    >>> numbers_at(fit, [0.0, 1.0, 2.0])["N"].round(2).to_list()
    [0.1, 0.17, 0.3]
    """
    from polars import DataFrame

    seconds, rate = checked_horizon(horizon), next(iter(fit.curves.values())).rate
    rows = []
    for condition in fit.curves if conditions is None else conditions:
        model = fit.at(condition)
        numbers = filter_numbers(model.processes, rate, seconds)
        times = {
            f"T_c of {term}": process.correlation_time(rate)
            for term, process in model.by_term.items()
            if process.parametrises is not None
        }
        rows.append({fit.condition: float(condition), "N": numbers.N, "K": numbers.K, **times})
    return DataFrame(rows)
