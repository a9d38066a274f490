"""Raw counts and increments to numbers with a unit: what a format states of them, and what the user declares."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm._arrays import Vector
from gmwm.errors import OptionError
from gmwm.readers.base import Layout
from gmwm.readers.columns import Choice
from gmwm.signals import AXES, axis_quantity
from gmwm.units import SI_UNIT


def checked_scale(scale: Mapping[str, float] | None) -> dict[str, float]:
    """`scale=` with each key an axis or a sensor, and each factor a finite number other than 0."""
    if scale is not None and not isinstance(scale, Mapping):
        raise OptionError(f'scale must map axes or sensors to factors, as {{"gyro": 1 / 131}}; got {scale!r}')
    factors = {}
    for key, value in (scale or {}).items():
        if key not in (*AXES, *SI_UNIT):
            raise OptionError(f"scale must name {', '.join((*SI_UNIT, *AXES))}; got {key!r}")
        try:
            factor = float(value)
        except (TypeError, ValueError):
            factor = math.nan
        if isinstance(value, bool | str) or not math.isfinite(factor) or factor == 0:
            raise OptionError(f"the scale of {key} must be a finite number other than 0, as 1 / 131; got {value!r}")
        factors[key] = factor
    return factors


def checked_increments(increments: bool | Sequence[str]) -> tuple[str, ...]:
    """`increments=` as names of sensors and axes; all of them for True."""
    if isinstance(increments, bool):
        return tuple(SI_UNIT) if increments else ()
    if isinstance(increments, str) or not isinstance(increments, Sequence):
        raise OptionError(f'increments must be True or a list of sensors or axes, as ["gyro"]; got {increments!r}')
    unknown = next((key for key in increments if key not in (*AXES, *SI_UNIT)), None)
    if unknown is not None:
        raise OptionError(f"increments must name {', '.join((*SI_UNIT, *AXES))}; got {unknown!r}")
    return tuple(increments)


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
