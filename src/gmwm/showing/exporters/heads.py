"""Sentences of an exported file: its verdict, the axes of its numbers, and what the numbers leave out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from gmwm.base.remarks import Severity
from gmwm.base.text import listed
from gmwm.base.units import SI_UNIT
from gmwm.showing.exporters.reduction import NAMES, RULES, AxisNoise, Rule, SensorNoise, lines_of
from gmwm.showing.exporters.text import is_given

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

_LINES = 3
"""Largest number of sinusoids of an axis that a file lists."""


def verdict(calibration: Calibration) -> str:
    """Return a sentence on whether the numbers of a file can be used, and which axes must not be used."""
    if is_given(calibration):
        return "Verdict: these numbers were given, and not measured by gmwm."
    severe = [remark for remark in calibration.remarks if remark.severity <= Severity.WRONG]
    if not severe:
        return f"Verdict: {calibration.verdict.text()}"
    names = {*calibration.axes, *calibration.failed}
    axes = list(dict.fromkeys(remark.subject for remark in severe if remark.subject in names))
    subject = listed(axes) if axes and all(remark.subject in names for remark in severe) else "this file"
    return f"Verdict: DO NOT USE {subject} until the cause is found. {severe[0].text()}"


def rule_of(sensor: SensorNoise, rule: Rule) -> str:
    """Return a sentence on the axes from which the numbers of a sensor come."""
    axes = ", ".join(axis.axis for axis in sensor.axes)
    name = NAMES[sensor.quantity].capitalize()
    if len(sensor.axes) == 1 or rule != "worst":
        return f"{name}: {axes if len(sensor.axes) == 1 else f'{RULES[rule]} {axes}'}."
    white, walk = (_source(sensor.worst(symbol), symbol) for symbol in ("N", "K"))
    return f"{name}: N is that of {white}, K that of {walk}, {RULES[rule]} {axes}."


def _source(axis: AxisNoise, symbol: str) -> str:
    return f"{axis.axis} (upper limit)" if getattr(axis, symbol).upper else axis.axis


def left_out(axes: Iterable[AxisNoise]) -> list[str]:
    """Return a sentence on the sinusoids that N and K do not include, the strongest of each axis first."""
    parts = []
    for axis in axes:
        lines = lines_of(axis.fit)
        unit = SI_UNIT["gyro" if axis.axis.startswith("gyro") else "accel"]
        shown = [f"{line.frequency:.3g} Hz ({line.amplitude:.2g} {unit})" for line in lines[:_LINES]]
        if len(lines) > _LINES:
            shown.append(f"{len(lines) - _LINES} more")
        parts += [f"{axis.axis} {', '.join(shown)}"] if shown else []
    return [f"N and K leave out periodic disturbances: {'; '.join(parts)}."] if parts else []
