"""Units of quantities and their conversion to SI units, and the names of the axes."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import MISSING_SAMPLES, Vector
from gmwm.base.errors import DataError, OptionError, UnitError

__all__ = ["Unit", "datasheet_units", "find_unit", "parse_unit", "unit_names"]


Quantity = Literal["gyro", "accel", "position"]

STANDARD_GRAVITY = 9.80665
"""Standard gravity g₀ in m/s² (exact, CGPM 1901)."""


@dataclass(frozen=True)
class Unit:
    """A unit of angular rate or specific force: its name, what it measures, and its factor to SI.

    Attributes
    ----------
    name : str
        Usual name of the unit, such as "deg/s".
    quantity : "gyro" or "accel"
        Angular rate or specific force.
    factor : float
        Size of the unit in rad/s or m/s².
    """

    name: str
    quantity: Quantity
    factor: float


_UNITS = (
    Unit("rad/s", "gyro", 1.0),
    Unit("deg/s", "gyro", math.pi / 180),
    Unit("mdeg/s", "gyro", math.pi / 180e3),
    Unit("mrad/s", "gyro", 1e-3),
    Unit("deg/min", "gyro", math.pi / 180 / 60),
    Unit("arcsec/s", "gyro", math.pi / 180 / 3600),
    Unit("rpm", "gyro", 2 * math.pi / 60),
    Unit("deg/h", "gyro", math.pi / 180 / 3600),
    Unit("m/s²", "accel", 1.0),
    Unit("mm/s²", "accel", 1e-3),
    Unit("cm/s²", "accel", 1e-2),
    Unit("ft/s²", "accel", 0.3048),
    Unit("g", "accel", STANDARD_GRAVITY),
    Unit("mg", "accel", STANDARD_GRAVITY / 1e3),
    Unit("mGal", "accel", 1e-5),
    Unit("µg", "accel", STANDARD_GRAVITY / 1e6),
)

SI_UNIT: dict[Quantity, str] = {"gyro": "rad/s", "accel": "m/s²"}  # the SI unit of each quantity of a sensor

IMPOSSIBLE = 1e12
"""Value (rad/s, m/s²) that no sensor exceeds, a choice: shock sensors have 2e6 m/s², unscaled counts 2e9."""


def beyond_sensors(values: Vector) -> NDArray[np.bool_] | None:
    """Return a mask of the values (rad/s or m/s²) that no sensor can measure; None if there is no such value.

    >>> beyond_sensors(np.array([0.1, -3.4e38, 9.8]))
    array([False,  True, False])
    """
    if values.size == 0 or (values.max() <= IMPOSSIBLE and values.min() >= -IMPOSSIBLE):
        return None
    beyond = np.abs(values) > IMPOSSIBLE
    return beyond if beyond.any() else None


def require_measurable(values: Vector, unit: str, axis: str) -> None:
    """Raise a DataError if the unit is rad/s or m/s² and no sensor can have measured a value."""
    beyond = beyond_sensors(values) if unit in SI_UNIT.values() else None
    if beyond is not None:
        index, name = int(np.argmax(beyond)), axis or "the signal"
        raise DataError(
            f"{name} has values that no sensor measures, the first at index {index}: {values[index]:.3g} {unit}",
            argument=name, got=float(values[index]), advice=MISSING_SAMPLES,
        )  # fmt: skip


_BY_NAME = {unit.name: unit for unit in _UNITS}

# Signs that stand for words or other signs: three degree signs, two Greek letters mu, and raised digits.
_SIGNS = str.maketrans(
    {
        "°": "deg", "º": "deg", "˚": "deg", "″": "arcsec", "μ": "µ", "²": "2", "¹": "1",
        "⁻": "-", "−": "-", "⁄": "/", "÷": "/", **dict.fromkeys(" \t_·*.^{}()[]"),
    }
)  # fmt: skip
_PREFIXES = {"": 1.0, "centi": 1e-2, "milli": 1e-3, "micro": 1e-6, "nano": 1e-9}
_SYMBOLS = {"centi": "c", "milli": "m", "micro": "µ", "nano": "n"}
_WORDS = {"c": "centi", "m": "milli", "u": "micro", "µ": "micro", "n": "nano", **{word: word for word in _PREFIXES}}
_ANGLES = {"rad": 1.0, "deg": math.pi / 180, "arcmin": math.pi / 10800, "arcsec": math.pi / 648000, "rev": 2 * math.pi}
_LENGTHS = {"m": 1.0, "ft": 0.3048}
_TIMES = {"s": 1, "min": 60, "h": 3600}
_DEGREES = ("deg", "s")
_SHORT_RATES = {"dps": _DEGREES, "d/s": _DEGREES, "dph": ("deg", "h"), "rps": ("rad", "s"), "rpm": ("rev", "min")}
_PREFIX = r"(?P<prefix>milli|micro|nano|centi|[mcnuµ])??"
_TIME = r"(?:s|sec|seconds?|secs)"
_RATE = re.compile(
    rf"{_PREFIX}(?:(?P<short>dps|d/s|dph|rps|rpm)|(?P<angle>deg|rad|arc-?sec|arc-?min|rev)(?:rees?|ians?|olutions?|onds?|utes?|s)?"
    rf"(?:/|per|p)?(?P<time>{_TIME}|min(?:ute)?s?|h(?:r|our)?s?)(?:-1)?)"
)
_ACCELERATION = re.compile(
    rf"{_PREFIX}(?P<length>m|ft|feet|foot)(?:et(?:er|re)s?)?(?:/|per|p)?{_TIME}"
    rf"(?:-?2|sq(?:uared?)?|(?:/|per|p)?{_TIME})"
)
_GRAVITY = re.compile(r"(?P<prefix>milli|micro|nano|[mnuµ])?-?(?:(?P<gal>gals?)|g(?:n|0|ees?|s|ravity|ravities)?)")


def in_celsius(values: Vector, unit: str) -> Vector:
    """Return temperatures in °C; a unit other than "K", "m°C" and "°F" leaves them as they are."""
    if unit in ("K", "m°C"):
        return values - 273.15 if unit == "K" else values / 1000
    return (values - 32) / 1.8 if unit == "°F" else values


@lru_cache(maxsize=1024)
def find_unit(text: str) -> Unit | None:
    """Return the unit that `text` spells, or None.

    A spelling is a prefix, a unit, and the time in the denominator: "deg/s", "°/s", "dps", "degrees per second",
    "deg_per_s", "mdps", "m s^-2", "ft/s²", "µg", "milli-g"; a size may stand before it, "0.1 deg/s".
    Blanks, underscores and dots do not matter. Case matters only for mega, which no sensor has: "Mg" is not a unit.

    >>> find_unit("Deg / s").factor == math.pi / 180, find_unit("milli_degrees_per_sec").name, find_unit("ft/s^2").name
    (True, 'mdeg/s', 'ft/s²')
    """
    if (sized := re.fullmatch(r"(\d+(?:\.\d+)?) +(\D.*)", text.strip())) and (unit := find_unit(sized[2])) is not None:
        return Unit(text.strip(), unit.quantity, float(sized[1]) * unit.factor)
    spelling = text.strip().translate(_SIGNS)
    if len(spelling) > 40:  # no unit is longer
        return None
    key = spelling.casefold().replace("μ", "µ")
    if match := _RATE.fullmatch(key):
        base, time = _SHORT_RATES.get(match["short"] or "", ("", ""))
        base = base or match["angle"].replace("-", "")
        time = time or ("min" if match["time"].startswith("m") else match["time"][0])
        name, size, quantity = f"{base}/{time}", _ANGLES[base] / _TIMES[time], "gyro"
    elif match := _ACCELERATION.fullmatch(key):
        base = match["length"].replace("foot", "ft").replace("feet", "ft")
        name, size, quantity = f"{base}/s²", _LENGTHS[base], "accel"
    elif match := _GRAVITY.fullmatch(key):
        name, size = ("Gal", 1e-2) if match["gal"] else ("g", STANDARD_GRAVITY)
        quantity = "accel"
    else:
        return None
    prefix = _WORDS[match["prefix"] or ""]
    mega = match["prefix"] == "m" and spelling[0] == "M" and (name == "g" or not spelling.isupper())
    if mega or (prefix == "centi" and name != "m/s²"):
        return None
    name = {"rev/min": "rpm", "Gal": "cm/s²"}.get(name, name) if not prefix else f"{_SYMBOLS[prefix]}{name}"
    return _BY_NAME.get(name) or Unit(name, cast(Quantity, quantity), size * _PREFIXES[prefix])


def unit_names(quantity: Quantity) -> tuple[str, ...]:
    """Return the units of a quantity by their usual names.

    >>> unit_names("accel")[0]
    'm/s²'
    """
    return tuple(unit.name for unit in _UNITS if unit.quantity == quantity)


def parse_unit(text: str, quantity: Quantity) -> Unit:
    """Return the unit of `quantity` with the name `text`.

    Raises
    ------
    UnitError
        If the text is not the name of a unit, or names a unit of the other quantity.
    """
    unit = find_unit(text)
    if unit is None or unit.quantity != quantity:
        names = ", ".join(unit_names(quantity))
        raise UnitError(f"{text!r} is not a unit of {quantity}; the units are {names}", argument="unit", got=text)
    return unit


TIME_UNITS = {"s": 1, "ms": 10**3, "us": 10**6, "ns": 10**9}
"""Units of time stamps, with the number of each unit in a second."""

LONG_TIME_UNITS = {"min": 60, "h": 3600, "d": 86400, ".NET ticks": 1e-7}
"""Other units of time, with their lengths in seconds: 1 tick of .NET and Windows is 100 ns."""

TIME_WORDS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s",
    "ms": "ms", "msec": "ms", "millis": "ms", "millisecond": "ms", "milliseconds": "ms",
    "us": "us", "usec": "us", "micros": "us", "µs": "us", "μs": "us", "microsecond": "us", "microseconds": "us",
    "ns": "ns", "nsec": "ns", "nanos": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "min": "min", "mins": "min", "minute": "min", "minutes": "min",
    "h": "h", "hr": "h", "hrs": "h", "hour": "h", "hours": "h", "d": "d", "day": "d", "days": "d",
    ".netticks": ".NET ticks",
}  # fmt: skip
"""Names of the units of time, with the short name of each unit."""
_SINCE = re.compile(r"([a-zµμ]+)\s+(?:since|from|of|after|elapsed|utc|gps|unix|epoch|tai)\b.*", re.IGNORECASE)


def find_time_unit(text: str) -> str:
    """Return the short name of the unit of time that `text` names; "" if it names none.

    >>> find_time_unit("[msec]"), find_time_unit("seconds since 1970-01-01"), find_time_unit("deg")
    ('ms', 's', '')
    """
    bare = text.strip().strip("[](){}<>")
    since = _SINCE.fullmatch(bare)
    return TIME_WORDS.get(since.group(1).casefold() if since else bare.casefold().replace(" ", ""), "")


# Spellings of the same unit, replaced in this order.
_SPELLINGS = (
    (r"[\s·*]", ""), (r"°", "deg"), (r"(sqrt|rt)\(?([a-z]+)\)?", r"√\2"), (r"√\(([a-z]+)\)", r"√\1"),
    (r"(hours?|hrs?)\b", "h"), (r"\bsec\b", "s"), (r"\^?2\b", "²"), (r"\^?3\b", "³"), (r"^[uμ](?=[gr])", "µ"),
)  # fmt: skip


def spelt(text: str) -> str:
    """Normalise the spelling of a unit, to compare units.

    >>> spelt("°/sqrt(hr)") == spelt("deg / √h"), spelt("ug/sqrt(Hz)") == spelt("µg/√Hz")
    (True, True)
    """
    spelling = text.casefold()
    for pattern, written in _SPELLINGS:
        spelling = re.sub(pattern, written, spelling)
    return spelling


_DEGREE = math.pi / 180

# SI unit by power of the second beside the signal's unit, and printed units, the usual first, with size in SI.
_COEFFICIENTS: dict[Quantity, dict[float, tuple[str, tuple[tuple[str, float], ...]]]] = {
    "gyro": {
        1.0: ("rad", (("arcsec", _DEGREE / 3600), ("µrad", 1e-6))),
        0.5: ("rad/s/√Hz", (("deg/√h", _DEGREE / 60), ("deg/s/√Hz", _DEGREE))),
        0.0: ("rad/s", (("deg/h", _DEGREE / 3600), ("deg/s", _DEGREE))),
        -0.5: ("rad/s/√s", (("deg/h/√h", _DEGREE / 3600 / 60), ("deg/s/√s", _DEGREE), ("rad/s²/√Hz", 1.0))),
        -1.0: ("rad/s²", (("deg/h/h", _DEGREE / 3600 / 3600), ("deg/s²", _DEGREE))),
    },
    "accel": {
        1.0: ("m/s", (("m/s", 1.0), ("mm/s", 1e-3))),
        0.5: ("m/s²/√Hz", (("m/s/√h", 1 / 60), ("µg/√Hz", STANDARD_GRAVITY / 1e6))),
        0.0: ("m/s²", (("mg", STANDARD_GRAVITY / 1e3), ("µg", STANDARD_GRAVITY / 1e6))),
        -0.5: ("m/s²/√s", (("mg/√h", STANDARD_GRAVITY / 60e3), ("m/s²/√h", 1 / 60), ("m/s³/√Hz", 1.0))),
        -1.0: ("m/s³", (("mg/h", STANDARD_GRAVITY / 3600e3), ("m/s²/h", 1 / 3600))),
    },
}
_PRINTED = {si: printed for table in _COEFFICIENTS.values() for si, printed in table.values()}
_SECONDS = {1.0: "·s", 0.5: "/√Hz", 0.0: "", -0.5: "/√s", -1.0: "/s"}


def noise_unit(time_power: float, unit: str, empty: str = "u") -> tuple[str, float]:
    """Return the SI unit of (unit of the signal) · s^`time_power`, and the factor to it; `empty` replaces "".

    >>> noise_unit(0.5, "rad/s")
    ('rad/s/√Hz', 1.0)
    """
    entry = find_unit(unit)
    if entry is None:
        return f"{unit or empty}{_SECONDS[time_power]}", 1.0
    return _COEFFICIENTS[entry.quantity][time_power][0], entry.factor


def datasheet_units(si: str) -> dict[str, float]:
    """Return the units in which datasheets and filters state a coefficient with the SI unit `si`, with the factors from
    SI.

    The usual unit is first. The mapping is empty for other units, such as seconds.

    >>> list(datasheet_units("m/s²/√Hz"))
    ['m/s/√h', 'µg/√Hz']
    """
    return {name: 1 / size for name, size in _PRINTED.get(si, ())}


def usual_unit(si: str) -> tuple[str, float]:
    """Return the usual datasheet unit of a coefficient and the factor from SI; the unit itself if it has none.

    >>> usual_unit("rad/s/√Hz")[0], usual_unit("s")
    ('deg/√h', ('s', 1.0))
    """
    return next(iter(datasheet_units(si).items()), (si, 1.0))


T = TypeVar("T")

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
"""The names of the six axes of an IMU, in the order in which they are shown."""
POSITIONS = ("east", "north", "up", "level")  # the names of the components of a position series; level is of the sea
LENGTHS = {name: Unit(name, "position", size) for name, size in (("m", 1.0), ("cm", 1e-2), ("mm", 1e-3))}


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
    """Return the quantity that an axis measures: "gyro", "accel" or "position". Sensors of an array may have numbers:
    gyro_1."""
    if axis in POSITIONS:
        return "position"
    if axis not in AXES and not (sensor_of(axis) in ("gyro", "accel") and letter_of(axis).isdecimal()):
        raise OptionError(argument="axis", expected=f"one of {', '.join(AXES)}", got=axis)
    return "gyro" if axis.startswith("gyro") else "accel"


def si_unit(axis: str) -> str:
    """Return the SI unit of an axis, "m" for a position."""
    return SI_UNIT.get(axis_quantity(axis), "m")
