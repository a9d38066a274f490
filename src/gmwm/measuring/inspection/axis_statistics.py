"""Statistics of one axis from chunks of any length, in bounded memory; they show motion and still parts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, row_medians, runs_of
from gmwm.measuring.inspection.knocks import BLOCK, FEWEST, Indices, Knock, Outliers, level_length, outliers_of
from gmwm.measuring.inspection.time_grid import SHORTEST, Extent

_SLAB = 256 * BLOCK  # samples that are processed together; it affects memory and speed only


class AxisStatistics:
    """Moments, outliers and levels of one axis, from samples in order; `resolution` is 0 if no step is visible."""

    def __init__(self, extent: Extent, resolution: float) -> None:
        self._extent, self._resolution = extent, resolution
        self._ranges = extent.windows()
        self.all = Moments(1)
        self.differences = Moments(1)
        # For each window: moments of all samples, of the samples without outliers, and of the first differences.
        self.windows, self.calm, self.steps = (Moments(len(self._ranges)) for _ in range(3))
        self._outliers: list[Outliers] = [(np.empty(0, dtype=np.int64), np.empty(0))]
        self._length = level_length(extent.samples)
        self._levels: list[tuple[int, list[Vector]]] = []
        self._runs, self._runs_of_all = ([list[Vector]() for _ in self._ranges] for _ in range(2))
        self._segment = self._row = 0  # joined range and index of the next sample
        self._waiting = np.empty(0)  # samples that are not yet processed
        self._tail = np.empty(0)  # the last processed samples of this range
        self._unlevelled = np.empty(0)
        self._means: list[tuple[int, list[Vector]]] = []
        self._unaveraged = np.empty(0)  # as `_unlevelled`, with NaN for outliers

    def update(self, values: Vector) -> None:
        """Add the next samples. They may extend over several ranges without gaps."""
        while values.size:
            _, last = self._extent.unbroken[self._segment]
            missing = last - self._row - self._waiting.size
            size = min(missing, _SLAB)  # so that only a slab is copied to join it with the waiting samples
            part, values = values[:size], values[size:]
            self._gather(part, part.size == missing)

    @property
    def length(self) -> int:
        """Number of samples of the blocks of `levels` and `means`."""
        return self._length

    def outliers(self) -> Outliers:
        """Return the indices and sizes of all outliers so far."""
        index, size = zip(*self._outliers, strict=True)
        return np.concatenate(index), np.concatenate(size)

    def levels(self) -> list[tuple[int, Vector]]:
        """Return the first sample and the block medians of each range that has at least five blocks."""
        return [(first, np.concatenate(medians)) for first, medians in self._levels]

    def means(self) -> list[tuple[int, Vector]]:
        """Return the first sample and the block means, without outliers, of each range with five blocks."""
        return [(first, np.concatenate(means)) for first, means in self._means]

    def runs(self, *, outliers: bool = False) -> list[Vector]:
        """Return the first consecutive samples of each window, with or without outliers."""
        return [np.concatenate(run) for run in (self._runs_of_all if outliers else self._runs) if run]

    def _gather(self, part: Vector, ends: bool) -> None:
        if not ends and self._waiting.size + part.size < _SLAB:
            self._waiting = np.concatenate([self._waiting, part])
            return
        values = np.concatenate([self._waiting, part]) if self._waiting.size else part
        first, last = self._extent.unbroken[self._segment]
        end = values.size if ends else values.size - values.size % BLOCK
        for k in range(0, end, _SLAB):
            slab = values[k : min(k + _SLAB, end)]
            self._work(slab, first, last)
        self._waiting = values[end:].copy()
        if ends:
            self._segment, self._tail = self._segment + 1, np.empty(0)
            self._unlevelled = self._unaveraged = np.empty(0)

    def _work(self, slab: Vector, first: int, last: int) -> None:
        """Process a number of whole blocks, or the end of a range."""
        index, size = self._unusual(slab, first, last)
        self._outliers.append((index, size))
        self._count(slab, index - self._row, first)
        if last - first >= 5 * self._length:
            self._level(slab, index - self._row, first)
        # A copy, because a view would keep the whole batch in memory.
        self._tail = slab[-BLOCK:].copy() if slab.size >= BLOCK else np.concatenate([self._tail, slab])[-BLOCK:]
        self._row += slab.size

    def _unusual(self, slab: Vector, first: int, last: int) -> Outliers:
        length = min(BLOCK, last - first)
        outliers = [(np.empty(0, dtype=np.int64), np.empty(0))]
        if length >= FEWEST:
            end = slab.size - slab.size % length
            if end:
                at, size = outliers_of(slab[:end].reshape(-1, length), self._resolution)
                outliers.append((self._row + at, size))
            if end < slab.size:
                # The remainder of a range is tested in a block that ends with the range.
                block = np.concatenate([self._tail, slab])[-length:]
                at, size = outliers_of(block.reshape(1, -1), self._resolution)
                begin = self._row + slab.size - length
                new = begin + at >= self._row + end
                outliers.append((begin + at[new], size[new]))
        index, sizes = zip(*outliers, strict=True)
        return np.concatenate(index), np.concatenate(sizes)

    def _count(self, slab: Vector, outliers: Indices, first: int) -> None:
        """Update the moments of the axis and of its windows."""
        begin = self._row
        carried = begin > first
        steps = np.diff(slab, prepend=self._tail[-1:]) if carried else np.diff(slab)
        shift = 0 if carried else 1  # index of a sample minus index of the difference that ends at it
        self.all.add(0, slab)
        self.differences.add_squares(0, steps)
        for k, (a, b) in enumerate(self._ranges):
            low, high = max(a - begin, 0), min(b - begin, slab.size)
            if low >= high:
                continue
            part = slab[low:high]
            calm, sums = part, sums_of(part)
            self.windows.join(k, sums)
            inside = outliers[(outliers >= low) & (outliers < high)] - low
            if inside.size:
                calm = np.delete(part, inside)
                self.calm.add(k, calm)
            else:
                self.calm.join(k, sums)
            # The mean hardly changes over 256 samples. The noise before rounding is estimated from them.
            for runs, samples in ((self._runs[k], calm), (self._runs_of_all[k], part)):
                if (missing := 256 - sum(run.size for run in runs)) > 0:
                    runs.append(samples[:missing].copy())
            # The difference that ends at the first sample of a window belongs to no window.
            second = max(low, a - begin + 1)
            self.steps.add_squares(k, steps[max(second - shift, 0) : high - shift])

    def _level(self, slab: Vector, outliers: Indices, first: int) -> None:
        """Append the medians of the blocks, and their means without outliers."""
        if not self._levels or self._levels[-1][0] != first:
            self._levels.append((first, []))
            self._means.append((first, []))
        clean = slab
        if outliers.size:
            clean = slab.copy()
            clean[outliers] = np.nan
        values, clean = np.concatenate([self._unlevelled, slab]), np.concatenate([self._unaveraged, clean])
        end = values.size - values.size % self._length
        if end:
            medians = row_medians(values[:end].reshape(-1, self._length))
            self._levels[-1][1].append(medians)
            self._means[-1][1].append(_means(clean[:end].reshape(-1, self._length), medians))
        self._unlevelled, self._unaveraged = values[end:].copy(), clean[end:].copy()


def _means(blocks: Vector, medians: Vector) -> Vector:
    """Return the means of blocks whose outliers are NaN; for a block with outliers only, its median."""
    means = np.mean(blocks, axis=1)
    for k in np.flatnonzero(np.isnan(means)):
        calm = blocks[k][~np.isnan(blocks[k])]
        means[k] = np.mean(calm) if calm.size else medians[k]
    return np.asarray(means)


class PartSums(NamedTuple):
    """Number, mean, and sum of the squared deviations from the mean of some values."""

    number: int
    mean: float
    squares: float


def sums_of(values: Vector) -> PartSums:
    """Return the sums of n > 0 values."""
    mean = float(np.mean(values))
    apart = values - mean
    return PartSums(values.size, mean, float(apart @ apart))


class Moments:
    """Means and variances of several groups of values, accumulated in parts."""

    def __init__(self, groups: int) -> None:
        self.counts, self.means, self._squares = (np.zeros(groups) for _ in range(3))

    def add(self, group: int, values: Vector) -> None:
        """Add values to a group."""
        if values.size:
            self.join(group, sums_of(values))

    def add_squares(self, group: int, values: Vector) -> None:
        """Add values to a group for which only the mean square is needed; it is stored as the mean."""
        if values.size:
            self.join(group, PartSums(values.size, float(values @ values) / values.size, 0.0))

    def variances(self) -> Vector:
        """Return the variance Σ (x − mean)² / n of each group; 0 for an empty group."""
        return np.divide(self._squares, self.counts, out=np.zeros_like(self.means), where=self.counts > 0)

    def join(self, group: int, sums: PartSums) -> None:
        """Add the sums of values to a group."""
        before = self.counts[group]
        self.counts[group] = before + sums.number
        apart = sums.mean - self.means[group]
        self.means[group] += apart * sums.number / self.counts[group]
        self._squares[group] += sums.squares + apart**2 * before * sums.number / self.counts[group]


_SHAKEN = 4.0
"""Ratio of the spread of a window to the usual one at which a unit is not at rest (tests/test_inspection_limits.py)."""
_TOUCHED = 2.0
"""Ratio above which a window beside such a window belongs to the motion (tests/test_inspection_limits.py)."""
_UNLIKE, _LINKED = 1.2, 0.5
"""Smallest ratio of the 90 % to the 10 % quantile of spreads of windows, and smallest rank correlation of neighbours,
for a change of level: at most 0.41 in 300 recordings of steady noise (tests/test_inspection_faults.py)."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Time ranges of motion (s, rounded outwards), largest relative spread by axis, and windows without motion."""

    spans: tuple[tuple[float, float], ...]
    ratios: Mapping[str, float]
    still: NDArray[np.bool_]

    def meets(self, begin: float, end: float) -> bool:
        """Return whether a time range has a part in common with the motion."""
        return any(begin <= last and end >= first for first, last in self.spans)


def motion_of(
    statistics: Mapping[str, AxisStatistics], knocks: Sequence[Knock], extent: Extent,
    values: Callable[[str, int, int], Vector],
) -> Motion:  # fmt: skip
    """Find the windows with an unusual standard deviation on any axis, in each the part that moves, and join them with
    the knocks at their edges. `values(axis, first, last)` returns samples."""
    windows = extent.windows()
    shaken, touched = np.zeros(len(windows), dtype=bool), np.zeros(len(windows), dtype=bool)
    ratios, limits = {}, {}
    for axis, sums in statistics.items():
        spreads = np.sqrt(sums.calm.variances())
        changing = spreads[sums.steps.means > 0]  # windows in which the output is not stuck
        usual = float(np.median(changing)) if changing.size else 0.0
        if usual > 0 and np.max(spreads) > _SHAKEN * usual:
            shaken |= spreads > _SHAKEN * usual
            touched |= spreads > _TOUCHED * usual
            ratios[axis], limits[axis] = float(np.max(spreads) / usual), _TOUCHED * usual
    ranges = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]]))).reshape(-1, 2)
    spans = []
    still = np.ones(len(windows), dtype=bool)
    for a, b in ranges:
        if np.any(shaken[a:b]):
            still[a:b] = False
            first, last = windows[a][0], windows[b - 1][1]
            # Pieces of a second, as the motion can be far shorter than a window.
            piece = max(min(round(extent.rate), (last - first) // (b - a)), SHORTEST)
            parts = {axis: values(axis, first, last) for axis in limits}
            moving = np.zeros((last - first) // piece, dtype=bool)
            for axis, part in parts.items():
                moving |= np.std(part[: moving.size * piece].reshape(-1, piece), axis=1) > limits[axis]
            if np.any(moving):
                at = piece * np.flatnonzero(moving)
                begin, end = max(int(at[0]) - piece, 0), int(at[-1]) + 2 * piece
                rests = {axis: np.concatenate([part[:begin], part[end:]]) for axis, part in parts.items()}
                if all(rest.size and np.std(rest) < limits[axis] for axis, rest in rests.items()):
                    first, last = first + begin, min(first + end, last)
            since, until = map(float, extent.times([first, last - 1]))
            window = min(until - since, (windows[a][1] - windows[a][0]) / extent.rate)
            spans.append(_widened(since, until, window, knocks))
    return Motion(spans=tuple((a, min(b, extent.end)) for a, b in _joined(spans)), ratios=ratios, still=still)


def level_change(sums: AxisStatistics, motion: Motion, extent: Extent) -> tuple[float, float] | None:
    """Return the ratio of the noise in loud and quiet windows, and the time (s) of the largest change; None without.
    First differences are used, which slow noise does not affect."""
    used = np.flatnonzero(motion.still & (sums.steps.means > 0))
    if used.size < 32:
        return None
    levels = np.log(sums.steps.means[used]) / 2
    ranks = np.argsort(np.argsort(levels)) - (used.size - 1) / 2
    low, high = np.quantile(levels, [0.1, 0.9])
    ratio = math.exp(high - low)
    if ratio < _UNLIKE or float(ranks[1:] @ ranks[:-1]) < _LINKED * float(ranks @ ranks):
        return None
    count = np.arange(1, used.size)
    sums_before = np.cumsum(levels - np.mean(levels))[:-1]
    split = int(np.argmax(sums_before**2 / (count * (used.size - count)))) + 1
    return ratio, float(extent.times([extent.windows()[used[split]][0]])[0])


def _widened(begin: float, end: float, window: float, knocks: Sequence[Knock]) -> tuple[float, float]:
    """Extend a time range by the knocks at its edges and an eighth of a window, and round it outwards."""
    margin = window / 8
    for knock in knocks:
        if knock.time <= end + margin and knock.time + knock.duration >= begin - margin:
            begin, end = min(begin, knock.time), max(end, knock.time + knock.duration)
    fine = 10.0 ** min(math.floor(math.log10(window)), 0) if window < 0.25 else 1.0
    step = next((step for step in (300.0, 60.0, 15.0, 5.0) if 3 * step <= window), fine)
    return max(0.0, math.floor((begin - margin) / step) * step), math.ceil((end + margin) / step) * step


def _joined(spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Join ordered time ranges that overlap or touch."""
    joined: list[tuple[float, float]] = []
    for begin, end in spans:
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        else:
            joined.append((begin, end))
    return tuple(joined)


# The limits separate recordings at rest, vehicles and turns by hand in tests/test_inspection.py.
_TURNED = 1.0  # change of the direction of gravity (degrees) between two blocks in which the unit turns
_APART = 10.0  # change of the direction of gravity (degrees) between two positions
_SHORTEST, _FEWEST = 8, 3  # fewest blocks of a still part, and fewest positions


def still_parts(
    levels: Mapping[str, list[tuple[int, Vector]]], length: int, extent: Extent
) -> list[tuple[float, float]]:
    """Return the times (s) of the still parts of a recording with three positions or more; otherwise []."""
    axes = [levels.get(f"accel_{axis}", []) for axis in "xyz"]
    parts, directions = list[tuple[float, float]](), list[Vector]()
    for ranges in zip(*axes, strict=False):
        first = ranges[0][0]
        blocks = np.column_stack([values for _, values in ranges])
        norms = np.linalg.norm(blocks, axis=1, keepdims=True)
        unit = np.divide(blocks, norms, out=np.zeros_like(blocks), where=norms > 0)
        still = np.sum(unit[1:] * unit[:-1], axis=1) > np.cos(np.radians(_TURNED))
        for begin, end in runs_of(still).tolist():
            # The blocks at both ends may contain a part of the turn.
            if end - begin - 1 >= _SHORTEST:
                edges = [first + length * (begin + 1), first + length * end - 1]
                since = extent.times(edges)
                parts.append((float(since[0]), float(since[1])))
                directions.append(np.mean(unit[begin + 1 : end], axis=0))
    turns = [float(a @ b) < np.cos(np.radians(_APART)) for a, b in pairwise(directions)]
    return parts if sum(turns) >= _FEWEST - 1 else []
