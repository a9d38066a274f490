"""The weighting matrix Ω of the criterion (ν̂ − ν)ᵀ Ω (ν̂ − ν)."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Matrix, Vector
from gmwm.covariance.mixture import smoothed
from gmwm.errors import DataError, ModelError, OptionError
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.variance.result import WaveletVariance

Weighting = Literal["diagonal", "optimal", "identity"] | ArrayLike
"""How levels are weighted: "diagonal", "optimal", "identity", a (J,) diagonal or a (J, J) matrix."""


WELL_KNOWN = 8.0
"""Degrees of freedom from which on the variance of a level is known to a small factor."""


def usual_weighting(model: Model) -> Literal["diagonal", "optimal"]:
    """Levels by themselves where a parameter or none makes a shape; with what they have in common where more do."""
    several = any(
        sum(not process.is_fixed(p.name) for p in process.nonlinear_parameters()) > 1 for process in model.processes
    )
    return "optimal" if several else "diagonal"


def sampling_variance(wv: WaveletVariance) -> Vector:
    """Var ν̂_j² ≈ 2 ν̄_j⁴ / η_j from the data alone, in unit⁴; ν̄² is ν̂², smoothed where it is of few coefficients.

    η_j = max(M_j / 2^j, 1), times the efficiency where ν̂² is robust: the safe bound of its larger variance.
    """
    return 2 * smoothed(wv) ** 2 / wv.degrees_of_freedom


def weighting_matrix(weighting: Weighting, wv: WaveletVariance) -> Matrix:
    """Ω as a (J, J) matrix, in unit⁻⁴, from the data alone.

    Parameters
    ----------
    weighting : "diagonal", "identity", or (J,) or (J, J) array
        "diagonal" is 1 / `sampling_variance`; a vector is taken as a diagonal.

    Raises
    ------
    DataError
        If a level has zero variance, which "diagonal" cannot weigh.
    OptionError
        If the matrix has the wrong shape, is not finite, or is not symmetric and positive definite.
    """
    size = len(wv)
    if isinstance(weighting, str):
        if weighting == "identity":
            return np.eye(size)
        if weighting != "diagonal":
            raise OptionError(f"weighting must be 'diagonal', 'optimal', 'identity' or a matrix, got {weighting!r}")
        if not np.all(wv.variance > 0):
            zero = ", ".join(str(j) for j in wv.levels[wv.variance <= 0])
            raise DataError(
                f"the wavelet variance is zero at level {zero}: a constant or coarsely quantised signal, which "
                "weighting='diagonal' cannot weigh; pass weighting='identity', your own matrix, or "
                f"{'robust=False' if wv.robust else 'other data'}"
            )
        with np.errstate(over="ignore", divide="ignore", under="ignore"):
            weights = 1 / sampling_variance(wv)
        if not (np.all(np.isfinite(weights)) and np.all(weights > 0)):
            raise DataError(
                f"the wavelet variance runs from {wv.variance.min():g} to {wv.variance.max():g}, whose squares leave "
                "the range of double precision; give the signal in a larger or smaller unit"
            )
        return np.diag(weights)
    try:
        matrix = np.asarray(weighting, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"weighting must be numbers, or 'diagonal', 'optimal' or 'identity'; {error}") from error
    if matrix.shape not in ((size,), (size, size)):
        raise OptionError(f"weighting must be a vector of {size} or a {size} x {size} matrix, got shape {matrix.shape}")
    if bad := int(np.count_nonzero(~np.isfinite(matrix))):
        raise OptionError(f"weighting must be finite, {bad} of its {matrix.size} weights are NaN or infinite")
    if matrix.ndim == 1:
        matrix = np.diag(matrix)
    largest = np.abs(matrix).max()
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * float(largest)):
        raise OptionError("weighting must be a symmetric matrix, this one differs from its transpose")
    return (matrix + matrix.T) / 2


def weighting_remarks(matrix: Matrix, wv: WaveletVariance) -> tuple[Remark, ...]:
    """What is to be known of weights of the user's, in words: whether they are a covariance that was not inverted.

    They are taken for one where they are as large as V_jj at every level that is well known, and at some of these far
    from 1 / V_jj.
    """
    known = (wv.degrees_of_freedom >= WELL_KNOWN) & (wv.variance > 0) & (np.diag(matrix) > 0)
    if np.count_nonzero(known) < 3 or not np.all(wv.variance > 0):
        return ()
    weights, variance = np.log(np.diag(matrix)[known]), np.log(sampling_variance(wv)[known])
    if np.all(np.abs(weights - variance) < math.log(5)) and np.any(np.abs(weights + variance) > math.log(1000)):
        return (Remark.of("weights-are-covariance", wv.axis),)
    return ()


def precision(covariance: Matrix) -> Matrix:
    """V⁻¹ (J, J), from V scaled to unit diagonal: levels differ by many powers of ten, their correlations do not.

    A direction whose share of the scatter is below rounding is taken to have that of rounding.

    Raises
    ------
    ModelError
        If a level has no variance at all.
    """
    scale = np.sqrt(np.diag(covariance))
    if not (np.all(np.isfinite(scale)) and np.all(scale > 0)):
        raise ModelError(
            "the model as estimated has no noise at some level: its covariance cannot be inverted; give it more terms, "
            "as WN(), or take weighting='diagonal'"
        )
    share, axes = np.linalg.eigh(covariance / scale[:, None] / scale[None, :])
    share = np.maximum(share, share[-1] * share.size * np.finfo(float).eps)
    inverse = (axes / share) @ axes.T / scale[:, None] / scale[None, :]
    return np.asarray((inverse + inverse.T) / 2)


def square_root(matrix: Matrix) -> Matrix:
    """Upper triangular L with LᵀL = Ω, from the Cholesky factor of Ω scaled to unit diagonal.

    Raises
    ------
    OptionError
        If Ω is not positive definite.
    """
    diagonal = np.diag(matrix)
    if np.all(diagonal > 0):
        scale = np.sqrt(diagonal)
        try:
            factor = np.linalg.cholesky(matrix / scale[:, None] / scale[None, :])
        except np.linalg.LinAlgError:
            pass
        else:
            return np.ascontiguousarray(factor.T * scale)
    raise OptionError("weighting must be positive definite, this matrix is not; is it a covariance not yet inverted?")
