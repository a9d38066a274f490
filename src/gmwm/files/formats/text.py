"""Read CSV and other text tables in blocks; a parsed schema keeps Polars from inferring anything."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.files.clock.text_stamps import UNIT, is_stamp, is_time_of_day
from gmwm.files.columns.column_names import named_unit, recognise, role_of, unit_of
from gmwm.files.columns.known_tables import known_table, names_by_file, stated_scales
from gmwm.files.contract import HEAD_BYTES, Channel, Layout, Mark, Reader, Rows, register, without_guests
from gmwm.files.formats.byte_sources import FileSource, recoded, text_encoding
from gmwm.files.formats.dialect import Commas, TextDialect, detect, sensor_word, split_line
from gmwm.files.formats.line_forms import COLOURS, WEEK, is_number
from gmwm.files.formats.text_rows import OR_SKIP, RowParser

BLOCK_BYTES = 8 << 20  # number of bytes in a block: enough to parse in parallel, and several blocks fit into memory

LINE_BYTES = 8 * BLOCK_BYTES  # largest number of bytes in a line. A longer line is not a row of a table

TAIL_BYTES, TAIL_LINES = 1 << 16, 1000
"""Number of bytes and lines at the end of a file that are compared with a last line without a newline."""
_ENOUGH = 10  # number of lines that show the usual length of a number; pinned by tests/readers/test_stamps.py


@dataclass(frozen=True)
class Place:
    """Beginning of a block of lines: its first byte and its first line."""

    begin: int
    line: int


@register
class TextReader(Reader):
    """Reader of delimited text, with or without header, comments, units and time."""

    name: ClassVar[str] = "text"
    extensions: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log", ".lvm", ".gcsv")
    commas: ClassVar[Commas] = ""

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.5 for text with a digit, 0.1 for other text, and 0.05 for text with zero bytes."""
        if text_encoding(head):
            return 0.5
        head = re.sub(*COLOURS, head)
        if any(bytes([c]) in head for c in (*range(1, 9), *range(14, 32))):
            return 0.0
        if b"\0" in head:
            return 0.05 if head[0] and path.suffix.lower() in self.extensions else 0.0  # `layout` says where
        return 0.5 if re.search(rb"\d", head) else 0.1

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings, with column names from the header or a comment; see `layouts_of`."""
        return self.layouts_of(FileSource(path))

    def layouts_of(self, source: FileSource) -> tuple[Layout, ...]:
        """Return the recordings in text: several if a column states the sensor of each row."""
        layout = self.layout(recoded(source))
        dialect: TextDialect = layout.state
        if dialect.sensors is None:
            return (layout,)
        column, values = dialect.sensors
        if any(map(sensor_word, values)):
            return tuple(_of_sensor(layout, column, value) for value in values if sensor_word(value))
        name = dialect.names[column]
        return tuple(
            replace(layout, topic=f"{name}={value}", state=replace(dialect, sensor=(column, value))) for value in values
        )

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield one chunk for each block; a column whose first rows contain long integers stays int64."""
        return self.rows(FileSource(path), layout, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return block marks without parsing numbers; none if midnights must be counted, or only some rows are read."""
        if any(map(is_time_of_day, layout.state.first_row)) or layout.state.sensor:
            return ()
        source, row, marks = recoded(FileSource(path)), 0, []
        if not source.seekable:
            return ()
        parser = RowParser(source, layout.state, layout, ())
        for place, block in _blocks(source, layout.state):
            count = parser.count(block, place.line)
            if count:
                marks.append(Mark(row, place))
            row += count
        return (*marks, Mark(row))

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield the chunks from the block of a mark on."""
        return self.rows(FileSource(path), layout, wanted, mark.place)

    def layout(self, source: FileSource) -> Layout:
        """Return the layout of a file or of unpacked text."""
        dialect = detect(_head_lines(source), source, self.commas, getattr(source, "names", ()))
        names = dialect.names or names_by_file(source.unpacked_path, dialect.columns) or ("",) * dialect.columns
        time, channels = _time_by_content(dialect), []
        program, roles = known_table(names, source.unpacked_path, dialect.above)
        logged = stated_scales(dialect.above) if program else {}
        for k, name in enumerate(names):
            unit = dialect.column_units[k] if dialect.column_units else ""
            axis = recognise(name).axis
            if k in roles and not dialect.stamps[k]:
                role, documented = roles[k]
                stated, scale = ("", 1.0) if named_unit(name, role) else logged.get(role.partition("_")[0], ("", 1.0))
                channels.append(Channel(name, documented or unit or stated, role, scale=scale))
            elif dialect.stamps[k]:
                channels.append(Channel(name, UNIT, "time" if k == time else ""))
            else:
                channels.append(Channel(name, (unit_of(unit, axis) or unit) if axis else unit))
        # Compressed formats detect by themselves whether they are complete.
        end = _open_end(source, dialect.delimiter) if source.seekable else None
        remarks: tuple[Remark, ...] = (Remark.of("last-line", case="read"),) if end is not None else ()
        if end:
            dialect = replace(dialect, cut=end)
        units = dialect.units
        words = tuple(word[:-1] for word in dialect.others)
        remarks += (Remark.of("left-out", case="names", kind="lines", names=words),) if words else ()
        if WEEK in dialect.cleaning:
            units = {"time": "s", **units}
            remarks += (Remark.of("time-read", case="read", form="week", clock="GPS"),)
        if program:
            remarks += (Remark.of("file-content", case="layout", format=program),)
        if (parts := dialect.stamp_parts) is not None:
            channels.append(Channel("header.stamp", "ns", "time"))
            joined = (names[parts.seconds], names[parts.fraction])
            remarks += (Remark.of("time-read", case="read", form="parts", columns=joined),)
        if dialect.comment and (count := _commented_rows(source, dialect)):
            path = str(source.unpacked_path)
            remarks += (Remark.of("left-out", path, case="commented", count=count, sign=dialect.comment),)
        return Layout(
            tuple(channels), dialect.first_row, rate=dialect.rate, units=units, remarks=remarks, state=dialect
        )

    def rows(
        self, source: FileSource, layout: Layout, wanted: Sequence[int], place: Place | None = None
    ) -> Iterator[Rows]:
        """Yield the numbers in text, from the first row or from the block at `place` on."""
        dialect: TextDialect = layout.state
        source = recoded(source)
        _require_end(source, layout)
        stamp, read = dialect.columns, list(wanted)
        if stamp in wanted and dialect.stamp_parts is not None:
            parts = dialect.stamp_parts
            read = [*dict.fromkeys([*(k for k in wanted if k != stamp), parts.seconds, parts.fraction])]
        parser = RowParser(source, dialect, layout, tuple(read))
        for begin, block in _blocks(source, dialect, place):
            chunk = parser.parse(block, begin.line)
            if chunk is not None:
                if stamp in wanted and dialect.stamp_parts is not None:
                    chunk = {k: dialect.stamp_parts.join(chunk, source) if k == stamp else chunk[k] for k in wanted}
                yield chunk


def _of_sensor(layout: Layout, column: int, value: str) -> Layout:
    """Return one sensor's recording in a table with a column of sensors: columns x, y, z, or three behind the time."""
    dialect: TextDialect = layout.state
    channels, sensor = list(layout.channels), sensor_word(value)
    free = [k for k, channel in enumerate(channels) if k != column and role_of(channel) != "time"]
    if not dialect.names and free:
        channels[free[0]] = replace(channels[free[0]], axis="time")
        free = free[1:]
    letters = {re.sub(r"[^a-z]", "", channels[k].name.partition("[")[0].casefold())[-1:]: k for k in free}
    places = [letters[letter] for letter in "xyz"] if letters.keys() >= set("xyz") else free[:3]
    android = {"gyro": "rad/s", "accel": "m/s²"}[sensor] if "android" in value.casefold() else ""
    unit = recognise(f"{value}_x").unit or android  # gyro_dps
    for letter, k in zip("xyz", places, strict=False):
        channels[k] = replace(channels[k], axis=f"{sensor}_{letter}", unit=channels[k].unit or unit)
    return replace(layout, channels=tuple(channels), topic=value, state=replace(dialect, sensor=(column, value)))


def text_reader(path: Path, head: bytes) -> TextReader | None:
    """Return the reader of text that fits its first bytes best; None if they are not text."""
    readers = [reader for reader in without_guests() if isinstance(reader, TextReader)]
    score, best = max(((reader.sniff(path, head), reader) for reader in readers), key=lambda pair: pair[0])
    return best if score > 0 else None


class _DecimalCommaReader(TextReader):
    """Reader of text whose numbers have a decimal comma. The user names it, because `1,004` may be 1004 or 1.004."""

    name: ClassVar[str] = "text:decimal-comma"
    extensions: ClassVar[tuple[str, ...]] = ()
    commas: ClassVar[Commas] = "decimal"

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0, because the user names this format."""
        return 0.0


class _ThousandsReader(_DecimalCommaReader):
    """Reader of text whose numbers have commas between thousands."""

    name: ClassVar[str] = "text:thousands"
    commas: ClassVar[Commas] = "thousands"


register(_DecimalCommaReader)
register(_ThousandsReader)


def _commented_rows(source: FileSource, dialect: TextDialect) -> int:
    """Return the number of rows of numbers below the first one that begin with the comment sign."""
    sign, count = dialect.comment.encode(), 0
    for _, block in _blocks(source, dialect):
        if sign not in block:
            continue
        for line in block.split(b"\n"):
            if line.lstrip().startswith(sign):
                cells = split_line(line.lstrip()[len(sign) :].decode("latin-1"), dialect.delimiter)
                numbers = sum(is_number(cell, dialect.decimal_comma) or is_stamp(cell) for cell in cells)
                count += len(cells) == dialect.fields and 2 * numbers > len(cells)
    return count


def _time_by_content(dialect: TextDialect) -> int | None:
    """Return the column that contains dates or times of day; None if a name states the time column."""
    timed = dialect.stamp_parts is not None or any(recognise(name).axis == "time" for name in dialect.names)
    if not dialect.names or timed:
        return None
    columns = [k for k, stamped in enumerate(dialect.stamps) if stamped]
    return min(columns, key=lambda k: is_time_of_day(dialect.first_row[k]), default=None)


def _head_lines(source: FileSource) -> list[str]:
    """Return the first complete lines as text, without a byte order mark."""
    with source.open() as file:
        head = file.read(HEAD_BYTES)
        more = bool(file.read(1))
    if b"\0" in head:
        raise ReadError(
            f"{source} is not text: it holds zero bytes, the first at byte {head.index(0)}",
            code="not-text",
            advice="If it is text, and the logger lost its power, delete them (tr -d '\\000'). Otherwise name its "
            "format with {--format}.",
        )
    if more and b"\n" in head:
        head = head[: head.rfind(b"\n") + 1]
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = head.decode("latin-1")  # for example a degree sign in the header; numbers are ASCII in either encoding
    return text.replace("\r\n", "\n").split("\n")


def _open_end(source: FileSource, delimiter: str) -> tuple[str, str] | tuple[()] | None:
    """Check the end of the last line: None if it ends with a newline, () if it may be complete. If the last number has
    fewer digits than that of every line before, it was cut off: return both cells."""
    with source.open() as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL_BYTES))
        *lines, last = file.read().decode("latin-1").split("\n")
    if not last.strip("\r") or last.endswith("\r"):
        return None
    *others, cut = (
        split_line(line.strip("\r"), delimiter)[-1] for line in [*lines[-TAIL_LINES:], last] if line.strip()
    )
    others = [cell for cell in others if is_number(cell)]
    was_cut = len(others) >= _ENOUGH and is_number(cut) and _lacks_digits(cut, others)
    return (cut, others[-1]) if was_cut else ()


def _require_end(source: FileSource, layout: Layout) -> None:
    """Raise an error if the last number of the text was cut off."""
    cut = layout.state.cut
    if cut and not layout.skip_bad_lines:
        raise ReadError(
            f"{source} ends within a number: its last line ends in {cut[0]!r} without a line end, the lines before in "
            f"numbers like {cut[1]!r}", code="cut-off", advice="Remove the last line." + OR_SKIP,
        )  # fmt: skip


def _lacks_digits(cell: str, others: Sequence[str]) -> bool:
    """Return whether a number is shorter than all others, or lacks the exponent that all others have."""
    powers = [len(other.lower().partition("e")[2].lstrip("+-")) for other in (cell, *others)]
    return len(cell) < min(map(len, others)) or powers[0] < min(powers[1:])


def _blocks(source: FileSource, dialect: TextDialect, place: Place | None = None) -> Iterator[tuple[Place, bytes]]:
    """Yield blocks of complete lines with their places, from the first row or from the block at `place` on."""
    first = b""
    with source.open() as file:
        begin, line = 0, dialect.first_line
        if place is not None:
            file.seek(place.begin)
            begin, line = place.begin, place.line
        elif line == 1:
            first = file.read(3)
            if first == b"\xef\xbb\xbf":
                begin, first = 3, b""
        else:
            begin = sum(len(file.readline()) for _ in range(line - 1))
        while first or (block := file.read(BLOCK_BYTES)):
            if first:
                block, first = first + file.read(BLOCK_BYTES), b""
            if not block.endswith(b"\n"):
                tail = file.readline(LINE_BYTES)
                block += tail
                if len(tail) == LINE_BYTES and not tail.endswith(b"\n"):
                    raise ReadError(
                        f"{source} has a line of more than {LINE_BYTES >> 20} MB after line {line + _lines(block)}",
                        code="line-too-long",
                        advice="Check that the file is a table of text with one sample per line.",
                    )
            ending = b""
            if not block.endswith(b"\n"):  # the end of the file
                end = block.rfind(b"\n") + 1
                block, ending = block[:end], block[end:]
            if block:
                yield Place(begin, line), block
            begin, line = begin + len(block), line + _lines(block)
            if ending and not dialect.cut:
                yield Place(begin, line), ending


def _lines(block: bytes) -> int:
    """Return the number of line ends. NumPy compares many bytes at once, `bytes.count` stops at each line."""
    return int(np.count_nonzero(np.frombuffer(block, dtype=np.uint8) == ord("\n")))
