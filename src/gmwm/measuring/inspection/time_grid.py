"""Segments of a recording, their times, and windows of equal length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector
from gmwm.base.time_base import begins_of, lost_before, times_of
from gmwm.recording.gaps import joined_ranges

_WINDOWS = 64
"""Number of windows whose means and standard deviations are compared (tests/test_inspection_limits.py)."""

Range = tuple[int, int]


@dataclass(frozen=True)
class Extent:
    """Segments (half-open index ranges) with start times since the first sample of the file, and whether lengths of
    gaps are known."""

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
        """Return about 64 half-open index ranges of similar length, whose means can be compared. None contains a gap
        that is too long to fill, unless both sides are shorter than half a window; too short ones are left out."""
        length = max(self.samples // _WINDOWS, 1)
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
