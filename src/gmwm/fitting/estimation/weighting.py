"""Weighting matrix Ω of the objective (ν̂ − ν)ᵀ Ω (ν̂ − ν)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.remarks import Remark
from gmwm.measuring.covariance.mixture import smoothed
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model

Weighting = Literal["diagonal", "optimal", "identity"] | ArrayLike
"""Weighting of the levels: "diagonal", "optimal", "identity", a (J,) diagonal or a (J, J) matrix."""


def usual_weighting(model: Model, wv: WaveletVariance | None = None) -> Literal["diagonal", "optimal"]:
    """Return "optimal" for several free shapes (docs/validation/weighting.md) or moments at lags, else "diagonal"."""
    several = (wv is not None and bool(np.any(wv.levels < 0))) or any(
        sum(not process.is_fixed(p.name) for p in process.nonlinear_parameters()) > 1 for process in model.processes
    )
    return "optimal" if several else "diagonal"


def sampling_variance(wv: WaveletVariance) -> Vector:
    """Approximate the variance of ν̂_j² from the data, Var ν̂_j² ≈ 2 ν̄_j⁴ / η_j, in unit⁴, with ν̂² smoothed at levels
    with few coefficients. For a robust ν̂², η_j times the efficiency gives an upper bound."""
    return 2 * smoothed(wv) ** 2 / wv.degrees_of_freedom


def weighting_matrix(weighting: Weighting, wv: WaveletVariance) -> Matrix:
    """Return Ω (J, J), unit⁻⁴, without a model: 1 / `sampling_variance`, or a given diagonal or matrix."""
    size = len(wv)
    if isinstance(weighting, str):
        if weighting == "identity":
            return np.eye(size)
        if weighting != "diagonal":
            raise OptionError(
                argument="weighting", expected="'diagonal', 'optimal', 'identity' or a matrix", got=weighting
            )
        if not np.all(wv.variance > 0):
            zero = ", ".join(str(j) for j in wv.levels[wv.variance <= 0])
            raise DataError(
                f"the wavelet variance is zero at level {zero}, because the signal is constant or coarsely quantized: "
                "diagonal weights do not exist",
                advice="Use the classical wavelet variance with {--robust=no}."
                if wv.robust
                else "Record with more bits or a smaller measurement range, or check the sensor.",
            )
        with np.errstate(over="ignore", divide="ignore", under="ignore"):
            weights = 1 / sampling_variance(wv)
        if not (np.all(np.isfinite(weights)) and np.all(weights > 0)):
            raise DataError(
                "the squares of the wavelet variance exceed the range of double precision",
                advice="Scale the signal to another unit.",
            )
        return np.diag(weights)
    try:
        matrix = np.asarray(weighting, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise OptionError(
            argument="weighting", expected="'diagonal', 'optimal', 'identity' or a matrix of numbers", got=weighting
        ) from error
    if matrix.shape not in ((size,), (size, size)):
        raise OptionError(
            f"weighting must be a vector of {size} or a {size} x {size} matrix; got shape {matrix.shape}",
            argument="weighting",
            got=matrix.shape,
        )
    if bad := int(np.count_nonzero(~np.isfinite(matrix))):
        raise OptionError(
            f"weighting must be finite; {bad} of {matrix.size} weights are NaN or infinite", argument="weighting"
        )
    if matrix.ndim == 1:
        matrix = np.diag(matrix)
    largest = np.abs(matrix).max()
    if not np.allclose(matrix, matrix.T, rtol=1e-9, atol=1e-12 * float(largest)):
        raise OptionError("weighting must be a symmetric matrix; it differs from its transpose", argument="weighting")
    return (matrix + matrix.T) / 2


def weighting_remarks(matrix: Matrix, wv: WaveletVariance) -> tuple[Remark, ...]:
    """Return a remark if the weights of a user look like a covariance that was not inverted: their diagonal agrees with
    the variances V_jj at every usable level, and differs much from 1 / V_jj at one."""
    # Levels with a relative standard error of at most 1/2 (tests/estimation/test_weights.py).
    usable = (wv.degrees_of_freedom >= 8.0) & (wv.variance > 0) & (np.diag(matrix) > 0)
    if np.count_nonzero(usable) < 3 or not np.all(wv.variance > 0):
        return ()
    weights, variance = np.log(np.diag(matrix)[usable]), np.log(sampling_variance(wv)[usable])
    # Factor to V_jj within which a weight looks like a variance (tests/estimation/test_weights.py).
    like_covariance = np.all(np.abs(weights - variance) < math.log(5.0))
    # Factor to 1 / V_jj of one weight: near 1 unit⁴, V_jj and 1 / V_jj cannot be distinguished.
    if like_covariance and np.any(np.abs(weights + variance) > math.log(1000.0)):
        return (Remark.of("weights-are-covariance", wv.axis),)
    return ()


def no_noise(model: object) -> ModelError:
    """Return the error for a model whose wavelet variance has no random error at some level."""
    return ModelError(
        f"{model} as estimated has no noise at some level, so its estimates would be exact",
        advice="Add WN to the model. If it has WN, the signal has a line or a ramp without noise, or parts with "
        "different noise: look at it with {gmwm info}, and leave these parts out with {--skip}.",
    )


def precision(covariance: Matrix) -> Matrix:
    """Return V⁻¹, scaled to unit diagonal, with eigenvalues above rounding; ModelError if a variance is zero."""
    scale = np.sqrt(np.diag(covariance))
    if not (np.all(np.isfinite(scale)) and np.all(scale > 0)):
        raise no_noise("the model")
    share, axes = np.linalg.eigh(covariance / scale[:, None] / scale[None, :])
    share = np.maximum(share, share[-1] * share.size * np.finfo(float).eps)
    inverse = (axes / share) @ axes.T / scale[:, None] / scale[None, :]
    return np.asarray((inverse + inverse.T) / 2)


@dataclass(frozen=True, eq=False)
class Weights:
    """Weighting matrix Ω (J, J), and what depends on it only."""

    matrix: Matrix
    tables: dict[object, Any] = field(default_factory=dict)
    """Tables under these weights, which searches keep; by `gmwm.estimation.atoms.ShapeGrid`."""

    @cached_property
    def root(self) -> Matrix:
        """Matrix L (J, J) with LᵀL = Ω; see `square_root`."""
        return square_root(self.matrix)

    @cached_property
    def positive(self) -> Vector:
        """Vector L⁻ᵀ √diag Ω (J,), whose inner product with every weighted wavelet variance is positive."""
        return np.ascontiguousarray(np.linalg.solve(self.root.T, np.sqrt(np.diag(self.matrix))))


def square_root(matrix: Matrix) -> Matrix:
    """Return the upper Cholesky factor L, LᵀL = Ω, of unit diagonal first; OptionError unless positive definite."""
    diagonal = np.diag(matrix)
    if np.all(diagonal > 0):
        scale = np.sqrt(diagonal)
        try:
            factor = np.linalg.cholesky(matrix / scale[:, None] / scale[None, :])
        except np.linalg.LinAlgError:
            pass
        else:
            return np.ascontiguousarray(factor.T * scale)
    raise OptionError(
        "weighting must be a positive definite matrix; this one is not",
        argument="weighting",
        advice="Invert it if it is a covariance.",
    )
