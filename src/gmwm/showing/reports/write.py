"""Render the content of a report as one self-contained HTML page, and write it as HTML or PDF."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.atomic_files import write_text, written_whole
from gmwm.base.errors import OptionError
from gmwm.showing.reports.content import report_data
from gmwm.showing.reports.printing import browser, print_html

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

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
