"""Find the unit of each axis: declared, stated by header or file, or inferred from gravity.

A gyroscope's cannot be inferred; the error says what each would mean, and what the recording shows. Counts and
increments are converted with factors in the file or declared ones."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError, UnitError
from gmwm.base.remarks import Remark
from gmwm.base.template import Fact
from gmwm.base.units import (
    LENGTHS,
    POSITIONS,
    SI_UNIT,
    STANDARD_GRAVITY,
    TIME_UNITS,
    Quantity,
    Unit,
    axis_quantity,
    find_unit,
    parse_unit,
    unit_names,
)
from gmwm.files.clock.text_stamps import UNIT as STAMPS
from gmwm.files.clock.text_stamps import form_remark, holds_stamps
from gmwm.files.columns.column_names import named_unit, recognise, unit_of, unknown_unit
from gmwm.files.columns.columns import ColumnChoice
from gmwm.files.contract import Layout
from gmwm.recording.options import TIME_NAMES


def multiply(
    layout: Layout, choice: ColumnChoice, factors: Mapping[str, float], increments: Sequence[str],
    raw: Mapping[str, Vector], rate: float,
) -> tuple[Remark, ...]:  # fmt: skip
    """Multiply numbers in place by factors of axes or their sensors, and increments by the rate; return remarks."""
    read = {key for axis in choice.axes for key in (axis, axis_quantity(axis))}
    for name, keys in (("scale", factors), ("increments", increments if set(increments) != set(SI_UNIT) else ())):
        unused = next((key for key in keys if key not in read), None)
        if unused is not None:
            raise OptionError(argument=name, expected=f"for axes that are read ({', '.join(choice.axes)})", got=unused)
    for axis in choice.axes:
        channel = layout.channels[choice.columns[axis]]
        factor = factors.get(axis, factors.get(axis_quantity(axis), 1.0)) * channel.scale
        if channel.increments or axis in increments or axis_quantity(axis) in increments:
            factor *= rate
        if factor != 1:
            raw[axis][...] *= factor
    remarks = [
        Remark.of("unit-named", key, case="factor", factor=factor, source="declared") for key, factor in factors.items()
    ]
    remarks += [Remark.of("unit-named", key, case="increments", source="declared") for key in increments if key in read]
    return tuple(remarks)


def offset_counts(axes: Sequence[str], values: Mapping[str, Vector]) -> bool:
    """Return whether numbers are unsigned 16-bit counts: two axes with means within 10 % of the middle of the range."""
    means = [float(np.mean(values[axis])) for axis in axes]
    near = sum(abs(mean / 2**15 - 1) < 0.1 for mean in means)  # a wide band: the counts of biases are far smaller
    return near >= min(2, len(axes)) and all(
        np.array_equal(np.rint(values[axis]), values[axis]) and values[axis].min() >= 0 and values[axis].max() < 2**16
        for axis in axes
    )


def _counts(sensor: str, axes: Sequence[str], values: Mapping[str, Vector]) -> tuple[str, str]:
    """Return a sentence and the advice for the message on an unknown unit if all numbers are whole; otherwise ""."""
    if not all(np.array_equal(np.rint(values[axis]), values[axis]) for axis in axes):
        return "", ""
    kind = "counts of 16 bits with an offset of 32768" if offset_counts(axes, values) else "whole, as counts are"
    unit, size = {"gyro": ("deg/s", 131), "accel": ("g", 16384)}[sensor]
    return f". The numbers are {kind}", (
        f"For counts, pass {{--units={sensor}:{unit}}}, and with {{--scale}} the size of a count from the data sheet: "
        f"{sensor}=1/{size} for {size} counts per {unit}."
    )


def parse_scale(text: str | None) -> dict[str, float] | None:
    """Parse the text of the option `scale`, with numbers or fractions, to the mapping that `gmwm.read` takes.

    >>> parse_scale("gyro=1/131,accel_x=6.1e-5")
    {'gyro': 0.007633587786259542, 'accel_x': 6.1e-05}
    """
    if text is None:
        return None
    factors = {}
    for part in text.split(","):
        name, mark, number = (piece.strip() for piece in part.partition("="))
        above, _, below = number.partition("/")
        try:
            factors[name] = float(above) / float(below or 1)
        except (ValueError, ZeroDivisionError):
            mark = ""
        if not mark or not name:
            expected = "factors of sensors or axes, such as gyro=1/131,accel_x=6.1e-5"
            raise OptionError(argument="scale", expected=expected, got=part.strip())
    return factors


_TYPICAL = (
    (1e-6, 0.0005, "fibre-optic and ring laser gyroscopes of navigation grade"),
    (0.0005, 0.003, "tactical gyroscopes such as STIM300 (0.0025)"),
    (0.003, 0.02, "gyroscopes such as MPU-6050 (0.005), BMI160 (0.007) and BMI088 (0.014)"),
    (0.02, 0.1, "gyroscopes such as L3GD20 (0.03)"),
)
"""Noise densities (deg/s/√Hz) in the datasheets of usual gyroscopes. They explain the question and decide nothing."""
_USUAL = (0.003, 0.1)
"""Noise densities (deg/s/√Hz) of gyroscopes in phones, drones and most loggers. A unit that gives one comes first."""
_QUIET_SHARE = 0.1
"""Share of windows that are quieter than the one whose noise is stated, so that motion elsewhere does not matter."""
_CLEAR = 0.7
"""Correlation of turns of gravity and gyroscopes above that of noise at rest (tests/readers/test_units.py)."""


def unknown_gyro(axes: Sequence[str], values: Mapping[str, Vector], rate: float) -> UnitError:
    """Make the error for gyroscopes without a unit. It states the noise density of the quietest part for both units,
    and the unit with which the turns of gravity agree. `values` (N,) are the numbers in the file, `rate` is in Hz."""
    density = float(np.median([_quiet_density(values[axis], rate) for axis in axes]))
    densities = {"deg/s": density, "rad/s": math.degrees(density)}
    readings = "; ".join(_reading(unit, value) for unit, value in densities.items())
    likely = _by_turns(values, rate)
    words, counts = _counts("gyro", axes, values)
    witness = f". The turns of gravity agree with {likely}" if likely else words
    usual = [likely] if likely else [unit for unit, value in densities.items() if _USUAL[0] <= value < _USUAL[1]]
    first = usual[0] if len(usual) == 1 else ""
    other = next(unit for unit in densities if unit != (first or "deg/s"))
    return UnitError(
        f"the unit of {', '.join(axes)} is neither declared nor named in the file. In the quietest part, the noise "
        f"density is {readings}{witness}",
        code="unit-unnamed",
        advice=(
            f"It is probably {{--units=gyro:{first}}}, otherwise {{--units=gyro:{other}}}."
            if first
            else counts or "State it with {--units=gyro:deg/s} or {--units=gyro:rad/s}."
        ),
    )


def _reading(unit: str, density: float) -> str:
    """Describe a noise density (deg/s/√Hz), and the gyroscopes that have it."""
    # The usual gyroscopes with a noise density (deg/s/√Hz); "" if there are none.
    parts = next((parts for low, high, parts in _TYPICAL if low <= density < high), "")
    typical = f"typical of {parts}" if parts else "which no usual gyroscope has"
    return f"{density:.3g} deg/s/√Hz ({60 * density:.3g} deg/√h) if it is {unit}, {typical}"


def _quiet_density(samples: Vector, rate: float) -> float:
    """Return the white noise density of the quiet windows, from first differences, which do not depend on the bias."""
    differences = np.diff(samples)
    width = max(32, min(round(rate), differences.size // 8))
    count = max(1, differences.size // width)
    windows = differences[: count * width].reshape(count, -1) if differences.size >= width else differences[None]
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.quantile(np.std(windows, axis=1), _QUIET_SHARE)) / math.sqrt(2 * rate)


def _by_turns(values: Mapping[str, Vector], rate: float) -> str:
    """Return the unit that turns of gravity show (the direction g turns with −ω × g), or "" without clear turns."""
    if not all(f"{sensor}_{axis}" in values for sensor in SI_UNIT for axis in "xyz"):
        return ""
    width = max(1, round(rate / 10))  # samples in 0.1 s, over which noise and vibration average out
    count = values["gyro_x"].size // width
    if count < 16:
        return ""
    gyro, accel = (
        np.column_stack(
            [values[f"{sensor}_{axis}"][: count * width].reshape(count, width).mean(axis=1) for axis in "xyz"]
        )
        for sensor in ("gyro", "accel")
    )
    with np.errstate(all="ignore"):
        down = accel / np.linalg.norm(accel, axis=1, keepdims=True)
        turns = np.diff(down, axis=0) * rate / width
        expected = -np.cross((gyro[1:] + gyro[:-1]) / 2, (down[1:] + down[:-1]) / 2)
        product, power = float(np.sum(turns * expected)), float(np.sum(expected**2))
        correlation = product / math.sqrt(power * float(np.sum(turns**2)) or 1.0)
    if not abs(correlation) > _CLEAR:
        return ""
    size = abs(product) / power
    return next((unit for unit, factor in (("rad/s", 1.0), ("deg/s", math.pi / 180)) if 0.5 < size / factor < 2), "")


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
    """Return the unit of time stamps or "", and a remark on dates or a replaced unit."""
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
    """Find every axis's unit; `values` (N,) give the norm of gravity. "deg" of `increments` agrees with "deg/s"."""
    units: dict[str, Unit] = {}
    remarks: list[Remark] = []
    if positions := [axis for axis in choice.axes if axis in POSITIONS]:
        units |= {axis: _length(layout.channels[choice.columns[axis]].unit, axis, declared) for axis in positions}
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


def _length(stated: str, axis: str, declared: Mapping[str, str]) -> Unit:
    """Return the unit of a position that the user declares or the file states."""
    unit = declared.get("position", stated)
    if unit not in LENGTHS:
        raise UnitError(
            f"the unit of {axis} is neither declared nor named in the file", code="unit-unnamed",
            advice="State it with {--units=position:mm}, position:cm or position:m.",
        )  # fmt: skip
    return LENGTHS[unit]


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
    # angular_velocity_x without an acceleration of ROS beside it is also a name of other programs.
    fields = [column for column in (recognise(other.name) for other in layout.channels) if column.ros]
    several = len({axis_quantity(column.axis) for column in fields}) > 1
    if recognise(channel.name).ros and (several or re.search("[./]", channel.name)):
        return _StatedUnit(SI_UNIT[quantity], "ros")
    return _StatedUnit()


def _unknown_unit(stated: str, axis: str, quantity: Quantity) -> UnitError:
    """Make the error for an unknown unit; for a unit of increments, such as deg, it advises to declare them."""
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
    words, counts = _counts("accel", axes, values)
    raise UnitError(
        f"the unit of the accelerometers is unknown, and the norm of their mean, {norm:.4g}, is neither 1 (g) nor 9.8 "
        "(m/s²)" + words, code="unit-implausible", advice=counts or _STATE_ACCEL,
    )  # fmt: skip


def _doubts(axes: list[str], values: Mapping[str, Vector], units: Mapping[str, Unit]) -> list[Remark]:
    """Report accelerometers whose norm is near gravity in another unit. Biases explain 20 %; another unit must be
    within 5 %, half of `_NEAR_GRAVITY`, as a stated unit is evidence against it."""
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
