"""Give every row a temperature, by linear interpolation between the rows that have a reading.

The interpolation is over the time stamps if they increase, and over the row numbers otherwise. Readings in rows without
samples are used too. Rows before the first reading get the first reading. More than `MOST_ROWS_APART` rows without a
reading get the last one before them. The result does not depend on how the rows are divided into chunks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.files.clock.lost_samples import is_missing
from gmwm.files.contract import Rows

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


def with_temperature(chunks: Iterable[Rows], columns: Mapping[str, int], first: float) -> Iterator[Rows]:
    """Yield the chunks with a temperature in each row, from the first reading (°C) on."""
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
        values = rows[column].astype(np.float64, copy=False)
        block, count = _RowBlock(rows, count, stamps=stamps, values=values, missing=missing), count + size
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
