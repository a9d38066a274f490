"""Table of the error budget in a report: the navigation errors after one minute, and the terms that cause them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gmwm.applications.navigation.summary_text import error_text, headline, terms_text
from gmwm.base.errors import GmwmError
from gmwm.base.remarks import Dialect, texts

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

DURATION = 60.0
"""Time of navigation without corrections (s) for the report, such as an outage of satellite positions in a tunnel."""


def budget_table(calibration: Calibration) -> dict[str, Any]:
    """Return headline, table rows and remarks of the error budget; empty if it fails, for example with raw counts."""
    try:
        found = calibration.budget(DURATION)
    except GmwmError:
        return {}
    rows = [["Error (1 σ)", "After 60 s", "Largest contributions"]]
    rows += [[one.title, error_text(one), terms_text(one)] for one in found.growths.values()]
    return {"headline": headline(found), "rows": rows, "remarks": texts(found.remarks, Dialect.HTML)}
