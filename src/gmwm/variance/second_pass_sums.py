"""What a second pass takes of coefficients: sums near the robust variance, and what lies around the median."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from gmwm import _core
from gmwm._arrays import Vector

FINEST = 8
"""Bits of a number that a cell leaves out at the least: cells of 2^-44 of its size."""
MOST = 1 << 17
"""Cells of a level, at the most."""


@dataclass(frozen=True, eq=False)
class Cells:
    """How many of some sizes lie in each of narrow cells, which are as fine as their number allows.

    A cell is told by the leading bits of a number. How a set is cut before it is counted changes nothing.

    Attributes
    ----------
    shift : int
        Bits that a cell leaves out.
    cells, counts : (n,) arrays
        Leading bits in rising order, and how many sizes have them.
    """

    shift: int = FINEST
    cells: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    @classmethod
    def of(cls, sizes: Vector) -> Cells:
        """Those of an array of numbers, none of them less than 0."""
        return cls(FINEST, *np.unique(sizes.view(np.int64) >> FINEST, return_counts=True))._few()

    def merge(self, other: Cells) -> Cells:
        """Those of both."""
        if not other.cells.size:
            return self
        shift = max(self.shift, other.shift)
        one, two = self._shifted(shift), other._shifted(shift)
        places = np.searchsorted(one.cells, two.cells)
        known = places < one.cells.size
        known[known] = one.cells[places[known]] == two.cells[known]
        counts = one.counts.copy()
        counts[places[known]] += two.counts[known]
        cells = np.insert(one.cells, places[~known], two.cells[~known])
        return Cells(shift, cells, np.insert(counts, places[~known], two.counts[~known]))._few()

    def _few(self) -> Cells:
        """In cells so wide that there are not too many."""
        made = self
        while made.cells.size > MOST:
            made = made._shifted(made.shift + 1)
        return made

    def _shifted(self, shift: int) -> Cells:
        """In cells that leave out so many bits."""
        if shift == self.shift or not self.cells.size:
            return Cells(shift, self.cells, self.counts)
        cells = self.cells >> (shift - self.shift)
        firsts = np.flatnonzero(np.diff(cells, prepend=-1))
        return Cells(shift, cells[firsts], np.add.reduceat(self.counts, firsts))

    def at(self, ranks: NDArray[np.int64]) -> Vector | None:
        """The sizes of these ranks, from 0 in rising order; None where there are not so many."""
        ends = np.cumsum(self.counts)
        if not self.cells.size or ranks.min() < 0 or ranks.max() >= ends[-1]:
            return None
        k = np.searchsorted(ends, ranks, side="right")
        inside = (ranks - (ends[k] - self.counts[k]) + 0.5) / self.counts[k]
        bits = (self.cells[k] << self.shift) + (inside * 2.0**self.shift).astype(np.int64)
        return np.asarray(bits.view(np.float64))


@dataclass(frozen=True, eq=False)
class Found:
    """What was taken of some coefficients of one level.

    Attributes
    ----------
    cubed, fourth : float
        Σ v q³ and Σ v q⁴ at the level's limit.
    below : int
        How many |W| lie below the level's bracket.
    inside : Cells
        Those that lie in it.
    sizes : (n,) array
        |W|, of a level that has so few that all are kept.
    """

    cubed: float = 0.0
    fourth: float = 0.0
    below: int = 0
    inside: Cells = field(default_factory=Cells)
    sizes: Vector = field(default_factory=lambda: np.empty(0))

    def merge(self, other: Found) -> Found:
        """That of the coefficients of both."""
        sizes = np.concatenate([self.sizes, other.sizes]) if other.sizes.size else self.sizes
        return Found(
            self.cubed + other.cubed,
            self.fourth + other.fourth,
            below=self.below + other.below,
            inside=self.inside.merge(other.inside),
            sizes=sizes,
        )


@dataclass(frozen=True, eq=False)
class Finds:
    """What was taken of all levels."""

    levels: tuple[Found, ...] = ()

    def merge(self, other: Finds) -> Finds:
        """That of the coefficients of both, level by level."""
        return Finds(tuple(a.merge(b) for a, b in zip_longest(self.levels, other.levels, fillvalue=Found())))


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is to be taken of each level's coefficients.

    Attributes
    ----------
    limits : (J,) array
        (cσ)² at which the sums are taken; 0 where none are.
    low, high : (J,) arrays
        The bracket of the median; high is 0 where there is none.
    kept : (J,) array of bool
        Whether all |W| are kept.
    """

    limits: Vector
    low: Vector
    high: Vector
    kept: NDArray[np.bool_]
    squares = False

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Finds:
        """Of all levels, all sums in one pass."""
        reach = min(levels, (running_sum.size - 1).bit_length() - 1, self.limits.size)
        if reach < 1:
            return Finds()
        cubed = fourth = np.zeros(reach)
        if np.any(self.limits[:reach] > 0):
            cubed, fourth, _ = _core.haar_biweight_sums(running_sum, self.limits[:reach].copy(), 1, begin)
        found = []
        for k in range(reach):
            # Of a coefficient of level j that ends at `begin` the first sample lies 2^j − 1 before.
            part = running_sum[max(begin + 1 - (2 << k), 0) :]
            found.append(Found(float(cubed[k]), float(fourth[k]), *self._sizes(part, k)))
        return Finds(tuple(found))

    def across(self, running_sum: Vector, level: int) -> Finds:
        """Of one level."""
        k = level - 1
        if k >= self.limits.size:
            return Finds()
        cubed = fourth = 0.0
        if self.limits[k] > 0:
            alone = np.zeros(level)
            alone[k] = self.limits[k]
            sums = _core.haar_biweight_sums(running_sum, alone, 1)
            cubed, fourth = float(sums[0][k]), float(sums[1][k])
        return self.at(level, Found(cubed, fourth, *self._sizes(running_sum, k)))

    def values(self, coefficients: Vector, level: int) -> Found:
        """Of an array."""
        k = level - 1
        if k >= self.limits.size or not coefficients.size:
            return Found()
        limit, sizes = float(self.limits[k]), np.abs(coefficients)
        cubed, fourth = _core.biweight_sums(sizes, limit) if limit > 0 else (0.0, 0.0)
        below, inside = 0, Cells()
        if self.high[k] > 0:
            below = int(np.count_nonzero(sizes <= self.low[k]))
            inside = Cells.of(sizes[(sizes > self.low[k]) & (sizes <= self.high[k])])
        return Found(cubed, fourth, below=below, inside=inside, sizes=sizes if self.kept[k] else np.empty(0))

    def at(self, level: int, part: Found, resolution: float = 0.0) -> Finds:
        """With that of one level; what is rounding is known already."""
        return Finds((*(Found() for _ in range(level - 1)), part))

    def nothing(self) -> Finds:
        """Of no coefficients."""
        return Finds()

    def _sizes(self, running_sum: Vector, k: int) -> tuple[int, Cells, Vector]:
        """How many of the coefficients in a running sum lie below the bracket, those in it; and all, where kept."""
        below, inside, sizes = 0, Cells(), np.empty(0)
        if running_sum.size > 2 << k:
            if self.high[k] > 0:
                below, between = _core.haar_between(running_sum, k + 1, float(self.low[k]), float(self.high[k]))
                inside = Cells.of(between)
            if self.kept[k]:
                sizes = _core.haar_sample(running_sum, k + 1, running_sum.size)
        return below, inside, sizes
