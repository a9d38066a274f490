"""Confidence intervals that include the uncertainty of the model choice, by averaging over models that fit the data."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from statistics import NormalDist

from gmwm.base.errors import GmwmError
from gmwm.base.lazy import scipy
from gmwm.choosing.datasheets import Datasheet, Entry, model_datasheet
from gmwm.choosing.datasheets.bias import SYMBOL, FitCurve
from gmwm.choosing.datasheets.effective import is_flicker
from gmwm.choosing.datasheets.limits import WIDEST_INTERVAL
from gmwm.choosing.selection.ranking import Candidate, Ranking
from gmwm.fitting.estimation.intervals import parameters_by_name, with_quick_intervals
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.spectrum import Line
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Parameter

LEAST_WEIGHT = 0.02
"""Smallest weight of a model in the average, relative to the best model (docs/validation/sensors.md)."""
EQUIVALENT_DIFFERENCE = 4.0
"""Criterion difference of equivalent models at most: larger ones are due to chance (docs/validation/sensors.md)."""
MOST_MODELS = 5  # largest number of models in the average
SAME_PROCESS_RATIO = 5.0
"""Largest ratio of the correlation times of Gauss-Markov terms in two models that are treated as the same process."""
OF_WHITE = ("N",)
"""Symbol of white noise; in an equally good model without it, a fast process replaces it, which says nothing of it."""
UNDETERMINED_RATIO = 1e4
"""Largest ratio of the ends of the interval of q_c for which a Gauss-Markov term counts as determined. A model with an
undetermined term is no better than a smaller model, and its intervals are not valid (docs/validation/sensors.md)."""
_TIMES = ("T_c", "q_c")
_LINE = ("f_0", "A")
WALK = "K"  # symbol of the rate random walk in a datasheet
WALK_SHARE = 0.01
"""Correlation time over length from which a GM term is a walk with K = q_c (docs/validation/sensors.md)."""


@dataclass(frozen=True)
class WeightedEstimate:
    """Estimate from one model with positive interval (`upper_only`: only `high`) and relative `weight`."""

    weight: float
    value: float
    low: float
    high: float
    upper_only: bool = False


ABSENT = WeightedEstimate(weight=0.0, value=0.0, low=0.0, high=0.0, upper_only=True)
"""WeightedEstimate of a number from a model that does not have it, which is zero."""


def averaged_interval(estimates: Sequence[WeightedEstimate], level: float) -> tuple[float, float]:
    """Return a confidence interval of a number, averaged over several models.

    Logarithms are normal in each model; at each end, the weighted tail areas have the mean (1 − level) / 2, or the
    lower end is 0 if models without the number weigh more. Source: Turek and Fletcher (2012), Model-averaged Wald
    confidence intervals, Comput. Stat. Data Anal. 56, 2809-2815."""
    law, tail = NormalDist(), (1 - level) / 2
    reach = law.inv_cdf(1 - tail)
    total = sum(e.weight for e in estimates)
    sure = [e for e in estimates if e.high > 0]
    if not sure or total <= 0:
        return 0.0, 0.0

    def above(x: float) -> float:
        share = 0.0
        for e in sure:
            if e.upper_only or e.low <= 0 or e.value <= 0:
                share += e.weight * (1 - law.cdf(reach * x / e.high))
            elif e.high <= e.low:
                share += e.weight * float(x <= e.value)
            else:
                side = e.high / e.value if x > e.value else e.value / e.low
                deviation = math.log(max(side, 1 + 1e-12)) / reach
                share += e.weight * (1 - law.cdf(math.log(x / e.value) / deviation))
        return share / total

    ends = [end for e in sure for end in (e.low, e.value, e.high) if 0 < end < math.inf]
    if not ends:
        return 0.0, math.inf
    first, last = math.log(min(ends)) - 7.0, min(math.log(max(ends)) + 7.0, 700.0)
    low = 0.0 if above(math.exp(first)) < 1 - tail else _crossing(above, 1 - tail, first, last)
    high = math.inf if above(math.exp(last)) > tail else _crossing(above, tail, first, last)
    return low, high


def _crossing(above: Callable[[float], float], wanted: float, first: float, last: float) -> float:
    if above(math.exp(first)) <= wanted:
        return math.exp(first)
    return math.exp(scipy.optimize.brentq(lambda y: above(math.exp(y)) - wanted, first, last, xtol=1e-15))


def weighted_candidates(ranking: Ranking, most: int = MOST_MODELS) -> list[tuple[float, Candidate]]:
    """Return the models to average over, with the weights exp(−Δ/2), where Δ is the criterion minus the best one."""
    weighted = []
    for candidate in ranking.distinct:
        difference = candidate.difference
        if candidate.equivalent:
            difference = min(difference, EQUIVALENT_DIFFERENCE)
        weight = math.exp(-difference / 2)
        if weight >= LEAST_WEIGHT or candidate.recommended:
            weighted.append((weight, candidate))
    return sorted(weighted, key=lambda pair: (not pair[1].recommended, -pair[0]))[:most]


def averaged_datasheet(sheet: Datasheet, ranking: Ranking, level: float) -> Datasheet:
    """Return the recommended model's datasheet; each interval is the union with the average over models. A number is a
    limit if models without it have over (1 − level) / 2 of the weight. B, the coefficient of flicker noise or else the
    minimum of the curve, is averaged over models with and without flicker noise. The interval of N contains those of
    the equivalent models, one of which is the true one: an average reaches a narrow one of small weight only in part
    (docs/validation/faults.md)."""
    candidates = weighted_candidates(ranking, len(ranking.distinct))
    averaged, rest = candidates[:MOST_MODELS], candidates[MOST_MODELS:]
    kinds = {_has_flicker(candidate) for _, candidate in averaged} if rest else set()
    other_kind = [pair for pair in rest if _has_flicker(pair[1]) not in kinds][:1]
    equivalent = [pair for pair in candidates if pair[1].equivalent]
    sheets = {id(pair): _sheet_of(pair[1], sheet, level) for pair in (*averaged, *other_kind, *equivalent)}
    if len(sheets) < 2:
        return sheet

    def weighted(pairs: Iterable[tuple[float, Candidate]]) -> list[tuple[float, Datasheet]]:
        return [(pair[0], other) for pair in pairs if (other := sheets[id(pair)]) is not None]

    def widened(entry: Entry) -> Entry:
        pairs = weighted([*averaged, *other_kind] if entry.symbol == SYMBOL else averaged)
        wider = entry if len(pairs) < 2 else _widen(entry, sheet, pairs, level)
        if entry.symbol not in OF_WHITE or wider.upper_only or wider.low is None or wider.high is None:
            return wider
        same = [other[entry.symbol] for _, other in weighted(equivalent) if entry.symbol in other]
        low = min([wider.low, *(number.low for number in same if number.low)])
        return replace(wider, low=low, high=max([wider.high, *(number.high for number in same if number.high)]))

    return replace(sheet, entries=tuple(map(widened, sheet.values())))


def _sheet_of(candidate: Candidate, sheet: Datasheet, level: float) -> Datasheet | None:
    """Return the datasheet of a candidate, which is `sheet` if it is recommended; None without (useful) intervals."""
    if candidate.recommended:
        return sheet
    with suppress(GmwmError):
        FitCurve.of(candidate.fit)  # here, because the copy with quick intervals has it, and the bias at rest needs it
        other = model_datasheet(with_quick_intervals(candidate.fit, level), level)
        return other if _is_determined(other) else None
    return None


def _has_flicker(candidate: Candidate) -> bool:
    wv, processes = candidate.fit.wavelet_variance, candidate.fit.model.processes
    return any(process.scale > 0 and is_flicker(process, wv.rate) for process in processes)


def with_band(sheet: Datasheet, errors: Mapping[str, float], lines: Iterable[Line], level: float) -> Datasheet:
    """Add intervals of f_b (relative `errors`) and of lines, strongest first, which the fit holds."""
    reach = NormalDist().inv_cdf((1 + level) / 2)
    errors = {**errors, **_line_errors(sheet, lines)}

    def with_interval(entry: Entry) -> Entry:
        if not entry.held or entry.symbol not in errors:
            return entry
        by = math.exp(min(reach * errors[entry.symbol], 700.0))  # e^700 is near the largest double
        return replace(entry, low=entry.value / by, high=entry.value * by, held=False)

    amplitudes = {entry.term: entry.value for entry in sheet.values() if _base(entry.symbol) == _LINE[1]}
    entries = sorted(map(with_interval, sheet.values()), key=lambda entry: -amplitudes.get(entry.term or "", math.inf))
    return replace(sheet, entries=tuple(entries))


def _line_errors(sheet: Datasheet, lines: Iterable[Line]) -> dict[str, float]:
    """Return the relative standard errors of frequencies and amplitudes from the spectrum by symbol."""
    errors = {}
    for entry in sheet.values():
        line = next((line for line in lines if line.frequency == entry.value), None)
        if _base(entry.symbol) == _LINE[0] and line is not None:
            errors[entry.symbol] = line.frequency_error / line.frequency
            errors[_LINE[1] + entry.symbol.removeprefix(_LINE[0])] = line.amplitude_error / line.amplitude
    return errors


def _is_determined(sheet: Datasheet) -> bool:
    """Return whether the interval of q_c of every Gauss-Markov term is narrow enough (see `UNDETERMINED_RATIO`)."""
    driving = [entry for entry in sheet.values() if _base(entry.symbol) == _TIMES[1] and not entry.upper_only]
    return all(entry.low and entry.high and entry.high <= UNDETERMINED_RATIO * entry.low for entry in driving)


def _widen(entry: Entry, sheet: Datasheet, others: Sequence[tuple[float, Datasheet]], level: float) -> Entry:
    if entry.held or entry.low is None or entry.high is None or entry.value <= 0 or entry.unit == "Hz":
        return entry
    estimates = []
    for weight, other in others:
        same = entry if other is sheet else _counterpart(entry, sheet, other)
        if same is not None:
            ends = max(same.low or 0.0, 0.0), math.inf if same.high is None else same.high
            estimates.append(WeightedEstimate(weight, abs(same.value), *ends, upper_only=same.upper_only))
        elif _base(entry.symbol) not in (*_TIMES, *OF_WHITE):
            estimates.append(replace(ABSENT, weight=weight))
    low, high = averaged_interval(estimates, level)
    low, high = min(low, entry.low), max(high, entry.high)
    return replace(entry, low=low, high=high, upper_only=entry.upper_only or low == 0.0)


def _base(symbol: str) -> str:
    """Return a symbol without the index or the name of its term, such as "K" of "K of RW"."""
    return symbol.partition("[")[0].partition(" of ")[0]


def _counterpart(entry: Entry, sheet: Datasheet, other: Mapping[str, Entry]) -> Entry | None:
    """Return another model's entry of the same number, or None; GM terms match by correlation time, even a walk."""
    base = _base(entry.symbol)
    if base != entry.symbol and base not in _TIMES and "[" not in entry.symbol:
        same = next((e for symbol, e in other.items() if _base(symbol) == base != symbol), None)
        walks = base != WALK or (same is not None and not same.upper_only)
        return same if walks else _slowest(other, sheet.samples / sheet.rate) or same
    if base not in _TIMES:
        return other.get(entry.symbol)
    time = sheet.get(_TIMES[0] + entry.symbol.removeprefix(base))
    if time is None:
        return None
    near = [symbol for symbol, e in other.items() if _base(symbol) == _TIMES[0] and e.value > 0]
    symbol = min(near, key=lambda name: abs(math.log(other[name].value / time.value)), default=None)
    if symbol is None or abs(math.log(other[symbol].value / time.value)) > math.log(SAME_PROCESS_RATIO):
        return None
    return other.get(base + symbol.removeprefix(_TIMES[0]))


def _slowest(other: Mapping[str, Entry], duration: float) -> Entry | None:
    """Return q_c of the slowest Gauss-Markov term; None if the term is too fast to be treated as a random walk."""
    slow = _slow({symbol: e.value for symbol, e in other.items() if _base(symbol) == _TIMES[0]}, duration)
    symbol = max(slow, key=slow.__getitem__, default=None)
    return None if symbol is None else other.get(_TIMES[1] + symbol.removeprefix(_TIMES[0]))


def _slow(times: Mapping[str, float], duration: float) -> dict[str, float]:
    """Return the correlation times (s) of terms that are treated as random walks (see `WALK_SHARE`)."""
    return {name: time for name, time in times.items() if time >= WALK_SHARE * duration}


def is_walk(process: Process, rate: float) -> bool:
    """Return whether a process has the datasheet number K, like a random walk."""
    return any(number.symbol == WALK for number in process.physical(rate))


def markov_instead_of_walk(sheet: Datasheet, ranking: Ranking) -> float | None:
    """Return the correlation time (s), 1 to 100 % of the recording, of a GM that could replace the walk, or None."""
    term = next((entry for entry in sheet.values() if entry.symbol.startswith(f"{WALK} of ")), None)
    walk, duration = term or sheet.get(WALK), sheet.samples / sheet.rate
    recommended = [candidate.fit.model for candidate in ranking.distinct if candidate.recommended]
    walks = any(p.scale > 0 and is_walk(p, sheet.rate) for model in recommended for p in model.processes)
    if walk is None or walk.upper_only or walk.held or not walks:
        return None
    for candidate in ranking.distinct:
        if candidate.difference <= EQUIVALENT_DIFFERENCE and not candidate.recommended:
            model = candidate.fit.model
            terms = {t: p for t, p in model.by_term.items() if p.scale > 0}
            if any(is_walk(process, sheet.rate) for process in terms.values()):
                continue
            times = {term: process.correlation_time(sheet.rate) or 0.0 for term, process in terms.items()}
            slow = [time for time in _slow(times, duration).values() if time <= duration]
            if slow:
                return max(slow)
    return None


def averaged_intervals(
    fit: Fit, intervals: Mapping[str, tuple[float, float]], sheet: Datasheet
) -> dict[str, tuple[float, float]]:
    """Return parameters' intervals, widened by the model choice as those of numbers that follow from one alone."""
    rate, widened = fit.wavelet_variance.rate, dict(intervals)
    for term, process in fit.model.by_term.items():
        for number in process.physical(rate) if process.scale > 0 else ():
            if len(number.slopes) != 1:
                continue
            ((parameter, slope),) = number.slopes.items()
            entry = next((e for e in sheet.values() if e.term == term and _base(e.symbol) == number.symbol), None)
            name = f"{term}.{parameter}"
            if entry is None or entry.low is None or entry.high is None or entry.value <= 0:
                continue
            if name not in widened or slope == 0:
                continue
            value, power = fit.parameters[name], 1 / slope
            ends = [_scale(value, end / entry.value, power) for end in (entry.low, entry.high)]
            low, high = widened[name]
            widened[name] = (min(low, *ends), max(high, *ends))
    parameters = parameters_by_name(fit.model)
    return {name: _narrow_enough(parameters.get(name), ends) for name, ends in widened.items()}


def _narrow_enough(parameter: Parameter | None, interval: tuple[float, float]) -> tuple[float, float]:
    """Return a parameter's interval, or a limit if wider than a number's may be; variances by square root."""
    low, high = interval
    power = None if parameter is None else parameter.scale_power
    if low <= 0 or high <= low * WIDEST_INTERVAL ** (1.0 if power is None else 2.0 / power):
        return interval
    return 0.0, math.inf if power is None else high


def _scale(value: float, ratio: float, power: float) -> float:
    """Return value · ratio^power. The ratio may be 0 or infinite, and the result is infinite if it would overflow."""
    if ratio <= 0 or math.isinf(ratio):
        return math.inf if (ratio <= 0) == (power < 0) else 0.0
    exponent = power * math.log(ratio)
    return value * math.exp(exponent) if exponent < 700.0 else math.inf
