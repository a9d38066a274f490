"""Distribution of the ratio of the classical to the robust wavelet variance in Gaussian noise."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Booleans, Vector
from gmwm.measuring.covariance.api import ratio_variances
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.covariance.robust import ratio_skewness
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import ModelLike, as_model


def ratio_errors(robust: WaveletVariance, tested: Booleans, model: ModelLike | None) -> Vector:
    """Compute the standard errors of log(ν̂²/ν̃²) in Gaussian noise at the levels in `tested`, for the classical ν̂²
    and the `robust` ν̃², with correlations of `model`, by default the likeliest mixture of all processes."""
    if not np.any(tested):
        return np.empty(0)
    whole = Design.of(robust)
    if model is None:
        there = robust.variance > 0
        # Scaling by a power of two causes no rounding error and keeps fourth powers within the range of numbers.
        unit = 4.0 ** np.floor(0.5 * np.log2(robust.variance.max()))
        design = whole.only(there)
        _, noise = mixture(robust.variance[there] / unit, robust.degrees_of_freedom[there], design)
    else:
        noise = as_model(model)
    square = ratio_variances(noise, whole.only(tested))
    assert robust.efficiency is not None
    beyond = 2 / robust.efficiency - 2
    # If the model has no noise, only a drift, one in 2^j coefficients counts as independent.
    square = np.where(square > 0, square, beyond / whole.degrees_of_freedom[tested])
    outcomes = robust.diagnostics.get("robust", {}).get("outcome", ["root"] * len(robust))
    fallen = np.array([outcome == "mad" for outcome in outcomes])[tested]
    # Gaussian efficiency of (MAD / 0.67449)², which replaces a robust estimate without a root (Rousseeuw and Croux
    # 1993, JASA 88).
    square *= np.where(fallen, max((2 / 0.3675 - 2) / beyond, 1.0), 1.0)
    return np.sqrt(square)


def ratio_law(place: Vector, error: Vector, efficiency: float) -> tuple[Vector, Vector]:
    """Approximate the distribution of log(ν̂²/ν̃²) / `error` by (G − k) / √k with a gamma variable G of the same
    skewness. Returns the shape k, and the argument of `scipy.special.gammaincc` for a larger ratio than `place`."""
    # Factor by which overlapping coefficients increase the skewness; it is 1.1 to 1.45 in simulations.
    # tests/covariance/test_ratio.py and docs/validation/contamination-test.md measure the size of the resulting test.
    shape = (2 / (1.3 * ratio_skewness(efficiency) * error)) ** 2
    return shape, np.maximum(shape + place * np.sqrt(shape), 0.0)
