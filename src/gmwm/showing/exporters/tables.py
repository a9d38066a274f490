"""Exports of the noise parameters of a unit as tables: CSV for spreadsheets, LaTeX for papers, and JSON."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from typing import Any

from gmwm.base.documents import indented_json, plain
from gmwm.base.errors import DataError
from gmwm.base.text import version
from gmwm.base.units import SI_UNIT, by_sensor, find_unit, noise_unit
from gmwm.calibration import Calibration
from gmwm.calibration.number_verdicts import Verdicts
from gmwm.calibration.result import AxisCalibration
from gmwm.calibration.tables import SENSORS, in_order, marked
from gmwm.choosing.datasheets import Entry
from gmwm.choosing.datasheets.effective import Use
from gmwm.showing.exporters.base import Exporter, ExportOptions, register, top
from gmwm.showing.exporters.reduction import axis_noise
from gmwm.showing.exporters.statespace import axis_matrices, has_matrices
from gmwm.showing.exporters.text import checksums, commented, paragraphs, recording

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
                "high: taken from the spectrum. use: the verdict.",
                *paragraphs(self.remarks(calibration, options)),
            ],
            "#",
        )  # fmt: skip
        out = io.StringIO()
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(
            ["axis", "model", "symbol", "title", "term", "value", "low", "high", "unit", "upper_only",
             "datasheet_value", "datasheet_low", "datasheet_high", "datasheet_unit", "use"]
        )  # fmt: skip
        verdicts = calibration.number_verdicts
        for axis, found in calibration.axes.items():
            for entry in found.datasheet.entries:
                si, datasheet = (
                    [value, "", "", unit] if entry.held else [value, low, high, unit]
                    for value, low, high, unit in map(entry.in_units, ("si", "datasheet"))
                )
                rows.writerow(
                    [*map(_text, (axis, found.fit.model.structure, entry.symbol, _title(entry), entry.term or "")),
                     *si, str(entry.upper_only).lower(), *datasheet, verdicts[axis][entry.symbol].usability.value]
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
        verdicts = calibration.number_verdicts
        blocks = [_tabular(sensor, axes, verdicts) for sensor, axes in by_sensor(calibration.axes).items()]
        return "\n\n".join(["\n".join(head), *blocks]) + "\n"


def _tabular(sensor: str, axes: Mapping[str, AxisCalibration], verdicts: Verdicts) -> str:
    sheets = {axis: {entry.name: entry for entry in found.datasheet.entries} for axis, found in axes.items()}
    table = [[SENSORS.get(sensor, sensor or "Axes"), *axes]]
    table.append(["model", *(found.fit.model.structure for found in axes.values())])
    for name in in_order([list(sheet) for sheet in sheets.values()]):
        entries = {axis: sheet.get(name) for axis, sheet in sheets.items()}
        unit = next(entry.in_units("datasheet")[3] for entry in entries.values() if entry is not None)
        title = name if unit == "1" else f"{name} ({unit})"
        table.append([title, *("" if e is None else marked(e, verdicts[a].get(e.symbol)) for a, e in entries.items())])
    lines = [" & ".join(map(latex, row)) + r" \\" for row in table]
    return "\n".join(
        [rf"\begin{{tabular}}{{l{'r' * len(axes)}}}", r"\hline", lines[0], r"\hline", *lines[1:], r"\hline",
         r"\end{tabular}"]
    )  # fmt: skip


_SIGNS = {
    "±": r"$\pm$", "≤": r"$\le$", "…": r"\,\ldots\,", "²": "$^2$", "³": "$^3$", "µ": r"$\mu$", "°": r"$^\circ$",
    "·": r"$\cdot$", "−": "$-$", "✗": "(do not use)",
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


FORMAT = "gmwm-numbers"


@register
class JsonNumbers(Exporter):
    """JSON with the noise parameters for other programs; calibration.json has the complete calibration."""

    name = "json"
    title = "other programs (JSON)"
    extension = ".json"
    takes = frozenset({"horizon", "duration"})

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the JSON document."""
        content = {
            "format": FORMAT,
            "version": 1,
            "gmwm": version(),
            "source": calibration.source_name,
            "sha256": checksums(calibration),
            "about": "SI units. Continuous time, except the parameters (per sample, beta in 1/s) and the matrices F, "
            "Q, H, R, P0 (steps of one sample). Each axis by itself, without inflation. filter: N and K for the "
            "horizon; if upper_limit is true, the number is an upper limit. matrices.two_states: white noise and the "
            "two Gauss-Markov states that are nearest to the Allan deviation from the horizon to the duration; error "
            "is the largest relative difference, error_of_one that of one state, error_of_walk that of N and K.",
            "horizon": options.horizon,
            "confidence": calibration.settings.confidence,
            "use": calibration.number_verdicts,
            "axes": {axis: _axis(axis, calibration, options) for axis in calibration},
            "failed": dict(calibration.failed),
            "remarks": [remark.to_dict() for remark in self.remarks(calibration, options)],
        }
        return indented_json(plain(content)) + "\n"


def _axis(axis: str, calibration: Calibration, options: ExportOptions) -> dict[str, Any]:
    axis_calibration = calibration.axes[axis]
    fit, wv = axis_calibration.fit, axis_calibration.fit.wavelet_variance
    units = fit.model.units(wv.unit or "u")
    return {
        "model": fit.model.structure,
        "rate": wv.rate,
        "samples": wv.samples,
        "unit": wv.unit,
        "parameters": {
            name: {"value": value, "interval": axis_calibration.intervals.get(name), "unit": units[name]}
            for name, value in fit.parameters.items()
        },
        "datasheet": [entry.to_dict() for entry in axis_calibration.datasheet.entries],
        "bias": None if axis_calibration.rest is None else axis_calibration.rest.to_dict(),
        "filter": _filter(axis, calibration, options),
        "matrices": axis_matrices(axis, calibration, options) if has_matrices(fit.model, wv.rate) else None,
    }


def _filter(axis: str, calibration: Calibration, options: ExportOptions) -> dict[str, Any] | None:
    """Return N and K of an axis with their units, or the reason why they do not exist."""
    fit = calibration[axis]
    unit = find_unit(fit.wavelet_variance.unit)
    if unit is None:
        return {"none_because": "the unit of the signal is unknown"}
    try:
        use, level = Use(options.horizon), calibration.settings.confidence
        noise = axis_noise(axis, calibration.axes[axis], quantity=unit.quantity, use=use, level=level)
    except DataError as error:
        return {"none_because": str(error)}
    return {
        symbol: {
            "value": number.value, "upper_limit": number.upper, "unit": noise_unit(power, SI_UNIT[unit.quantity])[0],
        }
        for symbol, number, power in (("N", noise.N, 0.5), ("K", noise.K, -0.5))
    }  # fmt: skip
