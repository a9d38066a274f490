"""Print an HTML page to a PDF file with an installed Chromium."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gmwm.base.errors import OptionError

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome", "microsoft-edge")
"""Names of browsers that can print a page. The first that is installed is used."""

PLACES = {
    "win32": (
        "Google/Chrome/Application/chrome.exe",
        "Microsoft/Edge/Application/msedge.exe",
        "Chromium/Application/chrome.exe",
    ),
    "darwin": ("Google Chrome", "Chromium", "Microsoft Edge"),
}
"""Where the installers of Windows and macOS put these browsers, which are not on the path there."""
_ROOTS = ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA")


def browser() -> str | None:
    """Return the path of an installed Chromium or a browser based on it; None if there is none."""
    return next(filter(None, map(shutil.which, (*NAMES, *_installed()))), None)


def _installed() -> Iterator[str]:
    """Return the files where installers put a browser on this system."""
    for place in PLACES.get(sys.platform, ()):
        if sys.platform == "darwin":
            yield f"/Applications/{place}.app/Contents/MacOS/{place}"
        else:
            yield from (str(Path(os.environ[root], place)) for root in _ROOTS if root in os.environ)


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
