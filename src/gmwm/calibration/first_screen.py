"""The first screen of a calibration: one line for each axis with N, K and B, their verdicts, and the model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import accumulate
from typing import TYPE_CHECKING

from gmwm.base.axis_names import by_sensor
from gmwm.base.text import TEXT_WIDTH, counted, table_with_rule
from gmwm.calibration.misfit import is_line
from gmwm.calibration.number_verdicts import MAIN, NumberVerdict, Usability, as_limit
from gmwm.calibration.tables import SENSORS, number
from gmwm.theory.processes.ordered import Ordered

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.choosing.datasheets import Entry
    from gmwm.theory.processes import Model

LEGEND = (
    "N, K: white noise and random walk for a filter. B: bias instability. ±: half the 95 % confidence interval. "
    "✓ use, ≤ use as an upper limit, ✗ do not use."
)


def axis_lines(calibration: Calibration) -> list[str]:
    """Return a table for each sensor with one line for each axis, of at most 80 columns."""
    lines: list[str] = []
    verdicts = calibration.number_verdicts
    for sensor, axes in by_sensor(calibration.axes).items():
        lines += [*([""] if lines else []), *_table(SENSORS.get(sensor, sensor or "Axes"), axes, verdicts)]
    for axis, reason in calibration.failed.items():
        lines.append(f"{axis}  ✗ not calibrated: {reason}"[:TEXT_WIDTH])
    return lines


def model_words(model: Model) -> str:
    """Describe a model in a word: the names of its processes, "filter" for an ARMA process, and the numbers of
    oscillations and lines.

    >>> from gmwm import Model
    >>> model_words(Model.parse("2*GM + WN + ARMA(2,1)"))
    '2*GM+WN+filter'
    """
    names: Counter[str] = Counter()
    lines, oscillations = 0, 0
    for process in model.processes:
        if is_line(type(process)):
            lines += 1
        elif process.is_complete and process.oscillation() is not None:
            oscillations += 1
        else:
            names["filter" if isinstance(process, Ordered) else process.name] += 1
    parts = [name if count == 1 else f"{count}*{name}" for name, count in names.items()]
    return "+".join(
        [
            *parts,
            *([counted(oscillations, "oscillation")] if oscillations else []),
            *([counted(lines, "line")] if lines else []),
        ]
    )


def _table(
    title: str, axes: Mapping[str, AxisCalibration], verdicts: Mapping[str, Mapping[str, NumberVerdict]]
) -> list[str]:
    symbols = main_symbols(axes)
    rows = [[title, *(f"{symbol} ({unit})" for symbol, unit in symbols.items()), "model"]]
    long = max(map(len, axes)) > len("Accelerometers")
    for axis, result in axes.items():
        cells = [_cell(result, verdicts[axis].get(symbol), symbol) for symbol in symbols]
        rows.append(["" if long else axis, *cells, model_words(result.fit.model)])
    spare = TEXT_WIDTH - sum(max(len(row[k]) for row in rows) + 2 for k in range(len(symbols) + 1)) - 2
    head_row, *axis_rows = rows
    rows, counts = [head_row], []
    for row in axis_rows:
        first, *more = _broken(row[-1], spare)
        rows += [[*row[:-1], first], *([*[""] * len(row[:-1]), part] for part in more)]
        counts.append(1 + len(more))
    head, rule, *lines = table_with_rule(rows)
    if max(map(len, lines)) > TEXT_WIDTH:
        head, rule, *lines = table_with_rule([row[:-1] for row in (head_row, *axis_rows)])
        counts = [1] * len(axis_rows)
    if long:
        ends = list(accumulate(counts))
        lines = [
            line for axis, count, end in zip(axes, counts, ends, strict=True)
            for line in (f"  {axis}"[:TEXT_WIDTH], *lines[end - count : end])
        ]  # fmt: skip
    return [head, rule, *lines]


def _broken(words: str, width: int) -> list[str]:
    """Break a model between its terms into lines of a width.

    >>> _broken("2*GM+WN+RW+1 oscillation+3 lines", 12)
    ['2*GM+WN+RW+', '1 osc.+', '3 lines']
    """
    if len(words) <= width:
        return [words]
    terms = words.replace("oscillation", "osc.").replace("osc.s", "osc.").split("+")
    lines = [""]
    for k, term in enumerate(terms):
        part = term if k == len(terms) - 1 else f"{term}+"
        if lines[-1] and len(lines[-1]) + len(part) > width:
            lines.append("")
        lines[-1] += part
    return lines


def main_symbols(axes: Mapping[str, AxisCalibration]) -> dict[str, str]:
    """Return the unit of N, K and B, without the symbols that no axis has."""
    entries = {
        symbol: next((result.datasheet[symbol] for result in axes.values() if symbol in result.datasheet), None)
        for symbol in MAIN
    }
    return {symbol: entry.in_units()[3] for symbol, entry in entries.items() if entry is not None}


def number_text(entry: Entry, verdict: NumberVerdict) -> str:
    """Format a number. A value that its verdict makes an upper limit is written as one."""
    return number(as_limit(entry) if verdict.usability is Usability.BOUND else entry)


def _cell(result: AxisCalibration, verdict: NumberVerdict | None, symbol: str) -> str:
    """Return a number with the mark of its verdict, which an upper limit needs not."""
    if verdict is None:
        return ""
    text = number_text(result.datasheet[symbol], verdict)
    return text if verdict.usability is Usability.BOUND else f"{text} {verdict.usability.mark}"
