"""Mean rise per sample over a whole recording with gaps, from the samples and their times."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Integers, Vector
from gmwm.recording.signals import Signal


class RiseSums(NamedTuple):
    """Sums for the least-squares slope of samples at times t (sampling intervals): means t̄ and x̄, `times2` Σ (t −
    t̄)², `product` Σ (t − t̄)(x − x̄); `known` is 1 if times are known and in order."""

    number: float = 0.0
    time: float = 0.0
    value: float = 0.0
    times2: float = 0.0
    product: float = 0.0
    known: float = 1.0

    @classmethod
    def of(cls, signal: Signal) -> RiseSums:
        """Compute the sums of a signal."""
        sums = cls()
        for values, start in zip(signal.segment_values(), signal.starts, strict=True):
            sums = sums.followed_by(_of_segment(values, start * signal.rate))
        return sums if signal.gaps_known or len(signal.segments) == 1 else sums._replace(known=0.0)

    def followed_by(self, later: RiseSums) -> RiseSums:
        """Return the sums over these samples and later samples."""
        if not self.number or not later.number:
            return later if later.number else self
        number, apart = self.number + later.number, later.time - self.time
        share, step = later.number / number, later.value - self.value
        return RiseSums(
            number=number, time=self.time + share * apart, value=self.value + share * step,
            times2=self.times2 + later.times2 + self.number * share * apart**2,
            product=self.product + later.product + self.number * share * apart * step,
            known=float(self.known and later.known and apart > 0),
        )  # fmt: skip

    def slope(self) -> float | None:
        """Return the rise per sample; None if the times are not known."""
        return self.product / self.times2 if self.known and self.times2 > 0 else None


def _of_segment(values: Vector, time: float) -> RiseSums:
    middle, mean = 0.5 * (values.size - 1), float(values.mean())
    product = float(np.dot(np.arange(values.size) - middle, values - mean))
    times2 = values.size * (values.size**2 - 1.0) / 12
    return RiseSums(number=values.size, time=time + middle, value=mean, times2=times2, product=product)


MOST_STORED = 8192  # Largest number of stored values. If there are more, every second value is dropped.
ROW_VALUES = 256
_ROW_SUMS = np.column_stack([np.arange(ROW_VALUES, dtype=np.float64), np.ones(ROW_VALUES)])


@dataclass(frozen=True, eq=False)
class ThinnedValues:
    """Every 2^k-th value of a recording, from index `first` on; `every` is their distance (samples)."""

    every: int = 1
    first: int = 0
    values: Vector = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of(cls, x: Vector, start: int) -> ThinnedValues:
        """Return the thinned values of a part that begins with sample `start`."""
        every = 1 << max(0, (x.size // MOST_STORED).bit_length() - 1)
        before = -start % every
        return cls(every, start + before, x[before::every].copy())._thin(every)

    def join(self, later: ThinnedValues) -> ThinnedValues:
        """Return the thinned values of this part and the part that directly follows it."""
        every = max(self.every, later.every)
        a, b = self._thin(every), later._thin(every)
        first = a.first if a.values.size else b.first
        return ThinnedValues(every, first, np.concatenate([a.values, b.values]))._thin(every)

    def _thin(self, every: int) -> ThinnedValues:
        """Keep every `every`-th sample, and fewer if more than `MOST_STORED` values remain."""
        first, values, distance = self.first, self.values, self.every
        while distance < every or values.size > MOST_STORED:
            odd = first // distance % 2
            first, values, distance = first + odd * distance, values[odd::2].copy(), 2 * distance
        return ThinnedValues(distance, first, values)

    def winsorised_rise(self, start: int, lengths: tuple[int, ...]) -> WinsorisedRise:
        """Return the mean rise of the second pass for segments of `lengths`, with clipping limits from these values."""
        middle = float(np.median(self.values)) if self.values.size else 0.0
        spread = float(np.median(np.abs(self.values - middle))) if self.values.size else 0.0
        sizes = np.array(lengths, dtype=np.float64)
        edges = start + np.cumsum([0, *lengths])
        # Least squares in each segment, weighted by the squares of the segment lengths.
        with np.errstate(divide="ignore", invalid="ignore"):
            weights = np.where(sizes > 1, 12.0 * sizes / (sizes**2 - 1.0), 0.0) / np.sum(sizes[sizes > 1] ** 2)
        # Values are clipped at 10 median absolute deviations from the median.
        return WinsorisedRise(middle, 10.0 * spread if spread > 0 else np.inf, edges, weights)


@dataclass(frozen=True, eq=False)
class WinsorisedRise:
    """Weights and limits (`middle` ± `reach`) of the mean rise, added by parts in any order; `edges` (S + 1,) of
    segments, and `weights` (S,) of Σ (t − t_m) x_t with the segment's middle t_m."""

    middle: float
    reach: float
    edges: Integers
    weights: Vector

    def rise(self, x: Vector, start: int) -> float:
        """Return the contribution to the mean rise of samples of one segment from index `start` on."""
        k = int(np.searchsorted(self.edges, start, side="right")) - 1
        if not 0 <= k < self.weights.size:
            return 0.0  # more samples than in the first pass
        values = x - self.middle
        np.clip(values, -self.reach, self.reach, out=values)
        # Process row by row to compute the sums of x and of t x in one pass.
        rows = values[: values.size // ROW_VALUES * ROW_VALUES].reshape(-1, ROW_VALUES) @ _ROW_SUMS
        remainder = values[rows.shape[0] * ROW_VALUES :]
        total = float(rows[:, 1].sum()) + float(remainder.sum())
        moment = float(rows[:, 0].sum() + ROW_VALUES * (np.arange(rows.shape[0], dtype=np.float64) @ rows[:, 1]))
        moment += float(np.arange(x.size - remainder.size, x.size, dtype=np.float64) @ remainder)
        begin = float(start - self.edges[k]) - 0.5 * (float(self.edges[k + 1] - self.edges[k]) - 1.0)
        return float(self.weights[k]) * (moment + begin * total)
