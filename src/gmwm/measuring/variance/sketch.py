"""Sketches: histograms of |W| in any order, which give a robust variance without stored coefficients.

Each octave has 128 bins of 0.4 to 0.8 %, with number and mean (to 2^-31). Measured relative errors at a root: 1e-7 for
smooth, 3e-5 for quantized data (1e-4 at efficiency 0.3); without one, typically 1e-3, at most 8e-3."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector, as_vector
from gmwm.base.errors import ReadError
from gmwm.measuring.variance.coefficients import haar_resolution

Counts = NDArray[np.int64]

BINS_OF_OCTAVE = 128  # bins per octave
SUM_UNIT = 2.0**-24  # unit of the sums over a bin, relative to the bin width
BEYOND = 2047 * BINS_OF_OCTAVE  # index of the bin of infinite values; bin 0 holds zero and values below 2^-1029


def _nothing() -> Counts:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Sketch:
    """Histogram of |W| of one level as integers, 2 kB per octave (about 60 kB), up to 5·10^11 per bin.

    Octave e, from `first` on, has 2^(e − 1023) ≤ |W| < 2^(e − 1022). `counts` and `sums` (128 m,) are numbers, and Σ
    (|W| − lower edge) / width in 2^-24. `zeros` (< 2^-1029) and `beyond` (infinite) are counted.

    >>> w = np.random.default_rng(1).normal(size=100_000)
    >>> part = Sketch.of(w[:30_000]).merge(Sketch.of(w[30_000:]))
    >>> bool(np.all(part.to_array() == Sketch.of(w).to_array())), len(part)
    (True, 100000)
    """

    zeros: int = 0
    beyond: int = 0
    first: int = 0
    counts: Counts = field(default_factory=_nothing)
    sums: Counts = field(default_factory=_nothing)

    @classmethod
    def of(cls, values: ArrayLike) -> Sketch:
        """Build the sketch of an array (M,) of coefficients, which can be empty."""
        return cls(*_core.sketch_values(as_vector(values, "values", at_least=0, finite=False)))

    @classmethod
    def of_haar(cls, running_sum: Vector, level: int, begin: int, end: int) -> Sketch:
        """Build the sketch of Haar coefficients, begin ≤ t < end and t ≥ 2^j − 1, from a running sum."""
        if running_sum.size <= 1 << level:
            return cls()
        return cls(*_core.haar_sketch(running_sum, level, begin, end))

    def __len__(self) -> int:
        """Return the number of coefficients."""
        return self.zeros + self.beyond + int(self.counts.sum())

    def merge(self, other: Sketch) -> Sketch:
        """Merge the sketches of two sets of coefficients."""
        zeros, beyond = self.zeros + other.zeros, self.beyond + other.beyond
        if not self.counts.size or not other.counts.size:
            filled = self if self.counts.size else other
            return Sketch(zeros, beyond, first=filled.first, counts=filled.counts, sums=filled.sums)
        first = min(self.first, other.first)
        last = max(part.first + part.counts.size // BINS_OF_OCTAVE for part in (self, other))
        counts, sums = np.zeros((2, (last - first) * BINS_OF_OCTAVE), dtype=np.int64)
        for part in (self, other):
            place = slice(
                (part.first - first) * BINS_OF_OCTAVE, (part.first - first) * BINS_OF_OCTAVE + part.counts.size
            )
            counts[place] += part.counts
            sums[place] += part.sums
        return Sketch(zeros, beyond, first=first, counts=counts, sums=sums)

    def to_array(self) -> Counts:
        """Return the nonempty bins as rows (bin, count, sum) in ascending order, for storage."""
        used = np.flatnonzero(self.counts)
        rows = np.column_stack([used + self.first * BINS_OF_OCTAVE, self.counts[used], self.sums[used]])
        ends = np.array([[0, self.zeros, 0], [BEYOND, self.beyond, 0]], dtype=np.int64)
        joint = np.concatenate([ends[:1], rows, ends[1:]])
        return joint[joint[:, 1] > 0]

    @classmethod
    def from_array(cls, rows: ArrayLike) -> Sketch:
        """Restore a sketch from the output of `to_array`; raise ReadError if the rows do not describe a sketch."""
        array = np.asarray(rows)
        if array.size == 0:
            return cls()
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
            raise ReadError(
                f"a sketch must have rows of three whole numbers; got {array.dtype} of shape {array.shape}",
                argument="rows",
                got=rows,
            )
        bins, counts, sums = array.astype(np.int64).T
        inside = (bins > 0) & (bins < BEYOND)
        if (
            bins[0] < 0 or bins[-1] > BEYOND or np.any(np.diff(bins) <= 0) or np.any(counts < 1)
            or np.any(sums < 0) or np.any(sums * SUM_UNIT >= np.where(inside, counts, SUM_UNIT))
        ):  # fmt: skip
            raise ReadError(
                "this is not a sketch: its bins must ascend, and the sum of each bin must agree with its count",
                argument="rows",
                got=rows,
            )
        zeros, beyond = (int(counts[bins == end].sum()) for end in (0, BEYOND))
        if not inside.any():
            return cls(zeros, beyond)
        bins, counts, sums = bins[inside], counts[inside], sums[inside]
        first, last = int(bins[0]) // BINS_OF_OCTAVE, int(bins[-1]) // BINS_OF_OCTAVE + 1
        dense = np.zeros((2, (last - first) * BINS_OF_OCTAVE), dtype=np.int64)
        dense[:, bins - first * BINS_OF_OCTAVE] = counts, sums
        return cls(zeros, beyond, first=first, counts=dense[0], sums=dense[1])


@dataclass(frozen=True, eq=False)
class Sketches:
    """Sketches of levels 1 … J of a recording, with the largest |W| of each level that can be a rounding error."""

    levels: tuple[Sketch, ...] = ()
    resolutions: Vector = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of_haar(cls, running_sum: Vector, levels: int, begin: int) -> Sketches:
        """Build the sketches of the Haar coefficients of levels 1 … `levels` that end at sample `begin` or later."""
        peak, end = float(np.abs(running_sum).max()), running_sum.size - 1
        numbers = range(1, min(levels, max(end, 1).bit_length() - 1) + 1)
        return cls(
            tuple(Sketch.of_haar(running_sum, level, begin, end) for level in numbers),
            np.array([haar_resolution(peak, level) for level in numbers], dtype=np.float64),
        )

    @classmethod
    def at(cls, level: int, sketch: Sketch, resolution: float) -> Sketches:
        """Return the sketches of all levels, with `sketch` at `level` and empty sketches at lower levels."""
        return cls((*(Sketch() for _ in range(level - 1)), sketch), np.append(np.zeros(level - 1), resolution))

    def merge(self, other: Sketches) -> Sketches:
        """Merge the sketches level by level."""
        resolutions = np.zeros(max(len(self.levels), len(other.levels)))
        for part in (self, other):
            resolutions_of_part = resolutions[: len(part.levels)]
            np.maximum(resolutions_of_part, part.resolutions, out=resolutions_of_part)
        pairs = zip_longest(self.levels, other.levels, fillvalue=Sketch())
        return Sketches(tuple(a.merge(b) for a, b in pairs), resolutions)

    def to_arrays(self) -> tuple[Counts, Vector]:
        """Return a table with the columns level, bin, count and sum, and the resolutions, for storage."""
        rows = [np.insert(sketch.to_array(), 0, level, axis=1) for level, sketch in enumerate(self.levels, start=1)]
        return np.concatenate([np.empty((0, 4), dtype=np.int64), *rows]), self.resolutions

    @classmethod
    def from_arrays(cls, rows: ArrayLike, resolutions: ArrayLike) -> Sketches:
        """Restore sketches from the output of `to_arrays`; raise ReadError if the arrays do not describe sketches."""
        table, sizes = np.asarray(rows), np.asarray(resolutions, dtype=np.float64)
        if table.size == 0:
            table = np.empty((0, 4), dtype=np.int64)
        if table.ndim != 2 or table.shape[1] != 4 or np.any((table[:, 0] < 1) | (table[:, 0] > sizes.size)):
            raise ReadError(
                f"sketches must have rows of a level from 1 to {sizes.size}, a bin, a count and a sum",
                argument="rows",
                got=rows,
            )
        parts = (table[table[:, 0] == level, 1:] for level in range(1, sizes.size + 1))
        return cls(tuple(Sketch.from_array(part) for part in parts), sizes)


class SketchCollector:
    """Statistics collector that builds sketches of the coefficients."""

    squares = True

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Sketches:
        """Build the sketches of the coefficients of levels 1 … `levels` that end at sample `begin` or later."""
        return Sketches.of_haar(running_sum, levels, begin)

    def across(self, running_sum: Vector, level: int) -> Sketches:
        """Build the sketch of all coefficients of one level of a running sum."""
        resolution = haar_resolution(float(np.abs(running_sum).max()), level)
        return Sketches.at(level, Sketch.of_haar(running_sum, level, 0, running_sum.size - 1), resolution)

    def values(self, coefficients: Vector, level: int) -> Sketch:
        """Build the sketch of an array of coefficients; the level has no effect."""
        return Sketch.of(coefficients) if coefficients.size else Sketch()

    def at(self, level: int, part: Sketch, resolution: float) -> Sketches:
        """Return the sketches of all levels, with `part` at `level` and empty sketches at lower levels."""
        return Sketches.at(level, part, resolution)

    def empty(self) -> Sketches:
        """Return the sketches of no coefficients."""
        return Sketches()


SKETCH_COLLECTOR = SketchCollector()


_BELOW_BIN = 52 - BINS_OF_OCTAVE.bit_length() + 1
"""Number of low-order bits of the mantissa that do not determine the bin."""


class SketchCoefficients:
    """Source for `robust_variances` with one sketch per level: two points per bin, of uniform variance (one if alone).

    >>> from gmwm.measuring.variance.robust import robust_variance, robust_variances
    >>> w = np.random.default_rng(1).normal(size=100_000)
    >>> sketched = robust_variances(SketchCoefficients([Sketch.of(w)], [0.0])).variance[0]
    >>> bool(abs(sketched / robust_variance(w) - 1) < 1e-6)
    True
    """

    def __init__(self, sketches: Sequence[Sketch], resolutions: Sequence[float]) -> None:
        self.counts = np.array([len(sketch) for sketch in sketches], dtype=np.int64)
        self._levels = [_Bins.of(sketch) for sketch in sketches]
        self._resolutions = resolutions

    @classmethod
    def of(cls, sketches: Sketches, levels: int) -> SketchCoefficients:
        """Build the source for the first `levels` levels."""
        return cls(sketches.levels[:levels], sketches.resolutions[:levels].tolist())

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Compute the sums over the bins of each level. The number of bins is small, so `every` is ignored."""
        sums = np.zeros((3, limits.size))
        for k, limit in enumerate(limits.tolist()):
            if limit > 0:
                sums[:, k] = *self._levels[k].biweight_sums(limit), self.counts[k]
        return sums[0], sums[1], sums[2]

    def sample(self, k: int, size: int) -> Vector:
        """Return `size` evenly spaced quantiles of |W| in ascending order."""
        count = int(self.counts[k])
        size = min(size, count)
        return self._levels[k].at(
            (2 * np.arange(size) + 1) * count // (2 * size) if size else np.empty(0, dtype=np.int64)
        )

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """Count the |W| up to `low`, and return the values between `low` and `high`; a bin counts by its mean."""
        below, above = self._levels[k].below(low), self._levels[k].below(high)
        return below, self._levels[k].at(np.arange(below, above))

    def median(self, k: int) -> float:
        """Compute the median of |W|, with an error of at most half a bin, which is 0.4 %."""
        count = int(self.counts[k])
        return float(self._levels[k].at(np.array([(count - 1) // 2, count // 2])).mean())

    def bracket(self, k: int) -> tuple[float, float]:
        """Return the edges of the bin that contains the median of |W|, slightly widened for rounding."""
        count = int(self.counts[k])
        return self._levels[k].edges(np.array([(count - 1) // 2, count // 2]))

    def resolution(self, k: int) -> float:
        """Return the largest |W| that can be a rounding error."""
        return self._resolutions[k]


@dataclass(frozen=True, eq=False)
class _Bins:
    """Nonempty bins in ascending order, with zero and infinity: `mean` ± `half`, cumulated numbers `ends`, and
    `squares` W² of representing points with `weights`."""

    mean: Vector
    half: Vector
    ends: Counts
    squares: Vector
    weights: Vector

    @classmethod
    def of(cls, sketch: Sketch) -> _Bins:
        used = np.flatnonzero(sketch.counts)
        bins, counts = used + sketch.first * BINS_OF_OCTAVE, sketch.counts[used]
        number = counts.astype(np.float64)
        place = sketch.sums[used] * SUM_UNIT / number
        # Numbers below 2^-1022 are in octave 0; its bins are as wide as those of octave 1.
        width = np.ldexp(1.0 / BINS_OF_OCTAVE, np.maximum(bins // BINS_OF_OCTAVE, 1) - 1023)
        mean = (bins << _BELOW_BIN).view(np.float64) + width * place
        padded = np.concatenate([[0], sketch.counts, [0]])
        alone = counts > 8 * (padded[used] + padded[used + 2])
        half = np.where(alone, 0.0, width * np.minimum(place, 1.0 - place))
        # A third of the largest possible variance for this mean, exact for a uniform distribution.
        variance = place * (1.0 - place) / 3.0 * (number - 1.0) / number
        deviation = np.where(alone, 0.0, width * np.sqrt(variance))
        with np.errstate(over="ignore", under="ignore"):
            squares = np.concatenate([mean - deviation, mean + deviation]) ** 2
        return cls(
            np.concatenate([[0.0], mean, [np.inf]]), np.concatenate([[0.0], half, [0.0]]),
            ends=np.cumsum(np.concatenate([[sketch.zeros], counts, [sketch.beyond]])), squares=squares,
            weights=np.concatenate([number, number]) / 2.0,
        )  # fmt: skip

    def biweight_sums(self, limit: float) -> tuple[float, float]:
        """Compute Σ v q³ and Σ v q⁴, with v = min(W²/limit, 1) and q = 1 − v. Zero and infinite values contribute 0."""
        v = np.minimum(self.squares, limit) / limit
        q = 1.0 - v
        term = self.weights * v * q**3
        return float(term.sum()), float(term @ q)

    def at(self, ranks: Counts) -> Vector:
        """Return the |W| of the given `ranks`, which count from 0 in ascending order."""
        k = np.searchsorted(self.ends, ranks, side="right")
        count = np.diff(self.ends, prepend=0)[k]
        inside = (ranks - (self.ends[k] - count) + 0.5) / count
        return np.asarray(self.mean[k] + (2.0 * inside - 1.0) * self.half[k])

    def edges(self, ranks: Counts) -> tuple[float, float]:
        """Return the lower edge of the first rank's bin and the upper edge of the last's, widened for rounding."""
        means = self.mean[np.searchsorted(self.ends, ranks, side="right")]
        first, last = means.view(np.int64) >> _BELOW_BIN
        low, high = (np.array([first, last + 1], dtype=np.int64) << _BELOW_BIN).view(np.float64).tolist()
        return (low * (1 - 1e-9) if first else -1.0), (high * (1 + 1e-9) if last < BEYOND else np.inf)

    def below(self, high: float) -> int:
        """Return the number of |W| that are at most `high`; a bin counts by its mean."""
        return int(self.ends[np.searchsorted(self.mean, high, side="right") - 1])
