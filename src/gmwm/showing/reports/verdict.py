"""Content of the verdict box of a report: a headline, the remarks, and the main results."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm.base.axis_names import by_sensor
from gmwm.base.remarks import Dialect, Remark, Severity, with_groups
from gmwm.base.text import duration_text
from gmwm.calibration.findings import equality_remarks, rejected_axes, unusable
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
    cautions = [one for one in calibration.remarks if one.severity is not Severity.INFO and one not in equality]
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
    return _points([one for one in calibration.remarks if one.severity is Severity.INFO and one not in equality])


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
    if not lost:  # Otherwise the headline states the number of axes that cannot be used.
        rate = f"{wv.rate:g} Hz"
        yield Remark.of("axes-calibrated", axes=len(calibration.axes), total=total, length=length, rate=rate)
    for sensor, members in by_sensor(calibration.axes).items():
        if numbers := _numbers({axis: one for axis, one in members.items() if axis not in lost}):
            yield Remark.of("numbers-found", SENSORS.get(sensor, sensor or "Axes"), numbers=numbers)
    passed = [
        axis for axis, one in calibration.axes.items() if one.test is not None and axis not in rejected_axes(calibration)
    ]
    for axis in passed:
        yield Remark.of("test-passed", axis)
    # If an axis could not be tested, another remark says so.
    if calibration.verdicts and all(_is_clean(found) for found in calibration.verdicts.values()):
        yield Remark.of("no-outliers")
    recordings = [calibration.recording, *calibration.recordings.values()]
    if any(recordings) and all(one.static for one in recordings if one is not None):
        yield Remark.of("at-rest")
    gaps = [found.fit.gap for found in calibration.axes.values()]
    certified = [gap for gap in gaps if gap is not None]
    if len(certified) == len(gaps):
        yield Remark.of("optimal", gap=100 * max(certified), exact="no" if max(certified) > 0 else "yes")


def _is_clean(verdict: Verdict) -> bool:
    return bool(np.any(verdict.tested)) and not verdict.contaminated


def _numbers(axes: Mapping[str, Any]) -> str:
    """Format the ranges of N, B and K over the given axes of a sensor."""
    parts = []
    for symbol in in_order([list(one.datasheet) for one in axes.values()]):
        entries = {axis: one.datasheet[symbol] for axis, one in axes.items() if symbol in one.datasheet}
        if symbol in _FIRST:
            parts.append(f"{next(iter(entries.values())).title} {symbol} {_range(entries)}")
    return "; ".join(parts)


_FIRST = ("N", "B", "K")


def _range(entries: Mapping[str, Entry]) -> str:
    """Format the smallest and the largest value of a number, or its largest upper limit if no axis has a value."""
    known: dict[str, float] = {}
    bounds = []
    unit = ""
    for axis, entry in entries.items():
        value, _, high, unit = entry.in_units("datasheet")
        if not entry.upper_only:
            known[axis] = value
        elif high is not None and math.isfinite(high):
            bounds.append(high)
    if known:
        texts = dict.fromkeys(significant(value, 3) for value in (min(known.values()), max(known.values())))
        more = f" ({', '.join(known)}; upper limits for the other axes)" if len(known) < len(entries) else ""
        return f"{' to '.join(texts)} {unit}{more}"
    return f"at most {significant(max(bounds), 3)} {unit}" if bounds else "not determined"
