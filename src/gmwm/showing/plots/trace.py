"""Reduction of a long signal to the samples that its plot needs: first, smallest, largest and last by column, which
look like all (U. Jugel et al., *M4: a visualization-oriented time series data aggregation*, 2014)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gmwm.base.arrays import Booleans, Integers, Vector
from gmwm.base.time_base import begins_of
from gmwm.recording.signals import Signal
from gmwm.showing.plots.figure import Polyline, Stroke


def extremes(values: Vector, columns: int) -> Integers:
    """Return sorted indices of the first, smallest, largest and last value of each of `columns` parts, or all.

    >>> extremes(np.array([0.0, 5.0, 1.0, -3.0, 2.0, 2.0, 2.0, 2.0, 9.0, 2.0]), 2)
    array([0, 1, 3, 4, 5, 8, 9])
    """
    n = values.size
    if n <= 4 * columns:
        return np.arange(n)
    edges = np.linspace(0, n, columns + 1).astype(np.int64)
    inner = [
        (a + int(np.argmin(values[a:b])), a + int(np.argmax(values[a:b])))
        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ]
    return np.unique(np.concatenate([edges[:-1], edges[1:] - 1, np.array(inner).ravel()]))


@dataclass(frozen=True, eq=False)
class Outline:
    """The samples of a signal that are drawn, with a NaN in each gap."""

    seconds: Vector  # (n,) times since the first sample
    y: Vector  # (n,) values in the unit of the plot; NaN interrupts the line
    # the smallest and the largest value of `y`
    low: float
    high: float
    mean: float  # mean of all samples; their median if samples are clipped
    # whether samples below `low`, and samples above `high`, were clipped to these limits, for example after a knock
    clipped: tuple[bool, bool] = (False, False)

    @property
    def span(self) -> float:
        """Difference between `high` and `low`."""
        return self.high - self.low

    def less(self, amount: float) -> Outline:
        """Return the trace with the constant `amount` subtracted from all values."""
        return Outline(
            self.seconds, self.y - amount, low=self.low - amount, high=self.high - amount, mean=self.mean - amount,
            clipped=self.clipped,
        )  # fmt: skip

    def beyond(self) -> tuple[Booleans, Booleans]:
        """Return a mask of the samples that were clipped at `high`, and a mask of those clipped at `low`."""
        below, above = self.clipped
        return above & (self.y >= self.high), below & (self.y <= self.low)


def trace(signal: Signal, factor: float, columns: int, left: float = 0.0, *, clip: bool = False) -> Outline:
    """Reduce a signal to a plot's trace, with values times `factor`, from the time `left` (s); `clip` limits samples
    far from nearly all others, so that a knock does not flatten the plot."""
    # Times are measured from the first sample, because seconds since 1970 do not resolve a microsecond in doubles.
    starts = [left + begin for begin in begins_of(signal.rate, signal.segments, signal.starts)]
    clock = Signal(signal.values, signal.rate, segments=signal.segments, starts=starts)
    seconds: list[Vector] = []
    y: list[Vector] = []
    for start, stop, share in _runs(signal, columns):
        index = start + extremes(signal.values[start:stop], share)
        times = clock.times(index)
        seconds += [times, times[-1:]]
        y += [factor * signal.values[index], np.array([math.nan])]
    shown: Vector = np.concatenate(y)[:-1]
    low, high = float(np.nanmin(shown)), float(np.nanmax(shown))
    if clip:
        few = factor * signal.values[:: max(1, signal.values.size // 100_000)]  # quantiles of all would take longer
        # The limits ignore the smallest and the largest 0.5 % of the samples, and are two spans of the others away, so
        # that Gaussian noise is clipped only beyond 12 standard deviations (tests/plots/test_plot_series.py).
        first, middle, last = (float(x) for x in np.quantile(few, (0.005, 0.5, 1 - 0.005)))
        least, most = first - 2.0 * (last - first), last + 2.0 * (last - first)
        if last > first and (low < least or high > most):
            return Outline(
                np.concatenate(seconds)[:-1], np.clip(shown, least, most), low=max(low, least), high=min(high, most),
                mean=middle, clipped=(low < least, high > most),
            )  # fmt: skip
    return Outline(np.concatenate(seconds)[:-1], shown, low=low, high=high, mean=factor * float(np.mean(signal.values)))


def even_trace(values: Vector, rate: float, factor: float, columns: int) -> Outline:
    """Reduce evenly sampled values, with NaN for missing samples, to the trace for a plot with `columns` columns."""
    index = extremes_there(values, columns)
    y = factor * values[index]
    mean = factor * float(np.mean(values, where=np.isfinite(values)))
    return Outline(index / rate, y, low=float(np.nanmin(y)), high=float(np.nanmax(y)), mean=mean)


def extremes_there(values: Vector, columns: int) -> Integers:
    """Return indices like `extremes`, but ignore NaN. A part with NaN only has one index, which interrupts the line.

    >>> extremes_there(np.array([0.0, 5.0, 1.0, np.nan, np.nan, np.nan, np.nan, np.nan, 9.0, 2.0]), 2)
    array([0, 1, 2, 8, 9])
    >>> extremes_there(np.array([0.0, 5.0, 1.0, 4.0, 2.0, *6 * [np.nan], 7.0, 8.0, 6.0, 7.0]), 3)
    array([ 0,  1,  4,  5, 11, 12, 13, 14])
    """
    n, finite = values.size, np.isfinite(values)
    if n <= 4 * columns or np.all(finite):
        return extremes(values, columns)
    least, greatest = np.where(finite, values, math.inf), np.where(finite, values, -math.inf)
    indices: list[int] = []
    for a, b in pairwise(np.linspace(0, n, columns + 1).astype(np.int64).tolist()):
        run = finite[a:b]
        if not np.any(run):
            indices.append(a)
            continue
        first, last = a + int(np.argmax(run)), b - 1 - int(np.argmax(run[::-1]))
        indices += [first, a + int(np.argmin(least[a:b])), a + int(np.argmax(greatest[a:b])), last]
    return np.unique(np.array(indices, dtype=np.int64))


def envelope(lower: Vector, upper: Vector, columns: int) -> tuple[Vector, Vector, Vector]:
    """Reduce a band to sample numbers, smallest lower and largest upper edges of `columns` parts; NaN without finite
    ones.

    >>> envelope(np.array([0.0, -1.0, 2.0, 3.0]), np.array([1.0, 2.0, np.inf, 5.0]), 2)
    (array([0., 3.]), array([-1.,  3.]), array([2., 5.]))
    """
    n, finite = lower.size, np.isfinite(lower) & np.isfinite(upper)
    low, high = np.where(finite, lower, math.nan), np.where(finite, upper, math.nan)
    if n <= columns:
        return np.arange(float(n)), low, high
    starts = np.linspace(0, n, columns + 1).astype(np.int64)[:-1]
    # A part is narrower than a visible dot, so its position may be shifted so that the band reaches both ends.
    return np.linspace(0.0, n - 1.0, columns), np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


def lone_values(y: Vector) -> Booleans:
    """Return a mask of the finite values whose neighbours are missing, so that a line cannot show these values.

    >>> lone_values(np.array([1.0, np.nan, 2.0, 3.0])).tolist()
    [True, False, False, False]
    """
    finite = np.concatenate([[False], np.isfinite(y), [False]])
    return np.asarray(finite[1:-1] & ~finite[:-2] & ~finite[2:])


def lone_dots(x: Vector, y: Vector, colour: str, layer: int) -> tuple[Polyline, ...]:
    """Return symbols at the lone_values values of a line; nothing if there are none."""
    alone = lone_values(y)
    dots = Polyline(x[alone], y[alone], stroke=Stroke(colour, 0.0, symbol="circle"), layer=layer)
    return (dots,) if np.any(alone) else ()


def _runs(signal: Signal, columns: int) -> Iterator[tuple[int, int, int]]:
    """Yield ranges drawn as one line (start, stop, columns), across gaps narrower than a column."""
    ends = [start + (b - a) / signal.rate for start, (a, b) in zip(signal.starts, signal.segments, strict=True)]
    total = max(ends) - min(signal.starts)
    first, opened = 0, signal.starts[0]
    for k, (_, stop) in enumerate(signal.segments):
        follows = k + 1 < len(signal.segments)
        if follows and 0 <= signal.starts[k + 1] - ends[k] < total / columns:
            continue
        yield first, stop, max(1, round(columns * (ends[k] - opened) / total))
        if follows:
            first, opened = stop, signal.starts[k + 1]


def offset_of(samples: Outline) -> float:
    """Return the constant to subtract from a trace: its rounded mean if all samples are far from zero, otherwise 0."""
    near_zero = samples.low - samples.span <= 0 <= samples.high + samples.span
    return 0.0 if near_zero else in_digits(samples.mean, samples.span)


def in_digits(mean: float, span: float) -> float:
    """Round a mean to few digits, small against `span`, so that a title can state the subtracted constant."""
    digits = math.ceil(math.log10(abs(mean) / span)) + 2 if mean and span else 6
    return float(f"{mean:.{min(max(digits, 2), 6) - 1}e}")
