"""Export of the noise parameters of a unit as tables: CSV for spreadsheets and LaTeX for papers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from gmwm.base.axis_names import by_sensor
from gmwm.calibration.tables import SENSORS, in_order, number
from gmwm.showing.exporters.base import Exporter, ExportOptions, register, top
from gmwm.showing.exporters.text import commented, paragraphs, recording

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.result import AxisCalibration
    from gmwm.choosing.datasheets import Entry

_ABOUT = (
    "Continuous-time numbers of each axis, without inflation. N and K: of a filter that predicts 1 s; the numbers with "
    "a term describe the model."
)


@register
class CsvTable(Exporter):
    """CSV with one row for each parameter of each axis, in SI units and in datasheet units."""

    name = "csv"
    title = "spreadsheets (CSV)"
    extension = ".csv"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the file: comment lines, a header and the rows."""
        level = calibration.settings.confidence
        head = commented(
            [
                *top(self, calibration),
                recording(calibration),
                f"{_ABOUT} low and high: {100 * level:g} % confidence interval. If upper_only is true, the number is "
                "zero or not distinguished from zero, and high is its upper limit. inf: not determined. No low and "
                "high: taken from the spectrum.",
                *paragraphs(self.remarks(calibration, options)),
            ],
            "#",
        )  # fmt: skip
        out = io.StringIO()
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(
            ["axis", "model", "symbol", "title", "term", "value", "low", "high", "unit", "upper_only",
             "datasheet_value", "datasheet_low", "datasheet_high", "datasheet_unit"]
        )  # fmt: skip
        for axis, found in calibration.axes.items():
            for entry in found.datasheet.entries:
                si, datasheet = (
                    [value, "", "", unit] if entry.held else [value, low, high, unit]
                    for value, low, high, unit in map(entry.in_units, ("si", "datasheet"))
                )
                rows.writerow(
                    [*map(_text, (axis, found.fit.model.structure, entry.symbol, _title(entry), entry.term or "")),
                     *si, str(entry.upper_only).lower(), *datasheet]
                )  # fmt: skip
        return "\n".join([*head, out.getvalue()])


def _title(entry: Entry) -> str:
    """Return the title of a number; that of an oscillation has its frequency."""
    return entry.title if entry.frequency is None else f"{entry.title} {entry.name.partition(' ')[2]}"


def _text(cell: str) -> str:
    """Return text in a form that spreadsheets do not interpret as a formula.

    >>> _text("=1+1"), _text("GM + WN")
    ("'=1+1", 'GM + WN')
    """
    return f"'{cell}" if cell.startswith(("=", "+", "-", "@", "\t")) else cell


@register
class LatexTable(Exporter):
    """LaTeX with a tabular for each sensor, which has a column for each axis and a row for each parameter."""

    name = "latex"
    title = "papers (LaTeX)"
    extension = ".tex"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return LaTeX code that needs no additional package."""
        level = calibration.settings.confidence
        head = commented(
            [
                *top(self, calibration),
                recording(calibration),
                f"{_ABOUT} The first column has the unit. +-: half the width of the {100 * level:g} % confidence "
                f"interval. <=: one-sided {50 + 50 * level:g} % upper limit.",
                *paragraphs(self.remarks(calibration, options)),
            ],
            "%",
        )  # fmt: skip
        blocks = [_tabular(sensor, axes) for sensor, axes in by_sensor(calibration.axes).items()]
        return "\n\n".join(["\n".join(head), *blocks]) + "\n"


def _tabular(sensor: str, axes: Mapping[str, AxisCalibration]) -> str:
    sheets = [{entry.name: entry for entry in found.datasheet.entries} for found in axes.values()]
    table = [[SENSORS.get(sensor, sensor or "Axes"), *axes]]
    table.append(["model", *(found.fit.model.structure for found in axes.values())])
    for name in in_order([list(sheet) for sheet in sheets]):
        unit = next(sheet[name].in_units("datasheet")[3] for sheet in sheets if name in sheet)
        title = name if unit == "1" else f"{name} ({unit})"
        table.append([title, *(number(sheet[name]) if name in sheet else "" for sheet in sheets)])
    lines = [" & ".join(map(latex, row)) + r" \\" for row in table]
    return "\n".join(
        [rf"\begin{{tabular}}{{l{'r' * len(axes)}}}", r"\hline", lines[0], r"\hline", *lines[1:], r"\hline",
         r"\end{tabular}"]
    )  # fmt: skip


_SIGNS = {
    "±": r"$\pm$", "≤": r"$\le$", "…": r"\,\ldots\,", "²": "$^2$", "³": "$^3$", "µ": r"$\mu$", "°": r"$^\circ$",
    "·": r"$\cdot$", "−": "$-$",
}  # fmt: skip
_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "_": r"\_", "%": r"\%", "&": r"\&", "#": r"\#", "$": r"\$",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
}  # fmt: skip


def latex(text: str) -> str:
    r"""Escape text for LaTeX.

    >>> print(latex("1.12e+03 ± 4.2 % deg/√h"), latex("T_c[1]"))
    $1.12\times10^{3}$ $\pm$ 4.2 \% deg/$\sqrt{\mathrm{h}}$ T\_c[1]
    """
    out = "".join(_SPECIAL.get(sign, _SIGNS.get(sign, sign)) for sign in text)
    out = re.sub(r"√([A-Za-z]+)", r"$\\sqrt{\\mathrm{\1}}$", out)
    return re.sub(r"(\d[\d.]*)e([+-]\d+)", lambda found: rf"${found[1]}\times10^{{{int(found[2])}}}$", out)
