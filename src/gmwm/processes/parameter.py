"""Parameters of a process: what one is, what it may be, in which unit, and whether it is held."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.errors import ModelError

_ESTIMATED = "Leave it out to estimate it."
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Fixed:
    """A value that is held during estimation; write `fixed(0.01)`."""

    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _as_number(self.value, "a fixed value"))

    def __repr__(self) -> str:
        return f"fixed({self.value!r})"


def fixed(value: float) -> Fixed:
    """A parameter held at `value`: estimation leaves it alone, and counts it as known.

    Parameters
    ----------
    value : float
        In the unit of the parameter, SI and per sample: u² for a variance, 1/s for β, Hz for a frequency.

    Returns
    -------
    Fixed
        To give to a process in place of a number.

    Raises
    ------
    ModelError
        If it is not a finite number; the process that is given it says whether it may be negative or zero.

    Examples
    --------
    >>> from gmwm.processes import GM
    >>> GM(beta=fixed(0.01))
    GM(beta=fixed(0.01))
    """
    return Fixed(value)


Value = float | Fixed | None
"""What a parameter may be given as: None is estimated, a number is where to start, `fixed(x)` is held."""


@dataclass(frozen=True)
class Parameter:
    """What a process says about one of its parameters.

    Parameters
    ----------
    name : str
        Its name in code and in results, "sigma2".
    symbol : str
        Its symbol in text, "σ²".
    description : str
        What it is, in a few words.
    domain : "positive", "real" or "between"
        Positive, any real number, or strictly between the `limits`. The scale parameter of a process may also
        be 0, which is what an estimate is when the data do not show the process.
    limits : pair of float
        Ends of the domain "between": −1 and 1 by default.
    signal_power, time_power : int
        Powers of the signal's unit and of the second in the parameter's unit: (2, 0) for a variance,
        (0, −1) for an inverse correlation time.
    per_sample : bool
        Whether the value belongs to one sampling step, so that it changes with the rate.
    scale_power : int or None
        p where the wavelet variance is proportional to value**p (1 for a variance, 2 for a slope); None for
        a parameter that changes the shape.
    unit_name : str or None
        A name for the unit where it has one of its own, "Hz".
    """

    name: str
    symbol: str
    description: str
    domain: Literal["positive", "real", "between"] = "positive"
    limits: tuple[float, float] = (-1.0, 1.0)
    signal_power: int = 0
    time_power: int = 0
    per_sample: bool = False
    scale_power: int | None = None
    unit_name: str | None = None

    def unit(self, signal_unit: str = "u") -> str:
        """The unit as text, for a signal in `signal_unit`; "" for a pure number.

        >>> Parameter("sigma2", "σ²", "variance", signal_power=2).unit("rad/s")
        '(rad/s)²'
        >>> Parameter("beta", "β", "inverse correlation time", time_power=-1).unit("rad/s")
        '1/s'
        """
        if self.unit_name is not None:
            return self.unit_name
        base = signal_unit or "u"
        over = _power(f"({base})" if "/" in base and self.signal_power != 1 else base, self.signal_power)
        if self.time_power > 0:
            over = "·".join(filter(None, (over, _power("s", self.time_power))))
        elif self.time_power < 0:
            over = f"{over or '1'}/{_power('s', -self.time_power)}"
        return f"{over} per sample" if over and self.per_sample else over

    def checked(self, value: object, owner: str) -> Value:
        """`value` if it may stand for this parameter of the process `owner`, as a plain float inside.

        Raises
        ------
        ModelError
            If it is not a finite real number in the domain, None or `fixed(…)` of such a number.
        """
        if value is None:
            return None
        if isinstance(value, Fixed):
            return Fixed(self._in_domain(value.value, owner))
        return self._in_domain(value, owner)

    def _in_domain(self, value: object, owner: str) -> float:
        name = f"{owner}.{self.name}"
        number = _as_number(value, name)
        zero_allowed = self.scale_power is not None
        if self.domain == "positive" and (number < 0 or (number == 0 and not zero_allowed)):
            least = "zero or positive" if zero_allowed else "positive"
            unit = f" ({self.unit()})" if self.unit() else ""
            raise _wrong(f"{name} ({self.description})", f"{least}{unit}", value, argument=name)
        low, high = self.limits
        if self.domain == "between" and not low < number < high:
            expected = f"strictly between {low:g} and {high:g}"
            raise _wrong(f"{name} ({self.description})", expected, value, argument=name)
        return number

    # --- every real number as a coordinate ------------------------------------------------------------

    def room(self, values: Vector) -> Vector:
        """How far each of the `values` is from an end of the domain; its own size where that has none, 1 at zero."""
        if self.domain == "between":
            return np.asarray(np.minimum(values - self.limits[0], self.limits[1] - values))
        size = np.abs(values)
        return np.asarray(np.where(size == 0, 1.0, size) if self.domain == "real" else values)

    def scanned(self, samples: int, rate: float) -> tuple[float, float]:
        """Ends of its coordinate for a record of `samples` at `rate` (Hz).

        Rates go from a turn of the record to one a sample, shares to 0.995, others from 0.1 to 10.
        """
        if self.domain == "positive":
            low, high = (rate / samples, rate) if self.time_power == -1 else (0.1, 10.0)
            return math.log(low), math.log(high)
        return (-3.0, 3.0) if self.domain == "between" else (-2.0, 2.0)

    def coordinate(self, values: Vector) -> Vector:
        """Coordinates of values, in which every real number is allowed: ln θ, artanh, or θ itself."""
        if self.domain == "between":
            low, high = self.limits
            return np.asarray(0.5 * np.log((values - low) / (high - values)))
        return np.asarray(np.log(values) if self.domain == "positive" else values)

    def at_coordinate(self, z: NDArray[Any]) -> NDArray[Any]:
        """Values at the coordinates `z`; analytic, so that it takes complex ones too."""
        if self.domain == "between":
            low, high = self.limits
            return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * np.tanh(z))
        return np.asarray(np.exp(z) if self.domain == "positive" else z)


@dataclass(frozen=True, eq=False)
class Branch:
    """One curve through the domain of a single nonlinear parameter, along a search coordinate u.

    Parameters
    ----------
    low, high : float
        Range of u that a record can tell apart from the processes named by `low_acts_as`, `high_acts_as`.
    values : function of u (n,)
        The nonlinear parameters (n, 1) there.
    slope : function of u (n,)
        Their derivatives by u (n, 1).
    coordinate : function of a value
        The u of a value, not clipped to the range; None where the value is not on this curve.
    low_acts_as, high_acts_as : str or None
        Names of the processes that the process becomes at the two ends; None where it becomes none of them.
    """

    low: float
    high: float
    values: Callable[[Vector], Matrix]
    slope: Callable[[Vector], Matrix]
    coordinate: Callable[[float], float | None]
    low_acts_as: str | None = None
    high_acts_as: str | None = None


def _power(base: str, power: int) -> str:
    if power == 0:
        return ""
    return base if power == 1 else base + str(power).translate(_SUPERSCRIPTS)


def _as_number(value: object, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _wrong(name, "a number", value, argument=name, advice=_ESTIMATED)
    number = float(value)
    if not math.isfinite(number):
        raise _wrong(name, "finite", value, argument=name, advice=_ESTIMATED)
    return number


def _wrong(what: str, expected: str, got: object, argument: str, advice: str = "") -> ModelError:
    # A literal message: the parameter of a process is no option of the command line.
    return ModelError(
        f"{what} must be {expected}; got {got!r}", argument=argument, expected=expected, got=got, advice=advice
    )
