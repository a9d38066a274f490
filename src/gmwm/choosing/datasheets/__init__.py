"""Datasheet numbers of a fit: Q, N, B, K, R, T_c and q_c, with confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.base.remarks import Remark
from gmwm.base.template import join_names
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.bias import SYMBOL, bias_instability
from gmwm.choosing.datasheets.effective import (
    DEFAULT_HORIZON_S,
    Use,
    changes_by_curve,
    effective_noise,
    filter_entries,
    limited,
    numbers_at,
)
from gmwm.choosing.datasheets.entry import Datasheet, Entry
from gmwm.choosing.datasheets.limits import measurable, plausible
from gmwm.fitting.estimation.intervals import Interval, confidence_intervals, is_weak, upper_reach
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.oscillator import name_in_text
from gmwm.theory.processes.parameter import Physical

__all__ = ["Datasheet", "Entry", "datasheet", "effective_noise", "model_datasheet", "numbers_at", "with_limits"]

FILTER = ("N", "K")  # symbols of the numbers of a filter, which come first in a datasheet
SAME_NUMBER_DIFFERENCE = 0.05
"""Relative difference up to which a filter's number replaces that of a term (tests/test_datasheet.py)."""

_FLICKER = f"{SYMBOL}_f"  # symbol of the coefficient of a flicker term, before it is renamed to B

_ORDER = (*FILTER, SYMBOL, _FLICKER, "Q", "R")


_TIMES = {1.0: "s", -1.0: "Hz", 0.0: "1"}
"""Units of numbers that do not depend on the unit of the signal, by their power of time."""


@dataclass(frozen=True)
class _Judged:
    """A fit with confidence intervals (None if unavailable); `z` is half their width in standard errors."""

    fit: Fit
    intervals: dict[str, Interval] | None
    z: float

    def weak(self, term: str, process: Process) -> bool:
        """Return whether a term cannot be distinguished from zero; False for terms with free shape parameters."""
        scale = process.scale_parameter()
        if not process.shape_is_fixed or process.is_fixed(scale.name) or self.intervals is None:
            return False
        return is_weak(self.fit, f"{term}.{scale.name}", scale, self.z)


def datasheet(fit: Fit, level: float = 0.95) -> Datasheet:
    """Convert a fit to datasheet numbers with confidence intervals.

    The numbers of a filter come first: the white noise N and the random walk K with which a filter predicts the noise
    over the next second best, from the whole model (see `effective_noise`). The numbers of the terms follow:

        Q = Q_d Δt   R = ωf   T_c = 1/β   q_c = √(2βσ²_GM)   A = √(2P)   f_0 of a sinusoid
        B = √B² of a flicker term, otherwise min over τ of the model's Allan deviation / √(2 ln 2/π)

    Here f = 1/Δt is the sampling rate, and the other symbols are parameters of the model: the standard deviation Q_d of
    the rounding error of quantization noise, the slope ω of a drift (per sample), the inverse correlation time β (1/s)
    and the variance σ²_GM of a Gauss-Markov process, the coefficient B² of flicker noise, the power P of a sinusoid.
    "N of WN" = √(σ²Δt) and "K of RW" = √(γ²f) are the numbers of white noise and of a random walk in the model. They
    are left out if they agree with N and K of the filter within 5 %.

    If the model has a flicker term that is not zero, the bias instability B is its coefficient, as the standard defines
    it. Otherwise B is computed from the minimum of the Allan deviation of the model without its sinusoids, so it
    includes the contributions of N and K at the minimum. If a flicker term is estimated as zero, B_f is its upper
    limit.

    A term that the data cannot distinguish from another process has no numbers of its own. An AR1 with φ > 0 has the
    T_c and q_c of the equivalent Gauss-Markov process.

    Confidence intervals are symmetric on a logarithmic scale. They come from the delta method with the joint covariance
    of the estimates. R can be negative, so its interval is R ± z SE with the standard error SE and the normal quantile
    z. A number is an upper limit if its term cannot be distinguished from zero (as in `Fit.confidence_intervals`), or
    if its interval spans more than a factor of 10. B is an upper limit if the data do not show that the curve has a
    minimum. A time or a frequency with such an interval is not determined.

    Parameters
    ----------
    fit : Fit
        A fit to a wavelet variance. If it has no unit, numbers are in "u", the unit of the data, and cannot be
        converted to datasheet units.
    level : float
        Confidence level, from 0.5 to below 1.

    Returns
    -------
    Datasheet
        A mapping of symbol to `Entry`.

    Raises
    ------
    OptionError
        If `level` is out of range.

    References
    ----------
    IEEE Std 952-1997, annex C.

    Examples
    --------
    >>> import gmwm
    >>> x = (gmwm.WN(sigma2=1e-6) + gmwm.RW(gamma2=1e-12)).simulate(100_000, 100.0, rng=1)
    >>> found = gmwm.fit(gmwm.WN() + gmwm.RW(), gmwm.Signal(x, 100.0, "rad/s")).datasheet()
    >>> list(found)
    ['N', 'K', 'B']
    >>> found["N"].low < 1e-4 < found["N"].high
    True
    >>> found["N"].in_units("datasheet")[3]
    'deg/√h'
    """
    level = as_confidence(level, "level")
    return with_limits(model_datasheet(fit, level), fit)


def with_limits(sheet: Datasheet, fit: Fit) -> Datasheet:
    """Return plausible numbers, with upper limits of N and K that may be zero, without repetitions by terms."""
    resonances = {entry.term: entry.value for entry in sheet.entries if entry.symbol.startswith("f_r")}
    entries = [
        plausible(entry, sheet.rate, sheet.samples, resonances.get(entry.term))
        for entry in sheet.entries
        if not _repeats(entry, sheet)
    ]
    filtered = {entry.symbol: entry for entry in entries if entry.symbol in FILTER}
    entries = [*limited(fit, filtered, DEFAULT_HORIZON_S, sheet.level).values(), *entries[len(filtered) :]]
    return replace(sheet, entries=tuple(measurable(entry, fit) for entry in entries))


def _repeats(entry: Entry, sheet: Datasheet) -> bool:
    """Return whether the number N or K of a term agrees with the number of a filter."""
    symbol, of, _ = entry.symbol.partition(" of ")
    if not of or symbol not in FILTER:
        return False
    of_filter = sheet[symbol].value
    return abs(entry.value - of_filter) <= SAME_NUMBER_DIFFERENCE * of_filter


def model_datasheet(fit: Fit, level: float) -> Datasheet:
    """Return the datasheet of a fit before `with_limits`, for averages over several models."""
    axis, model = fit.wavelet_variance.axis, fit.model
    remarks: list[Remark] = []
    intervals: dict[str, Interval] | None
    try:
        intervals = confidence_intervals(fit, level)
    except (MissingTheoryError, ModelError) as error:
        intervals = None
        remarks.append(Remark.of("no-intervals", axis, reason=error.reason))
    judged = _Judged(fit, intervals, NormalDist().inv_cdf((1 + level) / 2))
    entries = list(filter_entries(fit, Use(), level).values())
    changes = {
        symbol: change for symbol, change in changes_by_curve(fit).items() if change > 1 + SAME_NUMBER_DIFFERENCE
    }
    if changes:
        remarks.append(Remark.of("numbers-from-curve", axis, numbers=tuple(changes), factor=max(changes.values())))
    for term, process in model.by_term.items():
        numbers, remark = _of_term(judged, term, process)
        entries += [_beside(entry, entries) for entry in numbers]
        remarks += [remark] if remark else []
    # A filter with N cannot tell a Gauss-Markov process that is much faster than its horizon from white noise.
    times = (entry for entry in entries if entry.symbol.partition("[")[0] == "T_c")
    if fast := [str(entry.term) for entry in times if entry.value < DEFAULT_HORIZON_S / 10]:
        without = f", without {join_names(fast)}, which N contains"
        entries = [replace(e, title=e.title + without) if e.symbol.startswith("N of ") else e for e in entries]
    bias, remark = None, None
    if any(entry.symbol == _FLICKER and entry.value > 0 for entry in entries):
        # The coefficient of a flicker term is the bias instability B, as the standard defines it.
        bias_of = f"{LAWS[SYMBOL].name} of "
        entries = [replace(e, symbol=SYMBOL, title=bias_of + e.title) if e.symbol == _FLICKER else e for e in entries]
    else:
        bias, remark = _bias(judged)
    entries += [bias] if bias else []
    remarks += [remark] if remark else []
    entries.sort(key=lambda entry: _ORDER.index(entry.symbol) if entry.symbol in _ORDER else len(_ORDER))
    return _sheet(fit, tuple(entries), level, tuple(remarks))


def _beside(entry: Entry, entries: list[Entry]) -> Entry:
    """Return the number of a term, with the name of its term in the symbol if the symbol is taken."""
    if entry.symbol not in (other.symbol for other in entries):
        return entry
    return replace(entry, symbol=f"{entry.symbol} of {entry.term}", title=f"{entry.title} of {entry.term}")


def _of_term(judged: _Judged, term: str, process: Process) -> tuple[list[Entry], Remark | None]:
    """Return the datasheet numbers of one term, or a remark with the reason why there are none."""
    wv, name = judged.fit.wavelet_variance, name_in_text(term, process)
    if process.scale == 0 and not process.shape_is_fixed:
        return [], Remark.of("no-number", wv.axis, case="term", term=name, because="zero", process="")
    if other := judged.fit.diagnostics.acts_as.get(term):
        return [], Remark.of("no-number", wv.axis, case="term", term=name, because="acts", process=other)
    numbers = process.physical(wv.rate)
    if not numbers:
        return [], Remark.of("no-number", wv.axis, case="term", term=name, because="none", process="")
    weak = judged.weak(term, process)
    return [_entry(judged, term, process=process, number=number, weak=weak) for number in numbers], None


def _entry(judged: _Judged, term: str, process: Process, number: Physical, weak: bool) -> Entry:
    wv = judged.fit.wavelet_variance
    unit, factor = noise_unit(number.time_power, wv.unit) if number.signal_power else (_TIMES[number.time_power], 1.0)
    # If a model can contain a process several times, its symbols have the index of the term in the fit.
    _, bracket, place = term.partition("[") if process.repeatable else ("", "", "")
    slopes = {f"{term}.{name}": slope for name, slope in number.slopes.items() if not process.is_fixed(name)}
    value, held, upper_only = number.value, not slopes, False
    low: float | None
    high: float | None
    if held:
        low = high = value
    elif judged.intervals is None:
        low = high = None
    elif weak:
        scale = process.scale_parameter()
        limit = judged.intervals[f"{term}.{scale.name}"][1]
        at_limit = process.with_values(**{scale.name: limit}).physical(wv.rate)
        high = abs(next(n.value for n in at_limit if n.symbol == number.symbol))
        low, upper_only = -high if scale.domain == "real" else 0.0, True
    else:
        low, high = _interval(judged, process, number, slopes)
    low, high = (None if end is None else factor * end for end in (low, high))
    return Entry(
        symbol=number.symbol + bracket + place, title=number.title, value=factor * value, low=low, high=high, unit=unit,
        term=term, upper_only=upper_only, held=held,
        frequency=next((n.value for n in process.physical(wv.rate) if n.symbol == "f_0"), None),
    )  # fmt: skip


def _interval(judged: _Judged, process: Process, number: Physical, slopes: dict[str, float]) -> Interval:
    """Return a number's interval: ±z standard errors on a logarithmic scale, or a linear one if it has a sign."""
    sandwich, scale = judged.fit.sandwich, process.scale_parameter()
    place = [sandwich.names.index(name) for name in slopes]
    g = np.array(list(slopes.values()))
    total, own = (
        judged.z * math.sqrt(max(float(g @ errors.relative[np.ix_(place, place)] @ g), 0.0))
        for errors in (sandwich, sandwich.sampling)
    )
    if number.signal_power and scale.domain == "real":
        return number.value - total * abs(number.value), number.value + total * abs(number.value)
    power = number.slopes[scale.name] / (scale.scale_power or 1) if number.slopes.keys() == {scale.name} else None
    above = upper_reach(total, own, power)
    high = number.value * math.exp(min(above, 700.0)) if math.isfinite(above) else math.inf
    return number.value / math.exp(min(total, 700.0)), high


def _bias(judged: _Judged) -> tuple[Entry | None, Remark | None]:
    """Return the bias instability, or a remark with the reason why there is none."""
    try:
        return bias_instability(judged.fit, None if judged.intervals is None else judged.z)
    except MissingTheoryError as error:
        axis = judged.fit.wavelet_variance.axis
        return None, Remark.of("no-number", axis, case="b", reason=error.reason)


def _sheet(fit: Fit, entries: tuple[Entry, ...], level: float, remarks: tuple[Remark, ...]) -> Datasheet:
    wv = fit.wavelet_variance.without_lags
    unit, factor = noise_unit(0.0, wv.unit)
    # The Allan variance is twice the Haar wavelet variance, whichever filter the fit uses.
    deviation = factor * np.sqrt(2.0 * fit.model.wavelet_variance(wv.levels, wv.rate))
    return Datasheet(
        entries=entries, axis=wv.axis, unit=unit, model=fit.model.structure, samples=wv.samples, rate=wv.rate,
        level=level, averaging_time=np.ldexp(1.0, wv.levels - 1) / wv.rate, allan_deviation=deviation, remarks=remarks,
    )  # fmt: skip
