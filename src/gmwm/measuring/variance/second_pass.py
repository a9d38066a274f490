"""Exact robust wavelet variance from two passes over a recording.

Sketches of the first pass give σ² to 1e-4. Exact sums there differ smoothly from those of sketches, so a linear
correction has an error of 1e-8. Levels without a root get the exact median; levels with few coefficients keep all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Booleans, Integers, Vector
from gmwm.base.errors import DataError, OptionError
from gmwm.base.threads import one_at_a_time
from gmwm.measuring.variance.biweight import REACH, Biweight, biweight, scan
from gmwm.measuring.variance.coefficients import SAMPLED_COEFFICIENTS
from gmwm.measuring.variance.open_segments import SegmentedAccumulator
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.measuring.variance.rise import WinsorisedRise
from gmwm.measuring.variance.robust import RobustVariances, criterion_of, robust_variances
from gmwm.measuring.variance.sketch import SketchCoefficients
from gmwm.recording.batches import require_following

if TYPE_CHECKING:
    from gmwm.measuring.variance.accumulate import WaveletAccumulator

LEAST_OMITTED_BITS = 8
"""Smallest number of low-order bits that a cell omits. A cell is therefore at least 2^-44 of the value wide."""
MOST_CELLS = 1 << 17  # largest number of cells of a level


@dataclass(frozen=True, eq=False)
class MedianCells:
    """Counts of |W| in cells around the median, as fine as their maximum number allows; merged in any order. `cells`
    are leading bits in ascending order, without `shift` low-order bits."""

    shift: int = LEAST_OMITTED_BITS
    cells: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    counts: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))

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

    def at(self, ranks: Integers) -> Vector | None:
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
    """Sums over coefficients of a level: Σ v q³, Σ v q⁴ at (cσ)² (`Biweight.criterion`), counts of |W| `below` and
    `inside` the median's bracket, and `sizes` (all |W|) if few."""

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
    """Sums of the second pass by level (a `StatisticsCollector`): `limits` (cσ)² or 0, the bracket `low`, `high` (0:
    none) of the median of |W|, and whether all |W| are `kept`."""

    limits: Vector
    low: Vector
    high: Vector
    kept: Booleans
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
        """Return the sums of all levels, with `part` at `level` and empty lower ones; `resolution` has no effect."""
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


DOUBTFUL_CRITERION = 0.01
"""Smallest maximum and slope of the criterion at which sketch and exact coefficients surely agree on a root."""


class SecondPass(SegmentedAccumulator):
    """Second pass of `WaveletAccumulator.second_pass`: the exact robust variance from sketches. Needs the same samples
    and gaps, in any chunks; parts of `part` are merged in order."""

    def __init__(
        self, first: WaveletAccumulator, request: SumRequest, winsorised: WinsorisedRise, start: int, efficiency: float
    ):
        super().__init__(first.levels, first.exact, start, request)
        self.efficiency = efficiency
        self._seen, self._request, self._winsorised = first, request, winsorised
        self._rise = 0.0

    def part(self, start: int) -> SecondPass:
        """Create an empty second pass for the part of the recording that begins with sample `start`."""
        return SecondPass(
            self._seen, self._request, winsorised=self._winsorised, start=start, efficiency=self.efficiency
        )

    @one_at_a_time
    def merge(self, following: SecondPass) -> SecondPass:
        """Merge the part that directly follows; raises OptionError if it does not, or belongs to another first pass."""
        require_following(self, following, "exact", "levels", "efficiency")
        for name in ("limits", "low", "high", "kept"):
            if not np.array_equal(getattr(self._request, name), getattr(following._request, name)):
                raise OptionError(
                    "the two parts belong to different first passes", argument="following", got=following,
                    advice="Make both parts with `part` of the same second pass.",
                )  # fmt: skip
        joint = self.part(self.start)
        joint._take_state(self)
        joint._append(following)
        joint._rise = self._rise + following._rise
        return joint

    @one_at_a_time
    def result(self, confidence: float = 0.95) -> WaveletVariance:
        """Compute the robust wavelet variance of the whole recording.

        Levels up to `exact` agree with `wavelet_variance(…, robust=True)` to 1e-10; higher ones use every τ/64-th
        coefficient. Without a root: (MAD / 0.67449)², to 1e-7 if the median's bin has over 2^17 coefficients.
        `diagnostics["robust"]` adds "moved", the relative change in this pass. Other samples raise DataError."""
        self._fold()
        if self.start != self._seen.start or self.lengths != self._seen.lengths:
            raise DataError(
                f"the second pass must read all samples of the first pass, {_extent(self._seen)}; it read "
                f"{_extent(self)}",
                advice="Pass the same chunks of the same recording to both passes.",
            )
        sketched = self._seen._sketches()
        sums: SecondPassSums = self._all_statistics()
        levels = (*sums.levels, *(LevelSums() for _ in range(len(sums.levels), len(sketched.counts))))
        exact = robust_variances(Corrected(sketched, self._request, levels), self.efficiency)
        before = robust_variances(sketched, self.efficiency).variance
        moved = [abs(v / b - 1.0) if b > 0 else 0.0 for v, b in zip(exact.variance, before, strict=True)]
        rooted = (outcome == "root" for outcome in exact.diagnostics["outcome"])
        # The first pass is accurate to about 1e-4, so a larger change means that the samples differ.
        if others := [k for k, (share, at) in enumerate(zip(moved, rooted, strict=True)) if at and share > 0.05]:
            raise DataError(
                f"the second pass read other samples than the first pass: at level {others[0] + 1} the variance "
                f"differs by {100 * moved[others[0]]:.2g} %",
                advice="Pass the same chunks of the same recording to both passes.",
            )
        result = replace(exact, diagnostics={**exact.diagnostics, "moved": moved})
        return self._seen._curve(confidence, result, self.efficiency, self._rise)

    @one_at_a_time
    def __getstate__(self) -> dict[str, Any]:
        self._fold()
        return super().__getstate__()

    def __repr__(self) -> str:
        return f"SecondPass({self._seen.axis or 'unnamed'}, {len(self)} of {len(self._seen)} samples)"

    def _grow(self, x: Vector) -> None:
        self._rise += self._winsorised.rise(x, self.stop)
        super()._grow(x)


def _extent(record: SegmentedAccumulator) -> str:
    return f"{len(record)} in {len(record.lengths)} segments from number {record.start} on"


def sum_request(sketched: SketchCoefficients, estimate: RobustVariances, efficiency: float) -> SumRequest:
    """Choose, from the sketches of the first pass, the sums that the second pass collects."""
    tuning, levels = biweight(efficiency), len(sketched.counts)
    limits, low, high = np.zeros((3, levels))
    stored = sketched.counts <= SAMPLED_COEFFICIENTS
    for k in np.flatnonzero(~stored).tolist():
        outcome, variance = estimate.diagnostics["outcome"][k], float(estimate.variance[k])
        place: float | None = variance
        if outcome != "root":
            place = _nearest(sketched, k, tuning)
        elif criterion_of(sketched, k, variance, tuning)(0.0)[1] > -DOUBTFUL_CRITERION * tuning.a:
            outcome = "mad"
        if place is not None and 0 < tuning.c**2 * place < math.inf:
            limits[k] = tuning.c**2 * place
        if outcome == "mad":
            low[k], high[k] = sketched.bracket(k)
    return SumRequest(limits, low, high, stored)


def _nearest(sketched: SketchCoefficients, k: int, tuning: Biweight) -> float | None:
    """Return σ² at the maximum of the criterion of a level without a root; None if this maximum is far below 0."""
    sample = sketched.sample(k, SAMPLED_COEFFICIENTS)
    nonzero = sample[sample > sketched.resolution(k)]
    origin = float(np.median(nonzero)) ** 2 if nonzero.size else 0.0
    if not 0 < origin * math.exp(-REACH) <= origin * math.exp(REACH) < math.inf:
        return None
    criterion = criterion_of(sketched, k, origin, tuning)
    peaks = scan(criterion, 1e-3).peaks
    if not peaks:
        return None
    middle = max(peaks, key=lambda peak: peak[1])[0]
    places = np.linspace(middle - REACH / 30, middle + REACH / 30, 41)
    values = np.array([criterion(float(place))[0] for place in places])
    best = int(np.argmax(values))
    return origin * math.exp(float(places[best])) if values[best] > -DOUBTFUL_CRITERION * tuning.a else None


class Corrected:
    """Source of coefficients for `robust_variances`: sketches, corrected by the sums of a second pass."""

    def __init__(self, sketched: SketchCoefficients, request: SumRequest, sums: tuple[LevelSums, ...]) -> None:
        self.counts = sketched.counts
        self._sketched, self._request, self._found = sketched, request, sums
        cubed, fourth, _ = sketched.sums(request.limits)
        used = request.limits > 0
        self._cubed = np.where(used, [level.cubed for level in sums], 0.0) - cubed
        self._fourth = np.where(used, [level.fourth for level in sums], 0.0) - fourth

    def sums(self, limits: Vector, every: int = 1) -> tuple[Vector, Vector, Vector]:
        """Return the sums over the sketches plus a correction that is linear in log σ²; `every` is ignored."""
        # Largest distance in log σ² from the exact sums at which the linear correction is used.
        distance = 0.02
        cubed, fourth, count = self._sketched.sums(limits)
        for k in np.flatnonzero(limits > 0).tolist():
            if self._request.kept[k]:
                cubed[k], fourth[k] = _core.biweight_sums(self._found[k].sizes, float(limits[k]))
            elif self._request.limits[k] > 0:
                way = math.log(limits[k] / self._request.limits[k])
                # d Σ v q⁴ / d log σ² = 4 Σ v q³ − 5 Σ v q⁴
                slope = 4 * self._cubed[k] - 5 * self._fourth[k]
                off = self._fourth[k] + slope * min(max(way, -distance), distance)
                fourth[k] += off
                cubed[k] += (5 * off + (slope if abs(way) <= distance else 0.0)) / 4
        return cubed, fourth, count

    def sample(self, k: int, size: int) -> Vector:
        """Return all stored |W|, or quantiles of the sketch if they are not stored."""
        return self._found[k].sizes if self._request.kept[k] else self._sketched.sample(k, size)

    def between(self, k: int, low: float, high: float) -> tuple[int, Vector]:
        """Count the |W| up to `low` and return the values between `low` and `high`, both from the sketch."""
        return self._sketched.between(k, low, high)

    def median(self, k: int) -> float:
        """Compute the median of |W| from the stored values, or from the counts in the cells around the median."""
        level, count = self._found[k], int(self.counts[k])
        if self._request.kept[k]:
            return float(np.median(level.sizes))
        middle = level.inside.at(np.array([(count - 1) // 2, count // 2]) - level.below)
        return self._sketched.median(k) if middle is None else float(middle.mean())

    def resolution(self, k: int) -> float:
        """Return the largest |W| that can be a rounding error, from the first pass."""
        return self._sketched.resolution(k)
