"""Of a long signal, the samples that are enough to draw it.

Each column of dots keeps its first, least, greatest and last sample: what is drawn is what a line through all samples
would be (U. Jugel et al., *M4: a visualization-oriented time series data aggregation*, 2014).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.signals import Signal


def extremes(values: Vector, columns: int) -> NDArray[np.int64]:
    """Indices of the first, least, greatest and last of each of `columns` runs of one length, in ascending order.

    All indices where these would be no fewer.

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
class Trace:
    """A signal as it is drawn: some of its samples, and NaN where samples are missing.

    Parameters
    ----------
    seconds : (n,) array, s
        Since the first sample.
    y : (n,) array
        In the unit shown; NaN breaks the line.
    low, high : float
        The least and the greatest sample.
    mean : float
        Of all samples.
    """

    seconds: Vector
    y: Vector
    low: float
    high: float
    mean: float

    @property
    def span(self) -> float:
        """From the least sample to the greatest."""
        return self.high - self.low

    def less(self, amount: float) -> Trace:
        """The trace without a constant."""
        return Trace(self.seconds, self.y - amount, self.low - amount, self.high - amount, self.mean - amount)


def trace(signal: Signal, factor: float, columns: int) -> Trace:
    """The samples of a signal that `columns` columns of dots show, times `factor`."""
    # Counted from the first sample: a time of day in seconds since 1970 has no digits left for a microsecond.
    starts = [start - signal.starts[0] for start in signal.starts]
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
    return Trace(np.concatenate(seconds)[:-1], shown, low, high, factor * float(np.mean(signal.values)))


def _runs(signal: Signal, columns: int) -> Iterator[tuple[int, int, int]]:
    """Stretches of samples that are drawn as one line, with their shares of the columns.

    A gap that is narrower than a column has nowhere to be seen.
    """
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


def removed(one: Trace) -> float:
    """What is taken off a trace: its mean, in few digits, where zero is far from its samples; else nothing."""
    return 0.0 if one.low - one.span <= 0 <= one.high + one.span else _in_digits(one.mean, one.span)


def _in_digits(mean: float, span: float) -> float:
    """The mean to a fraction of the span: short enough to be printed, so that what is said is what is done."""
    digits = math.ceil(math.log10(abs(mean) / span)) + 2 if mean and span else 6
    return float(f"{mean:.{min(max(digits, 2), 6) - 1}e}")
