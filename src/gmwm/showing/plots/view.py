"""Views, which determine the quantity of a plot (wavelet variance or Allan deviation) and its unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.units import SI_UNIT, Quantity, datasheet_units, find_unit, parse_unit

ViewName: TypeAlias = Literal["auto", "wavelet", "allan"]
"""Quantity of a plot: the wavelet variance ν² over the scale τ, or the Allan deviation √(2ν²) over the averaging time
τ/2. "auto" is the Allan deviation if the filter is Haar's, otherwise the wavelet variance."""
UnitSystem: TypeAlias = Literal["auto", "si", "datasheet"]
"""Unit system of a plot: rad/s and m/s², or deg/h and mg. "auto" is deg/h and mg for an Allan deviation of data in a
unit of angular rate or acceleration, otherwise SI."""

DATASHEET_UNIT: dict[Quantity, str] = {quantity: next(iter(datasheet_units(si))) for quantity, si in SI_UNIT.items()}
"""Unit of an Allan deviation on datasheets, for gyroscopes and for accelerometers."""

_SQUARES = {"rad/s": "rad²/s²", "deg/h": "deg²/h²", "m/s²": "m²/s⁴", "mg": "mg²"}


@dataclass(frozen=True)
class View:
    """Quantity and unit in which a plot shows a wavelet variance, with the conversion factor."""

    name: Literal["wavelet", "allan"]  # the quantity that is drawn: wavelet variance or Allan deviation
    unit: str  # unit of a deviation in the plot; "" if the data have no unit
    factor: float  # conversion factor from the unit of the data to `unit`

    def time(self, tau: Vector) -> Vector:
        """Return the horizontal position of a scale τ (s): τ itself, or the Allan averaging time τ/2."""
        return tau / 2 if self.name == "allan" else tau

    def height(self, variance: Vector) -> Vector:
        """Return the vertical position of a wavelet variance ν², which is given in the squared unit of the data. The
        position is ν² itself, or the Allan deviation √(2ν²), because the Allan variance at the averaging time τ/2 is
        twice the Haar wavelet variance at the scale τ."""
        if self.name == "allan":
            variance = 2 * np.maximum(variance, 0.0)
            return np.asarray(self.factor * np.sqrt(variance), dtype=np.float64)
        return self.factor**2 * variance

    @property
    def time_label(self) -> str:
        """Label of the horizontal axis."""
        return "Averaging time τ (s)" if self.name == "allan" else "Scale τ (s)"

    @property
    def height_label(self) -> str:
        """Label of the vertical axis."""
        if self.name == "allan":
            return f"Allan deviation ({self.unit or 'unit of the data'})"
        return f"Wavelet variance ({self.square})"

    @property
    def square(self) -> str:
        """Unit of a variance in the plot."""
        if not self.unit:
            return "unit of the data, squared"
        return _SQUARES.get(self.unit, f"({self.unit})²")

    @property
    def of_datasheets(self) -> bool:
        """Whether the plot has datasheet units."""
        return self.unit in DATASHEET_UNIT.values()

    @property
    def reach(self) -> float:
        """Largest factor by which confidence limits and models may extend the vertical axis beyond the data."""
        return 10**0.5 if self.name == "allan" else 10.0


def view_of(unit: str, view: ViewName, units: UnitSystem) -> View:
    """Return the view of data in `unit`, with the quantity `view` and the unit system `units`.

    "auto" is the Allan deviation in datasheet units. A unit that is neither of an angular rate nor of an acceleration
    is kept. Raises OptionError for it if `units` is "datasheet", and if `view` or `units` is unknown.

    >>> view_of("deg/s", "wavelet", "si").height_label
    'Wavelet variance (rad²/s²)'
    >>> view_of("m/s²", "allan", "datasheet").height_label
    'Allan deviation (mg)'
    """
    view = "allan" if view == "auto" else view
    definition = find_unit(unit)
    if units == "auto":
        units = "datasheet" if view == "allan" and definition is not None else "si"
    if view not in ("wavelet", "allan"):
        raise OptionError(argument="view", expected='"wavelet" or "allan"', got=view)
    if units not in ("si", "datasheet"):
        raise OptionError(argument="units", expected='"si" (rad/s, m/s²) or "datasheet" (deg/h, mg)', got=units)
    if definition is None:
        if units == "datasheet":
            raise OptionError(
                "datasheet units need data in a unit of angular rate or acceleration, but the data are in "
                f"{unit or 'no unit'}",
                argument="units",
                got=units,
                advice="Use {--units=si}, or give the signal a unit such as rad/s.",
            )
        return View(view, unit, 1.0)
    quantity = definition.quantity
    shown = parse_unit((SI_UNIT if units == "si" else DATASHEET_UNIT)[quantity], quantity)
    return View(view, shown.name, definition.factor / shown.factor)
