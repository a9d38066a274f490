"""Upper limits of noise that the model does not contain, and of numbers that a recording cannot show."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.entry import Entry
from gmwm.fitting.estimation.estimator import fit_quietly
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import REWEIGHTED
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.noise import RW, WN


def variance_limit(
    wv: WaveletVariance, processes: Iterable[Process], of: Callable[[Process], float | Matrix]
) -> Matrix:
    """Return an upper limit of the variance that `of` computes, for any strengths of the processes.

    With wavelet variances ν_p and variances f_p, Σ c_p ν_p is at most a level's upper limit, so Σ c_p f_p at most this
    times max f_p/ν_p; the smallest bound holds. A random walk is always included: slow noise resembles it."""
    seen = wv.variance > 0  # A variance of zero is due to the coarse resolution of the output.
    parts = dict.fromkeys((*map(at_some_strength, processes), RW(gamma2=1.0)))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratios = [
            np.multiply.outer(1 / p.wavelet_variance(wv.levels, wv.rate, wv.filter)[seen], np.asarray(of(p)))
            for p in parts
        ]
        steepest = np.nanmax(np.array(ratios), axis=0)
    upper = wv.upper[seen].reshape((-1,) + (1,) * (steepest.ndim - 1))
    return np.asarray((upper * steepest).min(axis=0, initial=np.inf))


def strength_limit(wv: WaveletVariance, process: Process) -> float:
    """Return the largest factor of a process that exceeds measured upper limits at ≤ 2 levels, low by chance."""
    implied = process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    seen = (wv.variance > 0) & (implied > 0)
    return float(np.sort(wv.upper[seen] / implied[seen])[:3].max(initial=0.0)) or float("inf")


def allan_limit(wv: WaveletVariance, process_ratio: Vector) -> float:
    """Return the Allan variance's largest upper limit near its minimum; `process_ratio` is that to wavelet variance."""
    high = (process_ratio * wv.upper)[(wv.variance > 0) & np.isfinite(process_ratio)]
    if not high.size:
        return float("inf")
    k = int(np.argmin(high))
    return float(high[max(k - 1, 0) : k + 2].max())


def at_some_strength(process: Process) -> Process:
    """Return a process, with a scale of 1 if it is zero."""
    return process if process.scale > 0 else process.with_scale(1.0)


_KINDS: Mapping[str, type[Process]] = {"N": WN, "K": RW}
"""Process that is added to the model to compute the upper limit of N or K."""


def hidden(fit: Fit, entry: Entry, level: float) -> float:
    """Compute the upper limit of N or K from a fit with this term; infinite if unbounded, DataError without a fit."""
    kind = _KINDS[entry.symbol]
    try:
        holder = fit if any(isinstance(p, kind) for p in fit.model.processes) else _widened(fit, kind)
        intervals = holder.confidence_intervals(level)
    except GmwmError as error:
        message = f"the data give no upper limit of the {entry.title}: {error.reason}"
        raise DataError(message, advice="Record longer.").with_advice_of(error) from error
    pairs = holder.model.by_term.items()
    term, process = next((t, p) for t, p in pairs if isinstance(p, kind))
    scale = process.scale_parameter().name
    high = process.value(scale) if process.is_fixed(scale) else intervals[f"{term}.{scale}"][1]
    if not math.isfinite(high):
        return math.inf
    wv = fit.wavelet_variance
    number = process.with_values(**{scale: high}).physical(wv.rate)[0]
    return noise_unit(number.time_power, wv.unit)[1] * number.value


def _widened(fit: Fit, kind: type[Process]) -> Fit:
    """Fit the model with a process of class `kind` added to the same data, without warnings that it is zero."""
    weighting = fit.weighting if fit.weighting in REWEIGHTED else fit.weighting_matrix
    return fit_quietly(fit.model + kind(), fit.wavelet_variance, weighting, certify=False)


WIDEST_INTERVAL = 10.0
"""Ratio of ends from which an interval is a limit, or undetermined (tests/test_plausible.py)."""


def plausible(entry: Entry, rate: float, samples: int, resonance: float | None = None) -> Entry:
    """Return a number with an interval in the range that a recording can show, and not too wide.

    Frequencies are up to half the rate, times from a sample to the length, qualities up to `resonance` (Hz) times the
    length. Beyond `WIDEST_INTERVAL`, a strength becomes a limit, and others are undetermined."""
    if entry.held or entry.low is None or entry.high is None or entry.upper_only or entry.value <= 0:
        return entry
    duration = samples / rate
    ranges = {
        "s": (1 / rate, duration),
        "Hz": (0.0, rate / 2),
        "1": (0.0, (rate / 2 if resonance is None else min(resonance, rate / 2)) * duration),
    }
    least, most = ranges.get(entry.unit, (0.0, math.inf))
    low, high = max(entry.low, least), min(entry.high, most)
    if low <= high <= WIDEST_INTERVAL * low and least <= entry.value <= most:
        return replace(entry, low=low, high=high)
    if entry.unit in ranges:
        return replace(entry, low=0.0, high=math.inf, upper_only=True)
    return replace(entry, low=0.0, upper_only=True)


def measurable(entry: Entry, fit: Fit) -> Entry:
    """Return an upper limit of a strength that reaches measured upper limits of the variance alone, if above it. N and
    K of a filter are not those of terms, so limits within `WIDEST_INTERVAL` of the value, and infinity, stay."""
    wv = fit.wavelet_variance.without_lags
    if entry.held or not entry.upper_only or entry.high is None or not math.isfinite(entry.high):
        return entry
    terms = fit.model.by_term
    if entry.term is None and entry.symbol in _KINDS:
        kind = _KINDS[entry.symbol]
        process = kind().with_values(**{kind.parameters[0].name: 1.0})
        least = WIDEST_INTERVAL * entry.value if entry.value < entry.high else 0.0
    elif entry.term in terms:
        process, least = at_some_strength(terms[entry.term]), entry.value
    else:
        return entry
    symbol = entry.symbol.partition("[")[0].partition(" ")[0]
    number = next((n for n in process.physical(wv.rate) if n.symbol == symbol and n.signal_power), None)
    if number is None:
        return entry
    most = abs(number.value) * noise_unit(number.time_power, wv.unit)[1] * math.sqrt(strength_limit(wv, process))
    high = min(entry.high, max(least, most))
    return replace(entry, value=min(entry.value, high), high=high)
