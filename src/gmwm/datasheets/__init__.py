"""The numbers of a fit in the terms of datasheets and filters: Q, N, B, K, R, and what Gauss-Markov terms are."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.datasheets.bias import SYMBOL, bias_instability
from gmwm.datasheets.effective import Use, effective_noise, noise_in_use
from gmwm.datasheets.entry import Entry, significant
from gmwm.datasheets.equivalent_terms import translated
from gmwm.datasheets.sheet import Datasheet
from gmwm.errors import MissingTheoryError, ModelError
from gmwm.estimation.result import Fit
from gmwm.inference.intervals import Interval, confidence_intervals, free_shape, is_weak
from gmwm.options import as_confidence
from gmwm.processes.base import Process
from gmwm.processes.physical import Physical
from gmwm.remarks import Remark
from gmwm.units import noise_unit
from gmwm.variance.slope_line import LAWS

__all__ = ["Datasheet", "Entry", "datasheet", "effective_noise"]

_SHORT = 0.1
"""Correlation times (s) below which a term looks like white noise where the standard reads N, at τ = 1 s."""

_FLICKER = f"{SYMBOL}_f"
"""Symbol of what a flicker term says of itself."""

_ORDER = ("Q", "N", SYMBOL, _FLICKER, "K", "R")


_TIMES = {1.0: "s", -1.0: "Hz"}
"""Units of what has no unit of the signal."""


@dataclass(frozen=True)
class _Judged:
    """A fit without terms that act as others, what its terms were called, and what its data say of each parameter."""

    fit: Fit
    labels: tuple[str, ...]
    intervals: dict[str, Interval] | None
    z: float

    def weak(self, term: str, process: Process) -> bool:
        """Whether a process of known shape cannot be told from none."""
        scale = process.scale_parameter()
        if free_shape(process) or process.is_fixed(scale.name) or self.intervals is None:
            return False
        return is_weak(self.fit, f"{term}.{scale.name}", scale, self.z)


def datasheet(fit: Fit, level: float = 0.95) -> Datasheet:
    """What a fitted model says in the terms of datasheets, each number with its confidence interval.

        N = √(σ²Δt)   Q = Q_d Δt   K = √(γ²f)   R = ωf   T_c = 1/β   q_c = √(2βσ²_GM)
        B = √B² of a flicker term, or else min over τ of the model's Allan deviation / √(2 ln 2/π)
        A = √(2P)   f_0 of a line

    Where the model has a flicker term that is not zero, B is its coefficient, as the standard defines it; else it is
    read at the lowest point of the whole curve without its lines, whatever its terms are. The latter holds what of N
    and K there is at that point, and is no less than the former; the two are not compared. Of a flicker term that is
    estimated as zero, an upper limit is given as B_f where there is one.

    Terms that act as another process to these data are counted to that one: a Gauss-Markov term that acts as white
    noise adds to N², one that acts as a random walk to K². What the model has no term for is not invented. An AR1 has
    T_c and q_c of the Gauss-Markov process with its samples; with φ ≤ 0 there is none, and it is left out.

    Intervals are those of the logarithm, by the delta method with the joint covariance of the estimates (for a number
    that depends on a single parameter these are the transformed ends of its interval); R, which has a sign, has R ±
    z SE. Numbers that the data only bound, since their term is zero or cannot be told from zero, are upper limits, as
    in `Fit.confidence_intervals`; so is B where the curve has no minimum that the data show.

    Parameters
    ----------
    fit : Fit
        Of a wavelet variance whose unit says what the sensor measures; without a known unit the numbers are in "u",
        the unit of the data, and have no datasheet units.
    level : float
        Confidence level.

    Returns
    -------
    Datasheet
        A mapping of symbol to `Entry`.

    Raises
    ------
    OptionError
        If `level` is not between 0 and 1.

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
        remarks.append(Remark.of("no-intervals", axis, reason=str(error).rstrip(".")))
    judged = _Judged(written, labels, intervals, NormalDist().inv_cdf((1 + level) / 2))
    entries: list[Entry] = []
    for term, label, process in zip(written.model.terms, labels, written.model.processes, strict=True):
        found, remark = _of_term(judged, term, label, process)
        taken = {entry.symbol for entry in entries}
        entries += [_renamed(entry, label) if entry.symbol in taken else entry for entry in found]
        remarks += [remark] if remark else []
    if fast := [entry for entry in entries if entry.unit == "s" and entry.value < _SHORT]:
        white, remark = _white(fit, entries, fast, level)
        entries = [entry for entry in entries if entry.symbol != white.symbol] + [white] if white else entries
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


def _acts(fit: Fit, term: str) -> str | None:
    """The process that a term acts as."""
    return fit.diagnostics.acts_as.get(term)


def _of_term(judged: _Judged, term: str, label: str, process: Process) -> tuple[list[Entry], Remark | None]:
    """The numbers of one term, or a remark why there is none."""
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
    # Of terms that may be there several times, the number that the term has in the fit.
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
    """Ends at z standard errors on the scale of the logarithm; of a number with a sign, on its own."""
    found = judged.fit.sandwich
    place = [found.names.index(name) for name in slopes]
    g = np.array(list(slopes.values()))
    reach = judged.z * math.sqrt(float(g @ found.relative[np.ix_(place, place)] @ g))
    if number.signal_power and process.scale_parameter().domain == "real":
        return number.value - reach * abs(number.value), number.value + reach * abs(number.value)
    factor = math.exp(min(reach, 700.0))
    return number.value / factor, number.value * factor if math.isfinite(reach) else math.inf


def _white(fit: Fit, entries: list[Entry], fast: list[Entry], level: float) -> tuple[Entry | None, Remark]:
    """N with the terms that are white noise where it is read, at τ = 1 s; a remark that says which."""
    axis, names = fit.wavelet_variance.axis, tuple(f"{e.term} (T_c = {significant(e.value, 2)} s)" for e in fast)
    try:
        found = noise_in_use(fit, Use(_SHORT), level)["N_eff"]
    except (MissingTheoryError, ModelError) as error:
        return None, Remark.of("n-without", axis, terms=names, reason=str(error).rstrip("."))
    title = next((entry.title for entry in entries if entry.symbol == "N"), "white noise density")
    whole = {**found.to_dict(), "symbol": "N", "title": title}
    return Entry.from_dict(whole), Remark.of("n-includes", axis, terms=names)


def _bias(judged: _Judged) -> tuple[Entry | None, Remark | None]:
    """The bias instability, or a remark why there is none."""
    try:
        return bias_instability(judged.fit, None if judged.intervals is None else judged.z)
    except MissingTheoryError as error:
        return None, Remark.of("no-bias-instability", judged.fit.wavelet_variance.axis, reason=str(error).rstrip("."))


def _as_bias(entry: Entry) -> Entry:
    """The coefficient of flicker noise is the bias instability of the standard."""
    return replace(entry, symbol=SYMBOL, title=f"{LAWS[SYMBOL].name} of {entry.title}")


def _renamed(entry: Entry, label: str) -> Entry:
    """A second number of one name says which term it is of."""
    return Entry.from_dict({**entry.to_dict(), "symbol": f"{entry.symbol} of {label}"})


def _sheet(fit: Fit, entries: tuple[Entry, ...], level: float, remarks: tuple[Remark, ...]) -> Datasheet:
    wv = fit.wavelet_variance
    unit, factor = noise_unit(0.0, wv.unit)
    # Twice the Haar wavelet variance, whatever the filter of the fit.
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
