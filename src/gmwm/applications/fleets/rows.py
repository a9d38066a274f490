"""Make the rows of the table of a fleet, one for each unit and axis, from calibrations."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gmwm.base.remarks import Severity
from gmwm.base.text import printable
from gmwm.calibration.result import AxisCalibration, Calibration

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
