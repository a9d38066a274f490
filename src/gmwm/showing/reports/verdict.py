"""Content of the verdict box of a report: a headline, the remarks, and the main results."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm.base.axis_names import by_sensor
from gmwm.base.remarks import Dialect, Remark, Severity, with_groups
from gmwm.base.text import duration_text
from gmwm.calibration.findings import certificate_of, equality_remarks, rejected_axes, unusable
from gmwm.calibration.number_verdicts import Usability
from gmwm.calibration.tables import SENSORS, in_order
from gmwm.choosing.datasheets.entry import Entry, significant

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration
    from gmwm.measuring.outliers import Verdict

State = Literal["good", "look", "bad"]
"""State of a point in the verdict box. "good": nothing to do. "look": read the remark before using the numbers. "bad":
do not use the numbers before the cause is found."""

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
    """Return the content of the verdict box: "state", "code" and "headline" of the verdict, and a list "points".

    Each point has a "state", a "code" and a "text". Remarks that affect numbers come first, then the main results. The
    headline and the texts are HTML.
    """
    head = calibration.verdict
    equality = equality_remarks(calibration)
    cautions = [r for r in calibration.remarks if r.severity is not Severity.INFO and r not in equality]
    points = [*equality, *cautions, *_results(calibration)]
    return {
        "state": state_of(head),
        "code": head.code,
        "headline": head.text(Dialect.HTML),
        "points": _points(points),
    }


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
    length = duration_text(wv.samples / wv.rate)
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
    clean = calibration.verdicts and all(_is_clean(verdict) for verdict in calibration.verdicts.values())
    if clean and not codes & _OUTLIERS:
        yield Remark.of("check-passed", case="no-outliers")
    recordings = [calibration.recording, *calibration.recordings.values()]
    if any(recordings) and all(recording.static for recording in recordings if recording) and not codes & _MOTION:
        yield Remark.of("check-passed", case="rest")
    if (certificate := certificate_of(calibration.values())) is not None:
        yield certificate


def _is_clean(verdict: Verdict) -> bool:
    return bool(np.any(verdict.tested)) and not verdict.contaminated


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
