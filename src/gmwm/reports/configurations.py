"""Configuration files for other software, as texts to paste, with the settings that `export` has by default."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.errors import GmwmError
from gmwm.exporters import export, export_formats

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

FIRST = "kalibr"
"""The format that most others are like."""
LONGEST = 40_000
"""Characters beyond which a file is no text to paste."""


def configurations(calibration: Calibration) -> tuple[list[dict[str, str]], list[str]]:
    """The file of each format, as `name`, `title` and `text`; and of those that cannot be had, the reason."""
    found, left = [], []
    for name, title in sorted(export_formats().items(), key=lambda item: item[0] != FIRST):
        try:
            text = export(calibration, format=name)
        except GmwmError as error:
            left.append(f"{title}: {error}")
            continue
        if len(text) > LONGEST:
            left.append(f"{title}: too long to paste; gmwm export --format {name} writes it")
            continue
        found.append({"name": name, "title": title[:1].upper() + title[1:], "text": text})
    return found, left
