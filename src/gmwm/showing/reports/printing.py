"""Print an HTML page to a PDF file with an installed Chromium."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from gmwm.base.errors import OptionError

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
"""Names of browsers that can print a page. The first that is installed is used."""


def browser() -> str | None:
    """Return the path of an installed Chromium or a browser based on it; None if there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


def print_html(html: str, path: Path) -> None:
    """Print an HTML page to a PDF file.

    Raises
    ------
    OptionError
        If no browser is installed, or the browser does not write the PDF.
    """
    program = browser()
    if program is None:
        raise OptionError(
            "a PDF needs Chromium or Chrome, which is not installed", argument="path", got=str(path),
            advice="Write the page as .html and print it from a browser.",
        )  # fmt: skip
    with tempfile.TemporaryDirectory() as place:
        page, printed = Path(place, "page.html"), Path(place, "page.pdf")
        page.write_text(html, encoding="utf-8")
        options = ["--headless", "--disable-gpu", "--no-pdf-header-footer", f"--user-data-dir={place}/profile"]
        # Chromium does not run as the superuser with its sandbox. The page allows no network requests.
        options += ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
        command = [program, *options, "--virtual-time-budget=20000", f"--print-to-pdf={printed}", page.as_uri()]
        with contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(command, capture_output=True, timeout=120.0, check=False)
        if not printed.is_file():
            raise OptionError(
                f"{Path(program).name} did not write the PDF", argument="path", got=str(path),
                advice="Write the page as .html and print it from a browser.",
            )  # fmt: skip
        path.write_bytes(printed.read_bytes())
