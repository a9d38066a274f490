"""CSV and other text tables, read in blocks that Polars parses.

The header is parsed here, and Polars gets a schema, so it infers nothing from the first rows. Polars fills short rows
with nulls without an error. If a block has a null, its lines are searched for the first bad one, which the error names.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, NoReturn

import numpy as np

from gmwm.errors import ReadError
from gmwm.readers.base import HEAD_BYTES, Channel, Layout, Mark, Reader, Rows, register
from gmwm.readers.byte_sources import FileSource
from gmwm.readers.column_names import recognise, unit_of
from gmwm.readers.dialect import BLANKS, Dialect, comment_sign, detect, is_number, split
from gmwm.readers.text_stamps import UNIT, Midnights, is_stamp, is_time_of_day, times_of, what_is_wrong
from gmwm.remarks import Remark

if TYPE_CHECKING:
    import polars as pl

BLOCK_BYTES = 8 << 20
"""Bytes in a block: large enough to parse in parallel, small enough that several fit into memory."""

LINE_BYTES = 8 * BLOCK_BYTES
"""Most bytes in a line: a longer one is no row of a table."""

TAIL_BYTES, TAIL_LINES = 1 << 16, 1000
"""Bytes and lines at the end of a file with which a last line without a line end is compared."""
_ENOUGH = 10  # lines from which the usual length of a number is known; pinned by tests/readers/test_stamps.py

_BIG_INTEGER = 15  # digits that float64 always holds exactly
_BLANK_LINE, _BLANK_START = re.compile(rb"\n(?=[ \t\r]*\n)"), re.compile(rb"[ \t\r]*\n")
_BLANK_BEGIN = re.compile(rb"\A(?:[ \t\r]*\n)+")


@dataclass(frozen=True)
class Place:
    """Beginning of a block of lines: its first byte, the byte up to which the file was read, and its first line."""

    begin: int
    reached: int
    line: int


@register
class TextReader(Reader):
    """Delimited text, with or without header, comments, units and time."""

    name: ClassVar[str] = "text"
    extensions: ClassVar[tuple[str, ...]] = (".csv", ".txt", ".tsv", ".dat", ".asc", ".log")

    def sniff(self, path: Path, head: bytes) -> float:
        """0.5 if the first bytes are text that holds a digit, 0.1 if they are any other text."""
        if head.startswith((b"\xff\xfe", b"\xfe\xff")):
            return 0.5  # UTF-16, for which `layout` raises an error with advice
        control = sum(head.count(bytes([c])) for c in (*range(9), *range(14, 32)))
        if control:
            return 0.0
        return 0.5 if re.search(rb"\d", head) else 0.1

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """The columns, with names from the header or a comment."""
        return (self.layout(FileSource(path)),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """One chunk for each block; a column whose first rows hold long integers stays int64."""
        return self.rows(FileSource(path), layout, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Marks for the blocks. Their rows are counted in a pass over the file that parses no numbers.

        There are no marks if a column holds times of day, whose midnights must be counted from the first row.
        """
        if any(map(is_time_of_day, layout.state.first_row)):
            return ()
        source, row, marks = FileSource(path), 0, []
        parser = _Parser(source, layout.state, layout, ())
        for place, block in _blocks(source, layout.state.first_line):
            count = parser.count(block, place.line)
            if count:
                marks.append(Mark(row, place))
            row += count
        return (*marks, Mark(row))

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """The chunks from a block on."""
        return self.rows(FileSource(path), layout, wanted, mark.place)

    def layout(self, source: FileSource) -> Layout:
        """The columns of a text, from a file or unpacked."""
        dialect = detect(_head_lines(source), source)
        names = dialect.names or ("",) * dialect.columns
        time, channels = _time_by_content(dialect), []
        for k, name in enumerate(names):
            unit = dialect.column_units[k] if dialect.column_units else ""
            axis = recognise(name).axis
            if dialect.stamps[k]:
                channels.append(Channel(name, UNIT, "time" if k == time else ""))
            else:
                channels.append(Channel(name, (unit_of(unit, axis) or unit) if axis else unit))
        # Compressed formats detect by themselves whether they are complete.
        open_end = source.seekable and _is_open(source, dialect.delimiter)
        remarks = (Remark.of("no-line-end"),) if open_end else ()
        return Layout(
            tuple(channels), dialect.first_row, rate=dialect.rate, units=dialect.units, remarks=remarks, state=dialect
        )

    def rows(
        self, source: FileSource, layout: Layout, wanted: Sequence[int], place: Place | None = None
    ) -> Iterator[Rows]:
        """Give the numbers of a text, from the first row or from the block at a place on."""
        dialect: Dialect = layout.state
        parser = _Parser(source, dialect, layout, tuple(wanted))
        for begin, block in _blocks(source, dialect.first_line, place):
            chunk = parser.parse(block, begin.line)
            if chunk is not None:
                yield chunk


def _time_by_content(dialect: Dialect) -> int | None:
    """The column that is the time because it holds dates or times of day; None if a name states the time."""
    if not dialect.names or any(recognise(name).axis == "time" for name in dialect.names):
        return None
    found = [k for k, stamped in enumerate(dialect.stamps) if stamped]
    return min(found, key=lambda k: is_time_of_day(dialect.first_row[k]), default=None)


def _head_lines(source: FileSource) -> list[str]:
    """The first complete lines as text, without a byte order mark.

    Raises
    ------
    ReadError
        If the text is UTF-16, binary, or has bare carriage returns as line ends.
    """
    with source.open() as file:
        head = file.read(HEAD_BYTES)
        more = bool(file.read(1))
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ReadError(f"{source} is UTF-16 text", advice="Save it as UTF-8 (in a spreadsheet: CSV UTF-8).")
    if b"\0" in head:
        raise ReadError(f"{source} is not text: it holds zero bytes", advice="Name its format with {--format}.")
    if b"\n" not in head and head.rstrip(b"\r").count(b"\r"):
        raise ReadError(f"{source} has bare carriage returns as line ends", advice="Convert them to line feeds first.")
    if more and b"\n" in head:
        head = head[: head.rfind(b"\n") + 1]
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = head.decode("latin-1")  # for example a degree sign in the header; numbers are ASCII in either encoding
    return text.replace("\r\n", "\n").split("\n")


def _is_open(source: FileSource, delimiter: str) -> bool:
    """Whether the last line has no line end.

    Raises
    ------
    ReadError
        If its last number has fewer digits than those of all lines before.
    """
    with source.open() as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - TAIL_BYTES))
        *lines, last = file.read().decode("latin-1").split("\n")
    if not last.strip("\r") or last.endswith("\r"):
        return False
    *others, cut = (split(line.strip("\r"), delimiter)[-1] for line in [*lines[-TAIL_LINES:], last] if line.strip())
    others = [cell for cell in others if is_number(cell)]
    if len(others) >= _ENOUGH and is_number(cut) and _lacks_digits(cut, others):
        raise ReadError(
            f"{source} ends within a number: its last line ends in {cut!r} without a line end, the lines before in "
            f"numbers like {others[-1]!r}",
            advice="Remove the last line.",
        )
    return True


def _lacks_digits(cell: str, others: Sequence[str]) -> bool:
    """Whether a number is shorter than all others, or lacks the exponent that all others have."""
    powers = [len(other.lower().partition("e")[2].lstrip("+-")) for other in (cell, *others)]
    return len(cell) < min(map(len, others)) or powers[0] < min(powers[1:])


def _blocks(source: FileSource, first_line: int, place: Place | None = None) -> Iterator[tuple[Place, bytes]]:
    """Blocks of complete lines from `first_line` on, or from the block at a place on, each with its place."""
    with source.open() as file:
        line, rest, reached = first_line, b"", 0
        if place is not None:
            file.seek(place.begin)
            line, rest, reached = place.line, file.read(place.reached - place.begin), place.reached
        elif first_line == 1:
            rest = file.read(3)
            reached = len(rest)
            rest = b"" if rest == b"\xef\xbb\xbf" else rest
        else:
            reached = sum(len(file.readline()) for _ in range(first_line - 1))
        while read := file.read(BLOCK_BYTES):
            begin = Place(reached - len(rest), reached, line)
            reached += len(read)
            end = read.rfind(b"\n") + 1
            if end == 0:
                rest += read
                if len(rest) > LINE_BYTES:
                    raise ReadError(
                        f"{source} has a line of more than {LINE_BYTES >> 20} MB after line {line}",
                        advice="Check that the file is a table of text with one sample per line.",
                    )
                continue
            block, rest = rest + read[:end], read[end:]
            yield begin, block
            line += block.count(b"\n")
        if rest:
            yield Place(reached - len(rest), reached, line), rest


class _Parser:
    """Parse blocks of text into arrays."""

    def __init__(self, source: FileSource, dialect: Dialect, layout: Layout, wanted: tuple[int, ...]) -> None:
        import polars as pl

        self.source, self.dialect, self.layout, self.wanted = source, dialect, layout, wanted
        cells = enumerate(dialect.first_row)
        self.long = {k for k, cell in cells if dialect.integers[k] and len(cell.lstrip("+-")) > _BIG_INTEGER}
        self.schema: dict[str, type[pl.DataType]] = {str(k): pl.String for k in range(dialect.fields)}
        self.stamps = {k: dialect.first_row[k] for k in wanted if is_stamp(dialect.first_row[k])}
        self.midnights = {k: Midnights() for k, first in self.stamps.items() if is_time_of_day(first)}
        numbers = [k for k in wanted if k not in self.stamps]
        self.schema |= {str(k): pl.Int64 if k in self.long else pl.Float64 for k in numbers}
        # The last column is always read, because a short row has a null there.
        self.projection = sorted({*wanted, dialect.columns - 1})
        self.sign = dialect.comment.encode()

    def parse(self, block: bytes, line: int) -> Rows | None:
        """The numbers of a block that begins in `line`; None if it has no row."""
        frame = self._table(block, line)
        if frame is None:
            return None
        chunk = {}
        for k in self.wanted:
            column = frame.get_column(str(k))
            if k not in self.stamps:
                chunk[k] = np.ascontiguousarray(column.to_numpy())
                continue
            times = times_of(column, self.stamps[k])
            if (unknown := np.isnat(times)).any():
                self._explain_stamp(block, line, k, int(np.argmax(unknown)))
            chunk[k] = times.view(np.int64)
            if k in self.midnights:
                chunk[k] = self.midnights[k].continued(chunk[k])
        return chunk

    def count(self, block: bytes, line: int) -> int:
        """Number of rows in a block that begins in `line`. It is parsed only if it holds quotes or comments."""
        if b'"' in block or (self.sign and self.sign in block):
            frame = self._table(block, line)
            return 0 if frame is None else frame.height
        blank = len(_BLANK_LINE.findall(block)) + (_BLANK_START.match(block) is not None)
        ended = block.endswith(b"\n") or not block[block.rfind(b"\n") + 1 :].strip()
        return block.count(b"\n") - blank + (not ended)

    def _table(self, block: bytes, line: int) -> pl.DataFrame | None:
        """The columns of a block; None if it has no row.

        Raises
        ------
        ReadError
            At the first bad line.
        """
        import polars as pl

        if block.isspace():
            return None
        try:
            # Polars finds the number of columns in the first line, even if it is blank.
            frame = self._frame(self._plain(_BLANK_BEGIN.sub(b"", block, count=1)))
            if any(series.null_count() for series in frame):
                frame = self._frame(_without_blank_lines(self._plain(block)))
        except pl.exceptions.NoDataError:
            return None
        except pl.exceptions.PolarsError as error:
            self._explain(block, line)
            reason = str(error).splitlines()[0]
            raise ReadError(
                f"{self.source}, from line {line} on: {reason}", advice="Repair or remove this row."
            ) from error
        if any(series.null_count() for series in frame):
            self._explain(block, line)
            raise ReadError(
                f"{self.source}, from line {line} on: a row is not complete", advice="Repair or remove this row."
            )
        return None if frame.is_empty() else frame

    def _frame(self, block: bytes) -> pl.DataFrame:
        import polars as pl

        return pl.read_csv(
            block,
            has_header=False,
            schema=self.schema,
            columns=self.projection,
            separator=self.dialect.delimiter,
            decimal_comma=self.dialect.decimal_comma,
            # Polars searches every line for the comment sign, so it is passed only if there is one.
            comment_prefix=self.dialect.comment if self.sign and self.sign in block else None,
            quote_char='"' if b'"' in block else None,
        )

    def _plain(self, block: bytes) -> bytes:
        """The block without blanks around cells, and with single blanks as delimiters."""
        if self.dialect.delimiter == BLANKS:
            block = re.sub(rb"[ \t\r]+", b" ", block)
            return re.sub(rb"(?m)^ | $", b"", block)
        if b" " in block or (b"\t" in block and self.dialect.delimiter != "\t"):
            return block.translate(None, b" " if self.dialect.delimiter == "\t" else b" \t")
        return block

    def _explain(self, block: bytes, line: int) -> None:
        """Raise the error for the first bad line of a block.

        Raises
        ------
        ReadError
            With the file, the line, the column and the content of the cell.
        """
        d = self.dialect
        for number, text in self._lines(block, line):
            cells = split(text, d.delimiter)
            if len(cells) not in {d.fields, d.columns} and not (len(cells) > d.columns and not any(cells[d.columns :])):
                raise ReadError(
                    f"{self.source}, line {number}: {len(cells)} values, expected {d.columns} as in line "
                    f"{d.first_line} ({text.strip()[:60]!r})",
                    advice=_advice(block, line, number),
                )
            for k in self.wanted:
                self._explain_cell(cells[k], k, number)

    def _lines(self, block: bytes, line: int) -> Iterator[tuple[int, str]]:
        """The rows of a block that begins in `line`, each with the number of its line."""
        for number, raw in enumerate(block.split(b"\n"), line):
            try:
                text = raw.decode("utf-8").strip("\r")
            except UnicodeDecodeError:
                text = raw.decode("latin-1").strip("\r")
            if text.strip() and not comment_sign(text) == self.dialect.comment != "":
                yield number, text

    def _explain_stamp(self, block: bytes, line: int, column: int, row: int) -> NoReturn:
        """Raise the error for the time stamp in a row of a block, counted from 0."""
        number, text = next(islice(self._lines(block, line), row, None))
        cell = split(text, self.dialect.delimiter)[column]
        raise ReadError(
            f"{self.source}, line {number}: column {self._name(column)!r} holds "
            f"{what_is_wrong(cell, self.stamps[column])}",
            advice=_advice(block, line, number).removesuffix(".")
            + ", or leave the column out with {--columns=time:none} and pass {--rate}.",
        )

    def _name(self, column: int) -> str:
        return self.layout.channels[column].name or f"number {column}"

    def _explain_cell(self, cell: str, column: int, line: int) -> None:
        """Raise the error for a cell, if it is bad."""
        name = self._name(column)
        if cell == "":
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} is empty",
                advice="Remove such rows, or leave the column out with {--columns}.",
            )
        if column in self.stamps:
            return
        if not is_number(cell, self.dialect.decimal_comma):
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell[:40]!r}, expected a number",
                advice="Remove the line, or leave the column out with {--columns}.",
            )
        if column in self.long and not re.fullmatch(r"[+-]?\d+", cell):
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell!r} among integers of more than "
                f"{_BIG_INTEGER} digits",
                advice="Write all of them as integers.",
            )


def _advice(block: bytes, line: int, number: int) -> str:
    """What to do about a bad line of a block that begins in `line`."""
    last = not block.endswith(b"\n") and number == line + block.count(b"\n")
    return "The file ends there; if it was cut off, remove the line." if last else "Repair or remove the line."


def _without_blank_lines(block: bytes) -> bytes:
    """The block without blank lines, which Polars reads as rows of nulls."""
    return re.sub(rb"(?m)^[ \t\r]*\n", b"", block)
