"""Build the samples of a recording from the rows of a file: in SI units, split at gaps, with a summary of all rows.

Temperatures are interpolated between readings, also of rows without samples, by increasing time stamps or else row
numbers. The first one serves before it, and the last one for over `MOST_ROWS_APART` rows. Chunks have no effect."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase
from gmwm.base.units import beyond_sensors, in_celsius, si_unit
from gmwm.files.clock.missing_values import about_lost, as_floats, drop, gaps_of, is_missing, sift
from gmwm.files.clock.running_clock import KnownClock, KnownSegments, RunningClock
from gmwm.files.contract import Rows
from gmwm.files.readers.interpretation import TEMPERATURE, Interpretation, RowSource
from gmwm.recording.chunks import Samples
from gmwm.recording.signals import Imu, Signal

MOST_ROWS_APART = 1 << 20
"""Rows over which the temperature is interpolated (17 min at 1 kHz): so many rows wait in memory. It is a choice."""


@dataclass(frozen=True)
class _TemperatureReading:
    """A temperature, its row number, and its time from the first time stamp."""

    row: int
    stamp: float
    value: float


@dataclass(frozen=True, eq=False)
class _RowBlock:
    """Consecutive rows, starting with row `first` of the file."""

    rows: Rows
    first: int
    stamps: Vector
    values: Vector
    missing: NDArray[np.bool_]

    def reading(self, k: int) -> _TemperatureReading:
        """Return the reading of row k."""
        return _TemperatureReading(self.first + k, float(self.stamps[k]), float(self.values[k]))

    def fill(self, column: int, before: _TemperatureReading, after: _TemperatureReading | None) -> Rows:
        """Return the rows with a temperature in each, interpolated between readings in and next to the block."""
        present, at = np.flatnonzero(~self.missing), np.flatnonzero(self.missing)
        if not at.size:
            return self.rows
        readings = [before, *([] if after is None else [after])]
        row, stamp, value = (
            np.concatenate([[getattr(before, name)], inner, [getattr(reading, name) for reading in readings[1:]]])
            for name, inner in (
                ("row", present + self.first), ("stamp", self.stamps[present]), ("value", self.values[present]),
            )
        )  # fmt: skip
        before_index = np.searchsorted(row, at + self.first, side="right") - 1
        right = np.minimum(before_index + 1, row.size - 1)
        x, x0, x1 = self.stamps[at], stamp[before_index], stamp[right]
        ordered = (x0 <= x) & (x <= x1) & (x0 < x1)  # False for missing time stamps
        x, x0, x1 = (
            np.where(ordered, a, b) for a, b in ((x, at + self.first), (x0, row[before_index]), (x1, row[right]))
        )
        near = (right > before_index) & (row[right] - row[before_index] <= MOST_ROWS_APART)
        slope = np.divide(value[right] - value[before_index], x1 - x0, out=np.zeros(at.size), where=near)
        out = self.values.copy()
        out[at] = np.where(near, slope * (x - x0) + value[before_index], value[before_index])
        return {**self.rows, column: out}


def with_temperature(chunks: Iterable[Rows], columns: Mapping[str, int], first: float, unit: str) -> Iterator[Rows]:
    """Yield the chunks with a temperature (°C) in each row, from the first reading on. The file states it in `unit`."""
    column, count, origin = columns["temperature"], 0, None
    before = latest = _TemperatureReading(-MOST_ROWS_APART - 1, np.nan, first)
    waiting = list[_RowBlock]()

    def flush(after: _TemperatureReading | None) -> Iterator[Rows]:
        # Only the first of the waiting blocks may hold readings.
        for k, held in enumerate(waiting):
            yield held.fill(column, latest if k else before, after)
        waiting.clear()

    for rows in chunks:
        missing, size = is_missing(rows[column]), rows[column].size
        if missing is None:
            missing = np.zeros(size, dtype=bool)
        stamps = np.full(size, np.nan)
        if "time" in columns and size:
            origin = rows[columns["time"]][0] if origin is None else origin
            stamps = _since(rows[columns["time"]], origin)
        values = in_celsius(rows[column].astype(np.float64, copy=False), unit)
        block = _RowBlock({**rows, column: values}, count, stamps=stamps, values=values, missing=missing)
        count += size
        present = np.flatnonzero(~missing)
        if present.size:
            yield from flush(block.reading(present[0]))
            before, latest = latest, block.reading(present[-1])
        elif not waiting:
            before = latest
        waiting.append(block)
        if latest.row == count - 1 or count - latest.row > MOST_ROWS_APART:
            yield from flush(None)
    yield from flush(None)


def _since(stamps: NDArray[Any], origin: Any) -> Vector:
    """Return the time since the first time stamp; NaN where a time stamp is missing."""
    since: Vector = (stamps - origin).astype(np.float64)
    missing = is_missing(stamps)
    if missing is not None:
        since[missing] = np.nan
    return since


@dataclass(frozen=True, eq=False)
class RowSummary:
    """Summary of consecutive rows: their time stamps and the number of lost samples."""

    first: int  # number of the first sample, and of the sample after the last one
    stop: int
    start: float  # time of the first sample (s)
    parted: bool  # whether there is a gap before the first sample
    lost: int = 0  # number of lost samples
    impossible: int = 0  # number of the lost samples with values that no sensor can measure
    lacking: Mapping[str, int] = field(default_factory=dict)  # number of the other lost samples without each axis
    # for each gap, the number of the first sample after it, and its length (s)
    gaps: tuple[tuple[int, float], ...] = ()
    live: TimeBase | None = None  # the time base of a live stream
    about: tuple[Remark, ...] = ()  # remarks on the time stamps of a live stream

    def followed_by(self, later: RowSummary) -> RowSummary:
        """Merge this summary with the summary of the rows that directly follow."""
        # The samples of each part are numbered from the number of its first row in the file.
        shift = self.stop - later.first
        moved = tuple((sample + shift, seconds) for sample, seconds in later.gaps)
        return replace(
            self, stop=later.stop + shift, gaps=self.gaps + moved, lost=self.lost + later.lost,
            impossible=self.impossible + later.impossible, lacking=_sum(self.lacking, later.lacking),
        )  # fmt: skip

    def time_base(self, found: Interpretation) -> TimeBase:
        """Return the time base of the recording, from the time stamps of all rows."""
        return replace(self.live or found.timing.base, start=self.start, gaps=self.gaps, lost=self.lost)

    def remarks(self, found: Interpretation) -> tuple[Remark, ...]:
        """Return the remarks that need all rows: on lost samples, and on the time stamps of a live stream."""
        return (*self.about, *about_lost(self.time_base(found), self.impossible, self.lacking))


class SampleBuilder:
    """Builds samples from rows from `first` on; `lost_before`: the row before is lost; `owned` saves a copy."""

    def __init__(
        self, found: Interpretation, first: int = 0, lost_before: bool = False, *, owned: bool = False
    ) -> None:
        self._found, self._first, self._owned = found, first, owned
        self._known = KnownClock(found.timing, first)
        self._live = None if found.pace is None else RunningClock(found.pace)
        # Rows whose segment is not known yet, masks of lost ones, and of those after a row without a time stamp.
        self._waiting: dict[str, Vector] = {role: np.empty(0) for role in found.roles}
        self._lost, self._cut = np.zeros(0, dtype=bool), np.zeros(1, dtype=bool)
        self._came, self._segment, self._begun = first, 0, self._known.segment_at(first)
        self._parted = False
        # The row of the last sample, the number of the next sample, and whether a gap is between them.
        self._last, self._next, self._broken = first - 1, first, lost_before
        self._run: tuple[int, float] | None = None
        self._start: float | None = None
        # For each break between segments, the rows before and after it, and the number of the sample after it.
        self._breaks, self._count = list[tuple[int, int, int]](), 0
        self._impossible, self._lacking = 0, dict[str, int]()
        self._read = first  # number of rows of the file
        self._cuts = {first} if lost_before else set[int]()  # rows after a row without a time stamp

    def add(self, rows: Rows) -> Iterator[Samples]:
        """Add the next rows, and yield the samples whose segments are now known."""
        interpretation, columns = self._found, self._found.choice.columns
        first, self._read = self._read, self._read + next(iter(rows.values())).size
        rows = drop(rows, first, interpretation.copies)
        sifted = sift(rows, columns, interpretation.choice.axes)
        self._count += sifted.unplaced
        self._lacking = _sum(self._lacking, sifted.lacking)
        # Rows that were appended to the file after its time stamps were read are ignored.
        remaining = None if self._live else self._known.remaining()
        rows = {k: column[:remaining] for k, column in sifted.rows.items()}
        size = next(iter(rows.values())).size
        cut = np.zeros(size + 1, dtype=bool) if sifted.cut is None else sifted.cut[: size + 1]
        cut[0] |= self._cut[-1]
        self._cut = np.concatenate([self._cut[:-1], cut])
        lost = np.zeros(size, dtype=bool) if sifted.lost is None else sifted.lost[:size]
        impossible = None
        for role in interpretation.roles:
            values = self._in_si(as_floats(rows[columns[role]]), interpretation.factors.get(role, ()))
            self._waiting[role] = _append(self._waiting[role], values)
            beyond = beyond_sensors(values) if role in interpretation.choice.axes else None
            if beyond is not None:
                impossible = beyond if impossible is None else impossible | beyond
        if impossible is not None:
            self._impossible += int(np.count_nonzero(impossible & ~lost))
            lost = lost | impossible
        self._lost = _append(self._lost, lost)
        self._came += size
        yield from self._settle(self._live.take(rows[columns["time"]]) if self._live else self._known.take(size))

    def samples(self, rows: RowSource) -> Iterator[Samples]:
        """Yield the samples of all rows of a source."""
        columns, reading = self._found.choice.columns, self._found.first_temperature
        chunks = rows.chunks(list(columns.values()))
        unit = self._found.temperature_unit
        for chunk in chunks if reading is None else with_temperature(chunks, columns, reading, unit):
            yield from self.add(chunk)
        yield from self.end()

    def end(self) -> Iterator[Samples]:
        """Yield the samples that were held back until the end of a live stream."""
        if self._live:
            yield from self._settle(self._live.end())

    def summary(self) -> RowSummary:
        """Return the summary of all rows so far."""
        live = None if self._live is None else self._live.base()
        stamped = self._known.gaps(self._first, self._came) if live is None else live.gaps
        # No sample is missing where the clock was set back.
        gap_rows = {row for row, _ in stamped} | self._cuts
        gaps = [((a, b), sample) for a, b, sample in self._breaks if b - a > 1 or b in gap_rows]
        return RowSummary(
            self._first, self._next, start=self._begun[1] if self._start is None else self._start, parted=self._parted,
            gaps=gaps_of([pair for pair, _ in gaps], [k for _, k in gaps], stamped=stamped, rate=self._found.rate),
            lost=self._count, impossible=self._impossible, lacking=self._lacking, live=live,
            about=() if self._live is None else tuple(self._live.remarks()),
        )  # fmt: skip

    def _in_si(self, values: Vector, factors: Sequence[float]) -> Vector:
        for factor in factors:
            if self._owned:
                values *= factor
            else:
                values = values * factor
        return values

    def _settle(self, settled: KnownSegments) -> Iterator[Samples]:
        """Yield the waiting samples up to the last one whose segment is known."""
        first = self._came - self._lost.size
        count = settled.stop - first
        ready = {role: v[:count] for role, v in self._waiting.items()}
        self._waiting = {role: v[count:] for role, v in self._waiting.items()}
        lost, self._lost = self._lost[:count], self._lost[count:]
        cut, self._cut = np.flatnonzero(self._cut[:count]) + first, self._cut[count:]
        self._cuts.update(cut.tolist())
        clock = np.array([self._begun[0], *settled.firsts]), np.array([self._begun[1], *settled.starts])
        self._begun = int(clock[0][-1]), float(clock[1][-1])
        if not count:
            return
        rows = None
        turns = np.union1d(clock[0][1:][clock[0][1:] > 0], cut).astype(np.int64) - first
        if lost.any():
            rows = np.flatnonzero(~lost)
            self._count += count - rows.size
            ready = {role: v[rows] for role, v in ready.items()}
            turns = np.union1d(np.searchsorted(rows, turns), np.flatnonzero(np.diff(rows, prepend=-1) > 1))
            count, rows = rows.size, rows + first
        if count:
            yield self._samples(ready, turns[turns < count], clock, _RowNumbers(first, count, rows))
        self._broken = bool(lost[-1])

    def _samples(
        self, ready: dict[str, Vector], turns: NDArray[np.int64], clock: tuple[NDArray[np.int64], Vector],
        rows: _RowNumbers,
    ) -> Samples:  # fmt: skip
        """Make `Samples` from values in SI units. `turns` are the positions at which a segment begins."""
        begins = self._broken or bool(turns.size and turns[0] == 0)
        gap = begins and self._next > 0  # lost rows before the first sample are no gap
        self._parted |= gap and self._next == self._first
        if begins or self._run is None:
            turns = np.union1d([0], turns).astype(np.int64)
        at, numbers = rows.at(turns), self._next + turns
        segment = np.searchsorted(clock[0], at, side="right") - 1
        times = clock[1][segment] + (at - clock[0][segment]) / self._found.rate
        runs = list(zip(numbers.tolist(), times.tolist(), strict=True))
        if self._run is not None and not begins:
            runs.insert(0, self._run)
        self._start = runs[0][1] if self._start is None else self._start
        before = np.where(turns > 0, rows.at(np.maximum(turns - 1, 0)), self._last)
        gaps = slice(0 if gap else int(begins or self._run is None), None)
        self._breaks += zip(before[gaps].tolist(), at[gaps].tolist(), numbers[gaps].tolist(), strict=True)
        first, number = self._next, self._segment + gap
        self._next, self._last = first + rows.count, int(rows.at(np.array(rows.count - 1)))
        self._run, self._segment = runs[-1], number + len(runs) - 1
        temperature = ready.pop(TEMPERATURE, None)
        return Samples(ready, self._found.rate, first=first, segment=number, runs=tuple(runs), temperature=temperature)


@dataclass(frozen=True)
class _RowNumbers:
    """Row numbers: `count` consecutive rows from `first`, or a list of rows."""

    first: int
    count: int
    listed: NDArray[np.int64] | None

    def at(self, places: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the row numbers at some positions."""
        return places + self.first if self.listed is None else self.listed[places]


def _sum(before: Mapping[str, int], after: Mapping[str, int]) -> dict[str, int]:
    return {axis: before.get(axis, 0) + after.get(axis, 0) for axis in {**before, **after}}


def _append(before: NDArray[Any], after: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([before, after]) if before.size else after


def collect_samples(parts: Sequence[Samples], found: Interpretation, base: TimeBase, remarks: Sequence[Remark]) -> Imu:
    """Join samples into one recording, from its beginning."""
    if not parts:
        raise DataError(
            "the recording has no sample: each row has a value that no sensor measures",
            advice="Check the unit with {--units} and the format with {--format}.",
        )
    runs = list(dict(run for part in parts for run in part.runs).items())
    edges = [*(sample for sample, _ in runs), sum(len(part) for part in parts)]

    def whole(pieces: Sequence[Vector]) -> Vector:
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)

    signals = {
        axis: Signal(
            values=whole([part.values[axis] for part in parts]),
            rate=found.rate,
            unit=si_unit(axis),
            axis=axis,
            start=runs[0][1],
            segments=list(pairwise(edges)),
            starts=[time for _, time in runs],
        )
        for axis in found.choice.axes
    }
    temperature = [part.temperature for part in parts if part.temperature is not None]
    return Imu(signals, remarks=tuple(remarks), time_base=base, temperature=whole(temperature) if temperature else None)
