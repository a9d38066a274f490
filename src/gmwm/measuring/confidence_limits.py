"""Confidence limits of a variance by the chi-square rule."""

from __future__ import annotations

from gmwm.base.arrays import Vector
from gmwm.recording.options import as_confidence


def chi_square_limits(variance: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Return the lower and upper limits of variances V with η degrees of freedom, by the chi-square rule (Percival
    1995): η V / q_{(1 + c)/2} and η V / q_{(1 − c)/2}, with the quantiles q_p of χ²_η and the confidence c. Raises
    OptionError if `confidence` is not a number from 0.5 to below 1."""
    from scipy.special import gammaincinv

    half = freedom / 2
    tail = (1 - as_confidence(confidence)) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
