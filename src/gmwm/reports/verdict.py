"""The verdict on a calibration: a headline, what was found, and the remarks, each with its state."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

from gmwm._text import duration_text
from gmwm.calibration.findings import rejected, unusable
from gmwm.calibration.tables import SENSORS, in_order
from gmwm.datasheets.entry import Entry, significant
from gmwm.remarks import Dialect, Remark, Severity, with_groups
from gmwm.signals import by_sensor

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

State = Literal["good", "look", "bad"]
"""Nothing to do; read the remark; do not use before the cause is found."""

_STATES: Mapping[Severity, State] = {
    Severity.UNUSABLE: "bad",
    Severity.WRONG: "bad",
    Severity.BIASED: "look",
    Severity.UNCERTAIN: "look",
    Severity.INFO: "good",
}


def verdict(calibration: Calibration) -> dict[str, Any]:
    """Return `{"state": …, "headline": …, "points": [{"state": …, "code": …, "text": …}, …]}`; texts are HTML."""
    head = calibration.verdict
    cautions = [remark for remark in calibration.remarks if remark.severity is not Severity.INFO]
    points = [*cautions, *_found(calibration)]
    return {"state": _STATES[head.severity], "headline": head.text(Dialect.HTML), "points": _points(points)}


def notes(calibration: Calibration) -> list[dict[str, Any]]:
    """Remarks that affect no number, as points."""
    return _points([remark for remark in calibration.remarks if remark.severity is Severity.INFO])


def _points(remarks: list[Remark]) -> list[dict[str, Any]]:
    return [
        {"state": _STATES[group[0].severity], "code": group[0].code, "text": text}
        for group, text in with_groups(remarks, Dialect.HTML)
    ]


def _found(calibration: Calibration) -> Iterator[Remark]:
    """What is good to know: the axes, the numbers that are asked for first, the tests, and the certificate."""
    wv = next(iter(calibration.axes.values())).fit.wavelet_variance
    total = len(calibration.axes) + len(calibration.failed)
    length = duration_text(wv.samples / wv.rate)
    yield Remark.of("axes-calibrated", axes=len(calibration.axes), total=total, length=length, rate=f"{wv.rate:g} Hz")
    lost = unusable(calibration)
    for sensor, members in by_sensor(calibration.axes).items():
        if numbers := _numbers({axis: one for axis, one in members.items() if axis not in lost}):
            yield Remark.of("numbers-found", SENSORS.get(sensor, sensor or "Axes"), numbers=numbers)
    passed = [
        axis for axis, one in calibration.axes.items() if one.test is not None and axis not in rejected(calibration)
    ]
    for axis in passed:
        yield Remark.of("test-passed", axis)
    if calibration.verdicts and not any(found.contaminated for found in calibration.verdicts.values()):
        yield Remark.of("no-outliers")
    if calibration.recording is not None and calibration.recording.static:
        yield Remark.of("at-rest")
    gaps = [found.fit.gap for found in calibration.axes.values()]
    proven = [gap for gap in gaps if gap is not None]
    if len(proven) == len(gaps):
        yield Remark.of("optimal", gap=100 * max(proven), exact="no" if max(proven) > 0 else "yes")


def _numbers(axes: Mapping[str, Any]) -> str:
    """The numbers that are asked for first, over the axes of a sensor."""
    parts = []
    for symbol in in_order([list(one.datasheet) for one in axes.values()]):
        entries = {axis: one.datasheet[symbol] for axis, one in axes.items() if symbol in one.datasheet}
        if symbol in _FIRST:
            parts.append(f"{next(iter(entries.values())).title} {symbol} {_range(entries)}")
    return "; ".join(parts)


_FIRST = ("N", "B", "K")


def _range(entries: Mapping[str, Entry]) -> str:
    """From the smallest to the largest value; limits where the data only bound all of them."""
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
        more = f" (on {', '.join(known)}; of others only a limit is known)" if len(known) < len(entries) else ""
        return f"{' to '.join(texts)} {unit}{more}"
    return f"at most {significant(max(bounds), 3)} {unit}" if bounds else "not determined"
