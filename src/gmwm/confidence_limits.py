"""Confidence limits of a variance by the chi-square rule."""

from __future__ import annotations

from gmwm._arrays import Vector
from gmwm.options import as_confidence


def chi_square_limits(variance: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Limits η V / χ²_η(1 ∓ …) of a variance V with η degrees of freedom (Percival 1995).

    Raises
    ------
    OptionError
        If `confidence` is not a number from 0.5 to below 1.
    """
    from scipy.special import gammaincinv

    half = freedom / 2
    tail = (1 - as_confidence(confidence)) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
