"""Counts of |W| in bins: what a robust variance needs of coefficients that are not kept, in any order and grouping.

Bins are the same for every signal: an octave is cut in 128, so that a bin is 0.4 to 0.8 % wide. Each knows how many |W|
fell in and their mean, to 2^-31. Of a sum over all coefficients of a smooth function only the second order of a bin's
width is lost. Measured, a robust variance at a root is that of the coefficients themselves to 1e-7 for smooth
distributions, to 3e-5 for those of a quantizer (1e-4 at an efficiency of 0.3). Where there is no root it is the median,
which lies within half a bin: mostly 1e-3 of the variance, 8e-3 at the worst.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import zip_longest

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm import _core
from gmwm._arrays import Vector, as_vector
from gmwm.errors import ReadError
from gmwm.variance.coefficients import haar_resolution

Counts = NDArray[np.int64]

OCTAVE = 128
"""Bins of an octave."""
UNIT = 2.0**-24
"""In which the sums over a bin are kept, of its width."""
BEYOND = 2047 * OCTAVE
"""The bin of what is infinite; bin 0 is that of zero, and of what is less than 2^-1029."""


def _nothing() -> Counts:
    return np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Sketch:
    """How many |W| of one level lie in each bin, and their sum over it; all whole numbers.

    Memory is 2 kB for each octave from the smallest to the largest |W|, about 30 of them: 60 kB. Numbers hold for up
    to 5·10^11 coefficients in one bin.

    Attributes
    ----------
    zeros, beyond : int
        How many are zero (less than 2^-1029), and how many infinite.
    first : int
        Number of the first octave; octave e holds 2^(e − 1023) ≤ |W| < 2^(e − 1022).
    counts, sums : (128 m,) arrays
        Of the bins of m octaves: how many, and the sum of (|W| − bin's beginning) / bin's width, in 2^-24.

    Examples
    --------
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
        """That of an array of coefficients (M,), none or many."""
        return cls(*_core.sketch_values(as_vector(values, "values", at_least=0, finite=False)))

    @classmethod
    def of_haar(cls, running_sum: Vector, level: int, begin: int, end: int) -> Sketch:
        """That of the Haar coefficients W_{j,t} of one level, begin ≤ t < end and t ≥ 2^j − 1.

        `running_sum` is that of all samples (`_core.running_sum`); where none has so many, the sketch is empty.
        """
        if running_sum.size <= 1 << level:
            return cls()
        return cls(*_core.haar_sketch(running_sum, level, begin, end))

    def __len__(self) -> int:
        """Coefficients so far."""
        return self.zeros + self.beyond + int(self.counts.sum())

    def merge(self, other: Sketch) -> Sketch:
        """That of the coefficients of both."""
        zeros, beyond = self.zeros + other.zeros, self.beyond + other.beyond
        if not self.counts.size or not other.counts.size:
            kept = self if self.counts.size else other
            return Sketch(zeros, beyond, first=kept.first, counts=kept.counts, sums=kept.sums)
        first = min(self.first, other.first)
        last = max(part.first + part.counts.size // OCTAVE for part in (self, other))
        counts, sums = np.zeros((2, (last - first) * OCTAVE), dtype=np.int64)
        for part in (self, other):
            place = slice((part.first - first) * OCTAVE, (part.first - first) * OCTAVE + part.counts.size)
            counts[place] += part.counts
            sums[place] += part.sums
        return Sketch(zeros, beyond, first=first, counts=counts, sums=sums)

    def to_array(self) -> Counts:
        """All of it as rows (bin, count, sum) of the bins that are not empty, in rising order: to be stored."""
        used = np.flatnonzero(self.counts)
        rows = np.column_stack([used + self.first * OCTAVE, self.counts[used], self.sums[used]])
        ends = np.array([[0, self.zeros, 0], [BEYOND, self.beyond, 0]], dtype=np.int64)
        joint = np.concatenate([ends[:1], rows, ends[1:]])
        return joint[joint[:, 1] > 0]

    @classmethod
    def from_array(cls, rows: ArrayLike) -> Sketch:
        """The sketch whose `to_array` gave `rows`.

        Raises
        ------
        ReadError
            If they are not those of a sketch.
        """
        array = np.asarray(rows)
        if array.size == 0:
            return cls()
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
            raise ReadError(f"a sketch must have rows of three whole numbers; got {array.dtype} of shape {array.shape}")
        bins, counts, sums = array.astype(np.int64).T
        inside = (bins > 0) & (bins < BEYOND)
        if (
            bins[0] < 0 or bins[-1] > BEYOND or np.any(np.diff(bins) <= 0) or np.any(counts < 1)
            or np.any(sums < 0) or np.any(sums * UNIT >= np.where(inside, counts, UNIT))
        ):  # fmt: skip
            raise ReadError(
                "this is not a sketch: its bins must ascend, and the sum of each bin must agree with its count"
            )
        zeros, beyond = (int(counts[bins == end].sum()) for end in (0, BEYOND))
        if not inside.any():
            return cls(zeros, beyond)
        bins, counts, sums = bins[inside], counts[inside], sums[inside]
        first, last = int(bins[0]) // OCTAVE, int(bins[-1]) // OCTAVE + 1
        dense = np.zeros((2, (last - first) * OCTAVE), dtype=np.int64)
        dense[:, bins - first * OCTAVE] = counts, sums
        return cls(zeros, beyond, first=first, counts=dense[0], sums=dense[1])


@dataclass(frozen=True, eq=False)
class Sketches:
    """Those of all levels of a record, and up to which |W| a coefficient of each is rounding.

    Attributes
    ----------
    levels : tuple of Sketch
        Of levels 1 … J.
    resolutions : (J,) array
        The largest of the parts.
    """

    levels: tuple[Sketch, ...] = ()
    resolutions: Vector = field(default_factory=lambda: np.empty(0))

    @classmethod
    def of_haar(cls, running_sum: Vector, levels: int, begin: int) -> Sketches:
        """Those of the Haar coefficients of levels 1 … `levels` that end at sample `begin` or after."""
        peak, end = float(np.abs(running_sum).max()), running_sum.size - 1
        numbers = range(1, min(levels, max(end, 1).bit_length() - 1) + 1)
        return cls(
            tuple(Sketch.of_haar(running_sum, level, begin, end) for level in numbers),
            np.array([haar_resolution(peak, level) for level in numbers], dtype=np.float64),
        )

    @classmethod
    def at(cls, level: int, sketch: Sketch, resolution: float) -> Sketches:
        """With that of one level, nothing at those below it."""
        return cls((*(Sketch() for _ in range(level - 1)), sketch), np.append(np.zeros(level - 1), resolution))

    def merge(self, other: Sketches) -> Sketches:
        """Those of the coefficients of both, level by level."""
        resolutions = np.zeros(max(len(self.levels), len(other.levels)))
        for part in (self, other):
            own = resolutions[: len(part.levels)]
            np.maximum(own, part.resolutions, out=own)
        pairs = zip_longest(self.levels, other.levels, fillvalue=Sketch())
        return Sketches(tuple(a.merge(b) for a, b in pairs), resolutions)

    def to_arrays(self) -> tuple[Counts, Vector]:
        """All of it to be stored: rows (level, bin, count, sum), and the resolutions."""
        rows = [np.insert(sketch.to_array(), 0, level, axis=1) for level, sketch in enumerate(self.levels, start=1)]
        return np.concatenate([np.empty((0, 4), dtype=np.int64), *rows]), self.resolutions

    @classmethod
    def from_arrays(cls, rows: ArrayLike, resolutions: ArrayLike) -> Sketches:
        """Those whose `to_arrays` gave these.

        Raises
        ------
        ReadError
            If they are not those of sketches.
        """
        table, sizes = np.asarray(rows), np.asarray(resolutions, dtype=np.float64)
        if table.size == 0:
            table = np.empty((0, 4), dtype=np.int64)
        if table.ndim != 2 or table.shape[1] != 4 or np.any((table[:, 0] < 1) | (table[:, 0] > sizes.size)):
            raise ReadError(f"sketches must have rows of a level from 1 to {sizes.size}, a bin, a count and a sum")
        parts = (table[table[:, 0] == level, 1:] for level in range(1, sizes.size + 1))
        return cls(tuple(Sketch.from_array(part) for part in parts), sizes)


class SketchCollector:
    """Sketches of coefficients while their samples are there."""

    squares = True

    def haar(self, running_sum: Vector, levels: int, begin: int) -> Sketches:
        """Of all levels."""
        return Sketches.of_haar(running_sum, levels, begin)

    def across(self, running_sum: Vector, level: int) -> Sketches:
        """Of one level."""
        resolution = haar_resolution(float(np.abs(running_sum).max()), level)
        return Sketches.at(level, Sketch.of_haar(running_sum, level, 0, running_sum.size - 1), resolution)

    def values(self, coefficients: Vector, level: int) -> Sketch:
        """Of an array; the level is all the same."""
        return Sketch.of(coefficients) if coefficients.size else Sketch()

    def at(self, level: int, part: Sketch, resolution: float) -> Sketches:
        """With that of one level."""
        return Sketches.at(level, part, resolution)

    def empty(self) -> Sketches:
        """Of no coefficients."""
        return Sketches()


SKETCH_COLLECTOR = SketchCollector()
