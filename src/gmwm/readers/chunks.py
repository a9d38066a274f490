"""Build the chunks of a recording from the rows of a file: in SI units, cut at gaps, with a summary of all rows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.readers.api import constant, require_finite_rows
from gmwm.readers.base import Rows
from gmwm.readers.columns import Choice
from gmwm.readers.running_clock import Counted, Pace, RunningClock, Settled
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
    """Columns, units and rate of a recording, found from its first rows.

    Attributes
    ----------
    choice : Choice
        The columns to read, without temperature.
    words : mapping
        Name of each column in messages.
    factors : mapping of axis to factors
        Factors by which the numbers in the file are multiplied, one after the other.
    timing : Timing
        Rate and segments of the first rows.
    pace : Pace or None
        The pace of their time stamps; None without time stamps.
    remarks : tuple of Remark
        Remarks on how gmwm read the file.
    """

    choice: Choice
    words: Mapping[str, str]
    factors: Mapping[str, tuple[float, ...]]
    timing: Timing
    pace: Pace | None
    remarks: tuple[Remark, ...]

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return self.timing.base.rate


@dataclass(frozen=True, eq=False)
class RowSummary:
    """Summary of consecutive rows: their time stamps, and the axes with constant values.

    Attributes
    ----------
    first, stop : int
        Number of the first row, and of the row after the last one.
    parted : bool
        Whether there is a gap before the first row.
    alike : mapping of axis to number
        The axes that were constant so far, with their value in the file.
    counted : Counted
        Sums over the intervals of the time stamps.
    """

    first: int
    stop: int
    parted: bool
    alike: Mapping[str, float]
    counted: Counted

    def followed_by(self, later: RowSummary) -> RowSummary:
        """Merge with the summary of the rows that directly follow."""
        alike = {axis: value for axis, value in self.alike.items() if later.alike.get(axis) == value}
        counted = self.counted.followed_by(later.counted)
        return RowSummary(self.first, later.stop, parted=self.parted, alike=alike, counted=counted)

    def time_base(self, found: Interpretation) -> TimeBase:
        """The time base of the recording, from the time stamps of all rows."""
        return found.timing.base if found.pace is None else found.pace.base(self.counted)

    def remarks(self, found: Interpretation) -> tuple[Remark, ...]:
        """Remarks on the time stamps of all rows.

        Raises
        ------
        DataError
            If an axis has the same value in all rows.
        """
        for axis, value in self.alike.items():
            raise constant(found.words[axis], axis, value, self.stop)
        return () if found.pace is None else tuple(found.pace.remarks(self.counted, self.stop))


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
    before : (n,) array, optional
        The time stamps of the rows before it, as `RunningClock` needs them; None for the first row of the recording.
    """

    def __init__(self, found: Interpretation, size: int, first: int = 0, before: NDArray[Any] | None = None) -> None:
        self._found, self._size, self._first = found, size, first
        self._clock = None if found.pace is None else RunningClock(found.pace, first, before)
        self._alike: dict[str, float | None] = dict.fromkeys(found.choice.axes)
        # Rows whose segment is not known yet.
        self._waiting: dict[str, Vector] = {axis: np.empty(0) for axis in found.choice.axes}
        self._came, self._segment, self._begun = first, 0, (first, first / found.rate)
        self._parted = False

    def add(self, rows: Rows) -> Iterator[Chunk]:
        """Add the next rows, and yield the chunks whose segments are now known.

        Raises
        ------
        ReadError, DataError
            If `read` would refuse the rows.
        """
        found, columns = self._found, self._found.choice.columns
        for role, k in columns.items():
            require_finite_rows(rows[k], found.words[role], self._came)
        values = {axis: _in_si(rows[columns[axis]], found.factors[axis]) for axis in found.choice.axes}
        self._compare({axis: rows[columns[axis]] for axis in found.choice.axes})
        self._waiting = {axis: _joined(self._waiting[axis], v) for axis, v in values.items()}
        stamps = rows[columns["time"]] if self._clock is not None else np.empty(0)
        if found.pace is not None and self._came == self._first and stamps.size:
            self._begun = (self._first, found.pace.time(float(found.pace.ticks(stamps[:1])[0])))
        at_first, self._came = self._came == 0, self._came + next(iter(values.values())).size
        if self._clock is None:
            settled = Settled(self._came, (0,) if at_first else (), (0.0,) if at_first else ())
        else:
            settled = self._clock.take(stamps)
        yield from self._settled(settled)

    def end(self, behind: NDArray[Any] | None = None) -> Iterator[Chunk]:
        """Yield the last chunks. `behind` has the time stamps of the next rows of the recording, if there are any."""
        settled = Settled(self._came, (), ()) if self._clock is None else self._clock.end(behind)
        yield from self._settled(settled)

    def summary(self) -> RowSummary:
        """The summary of all rows so far."""
        counted = Counted() if self._clock is None else self._clock.counted
        alike = {axis: value for axis, value in self._alike.items() if value is not None}
        return RowSummary(self._first, self._came, parted=self._parted, alike=alike, counted=counted)

    def _settled(self, settled: Settled) -> Iterator[Chunk]:
        ready = self._waiting
        first = self._came - next(iter(ready.values())).size
        stop, times = settled.stop, dict(zip(settled.firsts, settled.starts, strict=True))
        self._waiting = {axis: v[stop - first :] for axis, v in ready.items()}
        for a, b in pairwise(sorted({first, *times, stop})):
            if a in times:
                self._segment, self._begun = self._segment + (a > 0), (a, times[a])
                self._parted |= a == self._first > 0
            for k in range(a, b, self._size):
                part = slice(k - first, min(k + self._size, b) - first)
                start = self._begun[1] + (k - self._begun[0]) / self._found.rate
                yield Chunk({axis: v[part] for axis, v in ready.items()}, k, self._segment, start)

    def _compare(self, numbers: Mapping[str, NDArray[Any]]) -> None:
        """Remove the axes whose values now differ from the list of constant axes."""
        for axis in list(self._alike):
            column, known = numbers[axis], self._alike[axis]
            value = float(column[0]) if known is None and column.size else known
            if column.size and (column[-1] != value or bool(np.any(column != value))):
                del self._alike[axis]
            else:
                self._alike[axis] = value


def _joined(before: Vector, after: Vector) -> Vector:
    return np.concatenate([before, after]) if before.size else after


def _in_si(numbers: NDArray[Any], factors: Sequence[float]) -> Vector:
    values: Vector = np.asarray(numbers).astype(np.float64, copy=False)
    for factor in factors:
        values = values * factor
    return values
