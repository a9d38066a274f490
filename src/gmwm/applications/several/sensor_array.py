"""Group the signals of several units that measure the same motion by axis."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from gmwm.applications.several.synchronous import synchronous_signals
from gmwm.base.axis_names import AXES
from gmwm.base.errors import DataError
from gmwm.recording.signals import Imu, Signal

ALONE = "virtual"
"""Name of the axis if the names of the signals do not state one."""
_MEMBER = re.compile(r"(?P<axis>.+?)\s*\[(?P<unit>[^\]]+)\]")
_EXPECTED = "several recordings, or a mapping of names such as gyro_x[0] to signals"


def like_axes(x: Any, rate: float | None) -> dict[str, dict[str, Signal]]:
    """Group the signals of an array of units by axis, and by name within each axis; `fuse` describes the arguments."""
    groups = _groups(x)
    axes = {}
    for axis, members in groups.items():
        if len(members) < 2:
            raise DataError(
                f"{axis} has only one signal, {next(iter(members))}", argument="x", advice=f"Pass {_EXPECTED}."
            )
        axes[axis] = synchronous_signals(members, rate, fill=False)
        units = {name: signal.unit for name, signal in axes[axis].items()}
        if len(set(units.values())) > 1:
            raise DataError(f"the signals of {axis} differ in their units", argument="x", got=units)
    return axes


def _groups(x: Any) -> dict[str, dict[str, Any]]:
    if isinstance(x, Imu):
        x = x.signals
    if not isinstance(x, Mapping):
        if not isinstance(x, Sequence) or isinstance(x, str) or not all(isinstance(item, Imu | Signal) for item in x):
            raise DataError(argument="x", expected=_EXPECTED, got=x)
        x = {str(k): item for k, item in enumerate(x)}
    if not x:
        raise DataError(argument="x", expected=_EXPECTED, got=x)
    if all(isinstance(item, Imu) for item in x.values()):
        return _of_units(x)
    matches = {name: _MEMBER.fullmatch(name) for name in x}
    if not any(matches.values()):
        return {_common_axis(x): dict(x)}
    groups: dict[str, dict[str, Any]] = {}
    for name, match in matches.items():
        if match is None:
            raise DataError(f"{name} names no unit, but other signals do", argument="x", got=list(x))
        groups.setdefault(match["axis"], {})[name] = x[name]
    return groups


def _of_units(units: Mapping[str, Imu]) -> dict[str, dict[str, Signal]]:
    """Group the signals of the axes that all units have."""
    first, *others = units.values()
    axes = [axis for axis in first.axes if all(axis in other.axes for other in others)]
    if not axes:
        raise DataError(
            "the recordings have no axis in common", argument="x", got={k: v.axes for k, v in units.items()}
        )
    return {axis: {f"{axis}[{name}]": unit[axis] for name, unit in units.items()} for axis in axes}


def _common_axis(x: Mapping[str, Any]) -> str:
    """Return the axis that the signals state, or a default name if they state none."""
    stated: Iterable[str] = {item.axis if isinstance(item, Signal) else "" for item in x.values()}
    names = set(stated) - {""} | (set(x) & set(AXES))
    if len(names) > 1:
        raise DataError(
            f"{', '.join(sorted(names))} do not measure the same motion", argument="x", got=list(x),
            advice="Pass signals of like axes, such as gyro_x[0] and gyro_x[1].",
        )  # fmt: skip
    return next(iter(names), ALONE)
