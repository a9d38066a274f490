"""The weighting matrix Ω of the criterion (ν̂ − ν)ᵀ Ω (ν̂ − ν)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Matrix, Vector, require_finite
from gmwm.covariance.mixture import smoothed
from gmwm.errors import DataError, ModelError, OptionError
from gmwm.variance.result import WaveletVariance

Weighting = Literal["diagonal", "optimal", "identity"] | ArrayLike
"""How levels are weighted: "diagonal", "optimal", "identity", a (J,) diagonal or a (J, J) matrix."""


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
        If the matrix has the wrong shape, or is not symmetric and positive definite.
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
    matrix = np.asarray(weighting, dtype=np.float64)
    if matrix.ndim == 1:
        matrix = np.diag(matrix)
    if matrix.shape != (size, size):
        raise OptionError(f"weighting must be a vector of {size} or a {size} x {size} matrix, got shape {matrix.shape}")
    require_finite(matrix.ravel(), "weighting")
    largest = np.abs(matrix).max()
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * float(largest)):
        raise OptionError("weighting must be a symmetric matrix, this one differs from its transpose")
    return (matrix + matrix.T) / 2


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
        raise ModelError("the model as estimated has no noise at some level: its covariance cannot be inverted")
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
