"""Render a report, or its one-page form, as one self-contained HTML page, and write it as HTML or PDF."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import io
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
from typing import Any

from gmwm.base.atomic_files import write_text, written_whole
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Severity, with_groups
from gmwm.base.text import counted, version, with_minus
from gmwm.calibration.findings import equality_remarks
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.summary_text import short_legend
from gmwm.calibration.tables import with_error
from gmwm.showing.reports.content import report_data
from gmwm.showing.reports.verdict import SENTENCE_ENDS, filter_tables, recording_facts, state_of, title_of

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
    """Print an HTML page to a PDF file. Raises an OptionError if no browser is installed, or if it writes no PDF."""
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
_IN_SCRIPT = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def report(calibration: Calibration, path: str | os.PathLike[str], *, one_page: bool = False) -> Path:
    """Write a calibration as HTML or PDF. `Calibration.report` describes the arguments."""
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in (".html", ".htm", ".pdf"):
        raise OptionError(argument="path", expected="a file name that ends in .html or .pdf", got=str(path))
    data = report_data(calibration) if not one_page else None
    if suffix != ".pdf":
        write_text(file, one_page_html(calibration) if data is None else page(data))
        return file
    with written_whole(file) as new:
        if data is None and browser() is None:
            draw_one_page(calibration, new)
        else:
            print_html(one_page_html(calibration) if data is None else page(data), new)
    return file


def page(data: dict[str, Any]) -> str:
    """Render the result of `report_data` as HTML. The security policy allows only the report's scripts (SHA-256) and no
    network, so no text of a recording runs a script."""
    scripts = [part("vendor/plotly-basic.min.js"), part("page/report.js")]
    digests = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; "
        "form-action 'none'"
    )
    words = {key: value for key, value in data.items() if key != "pictures"}
    html: str = template("report.html").render(
        **words,
        policy=policy,
        style=_ours(part("page/report.css")),
        scripts=[_ours(script) for script in scripts],
        pictures=_ours(as_json(data["pictures"])),
    )
    return html


@cache
def template(name: str) -> Any:
    """Return a Jinja template of this package, compiled. It escapes everything but what a filter marks as safe."""
    import jinja2

    templates = jinja2.Environment(
        autoescape=True,
        finalize=lambda value: with_minus(value) if type(value) is str else value,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=jinja2.FunctionLoader(lambda name: part(f"page/{name}")),
    )
    templates.filters["worded"] = lambda text: _ours(re.sub("`([^`]+)`", r"<code>\1</code>", escape(text)))
    templates.filters["breakable"] = lambda text: _ours(escape(text).replace("+", "+<wbr>").replace(" ", "&nbsp;"))
    # Remarks are already HTML, in which text from files is escaped.
    templates.filters["rendered"] = lambda text: _ours(text.replace(" %", "&nbsp;%"))
    templates.filters["trusted"] = _ours
    return templates.get_template(name)


def as_json(value: Any) -> str:
    """Return a value as JSON text that is safe inside <script>."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for character, escaped in _IN_SCRIPT.items():  # str.translate takes ten times as long
        text = text.replace(character, escaped)
    return text


def _ours(text: str) -> Any:
    """Mark a text that gmwm has written as safe HTML, which the template does not escape."""
    from markupsafe import Markup

    return Markup(text)


@cache
def part(name: str) -> str:
    """Return the text of a file of this package, such as a template or a script."""
    return files("gmwm.showing.reports").joinpath(name).read_text(encoding="utf-8")


MOST, SENTENCES = 3, 2
"""Most cautions, and sentences of each, for a report of one page (tests/reports/test_one_page.py)."""
FACTS = ("File", "Source", "SHA-256", "Sampling rate", "Length", "Gaps", "At rest", "Temperature")


def one_page_data(calibration: Calibration, dialect: Dialect = Dialect.HTML) -> dict[str, Any]:
    """Return the content of the page, without the plot, as strings. `dialect` is that of options in remarks."""
    tables = filter_tables(calibration, dialect)
    for table in tables:
        for row in table["rows"]:
            row["bias"] = "" if row["failed"] else _bias(calibration.axes[row["axis"]])
        table["bias"] = any(row["bias"] for row in table["rows"])
    return {
        "title": title_of(calibration),
        "state": state_of(calibration.verdict),
        "headline": calibration.verdict.text(dialect),
        "tables": tables,
        "lines": sum(len(table["rows"]) + len(table["reasons"]) for table in tables),
        "bias": any(table["bias"] for table in tables),
        "short_legend": short_legend(calibration),
        "cautions": _cautions(calibration, dialect),
        "facts": [*_facts(calibration).items(), ("Made with", f"gmwm {version()}")],
        "gmwm": version(),
    }


def _cautions(calibration: Calibration, dialect: Dialect) -> list[str]:
    """Return the first sentences of each of the most severe cautions, and a sentence with the number of others."""
    cautions = [remark for remark in calibration.remarks if remark.severity < Severity.INFO]
    groups = with_groups([*equality_remarks(calibration), *cautions], dialect)
    texts = list(dict.fromkeys(text for _, text in groups))
    short = [" ".join(SENTENCE_ENDS.split(text)[:SENTENCES]) for text in texts[:MOST]]
    if more := len(texts[MOST:]):
        short.append(f"{counted(more, 'more caution')} {'is' if more == 1 else 'are'} in the report.")
    return short


def _facts(calibration: Calibration) -> dict[str, str]:
    """Return the facts on the recording by name. For several recordings, a value is their own, or the first three."""
    recording = recording_facts(calibration)
    facts = {name: value for name, value in recording["facts"] if name in FACTS}
    for title, *values in recording["rows"][1:]:
        if title in FACTS:
            more = [f"and {len(values) - 3} more"] if len(values) > 3 else []
            facts[title] = values[0] if len(set(values)) == 1 else "; ".join([*values[:3], *more])
    return facts


def _bias(axis: AxisCalibration) -> str:
    """Return the bias of an axis at rest; "" if it was not estimated."""
    entry = axis.rest.entries[0] if axis.rest is not None else None
    if entry is None:
        return ""
    return f"{with_error(entry)} {entry.units[0]}" if entry.symbol == "b" else "tilt unknown"


def one_page_html(calibration: Calibration) -> str:
    """Return the page as HTML, which includes the plot."""
    buffer = io.BytesIO()
    calibration.plot().savefig(buffer, format="png", dpi=150)
    text: str = template("one_page.html").render(
        **one_page_data(calibration), style=_ours(part("page/report.css")),
        picture=base64.b64encode(buffer.getvalue()).decode(),
    )  # fmt: skip
    return text


def draw_one_page(calibration: Calibration, path: Path) -> None:
    """Write the page as a PDF with Matplotlib, which does not need Chromium."""
    import textwrap

    from matplotlib.transforms import Bbox

    from gmwm.showing.plots.matplotlib import Picture

    data = one_page_data(calibration, Dialect.PYTHON)
    figure: Picture = Picture(figsize=(8.27, 11.69))
    top = 0.965

    def line(text: str, size: float, *, bold: bool = False, width: int = 110, gap: float = 1.35) -> None:
        nonlocal top
        for row in textwrap.wrap(text, width) or [""]:
            figure.text(0.06, top, row, fontsize=size, va="top", weight="bold" if bold else "normal")
            top -= gap * size / 842

    line(data["title"], 14, bold=True, width=80)
    line(data["headline"], 11, bold=True, width=80, gap=1.6)
    for table in data["tables"]:
        cells = [[table["title"], *table["heads"], *(["Bias at rest"] if table["bias"] else []), "Model"]]
        for row in table["rows"]:
            numbers = [f"{cell['text']} {cell['mark']}" for cell in row["cells"]] or [""] * len(table["heads"])
            bias = [row["bias"]] if table["bias"] else []
            cells.append([row["axis"], *numbers, *bias, row["model"] or f"not calibrated: {row['failed']}"])
        height = 0.0145 * len(cells)
        axes = figure.add_axes((0.06, top - height, 0.88, height))
        axes.axis("off")
        widths = [2, *[2] * (len(cells[0]) - 2), 3]
        drawn = axes.table(cells, colWidths=widths, bbox=Bbox.unit(), cellLoc="left", edges="B")
        drawn.auto_set_font_size(False)
        drawn.set_fontsize(7)
        top -= height + 0.008
        for reason in table["reasons"]:
            line(f"{reason['mark']} {reason['numbers']}: {reason['text']}", 6.5, width=150)
        top -= 0.006
    buffer = io.BytesIO()
    calibration.plot().savefig(buffer, format="png", dpi=200)
    buffer.seek(0)
    from matplotlib.image import imread

    image = imread(buffer)
    height = 0.9 * 8.27 / 11.69 * image.shape[0] / image.shape[1]
    shown = figure.add_axes((0.06, top - height, 0.9, height))
    shown.imshow(image)
    shown.axis("off")
    top -= height + 0.015
    for text in data["cautions"]:
        line(f"- {text}", 7.5, width=130)
    top -= 0.01
    for name, value in data["facts"]:
        line(f"{name}: {value}", 7.5, width=130)
    figure.savefig(path, format="pdf", metadata={"CreationDate": None})
