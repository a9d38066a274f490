"""Confidence limits of a variance by the chi-square rule."""

from __future__ import annotations

from gmwm.base.arrays import Vector
from gmwm.recording.options import as_confidence


def chi_square_limits(variance: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Return the lower and upper confidence limits of variances V with η degrees of freedom (Percival 1995).

    With the quantile q_p of the χ² distribution with η degrees of freedom and the confidence c, the limits are
    η V / q_{(1 + c)/2} and η V / q_{(1 − c)/2}.

    Raises
    ------
    OptionError
        If `confidence` is not a number from 0.5 to below 1.
    """
    from scipy.special import gammaincinv

    half = freedom / 2
    tail = (1 - as_confidence(confidence)) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
