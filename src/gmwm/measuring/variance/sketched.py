"""Robust variance from sketches of the coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.measuring.variance.sketch import BEYOND, OCTAVE, UNIT, Counts, Sketch, Sketches

ALONE = 8
"""Ratio of the count of a bin to the counts of both neighbouring bins above which its values are treated as equal."""
_BELOW_BIN = 52 - OCTAVE.bit_length() + 1
"""Number of low-order bits of the mantissa that do not determine the bin."""


class SketchCoefficients:
    """Source of coefficients for `robust_variances` that knows only one sketch per level.

    The coefficients of a bin are represented by two points on both sides of their mean, which have the variance of a
    uniform distribution over the bin. If the neighbouring bins are nearly empty, they are treated as equal.

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
    """Nonempty bins of a sketch in ascending order, including zero and infinity.

    `mean` ± `half` is the interval in which the values are assumed to lie, and `ends` the number of values in a bin and
    below. `squares` are the W² of the points that represent the finite nonzero values, and `weights` their numbers.
    """

    mean: Vector
    half: Vector
    ends: Counts
    squares: Vector
    weights: Vector

    @classmethod
    def of(cls, sketch: Sketch) -> _Bins:
        used = np.flatnonzero(sketch.counts)
        bins, counts = used + sketch.first * OCTAVE, sketch.counts[used]
        number = counts.astype(np.float64)
        place = sketch.sums[used] * UNIT / number
        # Numbers below 2^-1022 are in octave 0; its bins are as wide as those of octave 1.
        width = np.ldexp(1.0 / OCTAVE, np.maximum(bins // OCTAVE, 1) - 1023)
        mean = (bins << _BELOW_BIN).view(np.float64) + width * place
        padded = np.concatenate([[0], sketch.counts, [0]])
        alone = counts > ALONE * (padded[used] + padded[used + 2])
        half = np.where(alone, 0.0, width * np.minimum(place, 1.0 - place))
        # A third of the largest variance that is possible for this mean. It is exact for a uniform distribution over
        # the bin.
        variance = place * (1.0 - place) / 3.0 * (number - 1.0) / number
        deviation = np.where(alone, 0.0, width * np.sqrt(variance))
        with np.errstate(over="ignore", under="ignore"):
            squares = np.concatenate([mean - deviation, mean + deviation]) ** 2
        return cls(
            np.concatenate([[0.0], mean, [np.inf]]),
            np.concatenate([[0.0], half, [0.0]]),
            ends=np.cumsum(np.concatenate([[sketch.zeros], counts, [sketch.beyond]])),
            squares=squares,
            weights=np.concatenate([number, number]) / 2.0,
        )

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
        """Return the lower edge of the bin of the first rank and the upper edge of the bin of the last rank, widened
        for rounding."""
        means = self.mean[np.searchsorted(self.ends, ranks, side="right")]
        first, last = means.view(np.int64) >> _BELOW_BIN
        low, high = (np.array([first, last + 1], dtype=np.int64) << _BELOW_BIN).view(np.float64).tolist()
        return (low * (1 - 1e-9) if first else -1.0), (high * (1 + 1e-9) if last < BEYOND else np.inf)

    def below(self, high: float) -> int:
        """Return the number of |W| that are at most `high`; a bin counts by its mean."""
        return int(self.ends[np.searchsorted(self.mean, high, side="right") - 1])
