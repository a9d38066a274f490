"""CSV and text tables: read block by block, each block parsed by Polars.

The header is ours, the numbers are Polars': it gets a schema, so nothing is inferred from the first rows.
Polars fills short rows with nulls without a word; a null is therefore looked up in the text, line by line,
and told with its line number. That search runs only when something is wrong.
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

if TYPE_CHECKING:
    import polars as pl

BLOCK_BYTES = 8 << 20
"""Bytes in a block: large enough to parse in parallel, small enough to stay in the cache of pages."""

LINE_BYTES = 8 * BLOCK_BYTES
"""Bytes in a line that are not waited for any longer."""

TAIL_BYTES, TAIL_LINES = 1 << 16, 1000
"""Where and with how many lines the last one is compared, if it has no line end."""
_ENOUGH = 10  # lines that say how long numbers are

_BIG_INTEGER = 15  # digits that float64 always holds
_BLANK_LINE, _BLANK_START = re.compile(rb"\n(?=[ \t\r]*\n)"), re.compile(rb"[ \t\r]*\n")
_BLANK_BEGIN = re.compile(rb"\A(?:[ \t\r]*\n)+")
_NO_END = "the last line has no line end: if the recording was cut off there, its last value may lack digits"


@dataclass(frozen=True)
class Place:
    """Where a block of lines begins: its first byte, the byte up to which was read before it, and its first line."""

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
            return 0.5  # UTF-16: ours, to be refused with the way out
        control = sum(head.count(bytes([c])) for c in (*range(9), *range(14, 32)))
        if control:
            return 0.0
        return 0.5 if re.search(rb"\d", head) else 0.1

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """The columns by header, comment or number."""
        return (self.layout(FileSource(path)),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """One chunk a block; a column whose first rows hold long integers stays int64."""
        return self.rows(FileSource(path), layout, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """The blocks; their rows are counted, which takes a pass over the file, but parses no number.

        None where a column holds times of day, whose midnights must be followed from the first.
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
        """The chunks of the blocks from one on."""
        return self.rows(FileSource(path), layout, wanted, mark.place)

    def layout(self, source: FileSource) -> Layout:
        """The columns of the text that a source holds, packed or not."""
        dialect = detect(_head_lines(source), source)
        names = dialect.names or ("",) * dialect.columns
        told, channels = _told_by_stamps(dialect), []
        for k, name in enumerate(names):
            unit = dialect.column_units[k] if dialect.column_units else ""
            axis = recognise(name).axis
            if dialect.stamps[k]:
                channels.append(Channel(name, UNIT, "time" if k == told else ""))
            else:
                channels.append(Channel(name, (unit_of(unit, axis) or unit) if axis else unit))
        # Packed bytes say themselves whether they are whole.
        notes = (_NO_END,) if source.seekable and _is_open(source, dialect.delimiter) else ()
        return Layout(
            tuple(channels), dialect.first_row, rate=dialect.rate, units=dialect.units, notes=notes, state=dialect
        )

    def rows(
        self, source: FileSource, layout: Layout, wanted: Sequence[int], place: Place | None = None
    ) -> Iterator[Rows]:
        """The numbers of the text that a source holds, from the first or from the block at a place on."""
        dialect: Dialect = layout.state
        parser = _Parser(source, dialect, layout, tuple(wanted))
        for begin, block in _blocks(source, dialect.first_line, place):
            chunk = parser.parse(block, begin.line)
            if chunk is not None:
                yield chunk


def _told_by_stamps(dialect: Dialect) -> int | None:
    """The column that is the time because dates with times stand in it, or times of day, where no name says time."""
    if not dialect.names or any(recognise(name).axis == "time" for name in dialect.names):
        return None
    found = [k for k, stamped in enumerate(dialect.stamps) if stamped]
    return min(found, key=lambda k: is_time_of_day(dialect.first_row[k]), default=None)


def _head_lines(source: FileSource) -> list[str]:
    """The first whole lines as text; the marks some programs put in front are removed or refused."""
    with source.open() as file:
        head = file.read(HEAD_BYTES)
        more = bool(file.read(1))
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise ReadError(f"{source} is UTF-16 text; save it as UTF-8 (in a spreadsheet: 'CSV UTF-8')")
    if b"\0" in head:
        raise ReadError(f"{source} is binary, no text (it holds zero bytes); name its format with format=")
    if b"\n" not in head and head.rstrip(b"\r").count(b"\r"):
        raise ReadError(f"{source} ends its lines with bare carriage returns; convert them to line feeds first")
    if more and b"\n" in head:
        head = head[: head.rfind(b"\n") + 1]
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = head.decode("latin-1")  # a degree sign in the header; numbers are ASCII either way
    return text.replace("\r\n", "\n").split("\n")


def _is_open(source: FileSource, delimiter: str) -> bool:
    """Whether the last line ends with the file, without a line end; an error if its last number was cut off there."""
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
            f"{source} ends within a number: its last line ends in {cut!r}, without a line end, and the lines before "
            f"in numbers as {others[-1]!r}; was it cut off? Remove the last line"
        )
    return True


def _lacks_digits(cell: str, others: Sequence[str]) -> bool:
    """Whether a number is shorter than all others are, or has not the exponent that all of them have."""
    powers = [len(other.lower().partition("e")[2].lstrip("+-")) for other in (cell, *others)]
    return len(cell) < min(map(len, others)) or powers[0] < min(powers[1:])


def _blocks(source: FileSource, first_line: int, place: Place | None = None) -> Iterator[tuple[Place, bytes]]:
    """Blocks of whole lines from `first_line` on, or from the one at a place, each with its place."""
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
                        f"{source} has a line of more than {LINE_BYTES >> 20} MB behind line {line}: no table"
                    )
                continue
            block, rest = rest + read[:end], read[end:]
            yield begin, block
            line += block.count(b"\n")
        if rest:
            yield Place(reached - len(rest), reached, line), rest


class _Parser:
    """Blocks of text into arrays."""

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
        # The last column is always read: a short row shows there, whichever axes are wanted.
        self.projection = sorted({*wanted, dialect.columns - 1})
        self.sign = dialect.comment.encode()

    def parse(self, block: bytes, line: int) -> Rows | None:
        """The numbers of a block that begins in `line`, or None if it holds none."""
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
        """How many rows `parse` finds in a block; only where quotes or comments are in it, it is parsed."""
        if b'"' in block or (self.sign and self.sign in block):
            frame = self._table(block, line)
            return 0 if frame is None else frame.height
        blank = len(_BLANK_LINE.findall(block)) + (_BLANK_START.match(block) is not None)
        ended = block.endswith(b"\n") or not block[block.rfind(b"\n") + 1 :].strip()
        return block.count(b"\n") - blank + (not ended)

    def _table(self, block: bytes, line: int) -> pl.DataFrame | None:
        """The columns of a block, or None if it has no row."""
        import polars as pl

        if block.isspace():
            return None
        try:
            # Polars takes the columns from the first line, be it blank.
            frame = self._frame(self._plain(_BLANK_BEGIN.sub(b"", block, count=1)))
            if any(series.null_count() for series in frame):
                frame = self._frame(_without_blank_lines(self._plain(block)))
        except pl.exceptions.NoDataError:
            return None
        except pl.exceptions.PolarsError as error:
            self._explain(block, line)
            reason = str(error).splitlines()[0]
            raise ReadError(f"{self.source}, from line {line} on: {reason}") from error
        if any(series.null_count() for series in frame):
            self._explain(block, line)
            raise ReadError(f"{self.source}, from line {line} on: a row is not complete")
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
            # Polars looks at every line for a comment sign: only where there is one.
            comment_prefix=self.dialect.comment if self.sign and self.sign in block else None,
            quote_char='"' if b'"' in block else None,
        )

    def _plain(self, block: bytes) -> bytes:
        """A block whose cells have no blanks around them and whose runs of blanks are one."""
        if self.dialect.delimiter == BLANKS:
            block = re.sub(rb"[ \t\r]+", b" ", block)
            return re.sub(rb"(?m)^ | $", b"", block)
        if b" " in block or (b"\t" in block and self.dialect.delimiter != "\t"):
            return block.translate(None, b" " if self.dialect.delimiter == "\t" else b" \t")
        return block

    def _explain(self, block: bytes, line: int) -> None:
        """Raise the error that the first bad line of a block deserves."""
        d = self.dialect
        for number, text in self._lines(block, line):
            cells = split(text, d.delimiter)
            if len(cells) not in {d.fields, d.columns} and not (len(cells) > d.columns and not any(cells[d.columns :])):
                raise ReadError(
                    f"{self.source}, line {number}: {len(cells)} values, expected {d.columns} as in line "
                    f"{d.first_line}; {_to_do(block, line, number)} ({text.strip()[:60]!r})"
                )
            for k in self.wanted:
                self._explain_cell(cells[k], k, number)

    def _lines(self, block: bytes, line: int) -> Iterator[tuple[int, str]]:
        """The rows of a block that begins in `line`, each with its line."""
        for number, raw in enumerate(block.split(b"\n"), line):
            try:
                text = raw.decode("utf-8").strip("\r")
            except UnicodeDecodeError:
                text = raw.decode("latin-1").strip("\r")
            if text.strip() and not comment_sign(text) == self.dialect.comment != "":
                yield number, text

    def _explain_stamp(self, block: bytes, line: int, column: int, row: int) -> NoReturn:
        """Raise the error of the stamp in a row of a block, counted from 0."""
        number, text = next(islice(self._lines(block, line), row, None))
        cell = split(text, self.dialect.delimiter)[column]
        raise ReadError(
            f"{self.source}, line {number}: column {self._name(column)!r} holds "
            f"{what_is_wrong(cell, self.stamps[column])}; {_to_do(block, line, number)}, or leave the column out with "
            'columns={"time": None} and pass rate='
        )

    def _name(self, column: int) -> str:
        return self.layout.channels[column].name or f"number {column}"

    def _explain_cell(self, cell: str, column: int, line: int) -> None:
        name = self._name(column)
        if cell == "":
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} is empty; remove or fill such rows first "
                "(a sample that is missing is a gap, not a zero)"
            )
        if column in self.stamps:
            return
        if not is_number(cell, self.dialect.decimal_comma):
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell[:40]!r}, expected a number; remove the "
                "line, or leave the column out with columns="
            )
        if column in self.long and not re.fullmatch(r"[+-]?\d+", cell):
            raise ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell!r} among integers of more than "
                f"{_BIG_INTEGER} digits; write all of them as integers"
            )


def _to_do(block: bytes, line: int, number: int) -> str:
    """What to do about a bad line of a block that begins in `line`."""
    last = not block.endswith(b"\n") and number == line + block.count(b"\n")
    return "the file ends there: was it cut off?" if last else "repair or remove the line"


def _without_blank_lines(block: bytes) -> bytes:
    """A block without empty lines, which Polars takes for rows of nulls."""
    return re.sub(rb"(?m)^[ \t\r]*\n", b"", block)
