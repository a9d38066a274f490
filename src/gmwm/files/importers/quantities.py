"""Parse numbers with the units of datasheets, and convert them to SI units."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass
from typing import Any

from gmwm.base.errors import OptionError, UnitError
from gmwm.base.units import datasheet_units, find_unit, noise_unit, spelt

# A value with its unit. The unit may begin with the letter e, so an exponent needs digits.
_REFERENCE = "a number with its value and unit, such as gyro.N=2.0deg/√h"
_VALUE = re.compile(r"([-+0-9.,']*(?:[eE][-+]?[0-9]+)?)\s*(.*)")


@dataclass(frozen=True)
class Reference:
    """A value that the manufacturer states.

    Parameters
    ----------
    value : float
        Value in `unit`.
    unit : str
        Unit of the value, for example "deg/√h".
    si : float
        The value in SI units.
    """

    value: float
    unit: str
    si: float

    def to_dict(self) -> dict[str, Any]:
        """Return the value as numbers and strings, ready for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}"


def as_reference(name: str, given: tuple[float, str], si: str, *, argument: str = "reference") -> Reference:
    """Convert a reference value from its unit to the SI unit `si`.

    >>> as_reference("gyro.N", (60.0, "°/sqrt(hr)"), "rad/s/√Hz").si == math.radians(1)
    True

    Raises
    ------
    OptionError
        If `given` is not a positive number with a unit.
    UnitError
        If the unit does not fit the number.
    """
    try:
        value, unit = given
        valid = isinstance(unit, str) and not isinstance(value, bool) and 0 < float(value) < math.inf
    except (TypeError, ValueError, OverflowError):
        valid = False
    if not valid:
        expected = f"a positive number and its unit for {name}, such as (2.0, 'deg/√h')"
        raise OptionError(argument=argument, expected=expected, got=given)
    return Reference(float(value), unit, float(value) * _factor(name, unit, si, argument))


def _factor(name: str, text: str, si: str, argument: str) -> float:
    """Return the factor that converts a unit to the SI unit."""
    sizes = {spelt(unit): 1 / factor for unit, factor in {**datasheet_units(si), si: 1.0}.items()}
    if (size := sizes.get(spelt(text))) is not None:
        return size
    # A number in the unit of the signal may have any unit of the signal.
    signal = find_unit(text)
    if signal is not None and noise_unit(0.0, signal.name)[0] == si:
        return signal.factor
    units = ", ".join(dict.fromkeys((*datasheet_units(si), si)))
    raise UnitError(argument=argument, expected=f"in one of {units} for {name}", got=text)


def parse_reference(text: str) -> tuple[str, tuple[float, str]]:
    """Parse the value of --reference: the name of a number, and its value and unit.

    >>> parse_reference("gyro.N = 2.0 deg/√h")
    ('gyro.N', (2.0, 'deg/√h'))
    """
    name, mark, quantity = (part.strip() for part in text.partition("="))
    match = _VALUE.fullmatch(quantity)
    sensor, dot, symbol = name.rpartition(".")
    if not mark or not sensor or not dot or not symbol or match is None or not quantity:
        raise OptionError(argument="reference", expected=_REFERENCE, got=text)
    try:
        value = float(match[1])
    except ValueError:
        comma = match[1].count(",") == 1 and "." not in match[1]
        advice = "Write {number}, with a decimal point." if comma else ""
        number = match[1].replace(",", ".")
        raise OptionError(argument="reference", expected=_REFERENCE, got=text, advice=advice, number=number) from None
    if not match[2]:
        raise OptionError(
            f"the value of {name} has no unit: {quantity}", argument="reference", got=text,
            advice="Add it, for example {--reference=gyro.N=2.0deg/√h}.",
        )  # fmt: skip
    return name, (value, match[2])
