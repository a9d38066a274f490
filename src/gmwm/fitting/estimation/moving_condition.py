"""Divide a recording during which a condition changes into bins of nearly constant condition.

Coefficients whose samples are all in a bin have the variance Σ_m s_m φ̄_m ν², with the mean φ̄_m over its samples.
Levels too long for a bin come from the whole recording."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError, OptionError
from gmwm.base.time_base import begins_of, times_of
from gmwm.measuring.regression.against import HOUR_S, TIME, Against, Asked, CovariateTerm
from gmwm.measuring.regression.api import regress, without
from gmwm.measuring.regression.covariates import Covariates
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal

BINS = 8
"""Bins of equal size; a time constant that changes by 10 changes by 1.3 in one (tests/estimation/test_moving.py)."""
PARTS = 4
"""Parts of a bin for the mean curve: outer bins are wide, and the curve at their mean condition may be 2 % off, with
four parts less than 0.6 % (tests/estimation/test_moving.py)."""
SHORTEST = 16  # number of samples over which the condition is averaged before it is assigned to a bin


@dataclass(frozen=True, eq=False)
class ConditionBins:
    """Curves of a recording by condition: `conditions` of samples by bin, `parts` (bins, levels, 4, 16) of coefficients
    in ascending order, and the curve of the `whole` recording."""

    curves: tuple[WaveletVariance, ...]
    conditions: tuple[Vector, ...]
    parts: NDArray[np.float64]
    whole: WaveletVariance

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest condition."""
        return min(float(np.min(c)) for c in self.conditions), max(float(np.max(c)) for c in self.conditions)

    @property
    def shares(self) -> Vector:
        """Shares of the bins in the recording."""
        sizes = np.array([values.size for values in self.conditions], dtype=np.float64)
        return np.asarray(sizes / sizes.sum())


def condition_of(signal: Signal, condition: Against) -> tuple[CovariateTerm, Covariates, Vector]:
    """Return the condition, the regression of the mean on it, and its value at each sample."""
    conditions = Asked.of(condition)
    term = conditions.terms[0] if len(conditions.terms) == 1 else None
    arrays = dict(conditions.arrays or {})
    if term is not None and term.name == TIME:
        covariates = Covariates.of([term], {}, signal)
        begins = begins_of(signal.rate, signal.segments, signal.starts)
        return term, covariates, times_of(np.arange(len(signal)), signal.rate, signal.segments, begins) / HOUR_S
    if term is None or term.name not in arrays:
        raise OptionError(
            argument="condition", expected="one condition with its samples, such as {'temperature': values}, or 'time'",
            got=condition,
        )  # fmt: skip
    covariates = Covariates.slow(term, arrays[term.name], signal)
    smooth = covariates.clock.interpolate(covariates.smooth[term.name], 0, len(signal))
    return term, covariates, arrays[term.name] if term.exact else smooth


def divide(signal: Signal, condition: Against, *, robust: bool, efficiency: float) -> tuple[str, ConditionBins]:
    """Remove a condition's effect on the mean, and measure the bins; it must vary, and stay over 16 samples."""
    term, covariates, values = condition_of(signal, condition)
    residual = without(signal, regress(signal, covariates), covariates)
    whole = wavelet_variance(residual, robust=robust, efficiency=efficiency)
    curves, conditions, bins = [], [], _runs(signal, values)
    for runs in bins:
        chosen = np.concatenate([np.arange(a, b) for a, b in runs])
        ends = np.cumsum([0, *(b - a for a, b in runs)]).tolist()
        part = Signal(residual.values[chosen], signal.rate, signal.unit, signal.axis, segments=list(pairwise(ends)))
        curves.append(wavelet_variance(part, robust=robust, efficiency=efficiency))
        conditions.append(values[chosen])
    # As in `noise_against`, at least half of the variance of the condition must be between the bins.
    middles, shares = [float(np.mean(c)) for c in conditions], [c.size for c in conditions]
    between = np.average((np.array(middles) - np.average(middles, weights=shares)) ** 2, weights=shares)
    # A level counts in the bins if they hold half of the coefficients of the recording.
    shortest = min(len(wv) for wv in curves) if len(curves) > 1 else 0
    counts = np.sum([wv.counts[:shortest] for wv in curves], axis=0)
    levels = int(np.count_nonzero(2 * counts >= whole.counts[:shortest])) if shortest else 0
    if levels == 0 or between < 0.5 * np.var(values):
        raise DataError(
            f"{term.name} changes too quickly: it leaves each of {BINS} bins within a few samples", argument="against",
            advice="Record slower changes, or recordings at constant conditions.",
        )  # fmt: skip
    parts = np.array([[_quantiles(values, runs, 1 << j) for j in range(1, levels + 1)] for runs in bins])
    return term.name, ConditionBins(tuple(wv.first(levels) for wv in curves), tuple(conditions), parts, whole)


def _quantiles(values: Vector, runs: list[tuple[int, int]], width: int) -> NDArray[np.float64]:
    """Return quantiles (4, 16) of the conditions of coefficients of `width` samples, by their numbers: long ones are
    only in long stays, further inside a bin."""
    long = [(a, b) for a, b in runs if b - a >= width]
    conditions = np.concatenate([values[a:b] for a, b in long])
    weights = []
    for a, b in long:
        place = np.arange(1, b - a + 1)
        weights.append(np.minimum(np.minimum(place, place[::-1]), min(width, b - a - width + 1)))
    order = np.argsort(conditions)
    cumulative = np.cumsum(np.concatenate(weights)[order])
    count = PARTS * 16  # 16 conditions represent a part
    place = np.searchsorted(cumulative, (np.arange(count) + 0.5) / count * cumulative[-1])
    return np.asarray(conditions[order[place]].reshape(PARTS, -1))


def _runs(signal: Signal, values: Vector) -> list[list[tuple[int, int]]]:
    """Return the ranges of samples of each bin with samples. The bins have equal shares of the recording."""
    parts = [np.arange(a, b - SHORTEST + 1, SHORTEST) for a, b in signal.segments]
    starts, segment = np.concatenate(parts), np.repeat(np.arange(len(parts)), [part.size for part in parts])
    means = np.array([np.mean(values[a : a + SHORTEST]) for a in starts])
    edges = np.unique(np.quantile(means, np.linspace(0, 1, BINS + 1)[1:-1])) if means.size else means
    place = np.searchsorted(edges, means)
    bins = []
    for k in np.unique(place):
        first = starts[place == k]
        breaks = np.flatnonzero((np.diff(first) != SHORTEST) | (np.diff(segment[place == k]) != 0)) + 1
        bins.append([(int(run[0]), int(run[-1]) + SHORTEST) for run in np.split(first, breaks)])
    return bins
