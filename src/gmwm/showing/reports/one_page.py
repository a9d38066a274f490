"""One-page report of a calibration: verdict, four numbers of each axis, one plot, cautions, and facts on the data."""

from __future__ import annotations

import base64
import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.remarks import Dialect, Severity, with_groups
from gmwm.base.text import counted, version
from gmwm.calibration.findings import equality_remarks
from gmwm.calibration.tables import with_error
from gmwm.showing.reports.filter_tables import SENTENCE_ENDS, filter_tables
from gmwm.showing.reports.recording_facts import recording_facts, title_of
from gmwm.showing.reports.verdict import state_of
from gmwm.showing.reports.write import environment, part

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.showing.plots.matplotlib import Picture

MOST, SENTENCES = 3, 2
"""Largest number of cautions, and of sentences of each, so that the report fits on one page
(tests/reports/test_one_page.py)."""
FACTS = ("File", "Source", "SHA-256", "Sampling rate", "Length", "Gaps", "At rest", "Temperature")


def one_page_data(calibration: Calibration, dialect: Dialect = Dialect.HTML) -> dict[str, Any]:
    """Return the content of the page, without the plot, as strings.

    Parameters
    ----------
    calibration : Calibration
    dialect : Dialect
        How options are written in remarks: as in Python, in the shell, or as HTML.
    """
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
    short = [" ".join(SENTENCE_ENDS.split(text)[:SENTENCES]) for text in texts[:MOST]]
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
    return facts


def _bias(axis: AxisCalibration) -> str:
    """Return the bias of an axis at rest; "" if it was not estimated."""
    entry = axis.rest.entries[0] if axis.rest is not None else None
    if entry is None:
        return ""
    return f"{with_error(entry)} {entry.units[0]}" if entry.symbol == "b" else "tilt unknown"


def one_page(calibration: Calibration) -> str:
    """Return the page as HTML, which includes the plot."""
    buffer = io.BytesIO()
    calibration.plot().savefig(buffer, format="png", dpi=150)
    template = environment().from_string(part("page/one_page.html"))
    text: str = template.render(
        **one_page_data(calibration), style=environment().filters["trusted"](part("page/report.css")),
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
