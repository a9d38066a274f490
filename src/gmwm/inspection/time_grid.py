"""Where a recording's samples are: what must be known of it before they are looked at one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from numpy.typing import ArrayLike

from gmwm._arrays import Vector
from gmwm.signals import Signal
from gmwm.time_base import begins_of, times_of

_WINDOWS = 64
"""Of a recording, whose means and spreads are compared."""

Range = tuple[int, int]


@dataclass(frozen=True)
class Extent:
    """Segments of a recording and when they begin, in seconds from its first sample before anything was cut off.

    Attributes
    ----------
    rate : float
        Samples per second (Hz).
    segments : tuple of (first, last)
        Index ranges without a gap.
    starts : tuple of float
        Time of the first sample of each (s).
    """

    rate: float
    segments: tuple[Range, ...]
    starts: tuple[float, ...]

    @classmethod
    def of(cls, signal: Signal, left: float = 0.0) -> Extent:
        """That of a signal in memory, the first sample of which was taken at `left` (s)."""
        return cls.at(signal.rate, signal.segments, signal.starts, left)

    @classmethod
    def at(cls, rate: float, segments: Sequence[Range], clock: Sequence[float], left: float) -> Extent:
        """That of segments by what some clock showed when they began; at the first sample `left` (s) were over."""
        begins = begins_of(rate, segments, clock)
        return cls(rate, tuple(segments), tuple(left + begin for begin in begins))

    @property
    def samples(self) -> int:
        """How many there are."""
        return self.segments[-1][1]

    def times(self, indices: ArrayLike) -> Vector:
        """When the samples with these indices were taken (s): what `skip` of `read` takes."""
        return times_of(indices, self.rate, self.segments, self.starts)

    def windows(self) -> list[Range]:
        """About 64 index ranges of like length, whose means and spreads are therefore comparable.

        They cross no gap, but where segments are shorter than half a window: those are taken together with the
        short ones beside them, and left out if that is not enough.
        """
        length = max(self.samples // _WINDOWS, 1)
        ranges: list[Range] = []
        joined = False  # whether the last range is of short segments and may still grow
        for first, last in self.segments:
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
