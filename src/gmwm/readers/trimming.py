"""A stream limited to ranges of time: between two times, and without the ranges to skip."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from gmwm.readers.chunks import Chunk
from gmwm.time_base import TimeBase
from gmwm.time_ranges import ROUNDING, cut_base, require_inside, require_some

Kept = Sequence[tuple[float, float]]
"""Ranges of time (s), in order."""


def trimmed(
    chunks: Iterable[Chunk], kept: Kept, rate: float, base: Callable[[], TimeBase], ended: Callable[[TimeBase], None]
) -> Iterator[Chunk]:
    """Yield the samples of chunks that lie in the kept time ranges, the same samples as `Imu.between`.

    Reading ends after the last range. Then `ended` is called with the time base of the kept samples, which is derived
    from the time base that `base` returns.

    Raises
    ------
    DataError
        At the end, if no segment of at least 8 samples is left, or a range to skip is after the end of the recording.
    """
    clock, cursor, left = _Clock(rate), _Cursor(rate), math.nan
    for chunk in chunks:
        clock.update(chunk)
        for a, b in clock.inside(chunk, kept):
            if not cursor.sizes:
                left = clock.time(chunk, a)
            yield cursor.numbered(chunk, a, b)
        if not kept or clock.end >= kept[-1][1]:
            break
    require_some(max(cursor.sizes, default=0), kept, clock.end)
    require_inside(kept, clock.end, rate)
    ended(cut_base(base(), cursor.starts, cursor.sizes, left))


class _Clock:
    """Time since the first sample, including gaps. If the clock was set back, the time continues without a step."""

    def __init__(self, rate: float) -> None:
        self._rate, self._segment = rate, -1
        self._origin = self._ahead = self.end = 0.0
        self._first, self._begin = 0, 0.0

    def update(self, chunk: Chunk) -> None:
        """Add the next chunk."""
        if self._segment < 0:
            self._origin = chunk.start
        if chunk.segment != self._segment:
            begin = chunk.start - self._origin + self._ahead
            if begin < self.end:
                self._ahead, begin = self._ahead + self.end - begin, self.end
            self._segment, self._first, self._begin = chunk.segment, chunk.first, begin
        self.end = self._begin + (chunk.first + len(chunk) - self._first) / self._rate

    def time(self, chunk: Chunk, k: int) -> float:
        """Time (s) of sample k of the current chunk."""
        return self._begin + (chunk.first + k - self._first) / self._rate

    def inside(self, chunk: Chunk, kept: Kept) -> Iterator[tuple[int, int]]:
        """The index ranges of a chunk that lie in the kept ranges of time."""
        shift = self._first - chunk.first
        for limits in kept:
            a, b = (
                int(np.clip(np.ceil((edge - self._begin) * self._rate - ROUNDING) + shift, 0, len(chunk)))
                for edge in limits
            )
            if a < b:
                yield a, b


class _Cursor:
    """Numbers the kept samples and segments."""

    def __init__(self, rate: float) -> None:
        self.starts: list[float] = []
        self.sizes: list[int] = []
        self._rate, self._count = rate, 0
        self._next = (-1, -1)  # segment and number of the sample that would follow without a gap

    def numbered(self, chunk: Chunk, a: int, b: int) -> Chunk:
        """The samples a to b of a chunk as a chunk of the kept recording."""
        start = chunk.start + a / self._rate
        if self._next != (chunk.segment, chunk.first + a):
            self.starts.append(start)
            self.sizes.append(0)
        self._next = (chunk.segment, chunk.first + b)
        values = {axis: v[a:b] for axis, v in chunk.values.items()}
        made = Chunk(values, self._count, len(self.sizes) - 1, start)
        self.sizes[-1] += b - a
        self._count += b - a
        return made
