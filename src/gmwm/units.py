"""Units of the two quantities an IMU measures, and the one table of factors to SI.

Everything inside the package is SI (rad/s, m/s²) and per sample; units appear in signals, labels,
readers and writers only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from gmwm.errors import UnitError

Quantity = Literal["gyro", "accel"]

STANDARD_GRAVITY = 9.80665
"""Standard gravity g₀ in m/s² (exact, CGPM 1901)."""


@dataclass(frozen=True)
class Unit:
    """A unit of angular rate or specific force: its name, what it measures, and its factor to SI."""

    name: str
    quantity: Quantity
    factor: float
    aliases: tuple[str, ...] = ()


_UNITS = (
    Unit("rad/s", "gyro", 1.0, ("rads^-1", "rad.s^-1", "radians/s", "radian/s", "rad/sec", "rps", "rads-1")),
    Unit(
        "deg/s",
        "gyro",
        math.pi / 180,
        ("dps", "°/s", "degrees/s", "degree/s", "deg/sec", "degs^-1", "degs-1"),
    ),
    Unit("mdeg/s", "gyro", math.pi / 180e3, ("mdps", "m°/s", "mdeg/sec")),
    Unit("deg/h", "gyro", math.pi / 180 / 3600, ("°/h", "deg/hr", "deg/hour", "dph")),
    Unit("m/s²", "accel", 1.0, ("m/s^2", "m/s2", "ms^-2", "ms-2", "m.s^-2", "m/s/s", "m/sec^2", "mps2")),
    Unit("g", "accel", STANDARD_GRAVITY, ("gn", "g0", "gee", "gees")),
    Unit("mg", "accel", STANDARD_GRAVITY / 1e3, ("millig",)),
    Unit("mGal", "accel", 1e-5, ("mgal",)),
    Unit("µg", "accel", STANDARD_GRAVITY / 1e6, ("ug", "μg", "microg")),
)

SI_UNIT: dict[Quantity, str] = {"gyro": "rad/s", "accel": "m/s²"}
"""The SI unit of each quantity."""


def _key(text: str) -> str:
    return text.strip().replace(" ", "").replace("·", "").replace("*", "").casefold()


_BY_NAME = {_key(name): unit for unit in _UNITS for name in (unit.name, *unit.aliases)}


def find_unit(text: str) -> Unit | None:
    """The unit a text names, or None; spaces, dots and case do not matter.

    >>> find_unit("Deg / s").factor == math.pi / 180
    True
    """
    return _BY_NAME.get(_key(text))


def parse_unit(text: str, quantity: Quantity) -> Unit:
    """The unit of `quantity` that a text names.

    Raises
    ------
    UnitError
        If the text names no unit, or a unit of the other quantity.
    """
    unit = find_unit(text)
    if unit is None or unit.quantity != quantity:
        known = ", ".join(u.name for u in _UNITS if u.quantity == quantity)
        came = f"{text!r}" if unit is None else f"{text!r}, a unit of the other sensor"
        raise UnitError(f"the {quantity} unit must be one of {known}; got {came}")
    return unit
