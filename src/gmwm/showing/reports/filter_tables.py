"""The first table of a report: N, K and B of each axis with their verdicts, and the reason of each verdict."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from gmwm.base.axis_names import by_sensor
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import list_text
from gmwm.calibration.number_verdicts import MAIN, NumberVerdict, Usability
from gmwm.calibration.summary_text import main_symbols, model_words, number_text
from gmwm.calibration.tables import SENSORS
from gmwm.showing.plots.labels import axis_title

if TYPE_CHECKING:
    from gmwm.calibration.result import AxisCalibration, Calibration

SENTENCE_ENDS = re.compile(r"(?<=[.!?]) (?=[A-Z<`])")
"""Spaces between the sentences of a text."""
_STATES = {Usability.USE: "good", Usability.BOUND: "look", Usability.DO_NOT_USE: "bad"}
_WITHOUT_REMARK = {
    Usability.BOUND: "The recording determines only an upper limit.",
    Usability.DO_NOT_USE: "The recording does not determine it.",
}


def filter_tables(calibration: Calibration, dialect: Dialect = Dialect.HTML) -> list[dict[str, Any]]:
    """Return a table for each sensor: "sensor", "title", "heads", "rows", and "reasons" of numbers that have a limit.

    A row has "axis", "title", "cells", "model" and "failed", which is the reason if the axis was not calibrated. A cell
    has "text", "mark" and "state". The reasons are sentences in the form of the dialect.
    """
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
    return {"text": text, "mark": mark, "state": _STATES[verdict.usability]}


def _reasons(
    calibration: Calibration, verdicts: Mapping[str, Mapping[str, NumberVerdict]], dialect: Dialect
) -> list[dict[str, Any]]:
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
        {"state": _STATES[usability], "mark": usability.mark, "code": code,
         "numbers": "; ".join(f"{symbol} of {list_text(names)}" for symbol, names in axes[usability, code].items()),
         "text": _first_sentence(group, dialect) or _WITHOUT_REMARK[usability]}
        for (usability, code), group in sorted(remarks.items(), key=lambda item: item[0][0] is Usability.BOUND)
    ]  # fmt: skip


def _first_sentence(remarks: Iterable[Remark], dialect: Dialect) -> str:
    """Return the first sentence of the text on some remarks. It names their axes only if it needs them."""
    named = [r if "{subjects}" in r.message.sentence_for(r.facts) else r.about("") for r in remarks]
    return " ".join(SENTENCE_ENDS.split(text)[0] for text in texts(named, dialect)[:1])
