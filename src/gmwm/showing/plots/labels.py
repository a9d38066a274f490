"""Quantity and unit of a plot, and its texts: names of axes, and legend entries of terms."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.units import SI_UNIT, Quantity, find_unit, letter_of, noise_unit, parse_unit, sensor_of, usual_unit
from gmwm.showing.plots.axes import number_text
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.oscillator import name_in_text
from gmwm.theory.processes.parameter import Parameter, Physical

_SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}

# Name of a unit of time, its length (s), and the shortest duration that is written in this unit (s).
_DURATIONS = (
    ("d", 86400.0, 172800.0), ("h", 3600.0, 7200.0), ("min", 60.0, 120.0), ("s", 1.0, 0.1), ("ms", 1e-3, 1e-4),
)  # fmt: skip

LINES, OSCILLATIONS = "Lines", "Oscillations"  # names of the sums of all sinusoids and of all oscillations of an axis
DIGITS = 2  # Number of significant digits of parameters in a legend. The summary of the fit has more digits.


def sensor_and_letter(axis: str) -> tuple[str, str]:
    """Return the sensor and the letter of an axis with a name such as "gyro_x"; ("", "") for any other name.

    >>> sensor_and_letter("accel_z"), sensor_and_letter("pressure")
    (('accel', 'z'), ('', ''))
    """
    sensor, letter = sensor_of(axis), letter_of(axis)
    return (sensor, letter) if sensor and letter in ("x", "y", "z") else ("", "")


def sensor_title(sensor: str) -> str:
    """Return the name of a sensor in words.

    >>> sensor_title("gyro")
    'Gyroscope'
    """
    return _SENSORS.get(sensor, sensor.replace("_", " ").capitalize())


def axis_title(axis: str) -> str:
    """Return the name of an axis in words; a name that is not of an axis is returned unchanged."""
    sensor, letter = sensor_and_letter(axis)
    return f"{sensor_title(sensor)} {letter.upper()}" if sensor else axis


def shared_name(process: Process, rate: float) -> str:
    """Return the name of the sum to which a term belongs in a plot of several axes; "" if it has a curve of its own."""
    if process.line(rate) is not None:
        return LINES
    return OSCILLATIONS if process.is_complete and process.oscillation() is not None else ""


def term_label(term: str, process: Process, view: View, rate: float) -> str:
    """Return a term with at most two key parameters: standard deviation, correlation time or amplitude.

    >>> from gmwm.processes import GM, SIN
    >>> view = View("allan", "rad/s", 1.0)
    >>> term_label("GM[1]", GM(beta=0.02, sigma2=9e-8), view, rate=100.0)
    'GM[1]: T = 50 s, σ = 3×10⁻⁴ rad/s'
    >>> term_label("SIN", SIN(frequency=0.7, power=2e-8), view, rate=100.0)
    'line 0.7 Hz: A = 2×10⁻⁴ rad/s'
    """
    name = name_in_text(term, process)
    texts = [
        _amplitude_text(p, process, view, rate) or parameter_text(p, process.value(p.name), view)
        for p in process.parameters[name != term : 2]
    ]
    more = ", …" if len(process.parameters) > 2 else ""
    return f"{name}: {', '.join(texts)}{more}"


def datasheet_label(term: str, process: Process, unit: str, rate: float) -> str:
    """Return a term with its values in the symbols and units of datasheets, as text; "" if it has no such values.

    >>> from gmwm.processes import AR, GM, SIN, WN
    >>> datasheet_label("WN", WN(sigma2=4e-7), "rad/s", rate=100.0)
    'WN: N = 0.22 deg/√h'
    >>> datasheet_label("GM[1]", GM(beta=0.02, sigma2=9e-8), "rad/s", rate=100.0)
    'GM[1]: T_c = 50 s, q_c = 740 deg/h/√h'
    >>> datasheet_label("SIN", SIN(frequency=0.7, power=2e-8), "rad/s", rate=100.0)
    'line 0.7 Hz: A = 41 deg/h'
    >>> datasheet_label("AR(2)", AR(phi=[0.59, -0.9], sigma2=1e-7), "rad/s", rate=100.0)
    'AR(2): N = 0.083 deg/√h, f_b = 36.6 Hz, f_r = 20.0 Hz, Q_r = 12'
    """
    name = name_in_text(term, process)
    numbers = process.physical(rate)[name != term :]
    # The frequency of a sinusoid needs no symbol, but the bandwidth of a noise process does.
    named = any(number.signal_power and number.time_power for number in numbers)
    return f"{name}: {', '.join(_physical_text(number, unit, named) for number in numbers)}" if numbers else ""


def _physical_text(number: Physical, unit: str, named: bool) -> str:
    """Format a datasheet value with symbol and unit. A frequency has a symbol only if `named` is True."""
    if not number.signal_power:
        if number.time_power < 0:
            return f"{f'{number.symbol} = ' if named else ''}{_three_digits(number.value)} Hz"
        if number.time_power == 0:
            return f"{number.symbol} = {number_text(number.value, DIGITS)}"
        return f"{number.symbol} = {duration_text(number.value)}"
    si, factor = noise_unit(number.time_power, unit)
    name, size = usual_unit(si)
    return f"{number.symbol} = {number_text(factor * size * number.value, DIGITS)} {name}"


def _amplitude_text(parameter: Parameter, process: Process, view: View, rate: float) -> str:
    """Format the amplitude that belongs to a power parameter, in the unit of the plot; "" for any other parameter."""
    if (parameter.signal_power, parameter.time_power) != (2, 0) or parameter.symbol.endswith("²"):
        return ""
    for number in process.physical(rate):
        if (number.signal_power, number.time_power) == (1, 0.0) and dict(number.slopes) == {parameter.name: 0.5}:
            return f"{number.symbol} = {number_text(view.factor * number.value, DIGITS)} {view.unit}".rstrip()
    return ""


def parameter_text(parameter: Parameter, value: float, view: View) -> str:
    """Format an estimate: a variance as its root, a rate as its inverse, a frequency without symbol."""
    unit = f" {view.unit}" if view.unit else ""
    if parameter.signal_power == 2 and parameter.time_power == 0:
        if not parameter.symbol.endswith("²"):
            square = f" {view.square}" if view.unit else ""
            return f"{parameter.symbol} = {number_text(view.factor**2 * value, DIGITS)}{square}"
        root = parameter.symbol.removesuffix("²")
        return f"{root} = {number_text(view.factor * value**0.5, DIGITS)}{unit}"
    if parameter.signal_power == 1 and parameter.time_power == 0:
        per = " per sample" if parameter.per_sample else ""
        return f"{parameter.symbol} = {number_text(view.factor * value, DIGITS)}{unit}{per}"
    if parameter.unit_name == "Hz":
        return f"{_three_digits(value)} Hz"
    if parameter.signal_power == 0 and parameter.time_power == -1 and value > 0:
        return f"T = {duration_text(1 / value)}"
    return f"{parameter.symbol} = {number_text(value)}"


def _three_digits(value: float) -> str:
    """Format a number with three significant digits, including trailing zeros."""
    return f"{value:#.3g}".rstrip(".") if 1e-3 <= value < 999.5 else number_text(value)


def duration_text(seconds: float) -> str:
    """Format a duration in a unit that suits its size."""
    for unit, size, least in _DURATIONS:
        if seconds >= least:
            return f"{number_text(seconds / size, DIGITS)} {unit}"
    return f"{number_text(1e6 * seconds, DIGITS)} µs"


def model_text(terms: Iterable[str]) -> str:
    """Return a short name of a model from the names of its terms."""
    counts: dict[str, int] = {}
    for term in terms:
        name = re.sub(r"\[\d+\]$", "", term)
        counts[name] = counts.get(name, 0) + 1
    return " + ".join(name if count == 1 else f"{count}·{name}" for name, count in counts.items())


ViewName: TypeAlias = Literal["auto", "wavelet", "allan"]
"""Wavelet variance ν² over τ, or Allan deviation √(2ν²) over τ/2; "auto" is the latter for Haar's filter."""
UnitSystem: TypeAlias = Literal["auto", "si", "datasheet"]
"""rad/s and m/s², or deg/h and mg; "auto" is the latter for Allan deviations of rates and accelerations."""

DATASHEET_UNIT: dict[Quantity, str] = {quantity: usual_unit(si)[0] for quantity, si in SI_UNIT.items()}
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
        """Return the position of ν²: itself, or √(2ν²), as the Allan variance at τ/2 is twice the Haar one at τ."""
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
    """Return the view of data in `unit`; "auto" is the Allan deviation in datasheet units, and other units are kept."""
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
