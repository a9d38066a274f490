"""Names of the six axes of an IMU, and the sensor, the direction and the quantity that belong to a name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from gmwm.base.errors import OptionError
from gmwm.base.units import Quantity

T = TypeVar("T")

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
"""The names of the six axes of an IMU, in the order in which they are shown."""


def sensor_of(axis: str) -> str:
    """Return the sensor of an axis; "" if its name has none.

    >>> sensor_of("gyro_x"), sensor_of("temperature")
    ('gyro', '')
    """
    return axis.rpartition("_")[0]


def letter_of(axis: str) -> str:
    """Return the direction of an axis, x, y or z; the whole name if it has no sensor.

    >>> letter_of("gyro_x")
    'x'
    """
    return axis.rpartition("_")[2]


def by_sensor(axes: Mapping[str, T]) -> dict[str, dict[str, T]]:
    """Return the values of axes, grouped by sensor.

    >>> by_sensor({"gyro_x": 1, "accel_x": 2, "gyro_y": 3})
    {'gyro': {'gyro_x': 1, 'gyro_y': 3}, 'accel': {'accel_x': 2}}
    """
    sensors: dict[str, dict[str, T]] = {}
    for axis, value in axes.items():
        sensors.setdefault(sensor_of(axis), {})[axis] = value
    return sensors


def axis_quantity(axis: str) -> Quantity:
    """Return the quantity that an axis measures, "gyro" or "accel". Sensors of an array may have numbers: gyro_1."""
    if axis not in AXES and not (sensor_of(axis) in ("gyro", "accel") and letter_of(axis).isdecimal()):
        raise OptionError(argument="axis", expected=f"one of {', '.join(AXES)}", got=axis)
    return "gyro" if axis.startswith("gyro") else "accel"
