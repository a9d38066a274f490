"""Summaries of the estimated processes (tracks) for the output of `gmwm track`, as JSON and as tables."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.base.text import counted

if TYPE_CHECKING:
    from gmwm.cli.model_source import AxisModel
    from gmwm.fitting.likelihood import Tracks

NUMBERS = ("mean", "rms_about_mean", "rms_error", "first", "first_reach", "last", "last_reach")
"""Names of the numbers that summarize a process, in the unit of the data. A reach is half the width of the confidence
band."""


def as_dict(model: AxisModel, found: Tracks, level: float) -> dict[str, Any]:
    """Return a summary of the tracks of an axis and their model, as plain values for JSON. The complete tracks are
    written by --output."""
    return {
        **model.to_dict(), "kind": found.kind, "rate": found.rate, "unit": found.unit, "samples": len(found),
        "missing": _missing(found), "first_time": float(found.times[0]), "last_time": float(found.times[-1]),
        "tracks": {label: _brief(found, label, level) for label in found.labels},
    }  # fmt: skip


def _missing(found: Tracks) -> int:
    return 0 if found.kind == "predict" else int(np.count_nonzero(np.isnan(found.data)))


def _brief(found: Tracks, label: str, level: float) -> dict[str, float | None]:
    """Return the numbers of `NUMBERS` for a track; None for a number that is unknown. They are its mean, its root mean
    square about the mean, the root mean square of its standard deviation, and its first and last values with half the
    width of their confidence bands."""
    path, error = found.mean[label], found.error[label]
    finite = np.isfinite(error)
    low, _ = found.band(label, level)
    numbers: dict[str, float] = {}
    for end, at in (("first", 0), ("last", -1)):
        if finite[at]:
            numbers |= {end: float(path[at]), f"{end}_reach": float(path[at] - low[at])}
    if np.any(finite):
        mean, rms = float(np.mean(path[finite])), float(np.std(path[finite]))
        numbers |= {"mean": mean, "rms_about_mean": rms, "rms_error": math.sqrt(np.mean(np.square(error[finite])))}
    return {name: numbers.get(name) for name in NUMBERS}


def tracks_text(name: str, model: AxisModel, found: Tracks, level: float, datasheet: bool) -> str:
    """Format the summary of each process of an axis as a table."""
    from gmwm.cli.output import table_text
    from gmwm.showing.plots.view import view_of

    shown = view_of(found.unit, "allan", "datasheet" if datasheet else "si")
    rows = [_row(label, _brief(found, label, level), found.kind == "predict", shown.factor) for label in found.labels]
    duration = f"{len(found) / found.rate:g} s"
    missing = f", {counted(_missing(found), 'sample')} missing" if _missing(found) else ""
    description = {
        "smooth": f"smoothed over {counted(len(found), 'sample')}, {duration}{missing}",
        "filter": f"filtered over {counted(len(found), 'sample')}, {duration}{missing}",
        "predict": f"predicted for the {duration} after the recording",
    }
    head = f"{name}: {model.values.structure}, values {model.origin}\n{description[found.kind]}, in {shown.unit}"
    reach = f"± {100 * level:g} %"
    middle = ["first", reach] if found.kind == "predict" else ["mean", "rms about mean", "rms error"]
    return f"{head}\n{table_text(['process', *middle, 'last', reach], rows)}"


def _row(label: str, brief: Mapping[str, float | None], ahead: bool, factor: float) -> list[str]:
    """Format the table row of a process. For a prediction (`ahead`), the row has the first and last value; otherwise
    the mean, deviation, error and last value."""

    def number(key: str) -> str:
        value = brief.get(key)
        if value is None:
            return "unknown"
        # The deviation of a constant process consists of rounding errors only.
        if value <= 1e-9 * (brief["rms_error"] or 0.0):
            return "0"
        return f"{factor * value:.{'3g' if factor * value >= 0.01 else '2e'}}"

    def value_text(key: str, by: str) -> str:
        value, error = brief.get(key), brief.get(by)
        if value is None or error is None:
            return "unknown"
        # If the standard error is zero, the deviation determines the number of digits.
        least = 1e-4 * (brief.get("rms_about_mean") or 0.0)
        return _rounded_to_error(factor * value, factor * max(error, least))

    last = [value_text("last", "last_reach"), number("last_reach")]
    if ahead:
        return [label, value_text("first", "first_reach"), number("first_reach"), *last]
    return [label, value_text("mean", "rms_error"), number("rms_about_mean"), number("rms_error"), *last]


def _rounded_to_error(value: float, error: float) -> str:
    """Format a value with the digits that are significant given its error.

    >>> _rounded_to_error(9.80665123456, 2e-4), _rounded_to_error(-7e-21, 1e-3), _rounded_to_error(1.23456e-4, 1e-4)
    ('9.806651', '0', '1.23e-04')
    """
    if not error:
        return f"{value or 0.0:.3g}"
    # At most six digits, if the error is tiny.
    digits = math.floor(math.log10(abs(value))) if value else 0
    places = min(2 - math.floor(math.log10(error)), 6 - digits)
    value = round(value, places)
    if not value:
        return "0"
    if abs(value) >= 0.01:
        return f"{value:.{max(places, 0)}f}"
    return f"{value:.{max(math.floor(math.log10(abs(value))) + places, 0)}e}"
