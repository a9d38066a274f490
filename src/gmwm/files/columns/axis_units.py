"""Find the unit of each axis. The user declares it, the header or the file states it, or it is inferred from gravity.

The unit of a gyroscope cannot be inferred. An error is raised if it is neither declared nor stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.axis_names import axis_quantity
from gmwm.base.errors import UnitError
from gmwm.base.remarks import Remark
from gmwm.base.template import Fact
from gmwm.base.units import SI_UNIT, STANDARD_GRAVITY, TIME_UNITS, Quantity, Unit, find_unit, parse_unit, unit_names
from gmwm.files.clock.text_stamps import UNIT as STAMPS
from gmwm.files.clock.text_stamps import form_remark, holds_stamps
from gmwm.files.columns.column_names import named_unit, recognise, unit_of, unknown_unit
from gmwm.files.columns.columns import ColumnChoice
from gmwm.files.columns.gyro_unit import unknown_gyro
from gmwm.files.columns.scale_factors import offset_words
from gmwm.files.contract import Layout
from gmwm.recording.options import TIME_NAMES

_INFERRED = ("g", "m/s²", "mg")
"""Units that can be inferred from the norm of the accelerometers, because gravity is 1 g, 9.81 m/s² or 1000 mg."""
_NEAR_GRAVITY = 0.10
"""Relative agreement of norm and gravity (tests/readers/test_units.py). Zero-g offsets reach 80 mg (PS-MPU-6000A)."""

_STATE_ACCEL = "State it with {--units=accel:g} or {--units=accel:m/s2}."


@dataclass(frozen=True)
class Scales:
    """The unit of each axis, and remarks that state the source of each unit."""

    units: dict[str, Unit]
    remarks: tuple[Remark, ...]


@dataclass(frozen=True)
class _StatedUnit:
    """The unit of an axis ("" if unknown), its source, and the unit in the file if another one was declared."""

    unit: str = ""
    source: str = ""
    stated: str = ""


def time_unit(layout: Layout, choice: ColumnChoice, declared: Mapping[str, str]) -> tuple[str, Remark | None]:
    """Return the unit of the time stamps, "" if unknown, and a remark if they are dates or a declared unit replaces
    another."""
    column = choice.columns["time"]
    channel = layout.channels[column]
    if holds_stamps(layout, column):
        unit = channel.unit if channel.unit in TIME_UNITS else STAMPS
        if declared.get("time", unit) != unit:
            raise UnitError(
                f"the time column {channel.name!r} holds dates and times ({layout.first_row[column]!r}), which have no "
                f"unit, but {declared['time']!r} was declared", code="unit-contradiction", argument="units",
                advice="Leave the unit of time out of {--units}.",
            )  # fmt: skip
        return unit, form_remark(layout.first_row[column])
    stated = named_unit(channel.name, "time") or unit_of(channel.unit, "time")
    unknown = "" if stated else unknown_unit(channel.name, channel.unit, "time")
    if "time" in declared:
        unit, other = declared["time"], stated or unknown or layout.units.get("time", "")
        overruled = other and other != unit
        return unit, Remark.of(
            "unit-contradicted", "time", case="declared", unit=unit, stated=other
        ) if overruled else None
    if unknown:
        raise UnitError(
            f"the unit {unknown!r} of the time column {channel.name!r} is unknown; the units are {TIME_NAMES}",
            code="unit-unknown",
            advice="If it is one of them, pass for example {--units=time:s}; if not, leave the time stamps out with "
            "{--columns=time:none} and pass {--rate}.",
        )
    return stated or layout.units.get("time", ""), None


def resolve(
    layout: Layout, choice: ColumnChoice, declared: Mapping[str, str], values: Mapping[str, Vector], rate: float,
    increments: Sequence[str] = (),
) -> Scales:  # fmt: skip
    """Find the unit of every axis. `declared` maps sensors to units. `values` (N,) are the numbers in the file, for the
    norm of gravity. For axes in `increments`, "deg" in the file does not contradict "deg/s"."""
    units: dict[str, Unit] = {}
    remarks: list[Remark] = []
    for quantity in SI_UNIT:
        axes = [axis for axis in choice.axes if axis_quantity(axis) == quantity]
        if not axes:
            continue
        stated = {
            axis: _stated_unit(
                layout, choice, declared=declared, axis=axis, integral=axis in increments or quantity in increments
            )
            for axis in axes
        }
        names = sorted({entry.unit for entry in stated.values() if entry.unit})
        if not names:
            if quantity == "gyro":
                raise unknown_gyro(axes, values, rate)
            name, remark = _by_gravity(axes, values)
            units |= {axis: parse_unit(name, quantity) for axis in axes}
            remarks.append(remark)
            continue
        unnamed = next((axis for axis, entry in stated.items() if not entry.unit), None)
        if unnamed is not None:
            raise UnitError(
                f"the unit of {unnamed} is not named, but the other axes are in {', '.join(names)}",
                code="unit-unnamed",
                advice="State the unit of the sensor with {--units=@example}.",
                example=f"{quantity}:{names[0]}",
            )
        units |= {axis: parse_unit(stated[axis].unit, quantity) for axis in axes}
        first = stated[axes[0]]
        if first.stated:
            remarks.append(
                Remark.of("unit-contradicted", quantity, case="declared", unit=first.unit, stated=first.stated)
            )
        else:
            shown: Fact = names[0] if len(names) == 1 else tuple(names)
            remarks.append(Remark.of("unit-named", quantity, case="unit", unit=shown, source=first.source))
        if quantity == "accel":
            remarks += _doubts(axes, values, units)
    return Scales(units, tuple(remarks))


def _stated_unit(
    layout: Layout, choice: ColumnChoice, declared: Mapping[str, str], axis: str, integral: bool
) -> _StatedUnit:
    """Return the unit of an axis if it is declared by the user or stated in the file."""
    quantity = axis_quantity(axis)
    channel = layout.channels[choice.columns[axis]]
    by_name = named_unit(channel.name, axis)
    by_format = unit_of(channel.unit, axis)
    if quantity in declared:
        unit = parse_unit(declared[quantity], quantity).name
        other = by_name or by_format or unknown_unit(channel.name, channel.unit, axis)
        if integral and other and find_unit(f"{other}/s") == find_unit(unit):
            other = ""
        return _StatedUnit(unit, "declared", other if other != unit else "")
    if by_name:
        return _StatedUnit(by_name, "header")
    if by_format:
        return _StatedUnit(by_format, "file")
    if unknown := unknown_unit(channel.name, channel.unit, axis):
        raise _unknown_unit(unknown, axis, quantity)
    if quantity in layout.units:
        return _StatedUnit(parse_unit(layout.units[quantity], quantity).name, "comment")
    if recognise(channel.name).ros:
        return _StatedUnit(SI_UNIT[quantity], "ros")
    return _StatedUnit()


def _unknown_unit(stated: str, axis: str, quantity: Quantity) -> UnitError:
    """Make the error for an unknown unit in the file. For a unit of increments, such as deg, the advice declares
    them."""
    message = f"the unit {stated!r} of {axis} is unknown; the units are {', '.join(unit_names(quantity))}"
    rate = find_unit(f"{stated}/s")
    if rate is not None and rate.quantity == quantity:
        return UnitError(
            message, code="unit-unknown",
            advice="If the numbers are increments over a sample, pass {--increments=@quantity} and {--units=@units}; "
            "if they are rates, pass {--units=@units} alone.", quantity=quantity, units=f"{quantity}:{rate.name}",
        )  # fmt: skip
    return UnitError(
        message, code="unit-unknown",
        advice="If it is one of them, pass for example {--units=@units}; if not, pass also its size in that unit with "
        "{--scale}.", units=f"{quantity}:{SI_UNIT[quantity]}",
    )  # fmt: skip


def _norm(axes: list[str], values: Mapping[str, Vector]) -> float:
    """Return the norm of the vector of the three accelerometer means, in the unit of the file."""
    with np.errstate(over="ignore"):  # damaged numbers may overflow; infinity is near no gravity
        return float(np.linalg.norm([np.mean(values[axis]) for axis in axes]))


def _by_gravity(axes: list[str], values: Mapping[str, Vector]) -> tuple[str, Remark]:
    """Infer the unit of the accelerometers from the norm of gravity; return it with the remark that states it."""
    if len(axes) < 3:
        raise UnitError(
            f"the unit of {', '.join(axes)} is unknown, and it can be inferred from gravity only with all three axes",
            code="unit-needs-three-axes",
            advice=_STATE_ACCEL,
        )
    norm = _norm(axes, values)
    for name in _INFERRED:
        gravity = STANDARD_GRAVITY / parse_unit(name, "accel").factor
        if abs(norm / gravity - 1) <= _NEAR_GRAVITY:
            return name, Remark.of("unit-inferred", unit=name, norm=norm, units=f"accel:{name}")
    raise UnitError(
        f"the unit of the accelerometers is unknown, and the norm of their mean, {norm:.4g}, is neither 1 (g) nor 9.8 "
        "(m/s²)" + offset_words(axes, values), code="unit-implausible", advice=_STATE_ACCEL,
    )  # fmt: skip


def _doubts(axes: list[str], values: Mapping[str, Vector], units: Mapping[str, Unit]) -> list[Remark]:
    """Report accelerometers whose norm is close to gravity in a unit other than the declared or stated one. A norm
    within 20 % of gravity is accepted, because biases can explain it. Another unit is suggested only if the norm in
    this unit is within 5 % of gravity. This is half of `_NEAR_GRAVITY`, because a stated unit is evidence
    against another one."""
    if len(axes) < 3 or len({units[axis].name for axis in axes}) > 1:
        return []
    norm, unit = _norm(axes, values), units[axes[0]]
    if abs(norm * unit.factor / STANDARD_GRAVITY - 1) <= 2 * _NEAR_GRAVITY:
        return []
    better = [
        n for n in _INFERRED if abs(norm * parse_unit(n, "accel").factor / STANDARD_GRAVITY - 1) <= _NEAR_GRAVITY / 2
    ]
    return [
        Remark.of("unit-doubtful", case="stated", unit=unit.name, norm=norm, likely=name, units=f"accel:{name}")
        for name in better
        if name != unit.name
    ]
