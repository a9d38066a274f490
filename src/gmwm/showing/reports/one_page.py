"""One-page report of a calibration: verdict, four numbers of each axis, one plot, cautions, and facts on the data."""

from __future__ import annotations

import base64
import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.remarks import Dialect, Severity, with_groups
from gmwm.base.text import counted, version
from gmwm.base.units import find_unit
from gmwm.calibration.findings import equality_remarks, unusable
from gmwm.calibration.tables import with_error
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.reports.recording_facts import recording_facts
from gmwm.showing.reports.verdict import state_of
from gmwm.showing.reports.write import environment, part

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.showing.plots.matplotlib import Picture

SYMBOLS = ("N", "B", "K")
MOST, SENTENCES = 3, 2
"""Largest number of cautions, and of sentences of each, so that the report fits on one page
(tests/reports/test_one_page.py)."""
FACTS = ("File", "Source", "SHA-256", "Sampling rate", "Length", "Gaps", "At rest", "Temperature")
_BETWEEN_SENTENCES = re.compile(r"(?<=[.!?]) (?=[A-Z<`])")


def one_page_data(calibration: Calibration, dialect: Dialect = Dialect.HTML) -> dict[str, Any]:
    """Return the content of the page, without the plot, as strings.

    Parameters
    ----------
    calibration : Calibration
    dialect : Dialect
        How options are written in remarks: as in Python, in the shell, or as HTML.
    """
    lost = set(unusable(calibration))
    heads = [*SYMBOLS, "Bias at rest"]
    numbers = {name: _numbers(axis) for name, axis in calibration.axes.items()}
    shown = [k for k in range(len(heads)) if k < len(SYMBOLS) or any(cells[k] for cells in numbers.values())]
    rows = [["Axis", "Model", *(heads[k] for k in shown)]]
    for axis, fit in calibration.items():
        note = " (cannot be used)" if axis in lost else ""
        rows.append([axis_title(axis) + note, fit.model.structure, *(numbers[axis][k] for k in shown)])
    rows += [
        [f"{axis_title(axis)} (not calibrated)", reason, *("" for _ in shown)]
        for axis, reason in calibration.failed.items()
    ]
    name = calibration.recording.file if calibration.recording and calibration.recording.file else calibration.source
    return {
        "title": f"Calibration of {name}" if name else "Calibration",
        "state": state_of(calibration.verdict),
        "headline": calibration.verdict.text(dialect),
        "rows": rows,
        "bias": len(shown) == len(heads),
        "confidence": f"{100 * calibration.settings.confidence:g} %",
        "cautions": _cautions(calibration, dialect),
        "facts": [*_facts(calibration).items(), ("Made with", f"gmwm {version()}")],
        "gmwm": version(),
    }


def _cautions(calibration: Calibration, dialect: Dialect) -> list[str]:
    """Return the first sentences of each of the most severe cautions, and a sentence with the number of others."""
    cautions = [remark for remark in calibration.remarks if remark.severity < Severity.INFO]
    groups = with_groups([*equality_remarks(calibration), *cautions], dialect)
    texts = list(dict.fromkeys(text for _, text in groups))
    short = [" ".join(_BETWEEN_SENTENCES.split(text)[:SENTENCES]) for text in texts[:MOST]]
    if more := len(texts[MOST:]):
        short.append(f"{counted(more, 'more caution')} {'is' if more == 1 else 'are'} in the report.")
    return short


def _facts(calibration: Calibration) -> dict[str, str]:
    """Return the facts on the recording by name. For several recordings, a value lists those of the first three."""
    recording = recording_facts(calibration)
    facts = {name: value for name, value in recording["facts"] if name in FACTS}
    for title, *values in recording["rows"][1:]:
        if title in FACTS:
            more = [f"and {len(values) - 3} more"] if len(values) > 3 else []
            facts[title] = "; ".join([*values[:3], *more])
    if facts.get("File", "").startswith(f"{facts.get('Source')}, "):
        del facts["Source"]
    return facts


def _numbers(axis: AxisCalibration) -> list[str]:
    """Return N, B, K and the bias of an axis with their intervals; "" for a number that the model does not have."""
    cells = [axis.datasheet[symbol].text() if symbol in axis.datasheet else "" for symbol in SYMBOLS]
    entry = axis.rest.entries[0] if axis.rest is not None else None
    if entry is None:
        return [*cells, ""]
    return [*cells, f"{with_error(entry)} {entry.units[0]}" if entry.symbol == "b" else "tilt unknown"]


def one_page(calibration: Calibration) -> str:
    """Return the page as HTML, which includes the plot."""
    buffer = io.BytesIO()
    _curves(calibration).savefig(buffer, format="png", dpi=130)
    template = environment().from_string(part("page/one_page.html"))
    text: str = template.render(
        **one_page_data(calibration), style=environment().filters["trusted"](part("page/report.css")),
        picture=base64.b64encode(buffer.getvalue()).decode(),
    )  # fmt: skip
    return text


def _curves(calibration: Calibration) -> Figure:
    units = [find_unit(fit.wavelet_variance.unit) for fit in calibration.values()]
    return calibration.plot(split=False, view="allan", units="si" if None in units else "datasheet")


def draw_one_page(calibration: Calibration, path: Path) -> None:
    """Write the page as a PDF with Matplotlib, which does not need Chromium."""
    import textwrap

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
    line(data["headline"], 11, bold=True, width=95, gap=1.6)
    axes = figure.add_axes((0.06, top - 0.22, 0.9, 0.21))
    axes.axis("off")
    wrapped = [[textwrap.fill(cell, 20) for cell in row] for row in data["rows"]]
    table = axes.table(cellText=wrapped[1:], colLabels=wrapped[0], loc="upper center", cellLoc="left")
    table.auto_set_font_size(False)
    table.set_fontsize(6.5)
    table.scale(1, 0.2 * 11.69 * 72 / 14 / max(len(wrapped), 1))
    top -= 0.24
    buffer = io.BytesIO()
    _curves(calibration).savefig(buffer, format="png", dpi=200)
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
