"""Segments of a recording, their times, windows of equal length, and outputs clipped at the end of the range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Integers, Vector
from gmwm.base.lazy import scipy
from gmwm.base.time_base import begins_of, lost_before, times_of
from gmwm.recording.gaps import joined_ranges

_WINDOWS, SHORTEST = 64, 16
"""Number of windows whose means and standard deviations are compared, and fewest samples of a window: with two, 28 of
30 recordings of white noise seemed to be moved; with 16, at most 1 % of 300 (tests/test_inspection_limits.py)."""

Range = tuple[int, int]


@dataclass(frozen=True)
class Extent:
    """Segments (index ranges) with start times (s), and whether lengths of gaps are known."""

    rate: float
    segments: tuple[Range, ...]
    starts: tuple[float, ...]
    gaps_known: bool = True

    @classmethod
    def of(
        cls, rate: float, segments: Sequence[Range], clock: Sequence[float], left: float, *, gaps_known: bool = True
    ) -> Extent:
        """Make the extent of segments with start times `clock` (s) from any zero; the first sample gets `left` (s)."""
        begins = begins_of(rate, segments, clock)
        return cls(rate, tuple(segments), tuple(left + begin for begin in begins), gaps_known)

    @cached_property
    def unbroken(self) -> tuple[Range, ...]:
        """Index ranges between the gaps that are too long to fill. Means and outliers do not depend on shorter gaps."""
        return joined_ranges(self.rate, self.segments, self.starts) if self.gaps_known else self.segments

    @property
    def end(self) -> float:
        """Time (s) at which the last sample ends."""
        first, last = self.segments[-1]
        return self.starts[-1] + (last - first) / self.rate

    def has_short_gap(self, index: int, reach: float) -> bool:
        """Return whether a gap that may be filled is at most `reach` samples from the sample with this index."""
        short = np.setdiff1d([first for first, _ in self.segments], [first for first, _ in self.unbroken])
        return bool(np.any(np.abs(short - index) <= reach))

    @property
    def filled_samples(self) -> tuple[int, int]:
        """Number of lost samples in gaps that are filled, and number of these gaps."""
        lost = lost_before(self.rate, self.segments, self.starts)
        filled = ~np.isin([first for first, _ in self.segments[1:]], [first for first, _ in self.unbroken])
        return int(np.sum(lost[filled])), int(np.count_nonzero(filled))

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.segments[-1][1]

    def times(self, indices: ArrayLike) -> Vector:
        """Return the times (s) of the samples with these indices, on the time axis of the option `skip` of `read`."""
        return times_of(indices, self.rate, self.segments, self.starts)

    def windows(self) -> list[Range]:
        """Return up to 64 half-open index ranges of similar length, whose means can be compared. None contains a gap
        that is too long to fill, unless both sides are shorter than half a window; too short ones are left out."""
        length = max(self.samples // _WINDOWS, min(SHORTEST, self.samples))
        ranges: list[Range] = []
        joined = False  # whether the last range consists of short segments and may still grow
        for first, last in self.unbroken:
            short = 2 * (last - first) < length
            if short and joined and ranges[-1][1] - ranges[-1][0] < length:
                ranges[-1] = (ranges[-1][0], last)
            else:
                ranges.append((first, last))
            joined = short
        long = [(a, b) for a, b in ranges if 2 * (b - a) >= length]
        windows = []
        for first, last in long:
            count = min(max((last - first) // length, 1), _WINDOWS)
            edges = [first + (last - first) * k // count for k in range(count + 1)]
            windows += list(pairwise(edges))
        return windows


_SHARE = 1e-3
"""Smallest share of samples at an extreme value that is reported. Gaussian noise that is clipped there loses 0.1 % of
its standard deviation (tests/test_inspection_faults.py, as the next constants)."""
_LEAST = 10  # smallest number of samples at an extreme value
_EXPECTED = 30.0
"""Number of samples that Gaussian noise would have beyond the extreme value, whose absence is not chance."""


_FINE = 3.0
"""Median quantization steps between differing neighbours from which rounding does not shape the tails (σ ≥ 3 steps)."""
_FOLDED = 0.04
"""Share of samples within a tenth of the rms from zero, none of them beyond zero, of an absolute value: 8 % of |x| for
noise x with mean 0, 2 % with a mean of two standard deviations (tests/test_inspection_faults.py)."""
_NORMAL = NormalDist()


@dataclass(frozen=True, kw_only=True)
class Saturation:
    """Samples of an axis at its extremes: their share, the commonest value, and the `loss` of spread of Gaussian noise.
    `matters`: N loses more than half the 95 % confidence interval of white noise. `inside`: of a dead band. `folded`:
    the output is an absolute value."""

    axis: str
    share: float
    value: float
    loss: float
    matters: bool
    inside: bool = False
    folded: bool = False


class Extremes:
    """The largest value of an axis, the next smaller one, and their numbers of samples, from samples in any parts."""

    def __init__(self) -> None:
        self.levels = np.empty(0)
        self.counts = np.empty(0, dtype=np.int64)

    def update(self, values: Vector) -> None:
        """Add samples."""
        if not values.size:
            return
        # The second value from the top of some samples is at most that of all.
        top = np.unique(values[::64])[-2:]
        values, numbers = np.unique(values[values >= top[0]] if top.size > 1 else values, return_counts=True)
        levels, places = np.unique(np.concatenate([self.levels, values]), return_inverse=True)
        counts = np.bincount(places, np.concatenate([self.counts, numbers])).astype(np.int64)
        self.levels, self.counts = levels[-2:], counts[-2:]

    def is_clipped(self, samples: int, step: float, noise: float) -> bool:
        """Return whether the noise (standard deviation before rounding) would extend beyond the largest value.

        log p of rounded Gaussian values has the second difference −step²/σ². The two largest values with n_1 and n_0
        samples predict n_1²/n_0 · exp(−step²/σ²) beyond. A varying mean makes the tail longer."""
        if self.levels.size < 2 or self.counts[-1] < max(_SHARE * samples, _LEAST):
            return False
        if not step:
            return True
        if not noise > 0:
            return False
        return bool(self.counts[-1] ** 2 / self.counts[-2] * math.exp(-((step / noise) ** 2)) > _EXPECTED)


class Ends:
    """Both ends of the range of an axis (`low` has those of the negative samples), and how far its samples move."""

    def __init__(self) -> None:
        self.low, self.high = Extremes(), Extremes()
        self._moves = list[float]()

    def update(self, values: Vector) -> None:
        """Add samples."""
        self.low.update(-values)
        self.high.update(values)
        stride = max(1, values.size // 20_000)  # so that a batch of any length costs little
        moves = np.abs(values[1::stride] - values[:-1:stride])
        if np.any(moves):
            self._moves.append(float(np.median(moves[moves > 0])))

    @property
    def move(self) -> float:
        """Median change of neighbours that differ; 0 if none do."""
        return float(np.median(self._moves)) if self._moves else 0.0

    def is_fine(self, step: float) -> bool:
        """Return whether most changes of neighbours are many steps: unlike the noise, clipping does not hide this."""
        return self.move > _FINE * step


def saturation_of(axis: str, ends: Ends, *, samples: int, step: float, noise: float) -> Saturation | None:
    """Return the share of clipped samples of an axis; None if it is not clipped. Arguments as in `is_clipped`.

    Samples at a value far from all others, such as failed readings written as 0, are wrong samples, of which at most a
    tenth is replaced (`outliers.spikes.MOST`)."""
    near = max(2 * step, ends.move)
    if ends.is_fine(step):
        step = 0.0
    clipped = [
        (int(side.counts[-1]), sign * float(side.levels[-1]))
        for side, sign in ((ends.low, -1.0), (ends.high, 1.0))
        if side.is_clipped(samples, step, noise)
        if np.ptp(side.levels) <= near or side.counts[-1] > 0.1 * samples
    ]
    if not clipped:
        return None
    share = sum(count for count, _ in clipped) / samples
    loss = _loss([count / samples for count, _ in clipped]) if share < 1 else 1.0
    return Saturation(
        axis=axis, share=share, value=max(clipped)[1], loss=loss, matters=loss > 1.96 / math.sqrt(2 * samples)
    )


def folding_of(axis: str, runs: Sequence[Vector], step: float) -> Saturation | None:
    """Return the median share of samples near zero in the runs if the output is an absolute value; None if samples have
    both signs, if steps are coarse, or if most of this share is exactly zero. Arguments as in `dead_band_of`."""
    values = np.concatenate([np.zeros(1), *runs])
    near = 0.1 * math.sqrt(float(np.mean(values**2)))
    if step >= near or not (np.min(values) >= 0 or np.max(values) <= 0):
        return None
    share = float(np.median([np.mean(np.abs(run) < near) for run in runs]))
    loss = 1 - math.sqrt(1 - 2 / math.pi)
    folded = Saturation(axis=axis, share=share, value=0.0, loss=loss, matters=True, folded=True)
    return folded if share > max(_FOLDED, 2 * float(np.mean(values == 0))) else None


def dead_band_of(axis: str, runs: Sequence[Vector], *, samples: int, step: float) -> Saturation | None:
    """Return the value that has more samples than noise puts there, as in a dead band; None without, or if several
    values do, as after rounding twice. `runs` are consecutive samples; `step` is 0 if no step is visible."""
    values = np.concatenate([np.empty(0), *runs])
    changes = np.concatenate([np.empty(0), *(np.diff(run) for run in runs)])
    if not np.any(changes):
        return None
    least = max(_SHARE * values.size, _LEAST)
    if step:
        places = np.rint((values - np.min(values)) / step)
        if np.max(places) > values.size:
            return None
        counts = np.bincount(places.astype(np.intp))
        # Correlated samples change the numbers more than independent ones.
        scatter = max(2 * float(np.var(values) / np.mean(changes**2)), 1.0)
        cells = round(float(np.min(values)) / step) + np.arange(counts.size)
        if np.var(values) < (_FINE * step) ** 2 and _is_truncated(cells, counts, scatter):
            share = float(np.mean(np.abs(values) < step / 2))
            return Saturation(axis=axis, share=share, value=0.0, loss=share / 2, matters=True, inside=True)
        most, excess = _unlike_neighbours(counts, least, scatter)
    else:  # noise does not return to a value
        changed = np.concatenate([run[1:][np.diff(run) != 0] for run in runs])
        levels, counts = np.unique(changed, return_counts=True)
        places = np.where(values == levels[np.argmax(counts)], np.argmax(counts), -1)
        most, excess = np.zeros(counts.size), counts >= least
    k = int(np.argmax(counts))
    # The commonest value is a neighbour of the values up to two steps away.
    if not excess[k] or np.any(excess[: max(k - 2, 0)]) or np.any(excess[k + 3 :]):
        return None
    value, share = float(np.median(values[places == k])), float(np.mean(places == k))
    loss = share - float(most[k]) / values.size
    if not most[k]:
        # The value is in place of samples up to `gap` away, with others on both sides (a dead band), or of any sample.
        apart = values[places != k] - value
        band = min(np.count_nonzero(apart < 0), np.count_nonzero(apart > 0)) >= least
        gap = float(np.min(apart**2)) if band else 0.0
        loss = share * max(gap / 3, float(np.var(apart) - np.mean(apart) ** 2)) / np.var(values) / 2
    if loss <= 1.96 / math.sqrt(2 * samples):
        return None
    return Saturation(axis=axis, share=share, value=value, loss=loss, matters=True, inside=True)


def _unlike_neighbours(counts: NDArray[np.intp], least: float, scatter: float) -> tuple[Vector, NDArray[np.bool_]]:
    """Return the largest number of samples that the neighbours of each value allow, and the values with more.

    From the commonest value to its neighbours, log p of rounded noise falls by at most as much as from these to the
    next ones; truncation towards zero doubles n at zero. Values without samples on both sides are alone. `scatter` is
    the variance of the numbers over that of independent samples."""
    padded = np.pad(counts.astype(np.float64), 2)
    sides = np.array([padded[:-4], padded[1:-3], padded[3:-1], padded[4:]])
    filled, weights = np.maximum(sides, 1.0), np.array([-0.5, 1.0, 1.0, -0.5])
    most = np.exp(weights @ np.log(filled))
    limit = most + np.sqrt(_EXPECTED * scatter * most * (1 + most * (weights**2 @ (1 / filled))))
    alone = ~np.any(sides, axis=0) & (counts >= least) & (np.sum(counts) - counts >= least)
    excess = alone | (np.all(sides >= _EXPECTED, axis=0) & (counts > limit))
    return np.where(alone, 0.0, most), excess


def _is_truncated(cells: Integers, counts: Integers, scatter: float) -> bool:
    """Return whether Gaussian noise that is truncated towards zero has these numbers of samples in values of whole
    steps, and rounded noise does not: neighbours cannot tell a peak of two steps from noise of one step."""
    if not np.any(cells == 0) or not np.any(counts[cells == 0]) or np.count_nonzero(counts) < 4:
        return False
    mean = float(cells @ counts / np.sum(counts))
    start = mean, 0.5 * math.log((cells - mean) ** 2 @ counts / np.sum(counts))

    def misfit(low: ArrayLike, high: ArrayLike) -> float:
        def deviance(of: Vector) -> float:
            edges = scipy.special.ndtr((np.stack([low, high]) - of[0]) * math.exp(-of[1]))
            expected = np.sum(counts) * np.maximum(edges[1] - edges[0], 1e-12)
            return float(2 * scipy.special.xlogy(counts, counts / expected).sum())

        return float(scipy.optimize.minimize(deviance, start, method="Nelder-Mead").fun)

    limit = _EXPECTED * scatter
    return misfit(cells - 0.5, cells + 0.5) > limit >= misfit(cells - (cells <= 0), cells + (cells >= 0))


def _loss(shares: list[float]) -> float:
    """Return the share of the standard deviation that Gaussian noise loses if these shares are clipped at its ends."""
    variance, shift = 1.0, 0.0
    for sign, share in zip((1.0, -1.0), shares, strict=False):
        end = _NORMAL.inv_cdf(1 - share)
        density = _NORMAL.pdf(end)
        variance -= end * density + share - end**2 * share
        shift += sign * (density - end * share)
    return 1 - math.sqrt(max(variance - shift**2, 0.0))
