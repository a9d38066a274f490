"""Sums that a second pass collects: biweight sums near the robust variance, and counts around the median."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector

LEAST_OMITTED_BITS = 8
"""Smallest number of low-order bits that a cell omits. A cell is therefore at least 2^-44 of the value wide."""
MOST_CELLS = 1 << 17
"""Largest number of cells of a level."""


@dataclass(frozen=True, eq=False)
class MedianCells:
    """Counts of |W| in narrow cells around the median, as fine as their maximum number allows; merged in any order. A
    cell has all numbers with the same leading bits: `shift` low-order bits are omitted. `cells` are the leading bits in
    ascending order, and `counts` the numbers of |W|."""

    shift: int = LEAST_OMITTED_BITS
    cells: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def of(cls, sizes: Vector) -> MedianCells:
        """Count nonnegative numbers in cells."""
        return cls(
            LEAST_OMITTED_BITS, *np.unique(sizes.view(np.int64) >> LEAST_OMITTED_BITS, return_counts=True)
        )._few()

    def merge(self, other: MedianCells) -> MedianCells:
        """Add the counts of two sets of coefficients."""
        if not other.cells.size:
            return self
        shift = max(self.shift, other.shift)
        a, b = self._coarsen(shift), other._coarsen(shift)
        places = np.searchsorted(a.cells, b.cells)
        shared = places < a.cells.size
        shared[shared] = a.cells[places[shared]] == b.cells[shared]
        counts = a.counts.copy()
        counts[places[shared]] += b.counts[shared]
        cells = np.insert(a.cells, places[~shared], b.cells[~shared])
        return MedianCells(shift, cells, np.insert(counts, places[~shared], b.counts[~shared]))._few()

    def _few(self) -> MedianCells:
        """Widen the cells until there are at most `MOST_CELLS`."""
        cells = self
        while cells.cells.size > MOST_CELLS:
            cells = cells._coarsen(cells.shift + 1)
        return cells

    def _coarsen(self, shift: int) -> MedianCells:
        """Return the counts in cells that omit `shift` bits."""
        if shift == self.shift or not self.cells.size:
            return MedianCells(shift, self.cells, self.counts)
        cells = self.cells >> (shift - self.shift)
        firsts = np.flatnonzero(np.diff(cells, prepend=-1))
        return MedianCells(shift, cells[firsts], np.add.reduceat(self.counts, firsts))

    def at(self, ranks: NDArray[np.int64]) -> Vector | None:
        """Return the |W| of these ranks, counted from 0 in ascending order; None if a rank is out of range."""
        ends = np.cumsum(self.counts)
        if not self.cells.size or ranks.min() < 0 or ranks.max() >= ends[-1]:
            return None
        k = np.searchsorted(ends, ranks, side="right")
        inside = (ranks - (ends[k] - self.counts[k]) + 0.5) / self.counts[k]
        bits = (self.cells[k] << self.shift) + (inside * 2.0**self.shift).astype(np.int64)
        return np.asarray(bits.view(np.float64))


@dataclass(frozen=True, eq=False)
class LevelSums:
    """Sums and counts over a set of coefficients of one level. `cubed` and `fourth` are Σ v q³ and Σ v q⁴ (see
    `Biweight.criterion`) at the limit (cσ)² of the level, `below` and `inside` the counts of |W| below and in the
    bracket of the median, and `sizes` all |W| of a level with few of them."""

    cubed: float = 0.0
    fourth: float = 0.0
    below: int = 0
    inside: MedianCells = field(default_factory=MedianCells)
    sizes: Vector = field(default_factory=lambda: np.empty(0))

    def merge(self, other: LevelSums) -> LevelSums:
        """Add the sums of two sets of coefficients."""
        sizes = np.concatenate([self.sizes, other.sizes]) if other.sizes.size else self.sizes
        return LevelSums(
            self.cubed + other.cubed, self.fourth + other.fourth, below=self.below + other.below,
            inside=self.inside.merge(other.inside), sizes=sizes,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class SecondPassSums:
    """Sums of all levels."""

    levels: tuple[LevelSums, ...] = ()

    def merge(self, other: SecondPassSums) -> SecondPassSums:
        """Add the sums of two sets of coefficients level by level."""
        return SecondPassSums(
            tuple(a.merge(b) for a, b in zip_longest(self.levels, other.levels, fillvalue=LevelSums()))
        )


@dataclass(frozen=True, eq=False)
class SumRequest:
    """Specification of the sums that the second pass collects at each level (J,); it is a `StatisticsCollector`.
    `limits` has (cσ)² for the sums, or 0 for none. `low` and `high` are the bracket of the median of |W|; `high` is 0
    without a bracket. `kept` tells whether all |W| of a level are stored."""

    limits: Vector
    low: Vector
    high: Vector
    kept: NDArray[np.bool_]
    squares = False

    def haar(self, running_sum: Vector, levels: int, begin: int) -> SecondPassSums:
        """Compute the sums over the coefficients of levels 1 … `levels` that end at sample `begin` or later."""
        reach = min(levels, (running_sum.size - 1).bit_length() - 1, self.limits.size)
        if reach < 1:
            return SecondPassSums()
        cubed = fourth = np.zeros(reach)
        if np.any(self.limits[:reach] > 0):
            cubed, fourth, _ = _core.haar_biweight_sums(running_sum, self.limits[:reach].copy(), 1, begin)
        sums = []
        for k in range(reach):
            # A coefficient of level j that ends at `begin` starts 2^j − 1 samples earlier.
            part = running_sum[max(begin + 1 - (2 << k), 0) :]
            sums.append(LevelSums(float(cubed[k]), float(fourth[k]), *self._sizes(part, k)))
        return SecondPassSums(tuple(sums))

    def across(self, running_sum: Vector, level: int) -> SecondPassSums:
        """Compute the sums over all coefficients of one level of a running sum."""
        k = level - 1
        if k >= self.limits.size:
            return SecondPassSums()
        cubed = fourth = 0.0
        if self.limits[k] > 0:
            alone = np.zeros(level)
            alone[k] = self.limits[k]
            sums = _core.haar_biweight_sums(running_sum, alone, 1)
            cubed, fourth = float(sums[0][k]), float(sums[1][k])
        return self.at(level, LevelSums(cubed, fourth, *self._sizes(running_sum, k)))

    def values(self, coefficients: Vector, level: int) -> LevelSums:
        """Compute the sums over an array of coefficients of one level."""
        k = level - 1
        if k >= self.limits.size or not coefficients.size:
            return LevelSums()
        limit, sizes = float(self.limits[k]), np.abs(coefficients)
        cubed, fourth = _core.biweight_sums(sizes, limit) if limit > 0 else (0.0, 0.0)
        below, inside = 0, MedianCells()
        if self.high[k] > 0:
            below = int(np.count_nonzero(sizes <= self.low[k]))
            inside = MedianCells.of(sizes[(sizes > self.low[k]) & (sizes <= self.high[k])])
        return LevelSums(cubed, fourth, below=below, inside=inside, sizes=sizes if self.kept[k] else np.empty(0))

    def at(self, level: int, part: LevelSums, resolution: float = 0.0) -> SecondPassSums:
        """Return the sums of all levels, with `part` at `level` and empty sums at lower levels; `resolution` has no
        effect."""
        return SecondPassSums((*(LevelSums() for _ in range(level - 1)), part))

    def empty(self) -> SecondPassSums:
        """Return the sums over no coefficients."""
        return SecondPassSums()

    def _sizes(self, running_sum: Vector, k: int) -> tuple[int, MedianCells, Vector]:
        """Return the number of |W| below the bracket, the counts in the bracket, and all |W| if they are stored."""
        below, inside, sizes = 0, MedianCells(), np.empty(0)
        if running_sum.size > 2 << k:
            if self.high[k] > 0:
                below, between = _core.haar_between(running_sum, k + 1, float(self.low[k]), float(self.high[k]))
                inside = MedianCells.of(between)
            if self.kept[k]:
                sizes = _core.haar_sample(running_sum, k + 1, running_sum.size)
        return below, inside, sizes
