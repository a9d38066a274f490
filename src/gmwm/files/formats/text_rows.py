"""Parse blocks of a text table, and handle the lines that are not rows.

Polars reads short rows as nulls, so such blocks are checked by line. Empty cells and NA are missing values. Wrong
numbers of cells, or text, are bad lines: an error or missing values. Repeated headers are left out."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from itertools import islice
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.text import counted
from gmwm.base.threads import require_threads
from gmwm.files.clock.missing_values import MISSING
from gmwm.files.clock.text_stamps import Midnights, is_stamp, is_time_of_day, times_of, what_is_wrong
from gmwm.files.contract import Layout, Rows
from gmwm.files.formats.byte_sources import FileSource
from gmwm.files.formats.dialect import BLANKS, COMMENT_SIGNS, MISSING_WORDS, TextDialect, comment_sign, split_line
from gmwm.files.formats.line_forms import COLOURS, is_grouped, is_number

if TYPE_CHECKING:
    import polars as pl

_BIG_INTEGER = 15  # digits that float64 always holds exactly
# Without a group that repeats, because a file may have millions of blank lines.
_BLANK_RUN = re.compile(rb"\n[ \t\r\f\v\n]*\n")
_BLANK_BEGIN = re.compile(rb"\A[ \t\r\f\v\n]*\n")
_GAP = b"NA"  # text in each cell of a row that replaces a bad line
_POINT = re.compile(rb"\d\.\d{3}(?!\d)")
_WORDS = re.compile(rb"(?i)n/?a\b|null|none|nan\(|#(?:ind|qnan)")
OR_SKIP = " To count such lines as lost samples, pass {--bad_lines=skip}."


class RowParser:
    """Parse blocks of text into arrays."""

    def __init__(self, source: FileSource, dialect: TextDialect, layout: Layout, wanted: tuple[int, ...]) -> None:
        require_threads(source)
        import polars as pl

        self.source, self.dialect, self.layout, self.wanted = source, dialect, layout, wanted
        self.headers = {line.strip().encode() for line in dialect.header if line.strip()}
        cells = enumerate(dialect.first_row)
        self.long = {k for k, cell in cells if dialect.integers[k] and len(cell.lstrip("+-")) > _BIG_INTEGER}
        self.schema: dict[str, type[pl.DataType]] = {str(k): pl.String for k in range(dialect.fields)}
        self.stamps = {k: dialect.first_row[k] for k in wanted if is_stamp(dialect.first_row[k])}
        self.midnights = {k: Midnights() for k, first in self.stamps.items() if is_time_of_day(first)}
        numbers = [k for k in wanted if k not in self.stamps]
        self.schema |= {str(k): pl.Int64 if k in self.long else pl.Float64 for k in numbers}
        # The last column is always read, because a short row has a null there.
        self.projection = sorted({*wanted, dialect.columns - 1, *(dialect.sensor or ())[:1]})
        self.cleaning = [(re.compile(pattern), replacement) for pattern, replacement in dialect.cleaning]
        self.comment = dialect.comment or COMMENT_SIGNS[0]  # a comment may come late
        self.sign = self.comment.encode()

    def parse(self, block: bytes, line: int) -> Rows | None:
        """Return the numbers of a block that begins in `line`; None if it has no row."""
        import polars as pl

        block = self._cleaned(block)
        if self.dialect.decimal_comma and _POINT.search(block):
            self._require_no_thousands(block, line)
        frame = self._table(block, line)
        if frame is None:
            return None
        if self.dialect.sensor is not None:
            column, value = self.dialect.sensor
            cells = frame.get_column(str(column))
            frame = frame.filter(cells.cast(pl.String).str.strip_chars() == value)
        return {k: self._column(frame.get_column(str(k)), k, block, line) for k in self.wanted}

    def _column(self, column: pl.Series, k: int, block: bytes, line: int) -> NDArray[Any]:
        """Return the numbers of column `k` of a block, with NaN or `MISSING` for a missing value."""
        if k in self.long:
            return np.ascontiguousarray(column.fill_null(MISSING).to_numpy())
        if k not in self.stamps:
            return np.ascontiguousarray(column.to_numpy())
        present = column.is_not_null().to_numpy()
        times = np.full(present.size, MISSING)
        if present.any():
            stamps = times_of(column.filter(column.is_not_null()), self.stamps[k])
            if (unknown := np.isnat(stamps)).any() and not self.layout.skip_bad_lines:
                self._explain_stamp(block, line, k, int(np.flatnonzero(present)[np.argmax(unknown)]))
            times[present] = stamps.view(np.int64)
        if k in self.midnights and (placed := times != MISSING).any():
            times[placed] = self.midnights[k].continue_days(times[placed])
        return times

    def _require_no_thousands(self, block: bytes, line: int) -> None:
        """Raise an error if a number has a point before three digits, in a file with decimal commas."""
        columns = [k for k in self.wanted if k not in self.stamps]
        for number, text in self._lines(block, line):
            cells = split_line(text, self.dialect.delimiter)
            for k in columns:
                if k < len(cells) and is_grouped(cells[k]):
                    raise ReadError(
                        f"{self.source}, line {number}: column {self._name(k)!r} holds {cells[k][:40]!r}, in which the "
                        "point may separate thousands or decimals, because other numbers have a decimal comma",
                        code="decimal-comma",
                        advice="Write all numbers with decimal points, and none between thousands.",
                    )

    def count(self, block: bytes, line: int) -> int:
        """Return the number of rows in a block; it is parsed only if it has quotes or comments."""
        block = self._cleaned(block)
        if b'"' in block or self.sign in block:
            frame = self._table(block, line)
            return 0 if frame is None else frame.height
        has_header = any(header in block for header in self.headers)
        again = sum(map(self._is_header, block.splitlines())) if has_header else 0
        begin = _BLANK_BEGIN.match(block)
        blank = sum(run[0].count(b"\n") - 1 for run in _BLANK_RUN.finditer(block, begin.end() if begin else 0))
        blank += begin[0].count(b"\n") if begin else 0
        ended = block.endswith(b"\n") or not block[block.rfind(b"\n") + 1 :].strip()
        return block.count(b"\n") - blank + (not ended) - again

    def _is_header(self, line: bytes) -> bool:
        """Return whether a line repeats the header, also with a byte order mark, as where files were joined."""
        return line.strip().removeprefix(BOM_UTF8) in self.headers

    def _cleaned(self, block: bytes) -> bytes:
        for pattern, replacement in self.cleaning:
            block = pattern.sub(replacement, block)
        return block

    def _table(self, block: bytes, line: int) -> pl.DataFrame | None:
        """Return the columns of a block, with nulls for missing values; None if it has no row."""
        import polars as pl

        if block.isspace():
            return None
        with suppress(pl.exceptions.PolarsError):  # a line cannot be parsed
            # Polars finds the number of columns in the first line, even if it is blank.
            odd_blanks = b"\f" in block or b"\v" in block  # Polars reads a line of them as a row
            text = _without_blank_lines(block) if odd_blanks else _BLANK_BEGIN.sub(b"", block, count=1)
            frame = self._frame_or_none(text)
            if frame is not None and _has_nulls(frame) and (b"\n\n" in block or b"\n\r\n" in block):
                frame = self._frame_or_none(_without_blank_lines(block))
            if frame is not None and (_has_nulls(frame) or self._has_more_cells(block, frame.height)):
                text = block if self._even(block) else self._repair(block, line)
                frame = self._frame_or_none(_without_blank_lines(text))
            return frame
        try:
            return self._frame_or_none(_without_blank_lines(self._repair(block, line)))
        except pl.exceptions.PolarsError as error:
            reason = str(error).splitlines()[0]
            raise ReadError(
                f"{self.source}, from line {line} on: {reason}", code="row-invalid", advice="Repair or remove this row."
            ) from error

    def _frame_or_none(self, block: bytes) -> pl.DataFrame | None:
        """Return the columns of a block; None if it has no row."""
        import polars as pl

        # The search for a byte takes a hundredth of the time of the regular expression.
        has_words = (b"n" in block or b"N" in block) and _WORDS.search(block) is not None
        try:
            frame = pl.read_csv(
                self._plain(block),
                has_header=False,
                schema=self.schema,
                columns=self.projection,
                separator=self.dialect.delimiter,
                decimal_comma=self.dialect.decimal_comma,
                # Polars searches every line for the comment sign, so it is passed only if there is one.
                comment_prefix=self.comment if self.sign in block else None,
                quote_char='"' if b'"' in block else None,
                null_values=list(MISSING_WORDS) if has_words else None,
            )
        except pl.exceptions.NoDataError:
            return None
        return None if frame.is_empty() else frame

    def _has_more_cells(self, block: bytes, rows: int) -> bool:
        """Return whether a row may be too long. Polars reports such a row only if it reads all columns."""
        d = self.dialect
        cells = len(block.split()) if d.delimiter == BLANKS else block.count(d.delimiter.encode()) + rows
        return len(self.projection) < d.columns and cells > rows * max(d.fields, d.columns)

    def _even(self, block: bytes) -> bool:
        """Return whether each line of a block has the right number of cells, by a count of the delimiters."""
        if self.dialect.delimiter == BLANKS or b'"' in block or self.sign in block:
            return False
        sign, counts = self.dialect.delimiter.encode(), {self.dialect.fields - 1, self.dialect.columns - 1}
        return all(line.count(sign) in counts for line in _without_blank_lines(block).split(b"\n") if line.strip())

    def _repair(self, block: bytes, line: int) -> bytes:
        """Return the block without repeated headers, and with rows of missing values for bad lines."""
        delimiter = b" " if self.dialect.delimiter == BLANKS else self.dialect.delimiter.encode()
        gap = delimiter.join([_GAP] * self.dialect.columns)
        good = []
        for number, raw in enumerate(BytesIO(block), line):
            if raw.isspace():
                continue
            raw = raw.removesuffix(b"\n")
            text = as_text(raw)
            if self._is_header(text.encode()):
                continue
            row = bool(text.strip()) and comment_sign(text) != self.comment
            error = self._error_in(text, number, block, line) if row else None
            if error is not None and not self.layout.skip_bad_lines:
                raise error
            good.append(raw if error is None else gap)
        return b"\n".join(good)

    def _plain(self, block: bytes) -> bytes:
        """Return the block without blanks around cells, and with single blanks as delimiters."""
        if self.dialect.delimiter == BLANKS:
            block = re.sub(rb"[ \t\r\f\v]+", b" ", block)
            return re.sub(rb"(?m)^ | $", b"", block)
        if b" " in block or (b"\t" in block and self.dialect.delimiter != "\t"):
            return block.translate(None, b" \f\v" if self.dialect.delimiter == "\t" else b" \t\f\v")
        return block

    def _error_in(self, text: str, number: int, block: bytes, line: int) -> ReadError | None:
        """Return the error for a line of a block that begins in `line`; None if the line is a valid row."""
        d = self.dialect
        if zeros := text.count("\0"):
            return ReadError(
                f"{self.source}, line {number} holds {counted(zeros, 'zero byte')}, as after a loss of power",
                code="row-invalid", advice="Delete them (tr -d '\\000')." + OR_SKIP,
            )  # fmt: skip
        cells = split_line(text, d.delimiter)
        if len(cells) not in {d.fields, d.columns} and not (len(cells) > d.columns and not any(cells[d.columns :])):
            return ReadError(
                f"{self.source}, line {number}: {len(cells)} values, expected {d.columns} as in line "
                f"{d.first_line} ({text.strip()[:60]!r})",
                code="row-length",
                advice=_advice(block, line, number) + OR_SKIP,
            )
        return next((error for k in self.wanted if (error := self._error_of(cells[k], k, number))), None)

    def _lines(self, block: bytes, line: int) -> Iterator[tuple[int, str]]:
        """Yield the rows of a block that begins in `line`, each with its line number."""
        for number, raw in enumerate(BytesIO(block), line):
            text = as_text(raw.removesuffix(b"\n"))
            if self._is_header(text.encode()):
                continue
            if text.strip() and comment_sign(text) != self.comment:
                yield number, text

    def _explain_stamp(self, block: bytes, line: int, column: int, row: int) -> NoReturn:
        """Raise the error for the invalid time stamp in row number `row` (from 0) of a block."""
        number, text = next(islice(self._lines(block, line), row, None))
        cell = split_line(text, self.dialect.delimiter)[column]
        raise ReadError(
            f"{self.source}, line {number}: column {self._name(column)!r} holds "
            f"{what_is_wrong(cell, self.stamps[column])}",
            code="row-invalid",
            advice=_advice(block, line, number).removesuffix(".")
            + ", or leave the column out with {--columns=time:none} and pass {--rate}."
            + OR_SKIP,
        )

    def _name(self, column: int) -> str:
        return self.layout.channels[column].name or f"number {column}"

    def _error_of(self, cell: str, column: int, line: int) -> ReadError | None:
        """Return the error for a cell; None if it is a number, a time stamp or a missing value."""
        name = self._name(column)
        if cell in MISSING_WORDS or cell == "":
            return None
        if column in self.stamps:
            bad = self.layout.skip_bad_lines and not is_stamp(cell)
            return (
                ReadError(f"{self.source}, line {line}: column {name!r} holds {cell[:40]!r}", code="row-invalid")
                if bad
                else None
            )
        if not is_number(cell, self.dialect.decimal_comma):
            return ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell[:40]!r}, expected a number",
                code="row-invalid",
                advice="Remove the line, or leave the column out with {--columns}." + OR_SKIP,
            )
        if column in self.long and not re.fullmatch(r"[+-]?\d+", cell):
            return ReadError(
                f"{self.source}, line {line}: column {name!r} holds {cell!r} among integers of more than "
                f"{_BIG_INTEGER} digits", code="row-invalid", advice="Write all of them as integers." + OR_SKIP,
            )  # fmt: skip
        return None


def as_text(line: bytes) -> str:
    """Decode a line to a string, without colours and the carriage return of Windows."""
    line = re.sub(*COLOURS, line)
    try:
        return line.decode("utf-8").strip("\r")
    except UnicodeDecodeError:
        return line.decode("latin-1").strip("\r")


def _advice(block: bytes, line: int, number: int) -> str:
    """Return the advice for a bad line of a block that begins in `line`."""
    last = not block.endswith(b"\n") and number == line + block.count(b"\n")
    return "The file ends there; if it was cut off, remove the line." if last else "Repair or remove the line."


def _has_nulls(frame: pl.DataFrame) -> bool:
    return any(series.null_count() for series in frame)


def _without_blank_lines(block: bytes) -> bytes:
    """Return the block without blank lines, which Polars reads as rows of nulls."""
    return _BLANK_RUN.sub(b"\n", _BLANK_BEGIN.sub(b"", block, count=1))
