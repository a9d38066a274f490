"""Convert raw counts and increments to numbers with a unit, with the factors in the file or with declared factors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.axis_names import axis_quantity
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.base.units import SI_UNIT
from gmwm.files.columns.columns import ColumnChoice
from gmwm.files.contract import Layout

_MIDDLE = 2**15
"""Middle of the range of counts of 16 bits."""


def multiply(
    layout: Layout, choice: ColumnChoice, factors: Mapping[str, float], increments: Sequence[str],
    raw: Mapping[str, Vector], rate: float,
) -> tuple[Remark, ...]:  # fmt: skip
    """Multiply the numbers by their factors, and increments by the rate, in place. If an axis has a factor of its own,
    the factor of its sensor is not used. `factors` and `increments` are declared by axis or sensor. Return remarks on
    both."""
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
    """Return whether the numbers of a sensor are counts of 16 bits without a sign: integers, of which two axes or more
    have means within 10 % of the middle of the range."""
    means = [float(np.mean(values[axis])) for axis in axes]
    near = sum(abs(mean / _MIDDLE - 1) < 0.1 for mean in means)  # a wide band: the counts of biases are far smaller
    return near >= min(2, len(axes)) and all(
        np.array_equal(np.rint(values[axis]), values[axis]) and values[axis].min() >= 0 and values[axis].max() < 2**16
        for axis in axes
    )


def offset_words(axes: Sequence[str], values: Mapping[str, Vector]) -> str:
    """Return a sentence for the message on an unknown unit if the numbers are counts with an offset; otherwise ""."""
    return ". The numbers are counts of 16 bits with an offset of 32768" if offset_counts(axes, values) else ""


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
