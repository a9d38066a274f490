"""Sources of wavelet coefficients: a running sum, one array per level, or several segments."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import MISSING_SAMPLES, Integers, Vector
from gmwm.base.errors import DataError


class CoefficientSource(Protocol):
    """Interface to the coefficients W of all levels. The index k is level k + 1, and `counts` has their numbers."""

    counts: Integers

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Return Σ v q³, Σ v q⁴ and their number, for one in `every` W; v = min(W²/limit, 1), q = 1 − v, 0: skip."""

    def sample(self, k: int, size: int) -> Vector:
        """Return |W| at `size` evenly spread positions, or all |W| if there are no more."""

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """Return the number of |W| ≤ `low`, and the values with `low` < |W| ≤ `high`."""

    def median(self, k: int) -> float:
        """Return the exact median of |W| at level k + 1. Only the values near the median of a sample are stored."""
        count = int(self.counts[k])
        sample = np.sort(self.sample(k, SAMPLED_COEFFICIENTS))
        if sample.size < count:
            around = 3 * math.isqrt(sample.size)
            low, high = float(sample[sample.size // 2 - around]), float(sample[sample.size // 2 + around])
            below, sizes = self.between(k, low, high)
            first, last = (count - 1) // 2 - below, count // 2 - below
            if first >= 0 and last < sizes.size:
                middle = np.partition(sizes, (first, last))
                return float(middle[first] + middle[last]) / 2
            sample = self.sample(k, count)
        return float(np.median(sample))

    def resolution(self, k: int) -> float:
        """Return the largest |W| that can be a rounding error."""


SAMPLED_COEFFICIENTS = 2048
"""Number of coefficients of a level that are used for the first search for the root and for the median."""


def haar_resolution(peak: float, level: int) -> float:
    """Return the largest rounding error of |W| at `level` for a running sum whose largest absolute value is `peak`."""
    return float(np.finfo(float).eps * peak * (4 + 2 ** (level / 2)) / 2**level)


def require_digits(x: Vector) -> None:
    """Raise DataError if a value is so large that the running sum loses the digits of the other values."""
    # Distance over median distance from the median beyond which sums round by 1e-4 of a typical coefficient.
    limit = 2.0**38
    sample = x[:: max(1, x.size // SAMPLED_COEFFICIENTS)]
    middle = float(np.median(sample))
    largest = max(float(x.max()) - middle, middle - float(x.min()))
    sizes = np.abs(sample - middle)
    if not sizes.any():
        sizes = np.abs(x - middle)
    typical = float(np.median(sizes[sizes > 0])) if largest > 0 else 0.0
    if largest <= limit * typical:
        return
    index = int(np.argmax(np.abs(x - middle)))
    raise DataError(
        f"the value {x[index]:.3g} at index {index} is more than {limit:.0e} times as large as the others differ, so "
        "that they have no digits beside it in double precision",
        got=float(x[index]),
        advice=MISSING_SAMPLES,
    )


class HaarCoefficients(CoefficientSource):
    """Haar MODWT coefficients, computed from one running sum of the signal."""

    def __init__(self, x: Vector, levels: int) -> None:
        require_digits(x)
        self.sum = _core.running_sum(x)
        self.counts = x.size - (np.int64(1) << np.arange(1, levels + 1, dtype=np.int64)) + 1
        self._peak = max(float(self.sum.max()), -float(self.sum.min()))

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """See `CoefficientSource.sums`. All levels are computed in one pass over the running sum."""
        return _core.haar_biweight_sums(self.sum, limits, every)

    def sample(self, k: int, size: int) -> Vector:
        """See `CoefficientSource.sample`."""
        return _core.haar_sample(self.sum, k + 1, size)

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """See `CoefficientSource.between`."""
        return _core.haar_between(self.sum, k + 1, low, high)

    def resolution(self, k: int) -> float:
        """See `haar_resolution`."""
        return haar_resolution(self._peak, k + 1)


class PlainCoefficients(CoefficientSource):
    """Coefficients stored as one array per level."""

    def __init__(self, levels: Sequence[Vector], resolutions: Sequence[float]) -> None:
        self.levels = levels
        self.counts = np.array([w.size for w in levels], dtype=np.int64)
        self._resolutions = resolutions

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """See `CoefficientSource.sums`."""
        sums = np.zeros((3, len(self.levels)))
        for k, limit in enumerate(limits.tolist()):
            if limit > 0:
                w = np.ascontiguousarray(self.levels[k][::every])
                sums[:, k] = *_core.biweight_sums(w, limit), w.size
        return sums[0], sums[1], sums[2]

    def sample(self, k: int, size: int) -> Vector:
        """Return one |W| of each of `size` intervals, at golden-ratio positions: no alias of a periodic W."""
        w = self.levels[k]
        if size >= w.size:
            return np.abs(w)
        cells = np.arange(size)
        places = ((cells + (cells * 0.6180339887498949) % 1) * (w.size / size)).astype(np.int64)
        return np.abs(w[np.minimum(places, w.size - 1)])

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """See `CoefficientSource.between`."""
        size = np.abs(self.levels[k])
        return int(np.count_nonzero(size <= low)), size[(size > low) & (size <= high)]

    def resolution(self, k: int) -> float:
        """Return the stored resolution."""
        return self._resolutions[k]


class PooledCoefficients(CoefficientSource):
    """Coefficients of several segments, which can have different numbers of levels."""

    def __init__(self, sources: Sequence[CoefficientSource]) -> None:
        self.sources = sources
        self.counts = np.zeros(max(len(source.counts) for source in sources), dtype=np.int64)
        for source in sources:
            self.counts[: len(source.counts)] += source.counts

    def _reaching(self, k: int) -> list[CoefficientSource]:
        return [source for source in self.sources if len(source.counts) > k]

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Add up the sums of the segments."""
        total = np.zeros((3, limits.size))
        for source in self.sources:
            reach = len(source.counts)
            if np.any(limits[:reach] > 0):
                total[:, :reach] += source.sums(np.ascontiguousarray(limits[:reach]), every)
        return total[0], total[1], total[2]

    def sample(self, k: int, size: int) -> Vector:
        """Sample each segment in proportion to its number of coefficients."""
        sources, count = self._reaching(k), int(self.counts[k])
        ends = np.cumsum([0, *(int(source.counts[k]) for source in sources)])
        # Rounding the cumulative counts, and not each share, keeps the total and does not omit all short segments.
        shares = np.diff(ends if size >= count else ends * size // count).tolist()
        parts = [source.sample(k, share) for source, share in zip(sources, shares, strict=True) if share]
        return np.concatenate(parts)

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """Combine the counts and values of all segments."""
        parts = [source.between(k, low, high) for source in self._reaching(k)]
        return sum(below for below, _ in parts), np.concatenate([sizes for _, sizes in parts])

    def resolution(self, k: int) -> float:
        """Return the largest resolution of the segments."""
        return max(source.resolution(k) for source in self._reaching(k))
