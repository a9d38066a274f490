"""Configuration files for other programs that a report shows. They use the default options of `export`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.base.errors import GmwmError
from gmwm.showing.exporters import export, export_formats

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

FIRST = "kalibr"
"""The format that is shown first."""
LONGEST_FILE = 40_000
"""Largest number of characters of a file in a report; tests/reports/test_report_page.py limits the size of a report."""


def configurations(calibration: Calibration) -> tuple[list[dict[str, str]], list[str]]:
    """Return `name`, `title` and `text` of each file, and for each format that cannot be written the reason."""
    written, refused = [], []
    for name, title in sorted(export_formats().items(), key=lambda item: item[0] != FIRST):
        try:
            text = export(calibration, format=name)
        except GmwmError as error:
            refused.append(f"{title}: {error}")
            continue
        if len(text) > LONGEST_FILE:
            refused.append(f"{title}: too long for the report. Write it with `gmwm export --format {name}`.")
            continue
        written.append({"name": name, "title": title[:1].upper() + title[1:], "text": text})
    return written, refused
