"""Means of a recording over blocks of time, so that a regression on slow covariates costs the same at any length."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gmwm.base.arrays import Booleans, Integers, Matrix, Vector, freeze
from gmwm.base.lazy import scipy
from gmwm.base.time_base import begins_of
from gmwm.recording.batches import BATCH_SAMPLES

LEAST_BLOCKS = 4096
"""Smallest number of blocks, if the recording has at least as many samples. Standard errors then differ by less than
0.1 % from those with all samples (docs/validation/regression.md)."""
CLIPPED_AT = 8.0
"""Distance from the block's median (standard deviations) at which samples are clipped, against shocks; chance 1e-15."""


def usual_length(samples: int, end: int) -> int:
    """Return the number of samples in a block, for `samples` samples and `end` with the missing samples in gaps."""
    # Largest number of blocks including those in gaps. It limits the memory for a recording with long gaps.
    return 1 << max(int(max(samples // LEAST_BLOCKS, end // (1 << 17))).bit_length() - 1, 0)


@dataclass(frozen=True, eq=False)
class BlockClock:
    """Times of samples, divided into blocks of `length` (a power of two). `segments` are ranges without gaps, and
    `offsets` the times of their first samples, in sampling intervals."""

    length: int
    rate: float
    segments: tuple[tuple[int, int], ...]
    offsets: tuple[int, ...]

    @classmethod
    def of(
        cls, rate: float, segments: tuple[tuple[int, int], ...], starts: tuple[float, ...], length: int | None = None
    ) -> BlockClock:
        """Divide a recording into at least `LEAST_BLOCKS` blocks, or into blocks of a given length."""
        begins = begins_of(rate, segments, starts)
        offsets, end = [], 0
        for begin, (first, last) in zip(begins, segments, strict=True):
            offsets.append(max(round(begin * rate), end))
            end = offsets[-1] + last - first
        samples = segments[-1][1]
        return cls(usual_length(samples, end) if length is None else length, rate, tuple(segments), tuple(offsets))

    @property
    def end(self) -> int:
        """Number of sampling intervals from the first sample to the end of the last one."""
        first, last = self.segments[-1]
        return self.offsets[-1] + last - first

    @property
    def blocks(self) -> int:
        """Number of blocks from the first to the last sample, including blocks in gaps."""
        return -(-self.end // self.length)

    @property
    def times(self) -> Vector:
        """Times of the centres of the blocks (s), measured from the first sample."""
        return np.asarray(((np.arange(self.blocks) + 0.5) * self.length - 0.5) / self.rate, dtype=np.float64)

    def places(self) -> list[tuple[int, int, int]]:
        """Return first sample, end and time (sampling intervals) of pieces of bounded size, each within one segment."""
        pieces = []
        for (first, last), offset in zip(self.segments, self.offsets, strict=True):
            begin = first
            while begin < last:
                # Each piece ends at the end of a block.
                stop = min(begin + (1 << 20) - (offset + begin - first) % self.length, last)
                pieces.append((begin, stop, offset + begin - first))
                begin = stop
        return pieces

    @cached_property
    def _ranges(self) -> Integers:
        """First sample, end and time of the first sample (in sampling intervals) of each segment (k, 3)."""
        return np.column_stack([np.array(self.segments, dtype=np.int64), np.array(self.offsets, dtype=np.int64)])

    @cached_property
    def counts(self) -> Integers:
        """Number of observed samples in each block."""
        first, last, offset = self._ranges.T
        # Samples before each edge, interpolated between ends of segments: exact, as all values are integers.
        corners = np.stack([offset, offset + last - first], axis=1).ravel()
        before = np.interp(np.arange(self.blocks + 1) * self.length, corners, np.stack([first, last], axis=1).ravel())
        return freeze(np.diff(before).astype(np.int64))

    def present(self) -> Booleans:
        """Return the mask of the blocks with at least half of their samples."""
        return np.asarray(self.counts * 2 >= self.length)

    def whole(self) -> Booleans:
        """Return the mask of the blocks with all of their samples."""
        return np.asarray(self.counts == self.length)

    def part(self, first: int, last: int) -> BlockClock:
        """Return the clock of the samples first … last − 1, with the same blocks."""
        ranges = [
            (max(begin, first) - first, min(end, last) - first, offset + max(first - begin, 0))
            for (begin, end), offset in zip(self.segments, self.offsets, strict=True)
            if begin < last and end > first
        ]
        return replace(
            self, segments=tuple((a, b) for a, b, _ in ranges), offsets=tuple(offset for _, _, offset in ranges)
        )

    def means(self, values: Vector, *, clipped: bool = False) -> Vector:
        """Return the mean of the samples in each block; 0 for empty blocks. If `clipped`, without outlying samples."""
        sums = np.zeros(self.blocks)
        for first in range(0, values.size, BATCH_SAMPLES):
            part = self.part(first, min(first + BATCH_SAMPLES, values.size)) if values.size > BATCH_SAMPLES else self
            part_sums = part.sums(values[first : first + BATCH_SAMPLES], clipped=clipped)
            sums[: part_sums.size] += part_sums
        return self.mean_of(sums)

    def mean_of(self, sums: Vector) -> Vector:
        """Return the means of blocks from the sums of their samples. Empty blocks have the value 0."""
        counts = self.counts
        return np.divide(sums, counts, out=np.zeros(sums.size), where=counts > 0)

    def sums(self, values: Vector, *, clipped: bool = False) -> Vector:
        """Return the sum of the samples in each block. The sums of several batches can be added."""
        spread = self._usual_spread(values) if clipped and self.length > 1 else 0.0
        sums = np.zeros(self.blocks)
        for first, last, place in self.places():
            part, at = values[first:last], place // self.length
            head = min((-place) % self.length, part.size)
            count = (part.size - head) // self.length
            edge = head + count * self.length
            rows = part[head:edge].reshape(-1, self.length)
            begin = at + (head > 0)
            sums[begin : begin + count] += np.sum(_clip(rows, spread) if spread else rows, axis=1)
            for margin, k in ((part[:head], at), (part[edge:], begin + count)):
                if margin.size:
                    sums[k] += np.sum(_clip(margin[None, :], spread) if spread else margin)
        return sums

    def clip(self, values: Vector) -> Vector:
        """Return the values with samples clipped that are far from the median of their block; see `CLIPPED_AT`."""
        spread, out = self._usual_spread(values), values.copy()
        for first, last, place in self.places():
            head = min((-place) % self.length, last - first)
            edge = last - (last - first - head) % self.length
            out[first + head : edge] = _clip(out[first + head : edge].reshape(-1, self.length), spread).ravel()
            for low, high in ((first, first + head), (edge, last)):
                if low < high:
                    out[low:high] = _clip(out[None, low:high], spread)[0]
        return out

    def _usual_spread(self, values: Vector) -> float:
        """Return the median of the standard deviations within blocks, over every eighth piece of the recording."""
        spreads = []
        for first, last, place in self.places()[::8]:
            part = values[first + min((-place) % self.length, last - first) : last]
            rows = part[: part.size - part.size % self.length].reshape(-1, self.length)
            spreads.append(np.std(rows, axis=1))
        every = np.concatenate(spreads) if spreads else np.empty(0)
        return float(np.median(every)) if every.size else 0.0

    def interpolate(self, means: Vector, first: int, last: int) -> Vector:
        """Interpolate block means linearly between centres of non-empty blocks, at samples first … last − 1."""
        at, curve = self._lines(means)
        samples = np.arange(first, last)
        begins, _, offsets = self._ranges.T
        places = samples + (offsets - begins)[np.searchsorted(begins, samples, side="right") - 1]
        return np.asarray(np.interp(places, at, curve))

    def onto(self, means: Vector, finer: BlockClock) -> Vector:
        """Return block means of a finer clock that keep the present means, from a spline through the running sum.
        Linear interpolation would reduce a daily cycle with 16 blocks per day by 2 %."""
        at, curve = self._lines(means)
        if self.length == finer.length or self.blocks < 4:
            return np.asarray(np.interp((np.arange(finer.blocks) + 0.5) * finer.length - 0.5, at, curve))
        edges = np.append(np.arange(self.blocks) * float(self.length), self.end)
        middles = np.interp((np.arange(self.blocks) + 0.5) * self.length - 0.5, at, curve)
        sums = np.concatenate([[0.0], np.cumsum(middles * np.diff(edges))])
        at = np.append(np.arange(finer.blocks) * float(finer.length), edges[-1])
        return np.asarray(np.diff(scipy.interpolate.CubicSpline(edges, sums)(at)) / np.diff(at))

    def _lines(self, means: Vector) -> tuple[Vector, Vector]:
        """Return times (sampling intervals) and values of nodes of a line through the means of non-empty blocks."""
        filled = np.flatnonzero(self.present() if np.any(self.present()) else self.counts > 0)
        at = np.asarray((filled + 0.5) * self.length - 0.5, dtype=np.float64)
        curve = means[filled]
        if filled.size > 1 and self.length > 1:
            # Extend the curve linearly to the first and to the last sample.
            rise = (curve[[1, -1]] - curve[[0, -2]]) / (at[[1, -1]] - at[[0, -2]]) * self.length
            curve = np.concatenate([[curve[0] - rise[0]], curve, [curve[-1] + rise[1]]])
            at = np.concatenate([[at[0] - self.length], at, [at[-1] + self.length]])
        return at, curve


def _clip(rows: Matrix, spread: float) -> Matrix:
    """Clip samples that are far from the median of their block. Each row is a block."""
    far = np.flatnonzero(np.ptp(rows, axis=1) > CLIPPED_AT * spread)
    if not far.size:
        return rows
    out = rows.copy()
    middle = np.median(rows[far], axis=1, keepdims=True)
    # 1.4826 times the median distance is the standard deviation of Gaussian noise.
    spreads = 1.4826 * np.median(np.abs(rows[far] - middle), axis=1, keepdims=True)
    reach = CLIPPED_AT * np.maximum(spreads, spread)
    out[far] = np.clip(rows[far], middle - reach, middle + reach)
    return out
