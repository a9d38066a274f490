"""Confidence limits of a variance by the chi-square rule."""

from __future__ import annotations

from numbers import Real

from gmwm._arrays import Vector
from gmwm.errors import OptionError


def chi_square_limits(variance: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Limits η V / χ²_η(1 ∓ …) of a variance V with η degrees of freedom (Percival 1995).

    Raises
    ------
    OptionError
        If `confidence` does not lie between 0 and 1.
    """
    from scipy.special import gammaincinv

    if not isinstance(confidence, float | Real) or not 0 < confidence < 1:
        raise OptionError(f"confidence must lie between 0 and 1, got {confidence!r}; 95 % is 0.95")
    half = freedom / 2
    tail = (1 - float(confidence)) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
