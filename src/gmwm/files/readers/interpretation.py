"""Interpret the columns of a recording: find the axes that work, their units, and the clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base import reporting
from gmwm.base.arrays import Vector, as_rate
from gmwm.base.errors import DataError, GmwmWarning, InferredUnitWarning, ReadError, TimeBaseWarning
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.text import counted
from gmwm.base.units import SI_UNIT, axis_quantity, in_celsius
from gmwm.files.clock.clock import clock_of, copied_rows
from gmwm.files.clock.missing_values import (
    Sifted,
    as_floats,
    dead_axes,
    drop,
    is_missing,
    require_repeated_rows,
    sift,
    sparse_axes,
    values_of_axes,
)
from gmwm.files.clock.running_clock import Pace
from gmwm.files.clock.text_stamps import holds_stamps, require_readable
from gmwm.files.clock.time_stamps import (
    Timing,
    as_stamps,
    beside_stated,
    calendar_unit,
    require_plausible,
    timing_without_stamps,
)
from gmwm.files.columns.axis_units import multiply, offset_counts, resolve, time_unit
from gmwm.files.columns.column_names import named_unit, unit_of
from gmwm.files.columns.columns import ColumnChoice, describe_columns
from gmwm.files.contract import Layout, Rows
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.options import ReadOptions

STAMPS = ("stamps-irregular", "samples-lost")
"""Codes of remarks that need all rows, and are known only at the end of a live stream."""

_CATEGORIES: Mapping[str, type[GmwmWarning]] = {
    "unit-inferred": InferredUnitWarning,
    "unit-doubtful": GmwmWarning,
    "rate-contradicted": TimeBaseWarning,
    "rate-ambiguous": TimeBaseWarning,
    "axis-dead": GmwmWarning,
    "sensor-columns-left-out": GmwmWarning,
    "stamps-irregular": TimeBaseWarning,
    "samples-lost": GmwmWarning,
}
"""Category of the Python warning, for each remark that is also a warning."""


def of_file(remarks: Iterable[Remark], path: object) -> tuple[Remark, ...]:
    """Set the file as the subject of remarks that are also warnings and do not concern an axis."""
    return tuple(
        remark.about(str(path)) if remark.code in _CATEGORIES and not remark.subject else remark for remark in remarks
    )


def warn(remarks: Iterable[Remark], stacklevel: int) -> None:
    """Issue the remarks that are also warnings. `stacklevel` is that of `warnings.warn` in the caller."""
    for remark in remarks:
        category = _CATEGORIES.get(remark.code)
        if category is not None:
            reporting.warn(category(remark), stacklevel=stacklevel + 1)


T = TypeVar("T")

HEAD_ROWS = 1 << 18
"""Rows from which the units of accelerometers and time stamps are inferred: 44 min at 100 Hz. It is a choice."""
TEMPERATURE = "temperature"


@dataclass(frozen=True, eq=False)
class Interpretation:
    """Columns, units and clock of a recording."""

    choice: ColumnChoice  # the columns to read: the axes, the temperature, and the time if it is needed to place rows
    words: Mapping[str, str]  # name of each column in messages
    # factors by which the numbers in the file are multiplied, one after the other
    factors: Mapping[str, tuple[float, ...]]
    timing: Timing  # rate and segments of all rows; for a live stream, of the first rows
    pace: Pace | None  # sampling interval, unit and origin of the time stamps of a live stream; None for a file
    remarks: tuple[Remark, ...]  # remarks on how gmwm read the file
    # whether some rows of the file are left out, so that the clock counts fewer rows than the file has
    sparse: bool = False
    copies: tuple[tuple[int, int], ...] = ()  # ranges of the rows that were written again, which are left out
    first_temperature: float | None = None  # the first reading of the temperature (°C); None if it is not read
    temperature_unit: str = ""  # the unit of the readings in the file; "" means °C

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return self.timing.base.rate

    @property
    def roles(self) -> tuple[str, ...]:
        """Names of the axes, and of the temperature if it is read."""
        return (*self.choice.axes, *([TEMPERATURE] if TEMPERATURE in self.choice.columns else []))

    def without_temperature(self) -> Interpretation:
        """Return it without the temperature, which a part of a recording cannot interpolate at its ends."""
        columns = {role: k for role, k in self.choice.columns.items() if role != TEMPERATURE}
        return replace(self, choice=ColumnChoice(columns, self.choice.remarks), first_temperature=None)

    def mounted(self, mount: Mapping[str, str]) -> Interpretation:
        """Return it with the axes of the vehicle: each is an axis of the unit, multiplied by −1 if its sign is −."""
        sources = {f"{sensor}_{axis}": f"{sensor}_{mount.get(axis, axis)}" for sensor in SI_UNIT for axis in "xyz"}
        signs = {axis: -1.0 for axis, source in sources.items() if "-" in source}
        names = {source.replace("-", ""): axis for axis, source in sources.items()}

        def of_vehicle(by_role: Mapping[str, T]) -> dict[str, T]:
            return {names.get(role, role): value for role, value in by_role.items()}

        factors = of_vehicle(self.factors)
        factors |= {axis: (*factors[axis], sign) for axis, sign in signs.items() if axis in factors}
        choice = ColumnChoice(of_vehicle(self.choice.columns), self.choice.remarks)
        return replace(self, choice=choice, words=of_vehicle(self.words), factors=factors)


class RowSource(Protocol):
    """Source of the rows of a recording."""

    def chunks(self, wanted: Sequence[int]) -> Iterator[Rows]:
        """Iterate over the rows of the wanted columns from the first one on."""


def understand(
    layout: Layout, choice: ColumnChoice, rows: Rows, *, path: Path, options: ReadOptions, source: RowSource | None
) -> Interpretation:
    """Find working axes, units and clock from all rows in memory, or the first `HEAD_ROWS`. Without `source` (live), no
    axis is left out, because a few rows do not show whether it works."""
    words = {role: column_words(layout, choice, role, path) for role in choice.columns}
    constants = {} if source is None else _dead(rows, choice, source)
    axes = tuple(axis for axis in choice.axes if axis not in constants)
    size = next(iter(rows.values())).size
    require_samples(size, words[choice.axes[0]])
    if not axes:
        axis, (value, size) = next(iter(constants.items()))
        raise constant(words[axis], axis, value, size)
    sparse = {} if source is None else _sparse(rows, choice, axes, source)
    if sparse:
        return _without(sparse, layout, choice, rows, path=path, options=options, source=source)
    sifted = sift(rows, choice.columns, axes)
    count = next(iter(sifted.rows.values())).size
    remaining = count if sifted.lost is None else count - int(np.count_nonzero(sifted.lost))
    if 2 * remaining < count:
        raise _apart_in_rows(sifted, choice, axes, layout=layout, path=path)
    require_samples(remaining, words[axes[0]])
    clock = partial(_timing, layout, choice, options, count)
    stamped, pace = "time" in choice.columns, None
    column = None
    if stamped and source is not None:
        column = TimeColumn(source, choice, axes)
        column.alone = sifted.lost is None and sifted.cut is None and not sifted.other
        time, about_time = column.of(clock)
        if time.set_back and (copies := copied_rows(column.records())):
            column.copies = copies
            time, about_time = column.of(clock)
            count = sum(stop - first for first, stop in copies)
            about_time += (Remark.of("stamps-irregular", case="again", count=len(copies), rows=count),)
        if sparse := _apart(column.values):
            return _without(sparse, layout, choice, rows, path=path, options=options, source=source)
    elif stamped:
        stamps = sifted.rows[choice.columns["time"]]
        time, about_time = clock([stamps])
        unit = time_unit(layout, choice, options.units)[0] or calendar_unit(stamps)
        unit = unit or as_stamps(stamps, "", options.rate)[0].unit
        pace = Pace.of(stamps, unit, time)
    else:
        time, about_time = clock(None)
    rate, integrals = time.base.rate, options.integrals
    ones = {axis: np.ones(1) for axis in choice.axes}
    counts = _first_samples(rows, choice, axes, source)
    require_repeated_rows(counts, time.base)
    offset = [
        s for s in SI_UNIT if (members := [a for a in axes if axis_quantity(a) == s]) and offset_counts(members, counts)
    ]
    about_scale = multiply(layout, choice, factors=options.scale, increments=integrals, raw=ones, rate=rate)
    numbers = {axis: values * ones[axis] for axis, values in counts.items()}
    scales = resolve(layout, choice, declared=options.units, values=numbers, rate=rate, increments=integrals)
    reading, degrees = None, ""
    if TEMPERATURE in choice.columns:
        channel = layout.channels[choice.columns[TEMPERATURE]]
        degrees = unit_of(channel.unit, TEMPERATURE) or named_unit(channel.name, TEMPERATURE)
        reading = _first_reading(rows, choice.columns[TEMPERATURE], source, degrees)
    remarks = [*layout.remarks, *choice.remarks]
    for axis, (value, size) in constants.items():
        kind = "missing" if np.isnan(value) else "constant"
        remarks.append(Remark.of("axis-dead", axis, kind=kind, value=value, rows=size))
    remarks += [Remark.of("counts-offset", sensor) for sensor in offset]
    if column is not None and column.other:
        remarks.append(Remark.of("file-content", case="other-rows", count=column.other, rows=column.rows))
    remarks += [*about_scale, *scales.remarks, *about_time]
    # The remarks on all time stamps of a live stream follow at the end of an iteration.
    remarks += [remark for remark in time.remarks if pace is None or remark.code not in STAMPS]
    return Interpretation(
        choice=_read_columns(choice.only(axes), rows, column, temperature=reading is not None), words=words,
        factors={axis: tuple(f for f in (float(ones[axis][0]), scales.units[axis].factor) if f != 1) for axis in axes},
        timing=time, pace=pace, remarks=of_file(remarks, path), sparse=column is not None and column.sparse,
        copies=() if column is None else column.copies, first_temperature=reading, temperature_unit=degrees,
    )  # fmt: skip


def _sparse(rows: Rows, choice: ColumnChoice, axes: Sequence[str], source: RowSource) -> dict[str, tuple[int, int]]:
    """Return axes that lack many values, with counts of theirs and of the others'; `TimeColumn` finds later ones."""
    counts = values_of_axes([rows], choice.columns, axes)
    size = next(iter(rows.values())).size
    if size >= HEAD_ROWS and ("time" not in choice.columns or min(counts.values()) < size):
        counts = values_of_axes(source.chunks([choice.columns[axis] for axis in axes]), choice.columns, axes)
    return _apart(counts)


def _apart(counts: Mapping[str, int]) -> dict[str, tuple[int, int]]:
    return {axis: (counts[axis], max(counts.values())) for axis in sparse_axes(counts)}


def _without(
    sparse: Mapping[str, tuple[int, int]], layout: Layout, choice: ColumnChoice, rows: Rows, *, path: Path,
    options: ReadOptions, source: RowSource | None,
) -> Interpretation:  # fmt: skip
    """Interpret the columns without some axes, and say so in remarks."""
    others = choice.only([axis for axis in choice.axes if axis not in sparse])
    interpretation = understand(layout, others, rows, path=path, options=options, source=source)
    columns = ",".join(
        f"{axis}:{layout.channels[choice.columns[axis]].name or choice.columns[axis]}" for axis in sparse
    )
    remarks = [
        Remark.of("axis-dead", axis, kind="sparse", value=float(count), rows=most, columns=columns)
        for axis, (count, most) in sparse.items()
    ]
    return replace(interpretation, remarks=(*of_file(remarks, path), *interpretation.remarks))


def _read_columns(choice: ColumnChoice, rows: Rows, column: TimeColumn | None, *, temperature: bool) -> ColumnChoice:
    """Return the columns to read; time stamps only if segments or a temperature depend on them."""
    columns = dict(choice.columns)
    if not temperature:
        columns.pop(TEMPERATURE, None)
    sparse = temperature and is_missing(rows[columns[TEMPERATURE]][:HEAD_ROWS]) is not None
    if column is not None and column.alone and not sparse:
        del columns["time"]
    return ColumnChoice(columns, choice.remarks)


def _first_samples(
    rows: Rows, choice: ColumnChoice, axes: Sequence[str], source: RowSource | None
) -> dict[str, Vector]:
    """Return each axis's first values, without incomplete rows, or from the 4096 rows after them."""
    first = _complete({k: column[:HEAD_ROWS] for k, column in rows.items()}, choice, axes)
    if source is None or next(iter(first.values())).size:
        return first
    parts: list[dict[str, Vector]] = []
    for chunk in source.chunks(list(choice.columns.values())):
        parts.append(_complete(chunk, choice, axes))
        if sum(part[axes[0]].size for part in parts) >= 4096:
            break
    return {axis: np.concatenate([part[axis] for part in parts])[:4096] for axis in choice.axes}


def _complete(rows: Rows, choice: ColumnChoice, axes: Sequence[str]) -> dict[str, Vector]:
    sifted = sift(rows, choice.columns, axes)
    usable = slice(None) if sifted.lost is None else ~sifted.lost
    return {axis: as_floats(sifted.rows[choice.columns[axis]])[usable] for axis in choice.axes}


def _dead(rows: Rows, choice: ColumnChoice, source: RowSource) -> dict[str, tuple[float, int]]:
    """Return the axes that are constant over all rows of a recording, with their value and the number of rows."""
    columns, size = choice.columns, next(iter(rows.values())).size
    constants = {axis: (value, size) for axis, value in dead_axes(rows, columns, choice.axes).items()}
    if not constants or size < HEAD_ROWS:
        return constants
    count = 0
    for chunk in source.chunks([columns[axis] for axis in constants]):
        count += next(iter(chunk.values())).size
        still = dead_axes(chunk, columns, constants)
        constants = {
            axis: (still[axis] if np.isnan(value) else value, count)
            for axis, (value, _) in constants.items()
            if axis in still and (still[axis] == value or np.isnan(still[axis]) or np.isnan(value))
        }
        if not constants:
            break
    return constants


def _first_reading(rows: Rows, column: int, source: RowSource | None, unit: str) -> float | None:
    """Return the first temperature of a recording (°C); None if there is none."""
    blocks = [rows] if source is None or rows[column].size < HEAD_ROWS else source.chunks([column])
    for block in blocks:
        missing = is_missing(block[column])
        readings = block[column] if missing is None else block[column][~missing]
        if readings.size:
            return float(in_celsius(as_floats(readings[:1]), unit)[0])
    return None


def _timing(
    layout: Layout, choice: ColumnChoice, options: ReadOptions, samples: int, stamps: Iterable[NDArray[Any]] | None
) -> tuple[Timing, tuple[Remark, ...]]:
    """Return the time base and remarks on the stamps; without them, one segment of `samples` rows."""
    if stamps is None:
        if options.rate is not None or layout.rate is None:
            return timing_without_stamps(as_rate(options.rate), samples), ()
        stated = Remark.of("rate-stated", case="stated", rate=Quantity(layout.rate, "Hz"), used="yes")
        return timing_without_stamps(as_rate(layout.rate), samples), (stated,)
    unit, about_unit = time_unit(layout, choice, options.units)
    timing, about_form = clock_of(stamps, unit, options.rate)
    if "time" not in options.units and options.rate is None:
        require_plausible(timing.base.rate, unit)
    if options.rate is None and layout.rate is not None and layout.rate_of_samples:
        timing = beside_stated(timing, layout.rate)
    return timing, tuple(remark for remark in (about_unit, about_form) if remark is not None)


class TimeColumn:
    """Counted time stamps in chunks, and numbers of values per axis; complete first rows imply no empty row."""

    def __init__(self, source: RowSource, choice: ColumnChoice, axes: Sequence[str]) -> None:
        self._source, self._columns, self._axes = source, choice.columns, axes
        self.alone, self.rows, self.other, self.unplaced = True, 0, 0, 0
        self.copies: tuple[tuple[int, int], ...] = ()
        self.values = dict.fromkeys(axes, 0)

    @property
    def sparse(self) -> bool:
        """Whether rows were left out."""
        return bool(self.other or self.unplaced or self.copies)

    def __iter__(self) -> Iterator[NDArray[Any]]:
        time = self._columns["time"]
        self.values, first = dict.fromkeys(self._axes, 0), 0
        for rows in self._source.chunks(list(self._columns.values())):
            first, rows = first + rows[time].size, drop(rows, first, self.copies)
            counts = values_of_axes([rows], self._columns, self._axes)
            self.values = {axis: self.values[axis] + count for axis, count in counts.items()}
            if self.alone:
                if is_missing(rows[time]) is not None:
                    raise _UnplacedRowsError
                yield rows[time]
                continue
            sifted = sift(rows, self._columns, self._axes)
            self.rows += rows[time].size
            self.other, self.unplaced = self.other + sifted.other, self.unplaced + sifted.unplaced
            yield sifted.rows[time]

    def records(self) -> Iterator[NDArray[Any]]:
        """Yield all rows as records of the time stamp and the bits of the values, which are equal for NaN too."""
        for rows in self._source.chunks(list(self._columns.values())):
            time = rows[self._columns["time"]]
            columns = [as_floats(rows[self._columns[axis]]).view(np.int64) for axis in self._axes]
            records = np.empty(time.size, dtype=[("time", time.dtype), ("values", np.int64, (len(columns),))])
            records["time"], records["values"] = time, np.column_stack(columns)
            yield records

    def of(self, clock: Callable[[Iterable[NDArray[Any]]], T]) -> T:
        """Return `clock` of the time stamps; again with all columns if a row has no time stamp."""
        try:
            return clock(self)
        except _UnplacedRowsError:
            self.alone = False
            return clock(self)


class _UnplacedRowsError(Exception):
    """Raised if a row has no time stamp."""


def require_time(layout: Layout, choice: ColumnChoice, rate: float | None, path: Path) -> None:
    """Require time stamps or a rate; time stamps are numbers, dates with times, or times of day."""
    for role, column in choice.columns.items():
        if role != "time" and holds_stamps(layout, column):
            raise ReadError(
                f"{column_words(layout, choice, role, path)} holds dates and times ({layout.first_row[column]!r}), "
                "expected numbers", code="column-not-numbers", advice="Name another column for it with {--columns}.",
            )  # fmt: skip
    if "time" not in choice.columns:
        if rate is None and layout.stray_time:
            raise ReadError(
                f"{path}: {layout.stray_time}",
                code="no-time",
                advice="Repair the file, or pass {--rate} to read it without time stamps.",
            )
        if rate is None and layout.rate is None:
            raise ReadError(
                f"{path} has no time column. Its columns: {describe_columns(layout)}",
                code="no-time",
                advice="Pass the samples per second with {--rate}, or name the time column with {--columns}.",
            )
        return
    k = choice.columns["time"]
    if not layout.channels[k].axis and k < len(layout.first_row):
        require_readable(layout.first_row[k], path)


def _apart_in_rows(sifted: Sifted, choice: ColumnChoice, axes: Sequence[str], layout: Layout, path: Path) -> DataError:
    """Make the error for a file in which most rows lack some axes, as sensors of different rates write it."""
    size = next(iter(sifted.rows.values())).size
    counts = {}
    for axis in axes:
        missing = is_missing(sifted.rows[choice.columns[axis]])
        counts[axis] = size if missing is None else size - int(np.count_nonzero(missing))
    shown = ", ".join(f"{axis} in {count}" for axis, count in counts.items())
    most = max(counts, key=lambda axis: counts[axis])[:-2]
    names = {axis: layout.channels[choice.columns[axis]].name or choice.columns[axis] for axis in axes}
    return DataError(
        f"{path}: most rows have no value in some axis: of {size} rows, {shown} have one",
        advice="If the sensors have different rates, read one after the other, for example with {--columns=@example}.",
        example=",".join(f"{axis}:{names[axis]}" for axis in axes if axis.startswith(most)),
    )


def require_samples(samples: int, what: str) -> None:
    """Require at least `MINIMUM_SAMPLES` samples of the column `what`."""
    if samples < MINIMUM_SAMPLES:
        raise DataError(
            f"{what} has {counted(samples, 'sample')}, but at least {MINIMUM_SAMPLES} are needed",
            advice="Record longer, or check whether the recording was interrupted.",
        )


def constant(what: str, role: str, value: float, rows: int) -> DataError:
    """Make the error for a recording in which no axis works."""
    how = "no finite number" if np.isnan(value) else f"the same value {value:g}"
    return DataError(
        f"{what} has {how} in all {counted(rows, 'row')}, and no other axis works",
        advice="Check whether the sensor was connected.",
        axis=role,
    )


def column_words(layout: Layout, choice: ColumnChoice, role: str, path: Path) -> str:
    """Return the name of a column for messages, from the file, the role, and the name in the file."""
    k = choice.columns[role]
    name = layout.channels[k].name or f"number {k}"
    return f"{path}: {role}" + ("" if name == role else f" (column {name!r})")
