"""The maker's values, in the units in which datasheets tell them."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from gmwm.errors import OptionError, UnitError
from gmwm.units import datasheet_units, find_unit, noise_unit, spelt


@dataclass(frozen=True)
class Reference:
    """A value of the maker.

    Parameters
    ----------
    value : float
        As it was given, in `unit`.
    unit : str
    si : float
        The same in SI.
    """

    value: float
    unit: str
    si: float

    def to_dict(self) -> dict[str, Any]:
        """The value as plain numbers and texts, ready for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}"


def as_reference(name: str, given: tuple[float, str], si: str) -> Reference:
    """A value with its unit, of a number whose SI unit is `si`.

    >>> as_reference("gyro.N", (60.0, "°/sqrt(hr)"), "rad/s/√Hz").si == math.radians(1)
    True

    Raises
    ------
    OptionError
        If it is no positive number with a unit.
    UnitError
        If the number is in no such unit.
    """
    try:
        value, unit = given
        whole = isinstance(unit, str) and not isinstance(value, bool) and 0 < float(value) < math.inf
    except (TypeError, ValueError):
        whole = False
    if not whole:
        raise OptionError(
            f"reference of {name} must be a positive number and its unit, as (2.0, 'deg/√h'); got {given!r}"
        )
    return Reference(float(value), unit, float(value) * _factor(name, unit, si))


def _factor(name: str, text: str, si: str) -> float:
    """Of a unit to SI."""
    known = {spelt(unit): 1 / factor for unit, factor in {**datasheet_units(si), si: 1.0}.items()}
    if (size := known.get(spelt(text))) is not None:
        return size
    # Of what has the unit of the signal itself: whatever the signal may be in.
    signal = find_unit(text)
    if signal is not None and noise_unit(0.0, signal.name)[0] == si:
        return signal.factor
    units = ", ".join(dict.fromkeys((*datasheet_units(si), si)))
    raise UnitError(f"the unit of {name} must be one of {units}; got {text!r}")
