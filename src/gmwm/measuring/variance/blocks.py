"""Block sums of a segment of samples, from which the coefficients of large scales are computed; 64 blocks per scale.

Block k of a step s has the samples k s … (k + 1) s − 1, counted from the beginning of the whole recording. Two
consecutive segments therefore have the same blocks as their union.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.measuring.variance.coefficients import haar_resolution


class LevelStatistic(Protocol):
    """Statistic of some coefficients of one level. Statistics can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistic of the coefficients of `self` and `other` together."""


class Statistics(Protocol):
    """Statistics of the coefficients of all levels. They can be merged in any order and grouping."""

    def merge(self, other: Any, /) -> Any:
        """Return the statistics of the coefficients of `self` and `other` together."""


class StatisticsCollector(Protocol):
    """Object that computes statistics of wavelet coefficients; `squares` tells whether Σ W² is needed too."""

    squares: bool

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Statistics:
        """Return the statistics of the coefficients of levels 1 … `levels` that end at sample `begin` or after."""

    def across(self, running_sum: Vector, level: int) -> Statistics:
        """Return the statistics of all coefficients of one level of a running sum."""

    def values(self, coefficients: Vector, level: int) -> LevelStatistic:
        """Return the statistic of an array of coefficients of one level, which can be empty."""

    def at(self, level: int, part: Any, resolution: float) -> Statistics:
        """Return the statistics of all levels, with `part` at `level`; |W| up to `resolution` can be rounding
        errors."""

    def empty(self) -> Statistics:
        """Return the statistics of no coefficients."""


BLOCKS_OF_SCALE = 64
"""Number of blocks per scale τ. Coefficients are computed at every τ/64-th sample."""
_KEPT = BLOCKS_OF_SCALE - 1


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of `step` = τ/64 samples in a segment, with the sum of the squared coefficients. `first` and `last` are
    the indices of the first complete block and of the end; last < first if the segment contains no multiple of the
    step. `before` and `after` are the sums of the samples outside these blocks (`before` of all if last < first),
    `heads` and `tails` those in the first and the last 63 blocks. `squares` and `count` are the sum of (sum of 32
    blocks − sum of the 32 preceding blocks)² and its number of terms, `total` and `moment` are Σ b_k and Σ (k − first)
    b_k over the sums b_k. `part` are further statistics of the coefficients W, and `resolution` is the largest |W| that
    can be a rounding error."""

    step: int
    first: int
    last: int
    before: float
    after: float = 0.0
    heads: Vector = field(default_factory=lambda: np.empty(0))
    tails: Vector = field(default_factory=lambda: np.empty(0))
    squares: float = 0.0
    count: int = 0
    total: float = 0.0
    moment: float = 0.0
    part: LevelStatistic | None = None
    resolution: float = 0.0

    @property
    def open(self) -> bool:
        """Whether the segment contains no multiple of the step."""
        return self.last < self.first

    def followed_by(self, later: Blocks, collector: StatisticsCollector | None = None) -> Blocks:
        """Combine the blocks of this segment and the segment that directly follows it."""
        if later.open:
            if self.open:
                return replace(self, before=self.before + later.before)
            return replace(self, after=self.after + later.before)
        if self.open:
            return replace(later, before=self.before + later.before)
        # If the boundary is not a multiple of the step, the remainders before and after it form one block.
        middle = [] if self.last == later.first else [self.after + later.before]
        joint = np.concatenate([self.tails, middle, later.heads])
        squares, count, part, resolution = block_statistics(joint, self.step, collector)
        if part is not None and self.part is not None and later.part is not None:
            part = self.part.merge(later.part).merge(part)
        heads, tails = self.heads, later.tails
        if heads.size < _KEPT:
            heads = np.concatenate([heads, middle, later.heads])[:_KEPT]
        if tails.size < _KEPT:
            tails = np.concatenate([self.tails, middle, tails])[-_KEPT:]
        return Blocks(
            step=self.step, first=self.first, last=later.last, before=self.before, after=later.after, heads=heads,
            tails=tails, squares=self.squares + later.squares + squares, count=self.count + later.count + count,
            total=self.total + sum(middle) + later.total,
            moment=self.moment
            + sum(middle) * (self.last - self.first)
            + later.moment
            + later.total * (later.first - self.first),
            part=part, resolution=max(self.resolution, later.resolution, resolution),
        )  # fmt: skip

    @property
    def rise(self) -> float | None:
        """Least-squares estimate of the rise per sample from the block means; None for fewer than two blocks."""
        n = self.last - self.first
        if n < 2:
            return None
        about = self.moment - 0.5 * (n - 1) * self.total
        return about / (n * (n * n - 1.0) / 12.0) / self.step**2

    def numbers(self) -> list[float]:
        """Return the numbers that `restored` needs besides the sums of the blocks."""
        return [
            self.first, self.last, self.before, self.after, self.squares, self.count, self.total, self.moment,
            self.heads.size,
        ]  # fmt: skip

    @classmethod
    def restore(cls, step: int, numbers: list[float], heads: Vector, tails: Vector) -> Blocks:
        """Restore the blocks from the output of `numbers` and the sums of the first and last blocks."""
        first, last, before, after, squares, count, total, moment, _ = numbers
        return cls(
            step=step, first=int(first), last=int(last), before=before, after=after, heads=heads.copy(),
            tails=tails.copy(), squares=squares, count=int(count), total=total, moment=moment,
        )  # fmt: skip

    def shift(self, offset: float, start: int, stop: int) -> Blocks:
        """Return the blocks of the segment from `start` to `stop` with `offset` added to every sample."""
        if self.open:
            return replace(self, before=self.before + offset * (stop - start))
        s, n = self.step, self.last - self.first
        return replace(
            self, before=self.before + offset * (self.first * s - start),
            after=self.after + offset * (stop - self.last * s), heads=self.heads + offset * s,
            tails=self.tails + offset * s, total=self.total + offset * s * n,
            moment=self.moment + offset * s * (n * (n - 1) / 2),
        )  # fmt: skip


def block_statistics(
    blocks: Vector, step: int, collector: StatisticsCollector | None
) -> tuple[float, int, LevelStatistic | None, float]:
    """Compute `squares`, `count`, `part` and `resolution` of `Blocks` from the sums of consecutive blocks."""
    count = blocks.size - BLOCKS_OF_SCALE + 1
    if count < 1:
        return 0.0, 0, _empty(collector, step), 0.0
    half = BLOCKS_OF_SCALE // 2
    sums = np.concatenate([[0.0], np.cumsum(blocks - blocks.mean())])
    w = sums[BLOCKS_OF_SCALE:] - 2.0 * sums[half:-half] + sums[:-BLOCKS_OF_SCALE]
    if collector is None:
        return float(w @ w), count, None, 0.0
    level = _level(step)
    # The same bound as for a running sum of samples of which only the last value of each block is known.
    resolution = haar_resolution(float(np.abs(sums).max()), level)
    return float(w @ w), count, collector.values(np.ldexp(w, -level), level), resolution


def _level(step: int) -> int:
    return (BLOCKS_OF_SCALE * step).bit_length() - 1


def _empty(collector: StatisticsCollector | None, step: int) -> LevelStatistic | None:
    return None if collector is None else collector.values(np.empty(0), _level(step))


def blocks_of(
    sums: Vector, start: int, stop: int, *, steps: list[int], collector: StatisticsCollector | None = None
) -> list[Blocks]:
    """Build the blocks of samples for each step, a power of two times the first one, from sums before its multiples and
    of all samples."""
    base, first, total = steps[0], -(-start // steps[0]), float(sums[-1])
    marks = sums[:-1]
    return [
        _of(
            step, start, stop=stop, marks=marks[(-first) % (step // base) :: step // base], total=total,
            collector=collector,
        )
        for step in steps
    ]  # fmt: skip


def _of(step: int, start: int, stop: int, marks: Vector, total: float, collector: StatisticsCollector | None) -> Blocks:
    """Build the blocks of one step from `marks`, the sums of all samples before each multiple of the step."""
    first, last = -(-start // step), stop // step
    if first > last:
        return Blocks(step, first, last, total, part=_empty(collector, step))
    blocks = np.diff(marks)
    squares, count, part, resolution = block_statistics(blocks, step, collector)
    return Blocks(
        step=step, first=first, last=last, before=float(marks[0]), after=total - float(marks[-1]),
        heads=blocks[:_KEPT].copy(), tails=blocks[-_KEPT:].copy(), squares=squares, count=count,
        total=float(blocks.sum()), moment=float(np.arange(blocks.size) @ blocks), part=part, resolution=resolution,
    )  # fmt: skip
