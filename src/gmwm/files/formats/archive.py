"""Read zip archives of text tables, which phones export, and text that is compressed with gzip or Zstandard.

Tables of sensors are joined only if rows pair one to one, with stamps within half an interval; rows at the ends are
left out, nothing is resampled. Other tables are topics."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES, axis_quantity
from gmwm.files.columns.column_names import named_unit, role_of
from gmwm.files.contract import HEAD_BYTES, Layout, Reader, Rows, register
from gmwm.files.formats.byte_sources import (
    GZIP,
    ZIP,
    ZSTD,
    CompressedSource,
    FileSource,
    MemberSource,
    PackedError,
    file_names,
    open_archive,
)
from gmwm.files.formats.sensorlogger import WITHOUT_GRAVITY, SensorLoggerReader, sensor
from gmwm.files.formats.text import TextReader, text_reader


@register
class CompressedReader(Reader):
    """Reader for text that is compressed as .gz or .zst."""

    name: ClassVar[str] = "compressed"
    extensions: ClassVar[tuple[str, ...]] = (".gz", ".zst", ".zstd")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 for the signatures of gzip and Zstandard, because another format may also be compressed."""
        return 0.9 if head.startswith((GZIP, ZSTD)) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings in the compressed text."""
        source = CompressedSource(path)
        reader, layouts = packed_text(source, path.with_suffix(""))
        return tuple(replace(layout, state=(reader, layout)) for layout in layouts)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers; the text is unpacked while it is read."""
        reader, inner = layout.state
        inner = replace(inner, skip_bad_lines=layout.skip_bad_lines)
        return reader.rows(CompressedSource(path), inner, wanted)  # type: ignore[no-any-return]


def packed_text(source: FileSource, name: Path) -> tuple[TextReader, tuple[Layout, ...]]:
    """Return the reader of the text in a compressed file, and the recordings in it."""
    with source.open() as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise ReadError(
            f"{source} is empty when unpacked", code="empty", advice="Check whether the recording was interrupted."
        )
    reader = text_reader(name, head)
    if reader is None:
        raise ReadError(
            f"{source} is not text when unpacked, and only text is read from compressed files",
            code="not-text",
            advice="Unpack it and pass the file in it.",
        )
    return reader, reader.layouts_of(source)


_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")


MAX_TABLES = 100
"""Largest number of tables in an archive. Each table is unpacked and searched for columns; phones export about ten."""


@dataclass(frozen=True)
class _ArchiveTable:
    """A table in an archive, with its bytes, its reader and its columns."""

    source: MemberSource
    reader: TextReader
    layout: Layout

    @property
    def quantities(self) -> set[str]:
        """Names of the sensors in the table: "gyro", "accel" or both."""
        axes = {role_of(channel) for channel in self.layout.channels}
        return {axis_quantity(axis) for axis in axes if axis in AXES}

    @property
    def without_gravity(self) -> bool:
        """Whether a phone removed gravity (linear acceleration; not the field linear_acceleration of ROS)."""
        if isinstance(self.reader, SensorLoggerReader):
            return sensor(Path(self.source.member)) == WITHOUT_GRAVITY
        headed = any(c.name.casefold().startswith("linear acceleration ") for c in self.layout.channels)
        return "accel" in self.quantities and (headed or "linear" in PurePosixPath(self.source.member).name.casefold())

    @property
    def time(self) -> int | None:
        """Index of the first column with a time; None if there is none."""
        return next((k for k, c in enumerate(self.layout.channels) if role_of(c) == "time"), None)

    def rows(self, wanted: Sequence[int], skip_bad_lines: bool = False) -> Iterator[Rows]:
        """Yield the values of the wanted columns, chunk by chunk."""
        return self.reader.rows(self.source, replace(self.layout, skip_bad_lines=skip_bad_lines), wanted)

    def read(self, wanted: Sequence[int], skip_bad_lines: bool = False) -> dict[int, NDArray[np.generic]]:
        """Return all values of each wanted column, by the index of the column."""
        parts = list(self.rows(wanted, skip_bad_lines))
        return {k: np.concatenate([part[k] for part in parts]) if parts else np.empty(0) for k in wanted}


@dataclass(frozen=True)
class _TablePair:
    """Two tables, the index of the first paired row of each, and the number of pairs."""

    tables: tuple[_ArchiveTable, _ArchiveTable]
    first: tuple[int, int]
    rows: int


@register
class ArchiveReader(Reader):
    """Reader of zip archives of text tables, such as the exports of Sensor Logger and phyphox."""

    name: ClassVar[str] = "zip"
    extensions: ClassVar[tuple[str, ...]] = (".zip",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.8 for the signature of zip archives, because other formats are zip archives too."""
        return 0.8 if head.startswith(ZIP) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording if the rows of both sensors can be paired, otherwise one for each table."""
        tables = _tables(path)
        gyro, accel = (_of_sensor(tables, quantity) for quantity in ("gyro", "accel"))
        if gyro is not None and accel is not None and gyro is not accel:
            joined = _pair_tables(gyro, accel)
            if joined is not None:
                others = [table.layout.topic for table in tables if table not in (gyro, accel)]
                left_out = (Remark.of("left-out", case="names", kind="tables", names=tuple(others)),) if others else ()
                return (replace(joined, remarks=(*joined.remarks, *left_out)),)
        return tuple(replace(table.layout, state=table) for table in tables)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the values of the wanted columns of one table, or of two paired tables."""
        if isinstance(layout.state, _ArchiveTable):
            yield from layout.state.rows(wanted, layout.skip_bad_lines)
            return
        pair: _TablePair = layout.state
        count = len(pair.tables[0].layout.channels)
        out: dict[int, NDArray[np.generic]] = {}
        for table, first, shift in zip(pair.tables, pair.first, (0, count), strict=True):
            mine = [k - shift for k in wanted if 0 <= k - shift < len(table.layout.channels)]
            if mine:
                out |= {
                    k + shift: v[first : first + pair.rows] for k, v in table.read(mine, layout.skip_bad_lines).items()
                }
        yield out


def _tables(path: Path) -> list[_ArchiveTable]:
    """Return the tables in an archive that have values of an inertial sensor."""
    with open_archive(path) as archive:
        names = list(dict.fromkeys(file_names(archive)))
    if sum(PurePosixPath(name).suffix.lower() in _SUFFIXES for name in names) > MAX_TABLES:
        raise PackedError(
            f"{path} holds more than {MAX_TABLES} tables",
            code="too-many",
            advice="Unpack it and pass the recording in it.",
        )
    tables, first_error = [], None
    for name in names:
        inside = PurePosixPath(name)
        if inside.suffix.lower() not in _SUFFIXES or inside.name.startswith("."):
            continue
        source = MemberSource(path, name)
        try:
            reader, layouts = packed_text(source, Path(inside.name))
        except PackedError:
            raise  # a damaged table must not be skipped
        except ReadError as error:
            first_error = first_error or error
            continue
        for layout in layouts:
            topic = "/".join([str(inside.with_suffix("")), *([layout.topic] if len(layouts) > 1 else [])])
            table = _ArchiveTable(source, reader, replace(layout, topic=topic))
            if table.without_gravity and not any(remark.code == "gravity-removed" for remark in layout.remarks):
                removed = Remark.of("gravity-removed", table.layout.topic)
                table = replace(table, layout=replace(table.layout, remarks=(*layout.remarks, removed)))
            if table.quantities or len(names) == 1:
                tables.append(table)
    if not tables:
        if first_error is not None and len(names) == 1:
            raise first_error
        shown = ", ".join(names[:8]) + (", …" if len(names) > 8 else "")
        raise ReadError(
            f"{path} holds no table with a known axis; its files: {shown or 'none'}",
            code="no-inertial-data",
            advice="Save each sheet as CSV, and pass the CSV file."
            if path.suffix.lower() in (".xlsx", ".xlsm", ".ods")
            else "Unpack it, and pass the table with {--columns}.",
        )
    return tables


def _of_sensor(tables: list[_ArchiveTable], quantity: str) -> _ArchiveTable | None:
    """Return the table of a sensor; None unless there is exactly one, or one that is not without_gravity."""
    several = [table for table in tables if table.quantities == {quantity}]
    if len(several) > 1:
        unfiltered = ("gyroscope", "totalacceleration")
        several = [t for t in several if sensor(Path(t.source.member)) in unfiltered] or several
    if len(several) == 1:
        return several[0]
    several = [t for t in several if not t.without_gravity]
    return several[0] if len(several) == 1 else None


def _pair_tables(gyro: _ArchiveTable, accel: _ArchiveTable) -> Layout | None:
    """Return one layout for the tables of both sensors if their rows can be paired; None otherwise."""
    if gyro.time is None or accel.time is None or accel.without_gravity:
        return None
    clocks = [table.layout.channels[k] for table, k in ((gyro, gyro.time), (accel, accel.time))]
    units = {named_unit(clock.name, "time") or clock.unit for clock in clocks}
    stamps = [table.read([k])[k] for table, k in ((gyro, gyro.time), (accel, accel.time))]
    if len(units) > 1:
        return None
    matched = _pair_rows(stamps[0], stamps[1])
    if matched is None:
        return None
    first, rows = matched
    unpaired = stamps[0].size + stamps[1].size - 2 * rows
    # The recording has the time stamps of the gyroscopes.
    channels = [
        replace(c, axis="", name=f"{accel.layout.topic}: stamps") if role_of(c) == "time" else c
        for c in accel.layout.channels
    ]
    paired = Remark.of("file-content", case="pairs", gyro=gyro.layout.topic, accel=accel.layout.topic, left=unpaired)
    return Layout(
        (*gyro.layout.channels, *channels), (*gyro.layout.first_row, *accel.layout.first_row),
        units={**accel.layout.units, **gyro.layout.units},
        remarks=(*gyro.layout.remarks, *accel.layout.remarks, paired), state=_TablePair((gyro, accel), first, rows),
    )  # fmt: skip


def _pair_rows(one: NDArray[np.generic], other: NDArray[np.generic]) -> tuple[tuple[int, int], int] | None:
    """Pair two columns of time stamps; return the first rows and the number of pairs, or None.

    >>> _pair_rows(np.arange(0.0, 9.0), np.arange(1.6, 12.0))
    ((2, 0), 7)
    """
    if min(one.size, other.size) < 2:
        return None
    a, b = ((values - one[0]).astype(np.float64) for values in (one, other))
    interval = float(np.median(np.diff(a)))
    if not interval > 0:
        return None
    shift = round(float(b[0]) / interval)
    # The shift may be off by one if the first time stamps jitter or the interval is rounded.
    for first in (shift, shift - 1, shift + 1):
        begin = (max(first, 0), max(-first, 0))
        rows = min(a.size - begin[0], b.size - begin[1])
        if rows >= 2 and np.all(np.abs(a[begin[0] :][:rows] - b[begin[1] :][:rows]) <= 0.5 * interval):
            return begin, rows
    return None
