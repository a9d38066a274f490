"""Render the content of a report as one self-contained HTML page, and write it as HTML or PDF."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.atomic_files import write_text, written_whole
from gmwm.base.errors import OptionError
from gmwm.showing.reports.content import report_data

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

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


# The HTML parser interprets these characters inside <script>, so they are escaped, which JSON allows.
_IN_SCRIPT = str.maketrans({"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"})


def report(calibration: Calibration, path: str | os.PathLike[str], *, one_page: bool = False) -> Path:
    """Write a calibration as HTML or PDF. `Calibration.report` describes the arguments."""
    from gmwm.showing.reports.one_page import draw_one_page
    from gmwm.showing.reports.one_page import one_page as short

    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in (".html", ".htm", ".pdf"):
        raise OptionError(argument="path", expected="a file name that ends in .html or .pdf", got=str(path))
    data = report_data(calibration) if not one_page else None
    if suffix != ".pdf":
        write_text(file, short(calibration) if data is None else page(data))
        return file
    with written_whole(file) as new:
        if data is None and browser() is None:
            draw_one_page(calibration, new)
        else:
            print_html(short(calibration) if data is None else page(data), new)
    return file


def page(data: dict[str, Any]) -> str:
    """Render the result of `report_data` as HTML.

    The content security policy allows only the scripts of the report, by their SHA-256, and no network requests. So
    text from a recording cannot run a script, even if the template fails to escape it.
    """
    scripts = [part("vendor/plotly-basic.min.js"), part("page/report.js")]
    allowed = " ".join(f"'sha256-{_digest(script)}'" for script in scripts)
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
        "form-action 'none'"
    )
    words = {key: value for key, value in data.items() if key != "pictures"}
    template = environment().from_string(part("page/report.html"))
    html: str = template.render(
        **words,
        policy=policy,
        style=_ours(part("page/report.css")),
        scripts=[_ours(script) for script in scripts],
        pictures=_ours(as_json(data["pictures"])),
    )
    return html


def environment() -> Any:
    """Return the Jinja environment of the templates. It escapes everything except what a filter marks as safe."""
    import jinja2

    templates = jinja2.Environment(
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.FunctionLoader(lambda name: part(f"page/{name}")),
    )
    templates.filters["worded"] = _code_as_html
    templates.filters["breakable"] = lambda text: _ours(escape(text).replace("+", "+<wbr>").replace(" ", "&nbsp;"))
    templates.filters["rendered"] = _ours  # Remarks are already HTML, in which text from files is escaped.
    templates.filters["trusted"] = _ours
    return templates


def as_json(value: Any) -> str:
    """Return a value as JSON text that is safe inside <script>."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return text.translate(_IN_SCRIPT)


def _ours(text: str) -> Any:
    """Mark a text that gmwm has written as safe HTML, which the template does not escape."""
    from markupsafe import Markup

    return Markup(text)


def _code_as_html(text: str) -> Any:
    """Return a text as HTML, with parts between backticks shown as code and everything else escaped."""
    return _ours(re.sub("`([^`]+)`", r"<code>\1</code>", escape(text)))


@cache
def part(name: str) -> str:
    """Return the text of a file of this package, such as a template or a script."""
    return files("gmwm.showing.reports").joinpath(name).read_text(encoding="utf-8")


def _digest(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
