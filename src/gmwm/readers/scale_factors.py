"""Raw counts and increments to numbers with a unit: what a format states of them, and what the user declares."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gmwm._arrays import Vector
from gmwm.errors import OptionError
from gmwm.readers.base import Layout
from gmwm.readers.columns import Choice
from gmwm.signals import axis_quantity
from gmwm.units import SI_UNIT


def multiply(
    layout: Layout,
    choice: Choice,
    factors: Mapping[str, float],
    increments: Sequence[str],
    raw: Mapping[str, Vector],
    rate: float,
) -> tuple[str, ...]:
    """Multiply the numbers by their factors, increments by the rate, in place; remarks on what the user declared.

    An axis' own factor goes before its sensor's.

    Parameters
    ----------
    layout, choice
        What the file says, and which columns are read.
    factors : mapping
        Factors by axis or sensor, checked.
    increments : sequence of str
        Axes or sensors that the user declares as increments, checked.
    raw : mapping of axis to (N,) array
        The numbers as they stand in the file.
    rate : float
        Samples per second (Hz).

    Raises
    ------
    OptionError
        If a factor is for an axis or a sensor that is not read.
    """
    read = {key for axis in choice.axes for key in (axis, axis_quantity(axis))}
    for name, keys in (("scale", factors), ("increments", increments if set(increments) != set(SI_UNIT) else ())):
        unused = next((key for key in keys if key not in read), None)
        if unused is not None:
            raise OptionError(f"{name} names {unused}, which is not read; read are: {', '.join(choice.axes)}")
    for axis in choice.axes:
        channel = layout.channels[choice.columns[axis]]
        factor = factors.get(axis, factors.get(axis_quantity(axis), 1.0)) * channel.scale
        if channel.increments or axis in increments or axis_quantity(axis) in increments:
            factor *= rate
        if factor != 1:
            raw[axis][...] *= factor
    notes = [f"{key}: numbers of the file times {factor:.8g}, as declared" for key, factor in factors.items()]
    notes += [f"{key}: increments, times the rate, as declared" for key in increments if key in read]
    return tuple(notes)
