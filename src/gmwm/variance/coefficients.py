"""Where wavelet coefficients come from: a running sum, an array for each level, or several of these. All read alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gmwm import _core
from gmwm._arrays import Vector


class Coefficients(Protocol):
    """The coefficients of all levels, in whatever form they are kept."""

    counts: NDArray[np.int64]

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Σ v q³, Σ v q⁴ and the number of coefficients of each level with a limit (cσ)² > 0; `every` reads a part."""

    def sample(self, k: int, size: int) -> Vector:
        """|W| at `size` places of level k + 1, spread evenly; all of them if there are no more."""

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """How many |W| are at most `low`, and those from there up to `high`."""

    def median(self, k: int) -> float:
        """The median of |W|."""

    def resolution(self, k: int) -> float:
        """The size up to which a coefficient is rounding, not signal."""


SAMPLE = 2048
"""Coefficients of a level on which its root, and its median, is first looked for."""


def selected_median(source: Coefficients, k: int) -> float:
    """The exact median of |W|: of all coefficients, only those near that of a sample are kept and sorted."""
    count = int(source.counts[k])
    sample = np.sort(source.sample(k, SAMPLE))
    if sample.size < count:
        around = 3 * math.isqrt(sample.size)
        low, high = float(sample[sample.size // 2 - around]), float(sample[sample.size // 2 + around])
        below, kept = source.between(k, low, high)
        first, last = (count - 1) // 2 - below, count // 2 - below
        if first >= 0 and last < kept.size:
            middle = np.partition(kept, (first, last))
            return float(middle[first] + middle[last]) / 2
        sample = source.sample(k, count)
    return float(np.median(sample))


def haar_resolution(peak: float, level: int) -> float:
    """|W| up to which a coefficient of `level` is rounding of a running sum whose largest value is `peak`."""
    return float(np.finfo(float).eps * peak * (4 + 2 ** (level / 2)) / 2**level)


class HaarCoefficients:
    """Those of the Haar MODWT, read from one running sum of the signal."""

    def __init__(self, x: Vector, levels: int) -> None:
        self.sum = _core.running_sum(x)
        self.counts = x.size - (np.int64(1) << np.arange(1, levels + 1, dtype=np.int64)) + 1
        self._peak = max(float(self.sum.max()), -float(self.sum.min()))

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """From the kernel, all levels in one pass."""
        return _core.haar_biweight_sums(self.sum, limits, every)

    def sample(self, k: int, size: int) -> Vector:
        """From the kernel."""
        return _core.haar_sample(self.sum, k + 1, size)

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """From the kernel."""
        return _core.haar_between(self.sum, k + 1, low, high)

    def median(self, k: int) -> float:
        """By selection."""
        return selected_median(self, k)

    def resolution(self, k: int) -> float:
        """What rounding of the running sum makes of a coefficient that is zero."""
        return haar_resolution(self._peak, k + 1)


class PlainCoefficients:
    """An array for each level."""

    def __init__(self, levels: Sequence[Vector], resolutions: Sequence[float]) -> None:
        self.levels = levels
        self.counts = np.array([w.size for w in levels], dtype=np.int64)
        self._resolutions = resolutions

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Level by level."""
        sums = np.zeros((3, len(self.levels)))
        for k, limit in enumerate(limits.tolist()):
            if limit > 0:
                w = np.ascontiguousarray(self.levels[k][::every])
                sums[:, k] = *_core.biweight_sums(w, limit), w.size
        return sums[0], sums[1], sums[2]

    def sample(self, k: int, size: int) -> Vector:
        """One place in each of equal cells, where in it goes by the golden section: no period is taken for a size."""
        w = self.levels[k]
        if size >= w.size:
            return np.abs(w)
        cells = np.arange(size)
        places = ((cells + (cells * 0.6180339887498949) % 1) * (w.size / size)).astype(np.int64)
        return np.abs(w[np.minimum(places, w.size - 1)])

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """By comparison."""
        size = np.abs(self.levels[k])
        return int(np.count_nonzero(size <= low)), size[(size > low) & (size <= high)]

    def median(self, k: int) -> float:
        """By selection."""
        return selected_median(self, k)

    def resolution(self, k: int) -> float:
        """As given."""
        return self._resolutions[k]


class PooledCoefficients:
    """Those of several segments together, each with as many levels as it has."""

    def __init__(self, sources: Sequence[Coefficients]) -> None:
        self.sources = sources
        self.counts = np.zeros(max(len(source.counts) for source in sources), dtype=np.int64)
        for source in sources:
            self.counts[: len(source.counts)] += source.counts

    def _reaching(self, k: int) -> list[Coefficients]:
        return [source for source in self.sources if len(source.counts) > k]

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Added up."""
        total = np.zeros((3, limits.size))
        for source in self.sources:
            reach = len(source.counts)
            if np.any(limits[:reach] > 0):
                total[:, :reach] += source.sums(np.ascontiguousarray(limits[:reach]), every)
        return total[0], total[1], total[2]

    def sample(self, k: int, size: int) -> Vector:
        """Of each segment its share."""
        sources, count = self._reaching(k), int(self.counts[k])
        ends = np.cumsum([0, *(int(source.counts[k]) for source in sources)])
        # Rounded at the ends, not each by itself: so they add up, and many short segments are not all left out.
        shares = np.diff(ends if size >= count else ends * size // count).tolist()
        parts = [source.sample(k, share) for source, share in zip(sources, shares, strict=True) if share]
        return np.concatenate(parts)

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """Of all segments."""
        found = [source.between(k, low, high) for source in self._reaching(k)]
        return sum(below for below, _ in found), np.concatenate([kept for _, kept in found])

    def median(self, k: int) -> float:
        """By selection."""
        return selected_median(self, k)

    def resolution(self, k: int) -> float:
        """That of the coarsest segment."""
        return max(source.resolution(k) for source in self._reaching(k))
