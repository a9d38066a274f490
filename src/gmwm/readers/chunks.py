"""Build the chunks of a recording from the rows of a file: in SI units, cut at gaps, with a summary of all rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gmwm._arrays import Vector
from gmwm.readers.base import Rows
from gmwm.readers.columns import Choice
from gmwm.readers.lost_samples import about_lost, as_floats, gaps_of, sift
from gmwm.readers.running_clock import KnownClock, Pace, RunningClock, Settled
from gmwm.readers.time_stamps import Timing
from gmwm.remarks import Remark
from gmwm.time_base import TimeBase


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of a recording without a gap between them, delivered at one time.

    Attributes
    ----------
    values : mapping of axis name to (n,) array, in rad/s or m/s²
    first : int
        Number of the first sample in the recording, from 0.
    segment : int
        Number of their segment, from 0. It increases if there is a gap between the previous chunk and this one.
    start : float
        Time of the first sample (s), on the clock of the recording.
    """

    values: Mapping[str, Vector]
    first: int
    segment: int
    start: float

    def __len__(self) -> int:
        return int(next(iter(self.values.values())).size)

    def __getitem__(self, axis: str) -> Vector:
        return self.values[axis]


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Columns and units of a recording, found from its first rows, and its clock.

    Attributes
    ----------
    choice : Choice
        The columns to read: the axes, and the time if it is needed to place rows.
    words : mapping
        Name of each column in messages.
    factors : mapping of axis to factors
        Factors by which the numbers in the file are multiplied, one after the other.
    timing : Timing
        Rate and segments of all rows; of the first rows of a live stream.
    pace : Pace or None
        The pace of the time stamps of a live stream; None for a file.
    remarks : tuple of Remark
        Remarks on how gmwm read the file.
    sparse : bool
        Whether the clock counts fewer rows than the file has.
    """

    choice: Choice
    words: Mapping[str, str]
    factors: Mapping[str, tuple[float, ...]]
    timing: Timing
    pace: Pace | None
    remarks: tuple[Remark, ...]
    sparse: bool = False

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return self.timing.base.rate


@dataclass(frozen=True, eq=False)
class RowSummary:
    """Summary of consecutive rows: their time stamps and the number of lost samples.

    Attributes
    ----------
    first, stop : int
        Number of the first sample, and of the sample after the last one.
    parted : bool
        Whether there is a gap before the first sample.
    lost : int
        Number of lost samples.
    gaps : tuple of (sample, seconds)
        For each gap, the first sample after it and its length.
    live : TimeBase or None
        The time base of a live stream.
    about : tuple of Remark
        Remarks on the time stamps of a live stream.
    """

    first: int
    stop: int
    parted: bool
    lost: int = 0
    gaps: tuple[tuple[int, float], ...] = ()
    live: TimeBase | None = None
    about: tuple[Remark, ...] = ()

    def followed_by(self, later: RowSummary) -> RowSummary:
        """Merge with the summary of the rows that directly follow."""
        # A part counts its samples from the number of its first row in the file.
        shift = self.stop - later.first
        moved = tuple((sample + shift, seconds) for sample, seconds in later.gaps)
        return RowSummary(
            self.first, later.stop + shift, parted=self.parted, gaps=self.gaps + moved, lost=self.lost + later.lost
        )

    def time_base(self, found: Interpretation) -> TimeBase:
        """The time base of the recording, from the time stamps of all rows."""
        return replace(self.live or found.timing.base, gaps=self.gaps, lost=self.lost)

    def remarks(self, found: Interpretation) -> tuple[Remark, ...]:
        """Remarks that need all rows: on lost samples, and on the time stamps of a live stream."""
        return (*self.about, *about_lost(self.time_base(found)))


class ChunkBuilder:
    """Builds the chunks of a recording from its rows, starting at any row.

    Parameters
    ----------
    found : Interpretation
        Columns, units and rate from the first rows of the recording.
    size : int
        Largest number of samples in a chunk.
    first : int
        Number of the first row that will be added.
    lost_before : bool
        Whether the row before it is lost.
    """

    def __init__(self, found: Interpretation, size: int, first: int = 0, lost_before: bool = False) -> None:
        self._found, self._size, self._first = found, size, first
        self._known = KnownClock(found.timing, first)
        self._live = None if found.pace is None else RunningClock(found.pace)
        # Rows whose segment is not known yet, and the numbers of those that are lost or follow a row without a place.
        self._waiting: dict[str, Vector] = {axis: np.empty(0) for axis in found.choice.axes}
        self._lost, self._cut = np.zeros(0, dtype=bool), np.zeros(1, dtype=bool)
        self._came, self._segment, self._begun = first, 0, self._known.segment_at(first)
        self._parted = False
        # The row of the last sample, the number of the next sample, and whether a gap is between them.
        self._last, self._next, self._broken = first - 1, first, lost_before
        self._breaks, self._count = list[tuple[tuple[int, int], int]](), 0

    def add(self, rows: Rows) -> Iterator[Chunk]:
        """Add the next rows, and yield the chunks whose segments are now known.

        Raises
        ------
        ReadError, DataError
            If `read` would refuse the rows.
        """
        found, columns = self._found, self._found.choice.columns
        sifted = sift(rows, columns, found.choice.axes)
        self._count += sifted.unplaced
        # Rows that were written after the clock was found do not belong to the recording.
        left = None if self._live else self._known.left()
        rows = {k: column[:left] for k, column in sifted.rows.items()}
        size = next(iter(rows.values())).size
        cut = np.zeros(size + 1, dtype=bool) if sifted.cut is None else sifted.cut[: size + 1]
        cut[0] |= self._cut[-1]
        self._cut = np.concatenate([self._cut[:-1], cut])
        lost = np.zeros(size, dtype=bool) if sifted.lost is None else sifted.lost[:size]
        self._lost = np.concatenate([self._lost, lost])
        values = {axis: _in_si(as_floats(rows[columns[axis]]), found.factors[axis]) for axis in found.choice.axes}
        self._waiting = {axis: _joined(self._waiting[axis], v) for axis, v in values.items()}
        self._came += size
        yield from self._settled(self._live.take(rows[columns["time"]]) if self._live else self._known.take(size))

    def end(self) -> Iterator[Chunk]:
        """Yield the last chunks."""
        if self._live:
            yield from self._settled(self._live.end())

    def summary(self) -> RowSummary:
        """The summary of all rows so far."""
        live = None if self._live is None else self._live.base()
        stamped = self._known.gaps(self._first, self._came) if live is None else live.gaps
        pairs, samples = [pair for pair, _ in self._breaks], [sample for _, sample in self._breaks]
        return RowSummary(
            self._first,
            self._next,
            parted=self._parted,
            gaps=gaps_of(pairs, samples, stamped=stamped, rate=self._found.rate),
            lost=self._count,
            live=live,
            about=() if self._live is None else tuple(self._live.remarks()),
        )

    def _settled(self, settled: Settled) -> Iterator[Chunk]:
        ready, lost, cut = self._waiting, self._lost, self._cut
        first = self._came - lost.size
        stop, times = settled.stop, dict(zip(settled.firsts, settled.starts, strict=True))
        self._waiting = {axis: v[stop - first :] for axis, v in ready.items()}
        self._lost, self._cut = lost[stop - first :], cut[stop - first :]
        turns = np.flatnonzero(np.diff(lost[: stop - first])) + 1 + first
        cuts = {int(row) + first for row in np.flatnonzero(cut[: stop - first])}
        for a, b in pairwise(sorted({first, *times, *turns.tolist(), *cuts, stop})):
            if a in times:
                self._begun = (a, times[a])
            self._broken |= (a in times and a > 0) or a in cuts
            if lost[a - first]:
                self._broken, self._count = True, self._count + b - a
                continue
            if self._broken:
                self._part(a)
            for k in range(a, b, self._size):
                part = slice(k - first, min(k + self._size, b) - first)
                start = self._begun[1] + (k - self._begun[0]) / self._found.rate
                yield Chunk({axis: v[part] for axis, v in ready.items()}, self._next, self._segment, start)
                self._next += part.stop - part.start
            self._last = b - 1

    def _part(self, row: int) -> None:
        """Begin a segment with a row, after a gap."""
        self._broken = False
        if self._next == 0:
            return  # rows before the first sample of the recording
        if self._next == self._first:
            self._parted = True
        self._segment += 1
        self._breaks.append(((self._last, row), self._next))


def _joined(before: Vector, after: Vector) -> Vector:
    return np.concatenate([before, after]) if before.size else after


def _in_si(values: Vector, factors: Sequence[float]) -> Vector:
    for factor in factors:
        values = values * factor
    return values
