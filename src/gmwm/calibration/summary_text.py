"""Format a calibration as text: verdict, a table for each sensor, and the most severe remarks."""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.remarks import Dialect, Quantity, Severity, brief, merged, texts
from gmwm.base.template import join_names
from gmwm.base.text import TEXT_WIDTH, counted, duration_text, p_text, round_text, table_with_rule, wrap_text
from gmwm.base.units import by_sensor, sensor_of
from gmwm.calibration.additions import axis_additions
from gmwm.calibration.findings import equality_remarks
from gmwm.calibration.misfit import is_line
from gmwm.calibration.number_verdicts import MAIN, NumberVerdict, Usability, Verdicts, as_limit
from gmwm.calibration.tables import SENSORS, fitting_tables, in_order, key, marked, number, with_error
from gmwm.choosing.replicates.result import RecordingNumber, short_spread
from gmwm.choosing.selection.ranking import search_lines
from gmwm.theory.processes.ordered import Ordered

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration
    from gmwm.choosing.datasheets import Datasheet, Entry
    from gmwm.theory.processes import Model


def axis_lines(calibration: Calibration) -> list[str]:
    """Return a table for each sensor with one line for each axis, of at most 80 columns."""
    lines: list[str] = []
    verdicts = calibration.number_verdicts
    for sensor, axes in by_sensor(calibration.axes).items():
        lines += [*([""] if lines else []), *_axes_table(sensor.capitalize() or "Axes", axes, verdicts)]
    for axis, reason in calibration.failed.items():
        start = f"{axis}  ✗ not calibrated: "
        lines.append(start + textwrap.shorten(reason, TEXT_WIDTH - len(start), placeholder=" …"))
    return lines


def model_words(model: Model) -> str:
    """Describe a model by its processes, "filter" for ARMA, and numbers of oscillations and lines.

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
    parts += [counted(oscillations, "oscillation")] if oscillations else []
    parts += [counted(lines, "line")] if lines else []
    return "+".join(parts)


def _axes_table(title: str, axes: Mapping[str, AxisCalibration], verdicts: Verdicts) -> list[str]:
    symbols = main_symbols(axes)
    head = [title, *(f"{symbol} ({unit})" for symbol, unit in symbols.items())]
    long = max(map(len, axes)) > len("accel_x") + 7
    rows = [head]
    for axis, result in axes.items():
        cells = [_cell(result, verdicts[axis].get(symbol), symbol) for symbol in symbols]
        rows.append(["" if long else axis, *cells])
    spare = TEXT_WIDTH - sum(max(len(row[k]) for row in rows) + 2 for k in range(len(head))) - 2
    if spare >= len("99 terms"):
        words = ["model", *_fitting_words([result.fit.model for result in axes.values()], spare)]
        rows = [[*row, word] for row, word in zip(rows, words, strict=True)]
    head_line, rule, *lines = table_with_rule(rows)
    if long:
        lines = [part for axis, line in zip(axes, lines, strict=True) for part in (f"  {axis}"[:TEXT_WIDTH], line)]
    return [head_line, rule, *lines]


def _fitting_words(models: Sequence[Model], width: int) -> list[str]:
    """Describe models by `model_words`, in a small width by their notation, or else by their first terms."""
    words = [model_words(model) for model in models]
    short = [word.replace("oscillation", "osc.").replace("osc.s", "osc.") for word in words]
    for forms in (words, short):
        if max(map(len, forms)) <= width:
            return forms
    return [_notation(model, width) for model in models]


def _notation(model: Model, width: int) -> str:
    names = Counter(process.name.partition("(")[0] for process in model.processes)
    parts = [name if count == 1 else f"{count}*{name}" for name, count in names.items()]
    terms_after = [*list(accumulate(reversed(names.values())))[::-1], 0]
    for k in range(len(parts), 0, -1):
        text = "+".join([*parts[:k], *([f"{terms_after[k]} more"] if terms_after[k] else [])])
        if len(text) <= width:
            return text
    return f"{terms_after[0]} terms"


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


REST: Mapping[Dialect, str] = {
    Dialect.PYTHON: "calibration.remarks", Dialect.SHELL: "report.html (or --all-remarks)", Dialect.HTML: "",
}  # fmt: skip
"""Where users find the remarks that the summary does not show."""

MOST_LINES = 10  # largest number of lines that a table shows. A choice: the weakest of more lines hardly matter
SPREAD_OF = ("N", "B", "K")  # symbols of the numbers whose spread between recordings the table shows
_FIRST = "[1]"
_BIAS, _MEAN = "b", "mean"
_REST = {_BIAS: "bias", "b_on": "turn-on", "b_rms": "bias rms"}


def summary(
    calibration: Calibration, dialect: Dialect = Dialect.PYTHON, *, every: bool = False, details: bool = False
) -> str:
    """Return a calibration as text of at most 80 columns; `Calibration.summary` describes the parameters."""
    equality, shell = equality_remarks(calibration), dialect is Dialect.SHELL
    parts = [wrap_text(calibration.verdict.text(dialect)), _head(calibration)]
    parts += [wrap_text(text) for text in texts(equality, dialect, codes=True)]
    parts += _details(calibration) if details else [axis_lines(calibration), wrap_text(short_legend(calibration))]
    remarks_shown = [remark for remark in calibration.remarks if remark not in equality]
    notes = [] if every or details else [remark for remark in remarks_shown if remark.severity is Severity.INFO]
    remarks_shown = [remark for remark in remarks_shown if remark not in notes]
    remarks = texts(remarks_shown, dialect, codes=True) if every else brief(remarks_shown, dialect, rest=REST[dialect])
    if notes:
        kind = "further note" if remarks else "note"
        remarks.append(f"{counted(len(merged(notes)), kind)}: {REST[dialect]}")
    if len(remarks) == 1 and notes:
        parts.append(remarks)
    elif remarks:
        head = f"What to know before using the numbers{' (gmwm explain CODE says more)' if shell else ''}:"
        parts.append([head, *(line for text in remarks for line in wrap_text(text, "- "))])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _details(calibration: Calibration) -> list[list[str]]:
    """Return the tables with all numbers of each axis, the reasons for the models, and the results of additions."""
    parts = [
        [SENSORS.get(sensor, sensor or "Axes"), *_tables(axes, calibration.number_verdicts)]
        for sensor, axes in by_sensor(calibration.axes).items()
    ]
    parts.append(wrap_text(legend(calibration)))
    parts += [
        [f"Why this model of {axis}?", *search_lines(result.search, TEXT_WIDTH)]
        for axis, result in calibration.axes.items() if result.search
    ]  # fmt: skip
    return [*parts, *(wrap_text(a.summary(calibration.addition(a.name))) for a in axis_additions())]


def _head(calibration: Calibration) -> list[str]:
    count = len(calibration.recordings)
    several = f"{count} recordings: " if count else ""
    lines = [f"Calibration{' of ' + several + calibration.source if calibration.source else ''}"]
    settings = calibration.settings
    searched = "searched for the model" if settings.searched else f"best model within {settings.within}"
    if settings.models:
        searched += f"; models given for {', '.join(settings.models)}"
    lines.append(f"{extent_text(calibration)}; {searched}")
    return [line for text in lines for line in wrap_text(text)]


def extent_text(calibration: Calibration) -> str:
    """Return the samples, rate and length of a calibration, as ranges over its axes, and the warm-up left out."""
    # On some axes, knocks are replaced too. The axis with the fewest filled samples shows how many were recorded.
    curves = sorted((r.fit.wavelet_variance for r in calibration.axes.values()), key=lambda wv: -wv.filled)
    shapes = {(wv.samples, wv.rate): (wv.samples - wv.filled, wv.filled, wv.rate) for wv in curves}.values()
    samples = _range([str(n) for n, _, _ in sorted(shapes)])
    most = max(filled for _, filled, _ in shapes)
    rate = _range([f"{rate:g}" for rate in sorted(rate for _, _, rate in shapes)])
    duration = _range([duration_text(seconds) for seconds in sorted(n / rate for n, _, rate in shapes)])
    omitted = [r for r in calibration.recording_remarks if r.facts.get("case") == "omitted"]
    firsts = {first.value for r in omitted if isinstance(first := r.facts["first"], Quantity)}
    part = f" on {len(omitted)} of {len(calibration.axes)} axes" if len(shapes) > 1 else ""
    cut = f", without the first {_range([duration_text(t) for t in sorted(firsts)])}{part} (settling)" if firsts else ""
    filled = f" and {most} filled ones" if most else ""
    return f"{samples} samples{filled} at {rate} Hz, {duration}{cut}"


def _range(ascending: Sequence[str]) -> str:
    """Format sorted texts as a range from the first to the last; a single text if both are equal."""
    first, last = ascending[0], ascending[-1]
    return first if first == last else f"{first} to {last}"


def _tables(axes: Mapping[str, AxisCalibration], verdicts: Verdicts) -> list[str]:
    """Return tables with a row for each number and a column for each axis, up to three if they fit."""
    return fitting_tables(list(axes), lambda names, _: rows_of({name: axes[name] for name in names}, verdicts), 3)


def rows_of(axes: Mapping[str, AxisCalibration], verdicts: Verdicts) -> list[list[str]]:
    """Return rows for axes: model, goodness of fit, outliers, then each number in datasheet units, ✗ if unusable."""
    calibrations = list(axes.values())
    rows = [
        ["", *axes],
        ["model", *(item.fit.model.structure.replace(" ", "") for item in calibrations)],
        ["equivalent", *(_others(item) for item in calibrations)],
        ["p of the fit", *("no test" if item.test is None else item.test.pvalue_in_words for item in calibrations)],
        ["outliers", *(outliers_word(item) for item in calibrations)],
    ]
    # If one axis has several Gauss-Markov terms, the only such term of another axis is in the row of the first term.
    several = {symbol for item in calibrations for symbol in item.datasheet if symbol.endswith(_FIRST)}
    columns = [
        {f"{symbol}{_FIRST}" if f"{symbol}{_FIRST}" in several else symbol: entry for symbol, entry in shown.items()}
        for shown in (_entries_of(item) for item in calibrations)
    ]
    for symbol in in_order([list(column) for column in columns]):
        entries = [column.get(symbol) for column in columns]
        unit = next(entry.in_units("datasheet")[3] for entry in entries if entry is not None)
        title = symbol if unit == "1" else f"{symbol} ({unit})"
        cells = zip(axes, entries, strict=True)
        rows.append([title, *("" if e is None else marked(e, verdicts[axis].get(e.symbol)) for axis, e in cells)])
    rows += _at_rest(calibrations)
    rows += _spreads(calibrations)
    return [*rows, *_line_rows(calibrations)]


def _line_rows(calibrations: Sequence[AxisCalibration]) -> list[list[str]]:
    """Return amplitudes of lines and rms of oscillations by frequency, the strongest first, and the number left out."""
    columns = [lines_of(item.datasheet) for item in calibrations]
    strongest: dict[str, float] = {}
    for column in columns:
        for name, entry in column.items():
            strongest[name] = max(strongest.get(name, 0.0), entry.value)
    names = sorted(strongest, key=lambda name: -strongest[name])
    rows = []
    for name in names[:MOST_LINES]:
        unit = next(column[name].in_units()[3] for column in columns if name in column)
        rows.append([f"{name} ({unit})", *(number(column[name]) if name in column else "" for column in columns)])
    if names[MOST_LINES:]:
        rows.append(["weaker lines", *(str(len(set(names[MOST_LINES:]) & set(column))) for column in columns)])
    return rows


def _at_rest(calibrations: Sequence[AxisCalibration]) -> list[list[str]]:
    """Return the rows with the bias at rest, its spread between recordings, and its rms over a duration."""
    columns = [
        {} if item.rest is None else {entry.symbol: entry for entry in item.rest.entries} for item in calibrations
    ]
    rows = []
    for symbol, title in _REST.items():
        entries = [column.get(symbol) for column in columns]
        shown = [entry for entry in entries if entry is not None]
        if shown:
            cells = ["" if e is None else with_error(e) if symbol == _BIAS else number(e) for e in entries]
            if symbol == _BIAS:
                cells = ["tilt unknown" if _MEAN in c and not cell else cell
                         for c, cell in zip(columns, cells, strict=True)]  # fmt: skip
            rows.append([f"{title} ({shown[0].in_units()[3]})", *cells])
    return rows


def _spreads(calibrations: Sequence[AxisCalibration]) -> list[list[str]]:
    """Return the spread of N, B and K between recordings, and the p-value of equality; no rows for one recording."""
    if all(item.replicates is None for item in calibrations):
        return []
    rows = []
    for symbol in SPREAD_OF:
        numbers = [_number_of(item, symbol) for item in calibrations]
        if any(number is not None and number.spread is not None for number in numbers):
            rows.append([f"{symbol} spread", *("" if n is None else short_spread(n) for n in numbers)])
    tests = ["" if item.replicates is None else p_text(item.replicates.pvalue) for item in calibrations]
    return [*rows, ["p of equality", *tests]]


def _number_of(calibration: AxisCalibration, symbol: str) -> RecordingNumber | None:
    numbers = () if calibration.replicates is None else calibration.replicates.numbers
    return next((number for number in numbers if number.symbol == symbol), None)


def lines_of(sheet: Datasheet) -> dict[str, Entry]:
    """Return the amplitudes of lines and the rms of oscillations, named by frequency, such as "line 0.564 Hz"."""
    kinds = {"A": "line", "rms": "oscillation"}
    lines = [
        (kinds[kind], entry.frequency, entry) for entry in reversed(sheet.entries)
        if entry.frequency is not None and (kind := entry.symbol.partition("[")[0]) in kinds
    ]  # fmt: skip
    names: list[str] = []
    for digits in range(3, 9):  # more digits only if two lines are close
        names = [f"{kind} {round_text(frequency, digits)} Hz" for kind, frequency, _ in lines]
        if len(set(names)) == len(names):
            break
    return {name: entry for name, (_, _, entry) in zip(names, lines, strict=True)}


def _entries_of(calibration: AxisCalibration) -> dict[str, Entry]:
    """Return the entries to show by symbol, without lines."""
    return {symbol: entry for symbol, entry in calibration.datasheet.items() if entry.frequency is None}


def _others(calibration: AxisCalibration) -> str:
    others = len(calibration.ranking.equivalent) - 1
    return "none" if others < 1 else counted(others, "model")


def outliers_word(calibration: AxisCalibration) -> str:
    """Return in a word what a test for outliers found on an axis, and what was done with them."""
    if calibration.verdict is None or not np.any(calibration.verdict.tested):
        return "not tested"
    if not calibration.verdict.contaminated:
        return "replaced" if calibration.verdict.replaced.knocks or calibration.verdict.replaced.spikes else "none"
    return "yes: left out" if calibration.fit.wavelet_variance.robust else "yes: kept"


def short_legend(calibration: Calibration) -> str:
    """Return the explanation of the tables of N, K and B, with the time up to which N and K hold."""
    times: dict[str, list[float]] = {}
    for remark in calibration.remarks:
        time = remark.facts.get("time")
        if remark.code == "walk-or-markov" and remark.facts["case"] == "claim" and isinstance(time, Quantity):
            times.setdefault(sensor_of(remark.subject), []).append(time.value)
    lengths = {name: duration_text(min(each)) for name, each in times.items()}
    ends = [f"{length} ({SENSORS.get(name, name).lower()})" for name, length in lengths.items()]
    if len(lengths) > 1 and len(same := set(lengths.values())) == 1:
        ends = [*same]
    predictions = f", for predictions up to {join_names(ends)}".replace(" ()", "") if ends else ""
    return (
        f"N, K: white noise and random walk of the axis for a filter{predictions}. B: bias instability. ±, +a/−b, "
        f"a … b: {100 * calibration.settings.confidence:g} % interval. ✓ use, ≤ use as an upper limit, ✗ do not use."
    )


def legend(calibration: Calibration) -> str:
    """Return the explanation of the symbols and words in the tables with all numbers."""
    named = key(entry for item in calibration.axes.values() for entry in _entries_of(item).values())
    level = calibration.settings.confidence
    names = {name.partition(" ")[0] for item in calibration.axes.values() for name in lines_of(item.datasheet)}
    lines = "".join(
        f" {name}: {what} at this frequency." for name, what in (("line", "amplitude"), ("oscillation", "rms"))
        if name in names
    )  # fmt: skip
    refused = any(verdict.refused for of_axis in calibration.number_verdicts.values() for verdict in of_axis.values())
    refusal = " ✗: do not use." if refused else ""
    biases = [bias for bias in calibration.rest.values() if bias.bias is not None]
    if biases:
        times = [duration_text(seconds) for seconds in sorted({bias.duration for bias in biases})]
        lines += (
            " bias: mean at rest, without gravity but with the Earth's rotation (at most 15 deg/h); ± includes slow "
            f"noise. bias rms: its changes over {_range(times)}."
        )
    if any(bias.bias is None for bias in calibration.rest.values()):
        lines += " tilt unknown: tell calibrate how level the unit stood (options tilt and gravity)."
    if any(bias.turn_on is not None for bias in biases):
        lines += " turn-on: standard deviation of the bias between recordings."
    if any(item.replicates for item in calibration.axes.values()):
        lines += (
            " spread: standard deviation between recordings without estimation errors; intervals include it. p of "
            "equality: p-value of the test that the recordings are equal."
        )
    return (
        f"{named}. ±, +a/−b, a … b: {100 * level:g} % interval. ≤: upper limit at {50 + 50 * level:g} %.{refusal} "
        "equivalent: number of other models that the data do not distinguish from the best; the simplest one is "
        f"recommended. p: p-value of the goodness-of-fit test.{_filter_note(calibration)}{lines}"
    )


def _filter_note(calibration: Calibration) -> str:
    """Return an explanation of AR, MA and ARMA terms that the search has added; "" if there are none."""
    names = {
        process.name.partition("(")[0]
        for item in calibration.axes.values() for process in item.fit.model.processes
        if isinstance(process, Ordered) and item.tried
    }  # fmt: skip
    return f" {', '.join(sorted(names))}: white noise behind the filter and resonances of the sensor." if names else ""
