"""Straight lines in an Allan deviation: the power law and the unit of each noise term, and fitted lines."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.units import datasheet_units, find_unit, noise_unit
from gmwm.recording.options import one_of

Term: TypeAlias = Literal["Q", "N", "B", "K", "R"]
"""Noise terms of IEEE Std 952: quantization noise, angle or velocity random walk, bias instability, rate random walk
and rate ramp."""


@dataclass(frozen=True)
class _Law:
    """Power law of a term, σ(τ) = factor · coefficient · τ^slope, by IEEE Std 952."""

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


def coefficient_unit(term: Term, unit: str, units: Literal["si", "datasheet"] = "si") -> tuple[str, float]:
    """Return the unit of a coefficient for data in `unit`, and the factor from the unit of the data and seconds to it.

    >>> name, factor = coefficient_unit("N", "rad/s", "datasheet")
    >>> name, round(factor, 3)
    ('deg/√h', 3437.747)
    """
    one_of(units, "units", ("si", "datasheet"))
    if units == "datasheet" and find_unit(unit) is None:
        raise OptionError(
            f"datasheet units need an angular rate or an acceleration; the data have {unit or 'no unit'}",
            argument="unit",
            got=unit,
            advice="Use {--units=si}.",
        )
    si, factor = noise_unit(-LAWS[term].slope, unit, empty="unit")
    if units == "si":
        return si, factor
    name, size = next(iter(datasheet_units(si).items()))
    return name, size * factor


@dataclass(frozen=True, kw_only=True)
class SlopeLine:
    """Line of fixed slope that was fitted to a range of an Allan deviation.

    Parameters
    ----------
    term : str
        Noise term: "Q", "N", "B", "K" or "R".
    coefficient : float
        Coefficient of the term, in the unit of the data and seconds.
    first, last, points : float, float, int
        First and last averaging times (s) of the range, and number of values that were used.
    bound : bool
        Whether the coefficient is only an upper bound: the bias instability of a curve that still falls at its end.
    """

    term: Term
    coefficient: float
    first: float
    last: float
    points: int
    bound: bool = False

    @property
    def slope(self) -> float:
        """Slope of the line in the logarithmic plot."""
        return LAWS[self.term].slope

    @property
    def name(self) -> str:
        """Name of the coefficient, for example "white noise density"."""
        return LAWS[self.term].name

    @property
    def reading_time(self) -> float:
        """Averaging time (s) at which the line has the value of its coefficient; for B the minimum of the curve."""
        law = LAWS[self.term]
        return self.first if law.slope == 0 else float(law.factor ** (-1 / law.slope))

    def deviation(self, tau: ArrayLike) -> Vector:
        """Compute the Allan deviation of the line at the averaging times `tau` (s)."""
        law = LAWS[self.term]
        return np.asarray(law.factor * self.coefficient * np.asarray(tau, dtype=np.float64) ** law.slope)
