"""In which unit each axis is: declared, named in the header, fixed by the format, or told by gravity.

A gyroscope has no such witness: its unit is declared or named, or it is an error.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Vector
from gmwm._text import OVERRULED
from gmwm.errors import UnitError
from gmwm.options import TIME_NAMES
from gmwm.readers.base import Layout
from gmwm.readers.column_names import named_unit, recognise, unit_of, unknown_unit
from gmwm.readers.columns import Choice
from gmwm.readers.text_stamps import UNIT as STAMPS
from gmwm.readers.text_stamps import described, holds_stamps
from gmwm.signals import axis_quantity
from gmwm.units import SI_UNIT, STANDARD_GRAVITY, TIME_UNITS, Quantity, Unit, find_unit, parse_unit, unit_names

_INFERRED = ("g", "m/s²", "mg")  # what the norm may tell apart
_NEAR = 0.10  # relative: biases and scale factors of low-cost accelerometers stay within


@dataclass(frozen=True)
class Scales:
    """The unit of each axis, remarks on how it is known, and what was only inferred."""

    units: dict[str, Unit]
    notes: tuple[str, ...]
    inferred: tuple[str, ...]
    doubts: tuple[str, ...]


def time_unit(layout: Layout, choice: Choice, declared: Mapping[str, str]) -> tuple[str, str]:
    """The unit of the time stamps where it is declared, named or fixed, "" otherwise; and a remark where it overrules.

    Raises
    ------
    UnitError
        If the file names a unit that is not known: sizes and intervals may tell a unit that nobody named, not that one.
        If a unit is declared for dates and times.
    """
    column = choice.columns["time"]
    channel = layout.channels[column]
    if holds_stamps(layout, column):
        unit = channel.unit if channel.unit in TIME_UNITS else STAMPS
        if declared.get("time", unit) != unit:
            raise UnitError(
                f"the time column {channel.name!r} holds dates and times ({layout.first_row[column]!r}), which have no "
                f'unit; got units={{"time": "{declared["time"]}"}}: drop it'
            )
        return unit, described(layout.first_row[column])
    said = named_unit(channel.name, "time") or unit_of(channel.unit, "time")
    unknown = "" if said else unknown_unit(channel.name, channel.unit, "time")
    if "time" in declared:
        unit, other = declared["time"], said or unknown or layout.units.get("time", "")
        return unit, f"time: {unit}, declared ({OVERRULED} {other})" if other and other != unit else ""
    if unknown:
        raise UnitError(
            f"the file says {unknown!r} for the unit of the time column {channel.name!r}, which is not known; known "
            f'are {TIME_NAMES}. If it is one of them, pass units={{"time": "s"}}; if not, leave the stamps out with '
            "columns={'time': None} and pass rate="
        )
    return said or layout.units.get("time", ""), ""


def resolve(
    layout: Layout,
    choice: Choice,
    declared: Mapping[str, str],
    values: Mapping[str, Vector],
    rate: float,
    increments: Sequence[str] = (),
) -> Scales:
    """The unit of every axis.

    Parameters
    ----------
    layout, choice
        What the file says, and which columns are read.
    declared : mapping
        Units by the user's word, checked.
    values : mapping of axis to (N,) array
        The numbers as they stand in the file, for what the accelerometers tell of themselves.
    rate : float
        Samples per second (Hz), for the noise shown when a gyroscope's unit is missing.
    increments : sequence of str
        Axes or sensors that the user declares as increments: "deg" in the file is not against "deg/s" then.

    Raises
    ------
    UnitError
        If the unit of a gyroscope is not known, or gravity does not tell the accelerometers'.
    """
    units: dict[str, Unit] = {}
    notes, inferred, doubts = [], [], []
    for quantity in SI_UNIT:
        axes = [axis for axis in choice.axes if axis_quantity(axis) == quantity]
        if not axes:
            continue
        known = {
            axis: _known(
                layout, choice, declared=declared, axis=axis, integral=axis in increments or quantity in increments
            )
            for axis in axes
        }
        names = {name for name, _ in known.values() if name}
        reason = next((why for name, why in known.values() if name), "")
        if not names:
            if quantity == "gyro":
                raise UnitError(_gyro_message(axes, values, rate))
            name, said = _by_gravity(axes, values)
            inferred.append(said)
            names, reason = {name}, "inferred from the norm"
        elif not all(name for name, _ in known.values()):
            silent = next(axis for axis, (name, _) in known.items() if not name)
            raise UnitError(
                f"the unit of {silent} is not named, the others have {', '.join(sorted(names))}; pass units="
            )
        only = next(iter(names))
        units |= {axis: parse_unit(known[axis][0] or only, quantity) for axis in axes}
        notes.append(f"{quantity}: {', '.join(sorted(names))}, {reason}")
        if quantity == "accel" and reason != "inferred from the norm":
            doubts += _doubts(axes, values, units)
    return Scales(units, tuple(notes), tuple(inferred), tuple(doubts))


def _known(layout: Layout, choice: Choice, declared: Mapping[str, str], axis: str, integral: bool) -> tuple[str, str]:
    """The unit of an axis and how it is known, or empty."""
    quantity = axis_quantity(axis)
    channel = layout.channels[choice.columns[axis]]
    by_name = named_unit(channel.name, axis)
    by_format = unit_of(channel.unit, axis)
    if quantity in declared:
        unit = parse_unit(declared[quantity], quantity).name
        other = by_name or by_format or unknown_unit(channel.name, channel.unit, axis)
        if integral and other and find_unit(f"{other}/s") == find_unit(unit):
            other = ""
        return unit, "declared" + (f" ({OVERRULED} {other})" if other and other != unit else "")
    if by_name:
        return by_name, "named in the header"
    if by_format:
        return by_format, "stated by the file"
    if unknown := unknown_unit(channel.name, channel.unit, axis):
        raise UnitError(_unknown_message(unknown, axis, quantity))
    if quantity in layout.units:
        return parse_unit(layout.units[quantity], quantity).name, "named in a comment"
    if recognise(channel.name).ros:
        return SI_UNIT[quantity], "as ROS messages have it (REP-103)"
    return "", ""


def _unknown_message(said: str, axis: str, quantity: Quantity) -> str:
    """The error for a unit that the file names and nobody knows, with the way out for increments and for factors."""
    known, si = ", ".join(unit_names(quantity)), SI_UNIT[quantity]
    rate = find_unit(f"{said}/s")
    message = f"the file says {said!r} for the unit of {axis}, which is not known; known are {known}. "
    if rate is not None and rate.quantity == quantity:
        return message + (
            f'If these are increments, integrals over a sample, pass increments=["{quantity}"] (--increments) and '
            f'units={{"{quantity}": "{rate.name}"}}; if they are rates after all, units= alone'
        )
    return message + (
        f'If it is one of them, pass units={{"{quantity}": "{si}"}} or the like; if not, also '
        f'scale={{"{quantity}": …}} (--scale) with its size in that unit'
    )


def _norm(axes: list[str], values: Mapping[str, Vector]) -> float:
    """Norm of the mean of the three accelerometers, in the unit of the file."""
    with np.errstate(over="ignore"):  # of damaged numbers: what is infinite is near to nothing
        return float(np.linalg.norm([np.mean(values[axis]) for axis in axes]))


def _by_gravity(axes: list[str], values: Mapping[str, Vector]) -> tuple[str, str]:
    """The accelerometers' unit by the norm of gravity, and the sentence that says so."""
    way_out = 'say it with units={"accel": "g"} or units={"accel": "m/s2"}'
    if len(axes) < 3:
        raise UnitError(
            f"the unit of {', '.join(axes)} is not known, and gravity needs all three axes to tell it; {way_out}"
        )
    norm = _norm(axes, values)
    for name in _INFERRED:
        gravity = STANDARD_GRAVITY / parse_unit(name, "accel").factor
        if abs(norm / gravity - 1) <= _NEAR:
            return name, (
                f"accelerometers taken to be in {name}: their norm is {norm:.4g}. If that is wrong, {way_out}"
            )
    raise UnitError(
        f"the unit of the accelerometers is not known, and their norm of {norm:.4g} is neither 1 (g) nor 9.8 "
        f"(m/s²); {way_out}"
    )


def _doubts(axes: list[str], values: Mapping[str, Vector], units: Mapping[str, Unit]) -> list[str]:
    """What gravity says against the unit of the accelerometers."""
    if len(axes) < 3 or len({units[axis].name for axis in axes}) > 1:
        return []
    norm, unit = _norm(axes, values), units[axes[0]]
    if abs(norm * unit.factor / STANDARD_GRAVITY - 1) <= 2 * _NEAR:
        return []
    better = [n for n in _INFERRED if abs(norm * parse_unit(n, "accel").factor / STANDARD_GRAVITY - 1) <= _NEAR / 2]
    return [
        f"the accelerometers are in {unit.name}, but their norm of {norm:.4g} is gravity in {name}; "
        f'if so, pass units={{"accel": "{name}"}}: every number would be off by that factor'
        for name in better
        if name != unit.name
    ]


def _gyro_message(axes: list[str], values: Mapping[str, Vector], rate: float) -> str:
    """The error for a gyroscope without a unit: the noise it would have in either."""
    # White noise density from first differences: blind to bias and slow drift.
    density = float(np.median([np.std(np.diff(values[axis])) for axis in axes])) / np.sqrt(2 * rate)
    in_rad = np.degrees(density)
    return (
        f"the unit of {', '.join(axes)} is neither declared nor named in the file. In deg/s the noise would be "
        f"{density:.3g} deg/s/√Hz ({60 * density:.3g} deg/√h), in rad/s {in_rad:.3g} deg/s/√Hz "
        f'({60 * in_rad:.3g} deg/√h); low-cost sensors have 0.002 to 0.1 deg/s/√Hz. Say which: units={{"gyro": '
        '"deg/s"} or units={"gyro": "rad/s"}'
    )
