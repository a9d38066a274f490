"""The bias at rest in a file: the values of three axes, what the header says, and axes whose bias is unknown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm.axis_names import letter_of, sensor_of
from gmwm.exporters.reduction import NAMES
from gmwm.remarks import Remark
from gmwm.units import SI_UNIT, Quantity

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.rest import BiasAtRest


def three(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> tuple[float, ...]:
    """Return the biases (SI) of the x, y and z axes of a sensor; 0 for a bias that is not known."""
    known = {letter_of(axis): one.bias for axis, one in rest.items() if sensor_of(axis) == quantity}
    return tuple(known.get(letter) or 0.0 for letter in "xyz")


def known_axes(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> list[str]:
    """Return the axes of a sensor whose bias is known."""
    return [axis for axis, one in rest.items() if sensor_of(axis) == quantity and one.bias is not None]


def stated(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[str]:
    """Yield a sentence on the bias of each axis: its value, its standard error, and how it changes."""
    for quantity in quantities:
        unit = SI_UNIT[quantity]
        for axis in sorted(known_axes(calibration.rest, quantity)):
            one = calibration.rest[axis]
            spread = f", turn-on spread {one.turn_on:.2g} {unit}" if one.turn_on is not None else ""
            yield (
                f"Bias of {axis} at rest: {one.bias:.4g} {unit}, standard error {one.bias_error:.2g} {unit}, rms of "
                f"its changes over {one.duration:.4g} s {one.rms:.2g} {unit}{spread}. It changes when the unit is "
                "switched on, and with temperature."
            )


def unknown(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[Remark]:
    """Yield a remark on the axes for which a file has 0 instead of a bias."""
    for quantity in quantities:
        known = set(known_axes(calibration.rest, quantity))
        letters = {letter_of(axis) for axis in known}
        axes = [f"{quantity}_{letter}" for letter in "xyz" if letter not in letters]
        if axes:
            seen = any(sensor_of(axis) == quantity for axis in calibration.rest)
            yield Remark.of(
                "bias-not-known", ", ".join(axes), why="tilt" if seen and quantity == "accel" else "recording",
                sensor=NAMES[quantity],
            )  # fmt: skip


def prior(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> float | None:
    """Return the standard deviation (SI) of the bias of a sensor before a filter has seen data; None if not known.

    It is the root sum of squares of the standard error of the bias, the rms of its changes at rest and, with several
    recordings, its spread from one turn-on to the next. The result is the largest value of the axes.
    """
    known = [rest[axis] for axis in known_axes(rest, quantity)]
    if len(known) < 3:
        return None
    return max(math.hypot(one.bias_error, one.rms, one.turn_on or 0.0) for one in known)
