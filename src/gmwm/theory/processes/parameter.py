"""Parameters of processes (name, domain, unit, fixed values), physical numbers, and quantities for random starts."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError
from gmwm.theory.filters import HAAR, WaveletFilter

_ESTIMATED = "Leave it out to estimate it."
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class Fixed:
    """Value of a parameter that is not estimated; write `fixed(0.01)`."""

    value: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "value", _as_number(self.value, "a fixed value"))

    def __repr__(self) -> str:
        return f"fixed({self.value!r})"


def fixed(value: float) -> Fixed:
    """Fix a parameter at `value`: it is not estimated and has no standard error.

    Parameters
    ----------
    value : float
        Value in the SI unit of the parameter, such as u² for a variance, 1/s for β, or Hz for a frequency.

    Returns
    -------
    Fixed
        Object that is passed to a process instead of a number.

    Raises
    ------
    ModelError
        If `value` is not a finite number. The process checks whether it lies in the domain of the parameter.

    Examples
    --------
    >>> from gmwm.processes import GM
    >>> GM(beta=fixed(0.01))
    GM(beta=fixed(0.01))
    """
    return Fixed(value)


Value = float | Fixed | None
"""Value of a parameter: None (estimated), a number (starting value) or `fixed(x)` (not estimated)."""


@dataclass(frozen=True)
class Parameter:
    """Definition of one parameter of a process.

    Parameters
    ----------
    name : str
        Name in code and in results, such as "sigma2".
    symbol : str
        Symbol in text, such as "σ²".
    description : str
        Meaning, in a few words.
    domain : "positive", "real" or "between"
        Set of allowed values: positive numbers, all real numbers, or numbers strictly between the `limits`. The scale
        parameter of a process may also be 0, which means that the process is absent.
    limits : pair of float
        Ends of the domain "between"; −1 and 1 by default.
    signal_power, time_power : int
        Powers of the unit of the signal and of the second in the unit of the parameter. They are 2 and 0 for a
        variance, and 0 and −1 for an inverse correlation time.
    per_sample : bool
        Whether the value refers to one sampling step, so that it depends on the rate.
    scale_power : int or None
        Exponent p if the wavelet variance is proportional to value**p (1 for a variance, 2 for a slope); None for a
        parameter that changes the shape.
    unit_name : str or None
        Name of the unit, if it has one, such as "Hz".
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
        """Return the unit as text, for a signal in `signal_unit`; "" for a dimensionless parameter.

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
        """Check a value of this parameter of the process `owner`, and convert it to float.

        Raises
        ------
        ModelError
            If the value is neither None, nor a finite real number in the domain, nor such a number in `fixed(…)`.
        """
        if value is None:
            return None
        if type(value) is float and 0.0 < value < math.inf and self.domain != "between":
            return value  # a fit creates thousands
        if isinstance(value, Fixed):
            self._in_domain(value.value, owner)
            return value
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

    def room(self, values: Vector) -> Vector:
        """Compute the distance (n,) of each of the `values` (n,) from the nearest end of the domain.

        The distance has the unit of the parameter. For a parameter that can be any real number, it is the absolute
        value, or 1 at zero."""
        if self.domain == "between":
            return np.asarray(np.minimum(values - self.limits[0], self.limits[1] - values))
        size = np.abs(values)
        return np.asarray(np.where(size == 0, 1.0, size) if self.domain == "real" else values)

    def scanned(self, samples: int, rate: float) -> tuple[float, float]:
        """Return the range of the coordinate of starting values, for a recording of `samples` samples at `rate` (Hz).

        Inverse times range from the reciprocal of the duration of the recording to the sampling rate, and other
        positive values from 0.1 to 10. Values between limits cover the central 99.5 % (tanh 3) of the interval, and
        real numbers range from −2 to 2."""
        if self.domain == "positive":
            low, high = (rate / samples, rate) if self.time_power == -1 else (0.1, 10.0)
            return math.log(low), math.log(high)
        return (-3.0, 3.0) if self.domain == "between" else (-2.0, 2.0)

    def coordinate(self, values: Vector) -> Vector:
        """Transform values θ to unconstrained coordinates.

        The coordinate is ln θ for a positive parameter, artanh of θ rescaled to ±1 for a parameter between limits, and
        θ for a real number."""
        if self.domain == "between":
            low, high = self.limits
            return np.asarray(0.5 * np.log((values - low) / (high - values)))
        return np.asarray(np.log(values) if self.domain == "positive" else values)

    def at_coordinate(self, z: NDArray[Any]) -> NDArray[Any]:
        """Compute the values at the coordinates `z`, which may be complex because the function is analytic."""
        if self.domain == "between":
            low, high = self.limits
            return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * np.tanh(z))
        return np.asarray(np.exp(z) if self.domain == "positive" else z)


@dataclass(frozen=True)
class Exponential:
    """Branch of exponential autocovariances for the kernel: λ = `bend`·(e^(u − low) − 1 + `least`) for coordinates u
    from low. `sign` is 1 for e^(−λ|k|), −1 for (−1)^k e^(−λ|k|). `innovation`: φ and innovation variance 1, as for
    `AR1`; else λ times the rate and marginal variance 1, as for `GM`."""

    bend: float
    least: float
    sign: float = 1.0
    innovation: bool = False


@dataclass(frozen=True, eq=False)
class Branch:
    """Curve through the domain of a single nonlinear parameter, along a search coordinate u.

    Parameters
    ----------
    low, high : float
        Range of u. Outside the range, a recording cannot distinguish the process from `low_acts_as` or `high_acts_as`.
    values : function of u (n,)
        Returns the nonlinear parameters (n, 1).
    slope : function of u (n,)
        Returns the derivatives (n, 1) of the nonlinear parameters with respect to u.
    coordinate : function of a parameter value
        Returns u, which is not clipped to the range; None if the value is not on this curve.
    low_acts_as, high_acts_as : str or None
        Names of the processes that the process approaches at the two ends; None if there is no such process.
    exponential : Exponential, optional
        Form of the autocovariance if it is exponential, which makes fits faster.
    """

    low: float
    high: float
    values: Callable[[Vector], Matrix]
    slope: Callable[[Vector], Matrix]
    coordinate: Callable[[float], float | None]
    low_acts_as: str | None = None
    high_acts_as: str | None = None
    exponential: Exponential | None = None


def _power(base: str, power: int) -> str:
    if power == 0:
        return ""
    return base if power == 1 else base + str(power).translate(_SUPERSCRIPTS)


def _as_number(value: object, name: str) -> float:
    if type(value) is float and math.isfinite(value):
        return value
    if isinstance(value, bool) or not isinstance(value, Real):
        raise _wrong(name, "a number", value, argument=name, advice=_ESTIMATED)
    try:
        number = float(value)
    except OverflowError:  # an integer
        number = math.inf
    if not math.isfinite(number):
        raise _wrong(name, "finite", value, argument=name, advice=_ESTIMATED)
    return number


def _wrong(what: str, expected: str, got: object, argument: str, advice: str = "") -> ModelError:
    # A literal message: the parameter of a process is no option of the command line.
    return ModelError(
        f"{what} must be {expected}; got {got!r}", argument=argument, expected=expected, got=got, advice=advice
    )


@dataclass(frozen=True)
class Physical:
    """Coefficient of a process in continuous time, as datasheets state it.

    Parameters
    ----------
    symbol : str
        Symbol, for example "N".
    title : str
        Name, for example "white noise density".
    value : float
        Value in (unit of the signal)^`signal_power` · s^`time_power`. Only the slope of a drift can be negative.
    time_power : float
        Exponent of the second in the unit: 1, ½, 0, −½ or −1.
    signal_power : int
        Exponent of the unit of the signal: 1, or 0 for a time, a frequency or a pure number.
    slopes : mapping of parameter name to float
        Derivative ∂ ln|value| / ∂ ln|θ| for each parameter θ on which the value depends.
    """

    symbol: str
    title: str
    value: float
    time_power: float
    signal_power: int = 1
    slopes: Mapping[str, float] = field(default_factory=dict)


Dominant = Literal["quantization", "white", "markov"]
"""Noise of the first two levels: steeper than ("quantization"), as ("white") or flatter than white ("markov")."""


@dataclass(frozen=True, eq=False)
class Occasion:
    """Data for Algorithms 2 and 3 of Balamuta et al. (see `Sampled`): σ̂_T² (`total`, over all levels), `spread` (max x
    − min x)/N, `dominant` noise, and the condition of each draw's `first` autoregression."""

    total: float
    spread: float
    dominant: Dominant
    first: NDArray[np.int64]
    levels: NDArray[np.int64]
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
