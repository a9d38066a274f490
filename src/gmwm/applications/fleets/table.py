"""Make the table of a fleet, and read and write its Parquet file."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.atomic_files import written_whole
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Severity
from gmwm.base.text import printable
from gmwm.base.threads import require_threads
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.tables import in_order

if TYPE_CHECKING:
    from polars import DataFrame

Row = dict[str, Any]
_INFINITE = "Infinity"


def rows_of(unit: str, path: str, found: Calibration) -> list[Row]:
    """Return a table row for each axis of a unit, including axes that could not be calibrated. Each datasheet parameter
    has the columns `<symbol>`, `<symbol>_low`, `<symbol>_high` and `<symbol>_unit`, in SI units. If only an upper limit
    is known, the value is None and the limit is in `<symbol>_high`."""
    base: Row = {
        "unit": unit,
        "file": printable(path),
        "cautions": sum(remark.severity < Severity.INFO for remark in found.recording_remarks),
    }
    if found.recording is not None:
        base |= {name: getattr(found.recording, name) for name in ("sha256", "samples", "rate", "duration")}
    rows = [
        base | {"axis": axis, "status": "calibrated", **_of_axis(axis_result)}
        for axis, axis_result in found.axes.items()
    ]
    return rows + [base | {"axis": axis, "status": "failed", "reason": why} for axis, why in found.failed.items()]


def failed_row(unit: str, path: str, reason: str) -> Row:
    """Return the table row of a unit that could not be calibrated."""
    return {"unit": unit, "file": printable(path), "status": "failed", "reason": printable(reason)}


def plain(row: Row) -> Row:
    """Return a row for JSON, with infinite limits replaced by a string.

    >>> from_plain(plain({"N": 1.0, "N_high": math.inf}))
    {'N': 1.0, 'N_high': inf}
    """
    return {name: _INFINITE if value == math.inf else value for name, value in row.items()}


def from_plain(row: Mapping[str, Any]) -> Row:
    """Restore a row from the result of `plain`."""
    return {name: math.inf if value == _INFINITE else value for name, value in row.items()}


def _of_axis(found: AxisCalibration) -> Row:
    fit = found.fit
    row: Row = {
        "model": fit.model.structure,
        "p_value": None if found.test is None else float(found.test.pvalue),
        "robust": fit.wavelet_variance.robust,
        "contaminated": None if found.verdict is None else bool(found.verdict.contaminated),
        "certified": fit.gap is not None and bool(fit.gap <= 1e-3),  # docs/validation/optimum.md
    }
    for symbol, entry in found.datasheet.items():
        bound = entry.upper_only
        row[symbol] = None if bound else entry.value
        row[f"{symbol}_low"] = 0.0 if bound else entry.low
        row[f"{symbol}_high"] = entry.high
        row[f"{symbol}_unit"] = entry.unit
    return row


TEXTS = ("unit", "axis", "status", "reason", "file", "sha256")
"""Text columns that identify a row. The columns of the recording, the model and the parameters follow them."""
LIMITS = ("", "_low", "_high", "_unit")
"""Suffixes of the four columns of a parameter."""
RUN_AGAIN = "Run the fleet again: finished units are not repeated."
"""Advice for a run that was not completed."""


def as_table(rows: Iterable[Row]) -> DataFrame:
    """Make the table from rows, with fixed columns and four columns for each parameter that any row has."""
    import polars as pl

    all_rows = list(rows)
    numbers: dict[str, Any] = {
        "samples": pl.Int64, "rate": pl.Float64, "duration": pl.Float64, "model": pl.String, "p_value": pl.Float64,
        "robust": pl.Boolean, "contaminated": pl.Boolean, "certified": pl.Boolean, "cautions": pl.Int64,
    }  # fmt: skip
    schema: dict[str, Any] = dict.fromkeys(TEXTS, pl.String) | numbers
    for symbol in symbols_of(all_rows):
        schema |= {f"{symbol}{end}": pl.String if end == "_unit" else pl.Float64 for end in LIMITS}
    # A fleet without units has an empty table with all columns.
    return pl.DataFrame({name: [row.get(name) for row in all_rows] for name in schema}, schema=schema)


def symbols_of(rows: Iterable[Row]) -> list[str]:
    """Return the symbols of all parameters that rows contain, in datasheet order."""
    each = [[name.removesuffix("_unit") for name in row if name.endswith("_unit")] for row in rows]
    # Many rows have the same symbols, so each distinct list of symbols is used once.
    return in_order([list(symbols) for symbols in dict.fromkeys(map(tuple, each))])


def write_table(table: DataFrame, path: Path) -> None:
    """Write the table to a Parquet file. If an error occurs, an existing file is unchanged."""
    require_threads(path)
    with written_whole(path) as temporary, temporary.open("wb") as file:  # Polars opens no path that is not UTF-8
        table.write_parquet(file)


def read_table(path: Path) -> DataFrame:
    """Read the table from a file that `write_table` wrote."""
    import polars as pl

    if not path.is_file():
        raise ReadError(f"{path} does not exist: no run of this fleet was completed", advice=RUN_AGAIN)
    try:
        table = pl.read_parquet(BytesIO(path.read_bytes()))  # see `write_table`
    except (OSError, pl.exceptions.PolarsError) as error:
        raise ReadError(f"{path} is not the table of a fleet: {error}", advice=RUN_AGAIN) from error
    if missing := [name for name in TEXTS if name not in table.columns]:
        raise ReadError(f"{path} is not the table of a fleet: it has no column {missing[0]!r}", advice=RUN_AGAIN)
    return table
