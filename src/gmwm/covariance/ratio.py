"""The distribution of the ratio of the classical to the robust wavelet variance in Gaussian noise."""

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
"""Factor of the skewness for overlapping coefficients, 1.1 to 1.45 in simulations. tests/covariance/test_ratio.py and
docs/validation/contamination-test.md have the size of the resulting test."""
_MEDIAN_EFFICIENCY = 0.3675
"""Gaussian efficiency of (MAD / 0.67449)², the fallback of the robust estimate (Rousseeuw and Croux 1993, JASA 88)."""


def ratio_errors(robust: WaveletVariance, tested: NDArray[np.bool_], model: ModelLike | None) -> Vector:
    """Compute standard errors of log(classical / robust) at the levels that are `tested`, in noise with the robust
    variance.

    Parameters
    ----------
    robust : WaveletVariance
        Robust wavelet variance with J levels.
    tested : (J,) bool array
        Levels to compute.
    model : Model, Process or str, optional
        Model with all its values, for the correlations; by default the most likely mixture of all processes.

    Returns
    -------
    array with one number for each tested level
    """
    if not np.any(tested):
        return np.empty(0)
    whole = Design.of(robust)
    if model is None:
        there = robust.variance > 0
        # Scaling by a power of two changes no digit and keeps fourth powers in range.
        unit = 4.0 ** np.floor(0.5 * np.log2(robust.variance.max()))
        design = whole.only(there)
        _, noise = mixture(robust.variance[there] / unit, robust.degrees_of_freedom[there], design)
    else:
        noise = as_model(model)
    square = ratio_variances(noise, whole.only(tested))
    assert robust.efficiency is not None
    beyond = 2 / robust.efficiency - 2
    # If the curve has no noise, as for a drift alone, count one independent coefficient in 2^j.
    square = np.where(square > 0, square, beyond / whole.degrees_of_freedom[tested])
    outcomes = robust.diagnostics.get("robust", {}).get("outcome", ["root"] * len(robust))
    fallen = np.array([outcome == "mad" for outcome in outcomes])[tested]
    square *= np.where(fallen, max((2 / _MEDIAN_EFFICIENCY - 2) / beyond, 1.0), 1.0)
    return np.sqrt(square)


def ratio_law(place: Vector, error: Vector, efficiency: float) -> tuple[Vector, Vector]:
    """Approximate the distribution of the ratio by a gamma distribution with its skewness: shape k and argument for
    `gammaincc`.

    log(classical / robust) / error is distributed approximately as (G − k) / √k, with G gamma-distributed with shape k.
    `gammaincc` of the two results is the probability of a larger ratio. `place` is in standard errors from 0.
    """
    shape = (2 / (_OVERLAP * ratio_skewness(efficiency) * error)) ** 2
    return shape, np.maximum(shape + place * np.sqrt(shape), 0.0)
