"""Sentences of an exported file: its verdict, the axes of its numbers, and what the numbers leave out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from gmwm.base.remarks import Remark, Severity
from gmwm.base.template import fact_text
from gmwm.base.text import list_text
from gmwm.base.units import SI_UNIT
from gmwm.showing.exporters.reduction import NAMES, RULES, AxisNoise, Rule, SensorNoise, lines_of
from gmwm.showing.exporters.text import is_given

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

_WHY = {"tilt": "tilt unknown", "recording": "no samples of the axis"}
"""Reasons why a bias is not known."""


def verdict(calibration: Calibration) -> str:
    """Return a sentence on whether the numbers of a file can be used, and which axes must not be used."""
    if is_given(calibration):
        return "Verdict: these numbers were given, and not measured by gmwm."
    severe = [remark for remark in calibration.remarks if remark.severity <= Severity.WRONG]
    if not severe:
        return f"Verdict: {calibration.verdict.text()}"
    names = {*calibration.axes, *calibration.failed}
    axes = list(dict.fromkeys(remark.subject for remark in severe if remark.subject in names))
    subject = list_text(axes) if axes and all(remark.subject in names for remark in severe) else "this file"
    return f"Verdict: DO NOT USE {subject} until the cause is found. {severe[0].text()}"


def rule_of(sensor: SensorNoise, rule: Rule) -> str:
    """Return a sentence on the axes from which the numbers of a sensor come."""
    axes = ", ".join(axis.axis for axis in sensor.axes)
    name = NAMES[sensor.quantity].capitalize()
    if len(sensor.axes) == 1:
        return f"{name}: {axes}."
    if rule != "worst":
        return f"{name}: {RULES[rule]} {axes}."
    white, walk = (_source(sensor.worst(symbol), symbol) for symbol in ("N", "K"))
    return f"{name}: N of {white}, K of {walk}, {RULES[rule]} {axes}."


def _source(axis: AxisNoise, symbol: str) -> str:
    return f"{axis.axis} (upper limit)" if getattr(axis, symbol).upper else axis.axis


def limits(remarks: Iterable[Remark]) -> list[str]:
    """Return a sentence on the numbers that are upper limits, and one on means that contain upper limits."""
    limits = [remark for remark in remarks if remark.code == "upper-limit"]
    whole = [remark for remark in limits if remark.facts["case"] == "axis"]
    among = [remark for remark in limits if remark.facts["case"] == "mean"]
    lines = []
    if whole:
        level = fact_text(whole[0].facts["level"])
        lines.append(f"UPPER LIMIT, not a measured value ({level}): {', '.join(remark.subject for remark in whole)}.")
    for number in dict.fromkeys(str(remark.facts["number"]) for remark in among):
        axes = [r.subject for r in among if r.facts["number"] == number and r.facts["kind"] != "measured"]
        lines.append(f"UPPER LIMIT among measured values: {number} contains the limit of {', '.join(axes)}.")
    return lines


def not_measured(remarks: Iterable[Remark]) -> list[str]:
    """Return a sentence on the biases for which the file has 0, because they are not known."""
    subjects: dict[str, list[str]] = {}
    for remark in remarks:
        subjects.setdefault(_WHY[str(remark.facts["why"])], []).append(remark.subject)
    axes = [f"{', '.join(names)} ({reason})" for reason, names in subjects.items()]
    return [f"NOT MEASURED: the bias of {', and of '.join(axes)}. The file has 0."] if axes else []


def left_out(sensors: Iterable[SensorNoise]) -> list[str]:
    """Return sentences on the sinusoids: the strongest of each sensor, their number, and their effect on N and K."""
    parts, count = [], 0
    for sensor in sensors:
        lines = [(line, axis.axis) for axis in sensor.axes for line in lines_of(axis.fit)]
        if lines:
            line, axis = max(lines, key=lambda pair: pair[0].amplitude)
            parts.append(f"{axis} {line.frequency:.3g} Hz ({line.amplitude:.2g} {SI_UNIT[sensor.quantity]})")
            count += len(lines)
    more = f" and {count - len(parts)} more" if count > len(parts) else ""
    if not parts:
        return []
    near = "N and K contain their error if the period is 1/10 to 3 times the horizon"
    return [f"Periodic disturbances ({near}): {', '.join(parts)}{more}."]
