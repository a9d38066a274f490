"""The law of the classical over the robust wavelet variance in Gaussian noise: its spread, and how it is skewed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.covariance.api import ratio_variances
from gmwm.covariance.design import Design
from gmwm.covariance.mixture import mixture
from gmwm.covariance.robust import ratio_skewness
from gmwm.processes.model import ModelLike, as_model
from gmwm.variance.result import WaveletVariance

_OVERLAP = 1.3
"""Overlapping coefficients make the ratio the more skewed: 1.1 to 1.45 times, in simulations."""
_MEDIAN_EFFICIENCY = 0.3675
"""Of (MAD / 0.67449)², to which the robust estimate falls back."""


def ratio_errors(robust: WaveletVariance, tested: NDArray[np.bool_], model: ModelLike | None) -> Vector:
    """Standard errors of log(classical / robust) at those levels that are `tested`, in noise with the robust variance.

    Parameters
    ----------
    robust : WaveletVariance
        J levels.
    tested : (J,) bool array
    model : Model, Process or str, optional
        For the correlations, with all its values; by default the likeliest mixture of all processes.

    Returns
    -------
    array, one for each level that is tested
    """
    if not np.any(tested):
        return np.empty(0)
    whole = Design.of(robust)
    if model is None:
        there = robust.variance > 0
        # By a power of two, which changes no digit, so that fourth powers stay in range.
        unit = 4.0 ** np.floor(0.5 * np.log2(robust.variance.max()))
        design = whole.only(there)
        _, noise = mixture(robust.variance[there] / unit, robust.degrees_of_freedom[there], design)
    else:
        noise = as_model(model)
    square = ratio_variances(noise, whole.only(tested))
    assert robust.efficiency is not None
    beyond = 2 / robust.efficiency - 2
    # Where the curve is that of a drift alone, or of no noise that there is: as if one coefficient in 2^j told more.
    square = np.where(square > 0, square, beyond / whole.degrees_of_freedom[tested])
    outcomes = robust.diagnostics.get("robust", {}).get("outcome", ["root"] * len(robust))
    fallen = np.array([outcome == "mad" for outcome in outcomes])[tested]
    square *= np.where(fallen, max((2 / _MEDIAN_EFFICIENCY - 2) / beyond, 1.0), 1.0)
    return np.sqrt(square)


def ratio_law(place: Vector, error: Vector, efficiency: float) -> tuple[Vector, Vector]:
    """The gamma law of the skewness that the ratio has: its shape, and where it has what `place` is for the ratio.

    log(classical / robust) / error is taken for (G − k) / √k, G of a gamma law of shape k. So `gammaincc` of the two is
    the probability of a larger one; `place` counts from 0 in standard errors.
    """
    shape = (2 / (_OVERLAP * ratio_skewness(efficiency) * error)) ** 2
    return shape, np.maximum(shape + place * np.sqrt(shape), 0.0)
