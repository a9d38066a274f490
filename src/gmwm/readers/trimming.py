"""A part of a recording in pieces: between two times, and without what was handled on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence

import numpy as np

from gmwm.readers.assembly import Piece
from gmwm.signals import TimeBase
from gmwm.time_ranges import ROUNDING, cut_base, require_inside, require_some

Kept = Sequence[tuple[float, float]]
"""Stretches of time (s), in order."""


def trimmed(
    pieces: Iterable[Piece], kept: Kept, rate: float, base: Callable[[], TimeBase], ended: Callable[[TimeBase], None]
) -> Iterator[Piece]:
    """What of the pieces lies in the stretches that are kept: the samples that `Imu.between` keeps.

    Behind the last stretch nothing more is read. `ended` is told the time base that there is then, from that of `base`.

    Raises
    ------
    DataError
        At the end, if no segment of 8 samples or more was left, or what was to be skipped lies behind the end.
    """
    clock, cursor, left = _Clock(rate), _Cursor(rate), math.nan
    for piece in pieces:
        clock.take(piece)
        for a, b in clock.inside(piece, kept):
            if not cursor.sizes:
                left = clock.time(piece, a)
            yield cursor.numbered(piece, a, b)
        if not kept or clock.end >= kept[-1][1]:
            break
    require_some(max(cursor.sizes, default=0), kept, clock.end)
    require_inside(kept, clock.end, rate)
    ended(cut_base(base(), cursor.starts, cursor.sizes, left))


class _Clock:
    """Seconds from the first sample, over gaps too; where the clock was set back as if nothing had happened."""

    def __init__(self, rate: float) -> None:
        self._rate, self._segment = rate, -1
        self._origin = self._ahead = self.end = 0.0
        self._first, self._begin = 0, 0.0

    def take(self, piece: Piece) -> None:
        """The piece that follows."""
        if self._segment < 0:
            self._origin = piece.start
        if piece.segment != self._segment:
            begin = piece.start - self._origin + self._ahead
            if begin < self.end:
                self._ahead, begin = self._ahead + self.end - begin, self.end
            self._segment, self._first, self._begin = piece.segment, piece.first, begin
        self.end = self._begin + (piece.first + len(piece) - self._first) / self._rate

    def time(self, piece: Piece, k: int) -> float:
        """When its sample k was taken."""
        return self._begin + (piece.first + k - self._first) / self._rate

    def inside(self, piece: Piece, kept: Kept) -> Iterator[tuple[int, int]]:
        """The ranges of it that lie in the stretches."""
        shift = self._first - piece.first
        for stretch in kept:
            a, b = (
                int(np.clip(np.ceil((edge - self._begin) * self._rate - ROUNDING) + shift, 0, len(piece)))
                for edge in stretch
            )
            if a < b:
                yield a, b


class _Cursor:
    """Numbers of what is kept."""

    def __init__(self, rate: float) -> None:
        self.starts: list[float] = []
        self.sizes: list[int] = []
        self._rate, self._count = rate, 0
        self._next = (-1, -1)  # segment and number in the recording of what would follow without a gap

    def numbered(self, piece: Piece, a: int, b: int) -> Piece:
        """A part of a piece as a piece of what is kept."""
        start = piece.start + a / self._rate
        if self._next != (piece.segment, piece.first + a):
            self.starts.append(start)
            self.sizes.append(0)
        self._next = (piece.segment, piece.first + b)
        values = {axis: v[a:b] for axis, v in piece.values.items()}
        made = Piece(values, self._count, len(self.sizes) - 1, start)
        self.sizes[-1] += b - a
        self._count += b - a
        return made
