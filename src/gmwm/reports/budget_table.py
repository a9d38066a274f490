"""The error budget of a calibration for the report: the errors after a minute, and what causes them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gmwm.budgets.summary_text import error_text, headline, terms_text
from gmwm.errors import GmwmError
from gmwm.remarks import Dialect, texts

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

DURATION = 60.0
"""Time of navigation without corrections (s) of the report: an outage of satellite positions in a tunnel."""


def budget_table(calibration: Calibration) -> dict[str, Any]:
    """Return headline, rows and remarks of the error budget; {} if an axis has none, such as an axis in counts."""
    try:
        found = calibration.budget(DURATION)
    except GmwmError:
        return {}
    rows = [["Error (1 σ)", "After 60 s", "Largest contributions"]]
    rows += [[one.title, error_text(one), terms_text(one)] for one in found.growths.values()]
    return {"headline": headline(found), "rows": rows, "remarks": texts(found.remarks, Dialect.HTML)}
