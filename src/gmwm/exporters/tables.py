"""Tables of the numbers of a unit: CSV for spreadsheets, LaTeX for papers."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from importlib import metadata
from typing import TYPE_CHECKING

from gmwm.calibration.tables import SENSORS, in_order, number
from gmwm.exporters.base import Exporter, ExportOptions, register
from gmwm.exporters.text import commented, recording
from gmwm.signals import by_sensor

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.result import AxisCalibration

_ABOUT = "Continuous in time. Each axis by itself; no inflation, no horizon: the datasheet of the whole model."


@register
class CsvTable(Exporter):
    """One row for each number of each axis, in SI and in the unit of datasheets."""

    name = "csv"
    title = "spreadsheets (CSV)"
    extension = ".csv"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Comment lines, a header, rows."""
        level = calibration.settings.confidence
        head = commented(
            [
                f"Noise of an IMU for {self.title}. Written by gmwm {metadata.version('gmwm')}.",
                *recording(calibration),
                f"{_ABOUT} low and high: {100 * level:g} % interval; where upper_only is true the data only bound the "
                "number, by high. inf: not determined.",
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
                rows.writerow(
                    [axis, found.fit.model.structure, entry.symbol, entry.title, entry.term or "",
                     *entry.in_units("si"), str(entry.upper_only).lower(), *entry.in_units("datasheet")]
                )  # fmt: skip
        return "\n".join([*head, out.getvalue()])


@register
class LatexTable(Exporter):
    """A tabular for each sensor: a column for each axis, a row for each number."""

    name = "latex"
    title = "papers (LaTeX)"
    extension = ".tex"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Needs no package."""
        level = calibration.settings.confidence
        head = commented(
            [
                f"Noise of an IMU for {self.title}. Written by gmwm {metadata.version('gmwm')}.",
                *recording(calibration),
                f"Units of datasheets, in the first column. {_ABOUT} +-: half the {100 * level:g} % interval; "
                f"<=: upper limit at {50 + 50 * level:g} %.",
            ],
            "%",
        )  # fmt: skip
        blocks = [_tabular(sensor, axes) for sensor, axes in by_sensor(calibration.axes).items()]
        return "\n\n".join(["\n".join(head), *blocks]) + "\n"


def _tabular(sensor: str, axes: Mapping[str, AxisCalibration]) -> str:
    sheets = [found.datasheet for found in axes.values()]
    table = [[SENSORS.get(sensor, sensor or "Axes"), *axes]]
    table.append(["model", *(found.fit.model.structure for found in axes.values())])
    for symbol in in_order([list(sheet) for sheet in sheets]):
        unit = next(sheet[symbol].in_units("datasheet")[3] for sheet in sheets if symbol in sheet)
        table.append([f"{symbol} ({unit})", *(number(sheet[symbol]) if symbol in sheet else "" for sheet in sheets)])
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
    r"""A text as LaTeX takes it.

    >>> print(latex("1.12e+03 ± 4.2 % deg/√h"), latex("T_c[1]"))
    $1.12\times10^{3}$ $\pm$ 4.2 \% deg/$\sqrt{\mathrm{h}}$ T\_c[1]
    """
    out = "".join(_SPECIAL.get(sign, _SIGNS.get(sign, sign)) for sign in text)
    out = re.sub(r"√([A-Za-z]+)", r"$\\sqrt{\\mathrm{\1}}$", out)
    return re.sub(r"(\d[\d.]*)e([+-]\d+)", lambda found: rf"${found[1]}\times10^{{{int(found[2])}}}$", out)
