"""Format the comparison of a calibration with a reference as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.base.remarks import texts
from gmwm.base.tables import headed
from gmwm.choosing.datasheets.entry import Entry, significant

if TYPE_CHECKING:
    from gmwm.calibration.reference_check import ReferenceCheck, ReferenceNumber

POWERS = {"Q": 1.0, "N": 0.5, "B": 0.0, "K": -0.5, "R": -1.0}
_WORDS = {
    "agrees": "agrees", "close": "within 10 %", "larger": "larger than measured", "smaller": "smaller than measured",
    "unknown": "not measured",
}  # fmt: skip


def summary(found: ReferenceCheck) -> str:
    """Return the text of `ReferenceCheck.summary`."""
    verdict, *others = found.remarks
    in_file = any(row.key for row in found)
    head = ["", *(["in the file"] if in_file else []), "reference", f"measured ({100 * found.level:g} % interval)"]
    head += [*(["measured, as in the file"] if in_file else []), "factor", ""]
    rows = [head, *(_row(row, in_file) for row in found)]
    about = f"Reference: {found.name} ({found.format})." if in_file else "Reference: numbers of a datasheet."
    if in_file:
        about += f" Measured N and K are for a filter with a horizon of {found.horizon:g} s, as in exported files."
    about += " factor: reference / measured, or its upper limit."
    parts = [texts([verdict])[0], "\n".join(headed(rows)), about, *texts(others)]
    if found.unmatched:
        parts.append(f"The calibration does not have {', '.join(found.unmatched)}.")
    return "\n\n".join(parts)


def _row(row: ReferenceNumber, in_file: bool) -> list[str]:
    cells = [f"{row.axis} {row.symbol}"]
    if in_file:
        cells.append(row.key if row.written is None else f"{row.key} {row.written:.4g}")
    value, unit = row.shown
    cells += [f"{significant(value, 3)} {unit}", _measured_text(row.measured)]
    if in_file:
        shown = row.as_written
        limit = "≤ " if row.measured is not None and row.measured.upper_only else ""
        cells.append("" if shown is None else f"{limit}{shown:.4g}")
    factor = row.factor
    return [*cells, "" if factor is None else f"{factor:.3g}", _WORDS[row.verdict]]


def _measured_text(entry: Entry | None) -> str:
    return "–" if entry is None else entry.text()
