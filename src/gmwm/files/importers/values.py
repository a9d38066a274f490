"""Noise numbers of an axis as datasheets and filters state them, their units, and their conversion to a model."""

from __future__ import annotations

import math
import re
from dataclasses import asdict, dataclass, replace
from typing import Any

from gmwm.base.errors import ModelError, OptionError, UnitError
from gmwm.base.time_base import parse_length
from gmwm.base.units import AXES, SI_UNIT, Quantity, datasheet_units, find_unit, noise_unit, spelt
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import DR, QN, RW, WN
from gmwm.theory.processes.power import FN

FLOOR = math.sqrt(2 * math.log(2) / math.pi)  # Allan deviation of flicker noise with the coefficient 1 (IEEE Std 952)
GAUSS_MARKOV_PEAK = 0.6173643
"""Largest Allan deviation of a GM of variance 1, at 1.89 correlation times (tests/importers/test_values.py)."""
_SQUARED = (1e-150, 1e150)  # range of numbers whose squares are floating-point numbers at any sampling rate


@dataclass(frozen=True, kw_only=True)
class Values:
    """The noise numbers of one axis, in SI units; None for a number that is not given.

    Attributes
    ----------
    N : float or None
        White noise density: rad/s/√Hz, m/s²/√Hz.
    K : float or None
        Random walk of the bias: rad/s/√s, m/s²/√s.
    B : float or None
        Bias instability: rad/s, m/s². Without `time` it is the coefficient of flicker noise, whose Allan deviation is
        0.664 B. With `time` it is a Gauss-Markov process whose largest Allan deviation is 0.664 B.
    sigma : float or None
        Standard deviation of a Gauss-Markov process, which needs `time`: rad/s, m/s².
    time : float or None
        Correlation time of the Gauss-Markov process (s).
    Q : float or None
        Quantization noise: rad, m/s.
    R : float or None
        Rate ramp: rad/s², m/s³.
    """

    N: float | None = None
    K: float | None = None
    B: float | None = None
    sigma: float | None = None
    time: float | None = None
    Q: float | None = None
    R: float | None = None

    def model(self, rate: float) -> Model:
        """Return the noise model with these numbers at a sampling rate (Hz).

        At the rate f, white noise has σ² = N² f, a random walk γ² = K²/f, flicker noise b² = B², quantization noise q²
        = Q² f², and a drift ω = R/f. A Gauss-Markov process has the variance σ² and β = 1/`time`.

        Raises
        ------
        ModelError
            If no number is positive, or the square of a number is not a floating-point number.

        Examples
        --------
        >>> Values(N=1e-4, K=1e-6).model(rate=100.0)
        Model('WN(sigma2=1e-06) + RW(gamma2=1e-14)')
        """
        smallest, largest = _SQUARED
        for name, value in vars(self).items():
            if value and not smallest < abs(value) < largest:
                raise ModelError(f"{name} must be between {smallest:g} and {largest:g} in SI units; got {value:g}")
        processes: list[Process] = []
        if self.N:
            processes.append(WN(sigma2=_product(self.N, self.N, rate)))
        if self.Q:
            processes.append(QN(q2=_product(self.Q, self.Q, rate, rate)))
        if self.time and (self.sigma or self.B):
            sigma = self.sigma if self.sigma else (self.B or 0.0) * FLOOR / GAUSS_MARKOV_PEAK
            processes.append(GM(beta=1.0 / self.time, sigma2=sigma**2))
        elif self.B:
            processes.append(FN(b2=self.B**2))
        if self.K:
            processes.append(RW(gamma2=float(f"{self.K**2 / rate:.15g}")))
        if self.R:
            processes.append(DR(omega=self.R / rate))
        if not processes:
            raise ModelError("there is no noise: every number is zero", advice="Give N, such as N=0.15deg/√h.")
        return Model(tuple(processes))

    def merged(self, other: Values) -> Values:
        """Return the numbers together with the numbers of `other`.

        Raises
        ------
        OptionError
            If a number is given twice.
        """
        numbers = {name: value for name, value in vars(other).items() if value is not None}
        if twice := [name for name in numbers if getattr(self, name) is not None]:
            raise OptionError(argument="source", expected=f"{twice[0]} once for each axis", got=twice[0])
        return replace(self, **numbers)


def _product(*factors: float) -> float:
    """Return a product without the rounding error of its last digit, for readable models."""
    return float(f"{math.prod(factors):.15g}")


# A value with its unit. The unit may begin with the letter e, so an exponent needs digits.
_REFERENCE = "a number with its value and unit, such as gyro.N=2.0deg/√h"
_VALUE = re.compile(r"([-+0-9.,']*(?:[eE][-+]?[0-9]+)?)\s*(.*)")


@dataclass(frozen=True)
class Reference:
    """A value that the manufacturer states in `unit`, for example "deg/√h", and in SI (`si`)."""

    value: float
    unit: str
    si: float

    def to_dict(self) -> dict[str, Any]:
        """Return the value as numbers and strings, ready for JSON."""
        return asdict(self)

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}"


def as_reference(name: str, given: tuple[float, str], si: str, *, argument: str = "reference") -> Reference:
    """Convert a positive reference value with unit to the SI unit `si`; OptionError or UnitError otherwise.

    >>> as_reference("gyro.N", (60.0, "°/sqrt(hr)"), "rad/s/√Hz").si == math.radians(1)
    True
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
    """Parse the value of --reference: the name of a number, and its value and unit."""
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


POWERS = {"Q": 1.0, "N": 0.5, "B": 0.0, "sigma": 0.0, "K": -0.5, "R": -1.0}
"""Datasheet symbols, with the power of the second in their unit, beside the signal's unit."""
_NAMES = {"σ": "sigma", "σ_GM": "sigma", "T": "T_c", "τ": "T_c", **{name: name for name in (*POWERS, "T_c")}}
EXAMPLE = "gyro: N=0.15deg/√h, B=3deg/h over 100s; accel: N=60µg/√Hz, K=1e-4m/s²/√s"
_IS_NUMBER = re.compile(r"[\wσ]+\s*=")
_PART = re.compile(
    r"\s*([\wσ]+)\s*=\s*([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)\s*"
    r"([^\s,;]*(?:\s*/\s*[^\s,;]+)*)(?:\s+over\s+([^,;]+))?\s*"
)


def read_datasheet(text: str) -> dict[str, Values | Model]:
    """Parse "SENSOR: SYMBOL=VALUE UNIT, …", separated by ";": gyro, accel or an axis; N, K, B, sigma, Q, R or T_c.

    "over 100s" after B or sigma is a GM's correlation time. A part can be a model with values.

    >>> read_datasheet("gyro_x: N=60 deg/√h")["gyro_x"].N == read_datasheet("gyro_x: N=1 deg/s/√Hz")["gyro_x"].N
    True
    """
    axes: dict[str, Values | Model] = {}
    for part in (part for part in text.split(";") if part.strip()):
        place, colon, body = (piece.strip() for piece in part.partition(":"))
        if not colon or place not in (*SI_UNIT, *AXES):
            expected = f"text such as '{EXAMPLE}', with gyro, accel or an axis before each colon"
            raise OptionError(argument="source", expected=expected, got=part.strip())
        quantity: Quantity = "gyro" if place.startswith("gyro") else "accel"
        values: Values | Model = _values(body, place, quantity) if _IS_NUMBER.match(body) else Model.parse(body)
        for axis in AXES:
            if axis == place or axis.rpartition("_")[0] == place:
                if axis in axes:
                    raise OptionError(argument="source", expected=f"{axis} once", got=text)
                axes[axis] = values
    if not axes:
        raise OptionError(argument="source", expected=f"text such as '{EXAMPLE}'", got=text)
    return axes


def _values(body: str, place: str, quantity: Quantity) -> Values:
    numbers: dict[str, float] = {}
    for part in body.split(","):
        match = _PART.fullmatch(part)
        name = _NAMES.get(match[1]) if match else None
        if match is None or name is None:
            expected = f"numbers such as N=0.15deg/√h, of {', '.join(dict.fromkeys(_NAMES.values()))}"
            raise OptionError(argument="source", expected=expected, got=part.strip())
        if name == "T_c":
            pairs = {"time": parse_length(match[2] + match[3], "source")}
        else:
            si = noise_unit(POWERS[name], SI_UNIT[quantity])[0]
            pairs = {name: as_reference(f"{place}.{name}", (float(match[2]), match[3]), si, argument="source").si}
        if match[4] is not None:
            if name not in ("B", "sigma"):
                raise OptionError(argument="source", expected="a correlation time after B or sigma only", got=part)
            pairs["time"] = parse_length(match[4].strip(), "source")
        for key, value in pairs.items():
            if key in numbers:
                raise OptionError(argument="source", expected=f"{key} once for {place}", got=body)
            numbers[key] = value
    if "time" in numbers and not numbers.keys() & {"B", "sigma"}:
        raise OptionError(argument="source", expected="B or sigma beside a correlation time", got=body)
    if "sigma" in numbers and "time" not in numbers:
        raise OptionError(argument="source", expected="a correlation time, as in sigma=5deg/h over 100s", got=body)
    if {"B", "sigma"} <= numbers.keys():
        raise OptionError(argument="source", expected="B or sigma, not both", got=body)
    return Values(**numbers)
