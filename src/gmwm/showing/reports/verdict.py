"""First screen of a report: facts on the recording, verdict, and N, K and B of each axis with their verdicts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Literal

import numpy as np

from gmwm.base.remarks import Dialect, Remark, Severity, texts, with_groups
from gmwm.base.text import duration_text, list_text
from gmwm.base.units import by_sensor
from gmwm.calibration.findings import certificate_of, equality_remarks, rejected_axes, unusable
from gmwm.calibration.number_verdicts import MAIN, NumberVerdict, Usability, Verdicts
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import AxisCalibration, Calibration
from gmwm.calibration.summary_text import extent_text, main_symbols, model_words, number_text
from gmwm.calibration.tables import SENSORS, in_order
from gmwm.choosing.datasheets.entry import Entry, significant
from gmwm.showing.plots.labels import axis_title

Facts = list[tuple[str, str]]  # pairs of name and value, in the order of the page


def recording_facts(calibration: Calibration) -> dict[str, Any]:
    """Return facts on the recording ("facts"), and for several ones a table with a column for each ("rows")."""
    axes = [("Axes", ", ".join([*calibration.axes, *calibration.failed])), ("Units", _units(calibration))]
    if calibration.recordings:
        columns = [
            dict([*_file(recording), *_length(recording.samples, recording.rate), *_conditions(recording)])
            for recording in calibration.recordings.values()
        ]
        titles = list(dict.fromkeys(title for column in columns for title in column))
        rows = [["", *calibration.recordings], *([t, *(c.get(t, "") for c in columns)] for t in titles)]
        return {"facts": axes, "rows": rows}
    recording = calibration.recording
    source = calibration.source_name
    facts: Facts = [("Source", source)] if source and (recording is None or source != recording.file) else []
    if recording is None:
        wv = next(iter(calibration.axes.values())).fit.wavelet_variance
        return {"facts": [*facts, *_length(wv.samples, wv.rate), *axes], "rows": []}
    lengths = {item.fit.wavelet_variance.samples for item in calibration.axes.values()}
    length = [("Length", extent_text(calibration))] if len(lengths) > 1 else _length(recording.samples, recording.rate)
    facts += [*_file(recording), *length, *axes, *_conditions(recording)]
    return {"facts": facts, "rows": []}


def title_of(calibration: Calibration) -> str:
    """Return the title of a report, with the name of the file."""
    recording = calibration.recording
    name = recording.file if recording is not None and recording.file else calibration.source_name
    return f"Calibration of {name}" if name else "Calibration"


def _file(recording: Recording) -> Facts:
    name = f"{recording.file}, {recording.size} bytes"
    return [("File", name), ("SHA-256", recording.sha256)] if recording.sha256 else []


def _length(samples: int, rate: float) -> Facts:
    return [("Sampling rate", f"{rate:g} Hz"), ("Length", f"{samples} samples, {duration_text(samples / rate)}")]


def _conditions(recording: Recording) -> Facts:
    """Return the facts on gaps, time stamps, motion and temperature of a recording."""
    gaps = recording.segments - 1
    lost = f"{gaps}, {duration_text(recording.missing)} missing" if recording.missing > 0 else str(gaps)
    jitter = recording.jitter
    stamps = "none" if jitter is None else f"jitter {significant(round(jitter, 9), 3)} s (root mean square)"
    rest = "yes" if recording.static else "no"
    facts: Facts = [("Gaps", lost if gaps else "none"), ("Time stamps", stamps), ("At rest", rest)]
    if recording.gravity is not None:
        facts.append(("Specific force", f"{recording.gravity:.5g} m/s²"))
    limits = recording.temperature
    temperature = "not recorded" if limits is None else f"{limits[0]:.4g} to {limits[1]:.4g} °C"
    return [*facts, ("Temperature", temperature)]


def _units(calibration: Calibration) -> str:
    units: dict[str, list[str]] = {}
    for axis, fit in calibration.items():
        units.setdefault(fit.wavelet_variance.unit or "not known", []).append(axis)
    return "; ".join(f"{unit}: {', '.join(axes)}" for unit, axes in units.items())


State = Literal["good", "look", "bad"]
"""State in the verdict box: "good", "look" (read the remark first), "bad" (do not use before a cause is found)."""

_STATES: Mapping[Severity, State] = {
    Severity.UNUSABLE: "bad",
    Severity.WRONG: "bad",
    Severity.BIASED: "look",
    Severity.UNCERTAIN: "look",
    Severity.INFO: "good",
}


_OUTLIERS = frozenset({"samples-replaced", "heavy-tails", "outliers-left-out", "outliers-found"})
_MOTION = frozenset({"recording-moved", "recording-settles"})
"""Codes of remarks on outliers and on motion. If there is one, it is the only statement about them."""


def state_of(remark: Remark) -> State:
    """Return the state that belongs to the severity of a remark."""
    return _STATES[remark.severity]


def verdict(calibration: Calibration) -> dict[str, Any]:
    """Return the verdict box: "state", "code", "headline" and "points", each of "state", "code" and "text" (HTML).
    Remarks that affect numbers come first, then the main results."""
    head = calibration.verdict
    equality = equality_remarks(calibration)
    cautions = [r for r in calibration.remarks if r.severity is not Severity.INFO and r not in equality]
    points = [*equality, *cautions, *_results(calibration)]
    return {"state": state_of(head), "code": head.code, "headline": head.text(Dialect.HTML), "points": _points(points)}


def notes(calibration: Calibration) -> list[dict[str, Any]]:
    """Return the remarks that do not affect any number, in the form of the points of `verdict`."""
    equality = equality_remarks(calibration)
    return _points([r for r in calibration.remarks if r.severity is Severity.INFO and r not in equality])


def _points(remarks: list[Remark]) -> list[dict[str, Any]]:
    return [
        {"state": state_of(group[0]), "code": group[0].code, "text": text}
        for group, text in with_groups(remarks, Dialect.HTML)
    ]


def _results(calibration: Calibration) -> Iterator[Remark]:
    """Yield remarks with the main results: axes, ranges of N, B and K, tests, and the certificate of the optimum."""
    wv = next(iter(calibration.axes.values())).fit.wavelet_variance
    total = len(calibration.axes) + len(calibration.failed)
    curves = [axis.fit.wavelet_variance for axis in calibration.axes.values()]
    lengths = [duration_text(seconds) for seconds in sorted({(wv.samples - wv.filled) / wv.rate for wv in curves})]
    length = " to ".join(dict.fromkeys((lengths[0], lengths[-1])))
    lost = unusable(calibration)
    codes = {remark.code for remark in calibration.remarks}
    if not lost:  # Otherwise the headline states the number of axes that cannot be used.
        rate = f"{wv.rate:g} Hz"
        yield Remark.of("results", case="axes", axes=len(calibration.axes), total=total, length=length, rate=rate)
    for sensor, members in by_sensor(calibration.axes).items():
        if numbers := _numbers(_usable_entries(calibration, members)):
            yield Remark.of("results", SENSORS.get(sensor, sensor or "Axes"), case="numbers", numbers=numbers)
    misfits = rejected_axes(calibration)
    for name, axis in calibration.axes.items():
        if axis.test is not None and name not in misfits:
            yield Remark.of("check-passed", name, case="model")
    # If an axis could not be tested, another remark says so.
    verdicts = calibration.verdicts.values()
    clean = verdicts and all(np.any(verdict.tested) and not verdict.contaminated for verdict in verdicts)
    if clean and not codes & _OUTLIERS:
        yield Remark.of("check-passed", case="no-outliers")
    recordings = [calibration.recording, *calibration.recordings.values()]
    if any(recordings) and all(recording.static for recording in recordings if recording) and not codes & _MOTION:
        yield Remark.of("check-passed", case="rest")
    if (certificate := certificate_of(calibration.values())) is not None:
        yield certificate


def _usable_entries(calibration: Calibration, axes: Iterable[str]) -> dict[str, dict[str, Entry]]:
    """Return the datasheet entries of some axes that can be used, also as a bound, by axis and symbol."""
    return {
        axis: {
            symbol: entry
            for symbol, entry in calibration.datasheets[axis].items()
            if calibration.number_verdicts[axis][symbol].usability is not Usability.DO_NOT_USE
        }
        for axis in axes
    }


def _numbers(sheets: Mapping[str, Mapping[str, Entry]]) -> str:
    """Format the ranges of N, B and K over the datasheets of some axes of a sensor."""
    parts = []
    for symbol in in_order([list(sheet) for sheet in sheets.values()]):
        entries = {axis: sheet[symbol] for axis, sheet in sheets.items() if symbol in sheet}
        if symbol in _FIRST:
            parts.append(f"{next(iter(entries.values())).title} {symbol} {_range(entries)}")
    return "; ".join(parts)


_FIRST = ("N", "B", "K")


def _range(entries: Mapping[str, Entry]) -> str:
    """Format the smallest and the largest value of a number, or its largest upper limit if no axis has a value."""
    values: dict[str, float] = {}
    bounds = []
    unit = ""
    for axis, entry in entries.items():
        value, _, high, unit = entry.in_units("datasheet")
        if not entry.upper_only:
            values[axis] = value
        elif high is not None and math.isfinite(high):
            bounds.append(high)
    if values:
        texts = dict.fromkeys(significant(value, 3) for value in (min(values.values()), max(values.values())))
        more = f" ({', '.join(values)}; upper limits for the other axes)" if len(values) < len(entries) else ""
        return f"{' to '.join(texts)} {unit}{more}"
    return f"at most {significant(max(bounds), 3)} {unit}" if bounds else "not determined"


SENTENCE_ENDS = re.compile(r"(?<=[.!?]) (?=[A-Z<`])")  # spaces between the sentences of a text
_STATE_OF_NUMBERS = {Usability.USE: "good", Usability.BOUND: "look", Usability.DO_NOT_USE: "bad"}
_WITHOUT_REMARK = {
    Usability.BOUND: "The recording determines only an upper limit.",
    Usability.DO_NOT_USE: "The recording does not determine it.",
}


def filter_tables(calibration: Calibration, dialect: Dialect = Dialect.HTML) -> list[dict[str, Any]]:
    """Return each sensor's table: "sensor", "title", "heads", "rows", and "reasons" of numbers with a limit. Rows have
    "axis", "title", "cells" ("text", "mark", "state"), "model" and "failed", the reason without numbers."""
    tables = []
    for sensor, members in by_sensor({**calibration.axes, **calibration.failed}).items():
        axes = {axis: calibration.axes[axis] for axis in members if axis in calibration.axes}
        symbols = main_symbols(axes)
        verdicts = {axis: calibration.number_verdicts[axis] for axis in axes}
        rows = [
            {"axis": axis, "title": axis_title(axis), "failed": "", "model": model_words(result.fit.model),
             "cells": [_cell(result, verdicts[axis].get(symbol), symbol) for symbol in symbols]}
            for axis, result in axes.items()
        ]  # fmt: skip
        rows += [
            {"axis": axis, "title": axis_title(axis), "failed": calibration.failed[axis], "model": "", "cells": []}
            for axis in members if axis in calibration.failed
        ]  # fmt: skip
        heads = [f"{symbol} ({unit})" for symbol, unit in symbols.items()] or list(MAIN)
        tables.append({
            "sensor": sensor, "title": SENSORS.get(sensor, sensor or "Axes"), "heads": heads, "rows": rows,
            "reasons": _reasons(calibration, verdicts, dialect), "bias": False,
        })  # fmt: skip
    return tables


def _cell(result: AxisCalibration, verdict: NumberVerdict | None, symbol: str) -> dict[str, str]:
    if verdict is None:
        return {"text": "", "mark": "", "state": ""}
    text = number_text(result.datasheet[symbol], verdict)
    mark = "" if verdict.usability is Usability.BOUND else verdict.usability.mark
    return {"text": text, "mark": mark, "state": _STATE_OF_NUMBERS[verdict.usability]}


def _reasons(calibration: Calibration, verdicts: Verdicts, dialect: Dialect) -> list[dict[str, Any]]:
    """Return "state", "mark", "numbers" and "text" for each reason why main numbers are limits or cannot be used."""
    limits = {remark.subject: remark for remark in calibration.remarks if remark.code == "b-limit"}
    remarks: dict[tuple[Usability, str], dict[Remark, None]] = {}
    axes: dict[tuple[Usability, str], dict[str, list[str]]] = {}
    for axis, symbol, verdict in ((a, s, of_axis[s]) for a, of_axis in verdicts.items() for s in MAIN if s in of_axis):
        if verdict.usability is Usability.USE:
            continue
        reason = verdict.reason or (limits.get(axis) if symbol == "B" else None)
        key = verdict.usability, reason.code if reason else ""
        remarks.setdefault(key, {}).update({reason: None} if reason else {})
        axes.setdefault(key, {}).setdefault(symbol, []).append(axis)
    return [
        {"state": _STATE_OF_NUMBERS[usability], "mark": usability.mark, "code": code,
         "numbers": "; ".join(f"{symbol} of {list_text(names)}" for symbol, names in axes[usability, code].items()),
         "text": _first_sentence(group, dialect) or _WITHOUT_REMARK[usability]}
        for (usability, code), group in sorted(remarks.items(), key=lambda item: item[0][0] is Usability.BOUND)
    ]  # fmt: skip


def _first_sentence(remarks: Iterable[Remark], dialect: Dialect) -> str:
    """Return the first sentence of each text on some remarks. It names their axes only if it needs them."""
    named = [r if "{subjects}" in r.message.sentence_for(r.facts) else r.about("") for r in remarks]
    return " ".join(SENTENCE_ENDS.split(text)[0] for text in texts(named, dialect))
