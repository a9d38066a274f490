"""Datasheet numbers of a fit: Q, N, B, K, R, T_c and q_c, with confidence intervals."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.base.remarks import Remark
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.bias import SYMBOL, bias_instability
from gmwm.choosing.datasheets.effective import Use, effective_noise, noise_in_use
from gmwm.choosing.datasheets.entry import Entry, significant
from gmwm.choosing.datasheets.equivalent_terms import translated
from gmwm.choosing.datasheets.sheet import Datasheet
from gmwm.fitting.estimation.intervals import Interval, confidence_intervals, free_shape, is_weak
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.allan_regression import LAWS
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.physical import Physical

__all__ = ["Datasheet", "Entry", "datasheet", "effective_noise"]

_SHORT = 0.1
"""Correlation time (s) below which a term counts as white noise in N. The standard defines N at τ = 1 s, and the limit
is a tenth of this time. Pinned by tests/test_datasheet.py."""

_DENSITY = "N"

_FLICKER = f"{SYMBOL}_f"
"""Symbol of the coefficient of a flicker term, before it is renamed to B."""

_ORDER = ("Q", "N", SYMBOL, _FLICKER, "K", "R")


_TIMES = {1.0: "s", -1.0: "Hz", 0.0: "1"}
"""Units of numbers that do not depend on the unit of the signal, by their power of time."""


@dataclass(frozen=True)
class _Judged:
    """A fit with its confidence intervals, after the replacement of terms that act as another process.

    A term acts as another process if the data cannot distinguish it from this process.

    Attributes
    ----------
    fit : Fit
        The fit after the replacement.
    labels : tuple of str
        The label in the original fit for each term.
    intervals : dict of name to Interval, or None
        Confidence intervals of the parameters; None if they cannot be computed.
    z : float
        Half the width of a confidence interval in standard errors.
    """

    fit: Fit
    labels: tuple[str, ...]
    intervals: dict[str, Interval] | None
    z: float

    def weak(self, term: str, process: Process) -> bool:
        """Return whether a term cannot be distinguished from zero; False for terms with free shape parameters."""
        scale = process.scale_parameter()
        if free_shape(process) or process.is_fixed(scale.name) or self.intervals is None:
            return False
        return is_weak(self.fit, f"{term}.{scale.name}", scale, self.z)


def datasheet(fit: Fit, level: float = 0.95) -> Datasheet:
    """Convert a fit to datasheet numbers with confidence intervals.

        N = √(σ²Δt)   Q = Q_d Δt   K = √(γ²f)   R = ωf   T_c = 1/β   q_c = √(2βσ²_GM)
        B = √B² of a flicker term, otherwise min over τ of the model's Allan deviation / √(2 ln 2/π)
        A = √(2P)   f_0 of a sinusoid

    Here f = 1/Δt is the sampling rate, and the other symbols are parameters of the model: the variance σ² of white
    noise, the standard deviation Q_d of the rounding error of quantization noise, the variance γ² of the steps of a
    random walk and the slope ω of a drift (both per sample), the inverse correlation time β (1/s) and the variance
    σ²_GM of a Gauss-Markov process, the coefficient B² of flicker noise, and the power P of a sinusoid.

    If the model has a flicker term that is not zero, the bias instability B is its coefficient, as the standard defines
    it. Otherwise B is computed from the minimum of the Allan deviation of the model without its sinusoids, so it
    includes the contributions of N and K at the minimum. If a flicker term is estimated as zero, B_f is its upper
    limit.

    A term that the data cannot distinguish from another process is included in the numbers of that process: a
    Gauss-Markov term that acts as white noise adds to N², and one that acts as a random walk adds to K². Processes that
    the model does not have give no numbers. An AR1 with φ > 0 has the T_c and q_c of the equivalent Gauss-Markov
    process.

    Confidence intervals are symmetric on a logarithmic scale. They come from the delta method with the joint covariance
    of the estimates. R can be negative, so its interval is R ± z SE with the standard error SE and the normal quantile
    z. A number is an upper limit if its term cannot be distinguished from zero (as in `Fit.confidence_intervals`). B is
    an upper limit if the data do not show that the curve has a minimum.

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
    ['N', 'B', 'K']
    >>> found["N"].low < 1e-4 < found["N"].high
    True
    >>> found["N"].in_units("datasheet")[3]
    'deg/√h'
    """
    level = as_confidence(level, "level")
    written, labels = translated(fit)
    left = {label for term, label in zip(written.model.terms, labels, strict=True) if _acts(written, term)}
    counted = {term: name for term, name in fit.diagnostics.acts_as.items() if term not in left}
    axis = fit.wavelet_variance.axis
    remarks = [Remark.of("counted-to", axis, term=term, process=name) for term, name in counted.items()]
    intervals: dict[str, Interval] | None
    try:
        intervals = confidence_intervals(written, level)
    except (MissingTheoryError, ModelError) as error:
        intervals = None
        remarks.append(Remark.of("no-intervals", axis, reason=error.reason))
    judged = _Judged(written, labels, intervals, NormalDist().inv_cdf((1 + level) / 2))
    entries: list[Entry] = []
    for term, label, process in zip(written.model.terms, labels, written.model.processes, strict=True):
        found, remark = _of_term(judged, term, label, process)
        taken = {entry.symbol for entry in entries}
        entries += [_renamed(entry, label) if entry.symbol in taken else entry for entry in found]
        remarks += [remark] if remark else []
    fast = [entry for entry in entries if entry.unit == "s" and entry.value < _SHORT]
    several = [entry for entry in entries if _is_density(entry)]
    if fast or len(several) > 1:
        white, remark = _white(fit, entries, fast or several[1:], level)
        entries = [entry for entry in entries if not _is_density(entry)] if white else entries
        entries += [white] if white else []
        remarks.append(remark)
    bias, remark = None, None
    if any(entry.symbol == _FLICKER and entry.value > 0 for entry in entries):
        entries = [_as_bias(entry) if entry.symbol == _FLICKER else entry for entry in entries]
    else:
        bias, remark = _bias(judged)
    entries += [bias] if bias else []
    remarks += [remark] if remark else []
    entries.sort(key=lambda entry: _ORDER.index(entry.symbol) if entry.symbol in _ORDER else len(_ORDER))
    return _sheet(fit, tuple(entries), level, tuple(remarks))


def _is_density(entry: Entry) -> bool:
    """Return whether an entry is the white noise density of one term, whose symbol `_renamed` may have changed."""
    return entry.symbol == _DENSITY or entry.symbol.startswith(f"{_DENSITY} of ")


def _acts(fit: Fit, term: str) -> str | None:
    """Return the name of the process that a term acts as; None if the data distinguish it from all others."""
    return fit.diagnostics.acts_as.get(term)


def _of_term(judged: _Judged, term: str, label: str, process: Process) -> tuple[list[Entry], Remark | None]:
    """Return the datasheet numbers of one term, or a remark with the reason why there are none."""
    wv = judged.fit.wavelet_variance
    if process.scale == 0 and free_shape(process):
        return [], Remark.of("no-numbers", wv.axis, term=label, because="zero", process="")
    if other := _acts(judged.fit, term):
        return [], Remark.of("no-numbers", wv.axis, term=label, because="acts", process=other)
    numbers = process.physical(wv.rate)
    if not numbers:
        return [], Remark.of("no-numbers", wv.axis, term=label, because="none", process="")
    weak = judged.weak(term, process)
    return [_entry(judged, term, label=label, process=process, number=number, weak=weak) for number in numbers], None


def _entry(judged: _Judged, term: str, label: str, process: Process, number: Physical, weak: bool) -> Entry:
    wv = judged.fit.wavelet_variance
    unit, factor = noise_unit(number.time_power, wv.unit) if number.signal_power else (_TIMES[number.time_power], 1.0)
    # If a model can contain a process several times, its symbols have the index of the term in the fit.
    _, bracket, place = label.partition("[") if process.repeatable else ("", "", "")
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
        symbol=number.symbol + bracket + place,
        title=number.title,
        value=factor * value,
        low=low,
        high=high,
        unit=unit,
        term=label,
        upper_only=upper_only,
        held=held,
    )


def _interval(judged: _Judged, process: Process, number: Physical, slopes: dict[str, float]) -> Interval:
    """Return the confidence interval of a number, with ±z standard errors on a logarithmic scale.

    For a number with a sign, the scale is linear.
    """
    found = judged.fit.sandwich
    place = [found.names.index(name) for name in slopes]
    g = np.array(list(slopes.values()))
    reach = judged.z * math.sqrt(float(g @ found.relative[np.ix_(place, place)] @ g))
    if number.signal_power and process.scale_parameter().domain == "real":
        return number.value - reach * abs(number.value), number.value + reach * abs(number.value)
    factor = math.exp(min(reach, 700.0))
    return number.value / factor, number.value * factor if math.isfinite(reach) else math.inf


def _white(fit: Fit, entries: list[Entry], fast: list[Entry], level: float) -> tuple[Entry | None, Remark]:
    """Return N of all terms that are white noise at τ = 1 s, where N is defined, and a remark that names these terms.

    If N cannot be computed, the entry is None and the remark gives the reason.
    """
    axis, rate = fit.wavelet_variance.axis, fit.wavelet_variance.rate
    names = tuple(f"{e.term} (T_c = {significant(e.value, 2)} s)" if e.unit == "s" else str(e.term) for e in fast)
    # Every term with a density at low frequencies is included, even if it has a resonance that decays slowly.
    times = [process.correlation_time(rate) or 0.0 for process in fit.model.processes if _has_density(process, rate)]
    try:
        found = noise_in_use(fit, Use(max(_SHORT, 1.01 * max(times, default=0.0))), level)["N_eff"]
    except (MissingTheoryError, ModelError) as error:
        return None, Remark.of("n-without", axis, terms=names, reason=error.reason)
    title = next((entry.title for entry in entries if entry.symbol == _DENSITY), "white noise density")
    whole = {**found.to_dict(), "symbol": _DENSITY, "title": title}
    return Entry.from_dict(whole), Remark.of("n-includes", axis, terms=names)


def _has_density(process: Process, rate: float) -> bool:
    return process.scale > 0 and any(number.symbol == _DENSITY for number in process.physical(rate))


def _bias(judged: _Judged) -> tuple[Entry | None, Remark | None]:
    """Return the bias instability, or a remark with the reason why there is none."""
    try:
        return bias_instability(judged.fit, None if judged.intervals is None else judged.z)
    except MissingTheoryError as error:
        axis = judged.fit.wavelet_variance.axis
        return None, Remark.of("no-bias-instability", axis, reason=error.reason)


def _as_bias(entry: Entry) -> Entry:
    """Return the entry of a flicker coefficient as the entry of the bias instability B, as the standard defines it."""
    return replace(entry, symbol=SYMBOL, title=f"{LAWS[SYMBOL].name} of {entry.title}")


def _renamed(entry: Entry, label: str) -> Entry:
    """Return an entry with its term in the symbol, such as "N of AR(2)", because another term has the same symbol."""
    return Entry.from_dict({**entry.to_dict(), "symbol": f"{entry.symbol} of {label}"})


def _sheet(fit: Fit, entries: tuple[Entry, ...], level: float, remarks: tuple[Remark, ...]) -> Datasheet:
    wv = fit.wavelet_variance
    unit, factor = noise_unit(0.0, wv.unit)
    # The Allan variance is twice the Haar wavelet variance, whichever filter the fit uses.
    deviation = factor * np.sqrt(2.0 * fit.model.wavelet_variance(wv.levels, wv.rate))
    return Datasheet(
        entries=entries,
        axis=wv.axis,
        unit=unit,
        model=fit.model.structure,
        samples=wv.samples,
        rate=wv.rate,
        level=level,
        averaging_time=np.ldexp(1.0, wv.levels - 1) / wv.rate,
        allan_deviation=deviation,
        remarks=remarks,
    )
