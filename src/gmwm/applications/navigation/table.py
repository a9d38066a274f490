"""Section of the error budget in a report: the navigation errors after one minute, and the terms that cause them."""

from __future__ import annotations

from gmwm.applications.navigation.result import error_text, headline, start, terms_text
from gmwm.base.errors import GmwmError
from gmwm.base.remarks import Dialect, texts
from gmwm.calibration.result import Calibration
from gmwm.showing.reports.content import Section


def budget_section(calibration: Calibration) -> Section | None:
    """Return the error budget; None if it cannot be computed, for example because an axis is in raw counts."""
    try:
        budget = calibration.budget(60.0)  # s, such as an outage of satellite positions in a tunnel
    except GmwmError:
        return None
    rows = [[growth.title, error_text(growth), terms_text(growth)] for growth in budget.growths.values()]
    return Section(
        title="An error budget: one minute without corrections",
        text=f"{headline(budget)} {start(budget)} The errors are those that the noise causes in unaided inertial "
        "navigation. For other durations, and the growth over time, use `gmwm budget`.",
        rows=[["Error (1 σ)", "After 60 s", "Largest contributions"], *rows],
        remarks=texts(budget.remarks, Dialect.HTML),
    )
