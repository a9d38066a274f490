"""The lines of an Allan deviation: the law of each term, its units, and a line fitted to a stretch of a curve."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector
from gmwm.errors import OptionError
from gmwm.units import STANDARD_GRAVITY, find_unit

Term: TypeAlias = Literal["Q", "N", "B", "K", "R"]
"""Quantization noise, angle or velocity random walk, bias instability, rate random walk, rate ramp."""


@dataclass(frozen=True)
class _Law:
    """σ(τ) = factor · coefficient · τ^slope, by IEEE Std 952."""

    name: str
    slope: float
    factor: float


LAWS: dict[Term, _Law] = {
    "Q": _Law("quantization noise", -1.0, math.sqrt(3)),
    "N": _Law("angle or velocity random walk", -0.5, 1.0),
    "B": _Law("bias instability", 0.0, math.sqrt(2 * math.log(2) / math.pi)),
    "K": _Law("rate random walk", 0.5, 1 / math.sqrt(3)),
    "R": _Law("rate ramp", 1.0, 1 / math.sqrt(2)),
}
"""The terms of an Allan deviation, by ascending slope."""

_DEGREE = 180 / math.pi
_SI_UNITS: dict[str, dict[Term, str]] = {
    "gyro": {"Q": "rad", "N": "rad/s/√Hz", "B": "rad/s", "K": "rad/s/√s", "R": "rad/s²"},
    "accel": {"Q": "m/s", "N": "m/s²/√Hz", "B": "m/s²", "K": "m/s²/√s", "R": "m/s³"},
}
_DATASHEET: dict[str, dict[Term, tuple[str, float]]] = {
    "gyro": {
        "Q": ("arcsec", _DEGREE * 3600),
        "N": ("deg/√h", _DEGREE * 60),
        "B": ("deg/h", _DEGREE * 3600),
        "K": ("deg/h/√h", _DEGREE * 3600 * 60),
        "R": ("deg/h/h", _DEGREE * 3600 * 3600),
    },
    "accel": {
        "Q": ("m/s", 1.0),
        "N": ("m/s/√h", 60.0),
        "B": ("mg", 1e3 / STANDARD_GRAVITY),
        "K": ("mg/√h", 60e3 / STANDARD_GRAVITY),
        "R": ("mg/h", 3600e3 / STANDARD_GRAVITY),
    },
}


def coefficient_unit(term: Term, unit: str, units: Literal["si", "datasheet"] = "si") -> tuple[str, float]:
    """The unit of a coefficient of data in `unit`, and the factor to it from the unit of the data and seconds.

    >>> coefficient_unit("N", "rad/s", "datasheet")
    ('deg/√h', 3437.746770784939)
    """
    if units not in ("si", "datasheet"):
        raise OptionError(f"units must be 'si' or 'datasheet', got {units!r}")
    known = find_unit(unit)
    if known is None:
        if units == "datasheet":
            raise OptionError(f'units="datasheet" needs an angular rate or an acceleration, got {unit or "no unit"!r}')
        name = unit or "unit"
        return {"Q": f"{name}·s", "N": f"{name}/√Hz", "B": name, "K": f"{name}/√s", "R": f"{name}/s"}[term], 1.0
    if units == "si":
        return _SI_UNITS[known.quantity][term], known.factor
    name, factor = _DATASHEET[known.quantity][term]
    return name, known.factor * factor


@dataclass(frozen=True)
class SlopeLine:
    """One line of fixed slope through a stretch of an Allan deviation.

    Parameters
    ----------
    term : str
        "Q", "N", "B", "K" or "R".
    coefficient : float
        Its coefficient, in the unit of the data and seconds.
    first, last : float
        Averaging times between which it was fitted (s).
    points : int
        How many values of the deviation it was fitted to.
    bound : bool
        The curve still falls at its end: the bias instability is at most this.
    """

    term: Term
    coefficient: float
    first: float
    last: float
    points: int
    bound: bool = False

    @property
    def slope(self) -> float:
        """Slope in the logarithmic plot."""
        return LAWS[self.term].slope

    @property
    def name(self) -> str:
        """What it stands for."""
        return LAWS[self.term].name

    @property
    def reading_time(self) -> float:
        """τ at which the line passes through its coefficient (s): √3, 1, 3, √2; for B the time of the minimum."""
        law = LAWS[self.term]
        return self.first if law.slope == 0 else float(law.factor ** (-1 / law.slope))

    def deviation(self, tau: ArrayLike) -> Vector:
        """Height of the line at averaging times (s)."""
        law = LAWS[self.term]
        return np.asarray(law.factor * self.coefficient * np.asarray(tau, dtype=np.float64) ** law.slope)
