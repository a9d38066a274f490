"""Compute statistics of one axis of a recording from chunks of any length, in bounded memory."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Vector, row_medians
from gmwm.measuring.inspection.knocks import BLOCK, FEWEST, Indices, Outliers, level_length, outliers_of
from gmwm.measuring.inspection.time_grid import Extent

_SLAB = 256 * BLOCK  # samples that are processed together; it affects memory and speed only


class AxisStatistics:
    """Moments, outliers and levels of one axis, whose samples are passed to `update` in order. The quantization step
    `resolution` is 0 if none is visible."""

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
        self._runs: list[list[Vector]] = [[] for _ in self._ranges]
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

    def runs(self) -> list[Vector]:
        """Return the first consecutive samples of each window, without outliers."""
        return [np.concatenate(run) for run in self._runs if run]

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
            self.windows.add(k, part)
            inside = outliers[(outliers >= low) & (outliers < high)] - low
            calm = np.delete(part, inside) if inside.size else part
            self.calm.add(k, calm)
            # The mean hardly changes over 256 samples. The noise before rounding is estimated from them.
            if (missing := 256 - sum(run.size for run in self._runs[k])) > 0:
                self._runs[k].append(calm[:missing].copy())
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


class Moments:
    """Means and variances of several groups of values, accumulated in parts."""

    def __init__(self, groups: int) -> None:
        self.counts, self.means, self._squares = (np.zeros(groups) for _ in range(3))

    def add(self, group: int, values: Vector) -> None:
        """Add values to a group."""
        if values.size:
            mean = float(np.mean(values))
            self._join(group, values.size, mean, float(np.sum((values - mean) ** 2)))

    def add_squares(self, group: int, values: Vector) -> None:
        """Add values to a group for which only the mean square is needed; it is stored as the mean."""
        if values.size:
            self._join(group, values.size, float(np.mean(values**2)), 0.0)

    def variances(self) -> Vector:
        """Return the variance Σ (x − mean)² / n of each group; 0 for an empty group."""
        return np.divide(self._squares, self.counts, out=np.zeros_like(self.means), where=self.counts > 0)

    def _join(self, group: int, count: int, mean: float, squares: float) -> None:
        before = self.counts[group]
        self.counts[group] = before + count
        apart = mean - self.means[group]
        self.means[group] += apart * count / self.counts[group]
        self._squares[group] += squares + apart**2 * before * count / self.counts[group]
