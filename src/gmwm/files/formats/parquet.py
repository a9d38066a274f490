"""Read Parquet files, and the Arrow files that Feather is today, with Polars in slices of rows."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.threads import require_threads
from gmwm.files.clock.missing_values import MISSING
from gmwm.files.clock.text_stamps import is_stamp, is_time_of_day, times_of, what_is_wrong
from gmwm.files.contract import Channel, Layout, Mark, Reader, Rows, damage_error, register

if TYPE_CHECKING:
    import polars as pl

TABLE_ROWS = 1 << 18  # rows of a chunk. 2²⁰ rows need 200 MB more for six axes; fewer decode one row group more often

_ARROW = b"ARROW1"


@register
class ParquetReader(Reader):
    """Reader of Parquet and Arrow files."""

    name: ClassVar[str] = "parquet"
    extensions: ClassVar[tuple[str, ...]] = (".parquet", ".pq", ".feather", ".arrow")
    signatures: ClassVar[tuple[bytes, ...]] = (b"PAR1", _ARROW)
    single: ClassVar[bool] = True

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the columns of the schema. A column of dates is the time, in the unit of its type."""
        import polars as pl

        try:
            scan = _scan(path)
            schema = scan.collect_schema()
            first = scan.head(1).collect()
            row = () if first.is_empty() else tuple(map(_first_cell, first.get_columns()))
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
            reason = str(error).splitlines()[0]
            raise damage_error(f"{path} is not a complete Parquet or Arrow file ({reason})", "incomplete") from error
        channels = tuple(
            Channel(name, dtype.time_unit, "time") if isinstance(dtype, pl.Datetime) else Channel(name)
            for name, dtype in schema.items()
        )
        if not row:
            raise ReadError(
                f"{path} has columns but no rows", code="empty", advice="Check whether the recording was interrupted."
            )
        return (Layout(channels, row),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield slices of the wanted columns; integers as int64, all others as float64."""
        return self.chunks_from(path, layout, wanted, Mark(0))

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return marks for the slices, from the number of rows that the file states."""
        import polars as pl

        rows = int(_scan(path).select(pl.len()).collect().item())
        return (*(Mark(row) for row in range(0, rows, TABLE_ROWS)), Mark(rows))

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield the chunks from a mark on."""
        import polars as pl

        names = [layout.channels[k].name for k in wanted]
        scan = _scan(path).select(names)
        row = mark.row
        while True:
            try:
                frame = scan.slice(row, TABLE_ROWS).collect()
            except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
                raise damage_error(f"{path} is damaged after row {row}: {str(error).splitlines()[0]}") from error
            if frame.is_empty():
                return
            columns = zip(wanted, names, strict=True)
            yield {k: _numbers(frame.get_column(name), path, row, layout.first_row[k]) for k, name in columns}
            row += frame.height


def _scan(path: Path) -> pl.LazyFrame:
    """Return a lazy frame. The file name is not a pattern, and can contain bytes that are not UTF-8."""
    require_threads(path)
    import polars as pl

    with path.open("rb") as file:
        scan = pl.scan_ipc if file.read(len(_ARROW)) == _ARROW else pl.scan_parquet
    try:
        name = os.fspath(path).encode().decode()
    except UnicodeEncodeError:
        return scan(BytesIO(path.read_bytes()))
    return scan(glob.escape(name))


def _first_cell(series: pl.Series) -> str:
    """Return the first cell as text. A date beyond the calendar of Python is a number of units since 1970."""
    import polars as pl

    try:
        return str(series.to_list()[0])
    except (ValueError, OverflowError, pl.exceptions.PanicException):
        return str(series.to_physical().to_list()[0])


def _numbers(series: pl.Series, path: Path, row: int, first: str) -> NDArray[Any]:
    """Convert a column to an array, with NaN or `MISSING` for a null; `first` is its first cell in the file."""
    import polars as pl

    dtype = series.dtype
    dated = dtype == pl.String and is_stamp(first) and not is_time_of_day(first)
    if isinstance(dtype, pl.Datetime):
        series = series.to_physical()
    elif not dated and not (dtype.is_numeric() or dtype == pl.Null):
        raise ReadError(
            f"{path}: column {series.name!r} holds {dtype}, expected numbers",
            code="column-not-numbers",
            advice="Name other columns with {--columns}.",
        )
    if dated:
        present = series.is_not_null().to_numpy()
        times = np.full(present.size, MISSING)
        if present.any():
            stamps = times_of(series.drop_nulls(), first)
            if (unknown := np.isnat(stamps)).any():
                at = int(np.flatnonzero(present)[np.argmax(unknown)])
                raise ReadError(
                    f"{path}: column {series.name!r} holds {what_is_wrong(series[at], first)} in row {row + at + 1}",
                    code="row-invalid",
                    advice="Repair the row, or leave the column out with {--columns=time:none} and pass {--rate}.",
                )
            times[present] = stamps.view(np.int64)
        return times
    integer = series.dtype.is_integer()
    if integer and series.dtype == pl.UInt64 and series.len() and int(series.max() or 0) >= 1 << 63:  # type: ignore[arg-type]
        raise ReadError(
            f"{path}: column {series.name!r} holds integers above 2⁶³",
            code="integers-too-large",
            advice="Leave the column out with {--columns}, or save it as 64-bit floating-point numbers.",
        )
    numbers = series.cast(pl.Int64).fill_null(MISSING) if integer else series.cast(pl.Float64)
    # A view would keep the memory of the whole row group.
    return np.array(numbers.to_numpy())
