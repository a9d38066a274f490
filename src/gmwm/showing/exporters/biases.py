"""Biases at rest for exported files: values, text for the head, and remarks on unknown biases."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm.base.axis_names import letter_of, sensor_of
from gmwm.base.remarks import Remark
from gmwm.base.units import SI_UNIT, Quantity
from gmwm.showing.exporters.reduction import NAMES

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.rest import BiasAtRest


def three(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> tuple[float, ...]:
    """Return the biases (SI) of the x, y and z axes of a sensor. A bias that is not known is 0."""
    known = {letter_of(axis): one.bias for axis, one in rest.items() if sensor_of(axis) == quantity}
    return tuple(known.get(letter) or 0.0 for letter in "xyz")


def known_axes(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> list[str]:
    """Return the axes of a sensor whose bias is known."""
    return [axis for axis, one in rest.items() if sensor_of(axis) == quantity and one.bias is not None]


def stated(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[str]:
    """Yield a sentence on the biases of each sensor, with standard errors and the size of their changes."""
    for quantity in quantities:
        axes = sorted(known_axes(calibration.rest, quantity))
        if not axes:
            continue
        rest = [calibration.rest[axis] for axis in axes]
        each = ", ".join(
            f"{axis} {bias.bias:.3g} +- {bias.bias_error:.1g}" for axis, bias in zip(axes, rest, strict=True)
        )
        rms = max(bias.rms for bias in rest)
        spread = [bias.turn_on for bias in rest if bias.turn_on is not None]
        turn_on = f", turn-on spread {max(spread):.2g}" if spread else ""
        yield f"Bias at rest ({SI_UNIT[quantity]}): {each}; rms over {rest[0].duration:.4g} s {rms:.2g}{turn_on}."


def unknown(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[Remark]:
    """Yield a remark for each sensor with axes whose bias is not known, so that the file contains 0."""
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
    """Return the prior standard deviation (SI) of the bias of a sensor for a filter, or None if it is not known: for
    the worst axis, the root sum of squares of the error of the bias, the RMS of its changes at rest and its turn-on
    spread."""
    known = [rest[axis] for axis in known_axes(rest, quantity)]
    if len(known) < 3:
        return None
    return max(math.hypot(one.bias_error, one.rms, one.turn_on or 0.0) for one in known)
