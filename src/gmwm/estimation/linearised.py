"""Linearisation of a fit near its estimate: the covariance of the parameters, and the residuals that they cannot
explain."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.covariance import Design
from gmwm.estimation.weighting import square_root
from gmwm.processes.model import Model

COLLINEAR = 1e-9
"""Relative singular value of the Jacobian below which a direction of the parameters is not determined. Pinned by
tests/inference/test_plan.py: parameters with the same effect on the curve have infinite standard errors."""
NO_COEFFICIENT = 1e-8
"""Value that replaces a coefficient φ = 0, because errors are relative to values."""


def relative_covariance(slopes: Matrix, matrix: Matrix, wavelet: Matrix) -> Matrix:
    """Compute B V Bᵀ (p, p) for a Jacobian D (J, p); infinite for parameters that the Jacobian does not determine."""
    if slopes.shape[1] == 0:
        return np.zeros((0, 0))
    root = square_root(matrix)
    gain, lost = parameter_gain(root @ slopes)
    gain = gain @ root
    result = np.asarray(gain @ wavelet @ gain.T)
    result[lost] = result[:, lost] = 0.0
    result[lost, lost] = np.inf
    return (result + result.T) / 2


def parameter_gain(weighted: Matrix) -> tuple[Matrix, NDArray[np.bool_]]:
    """Return the pseudoinverse (p, J) of a weighted Jacobian LD (J, p), and the parameters that it does not determine
    (p,)."""
    length = np.linalg.norm(weighted, axis=0)
    seen = length > 0
    left, strength, right = np.linalg.svd(weighted[:, seen] / length[seen], full_matrices=False)
    clear = strength > COLLINEAR * strength.max(initial=0.0)
    gain = np.zeros(weighted.shape[::-1])
    gain[seen] = (right[clear].T / strength[clear]) @ left[:, clear].T / length[seen, None]
    lost = ~seen
    lost[seen] = 1 - np.sum(right[clear] ** 2, axis=0) > 1e-12
    return gain, lost


def unexplained(left: Vector, slopes: Matrix) -> tuple[float, int]:
    """Return the squared length of a vector (J,) without its part in the span of some columns (J, p), and the rank of
    the columns."""
    length = np.linalg.norm(slopes, axis=0)
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    clear = strength > COLLINEAR * strength.max(initial=0.0)
    taken = axes[:, clear].T @ left
    return float(left @ left - taken @ taken), int(np.count_nonzero(clear))


def columns_of(model: Model, acts_as: Mapping[str, str]) -> tuple[list[str], set[str]]:
    """Return the names of the free parameters, and the subset that is reported."""
    columns, reported = [], set()
    for term, process in zip(model.terms, model.processes, strict=True):
        if process.scale == 0:
            continue
        for parameter in process.parameters:
            name = f"{term}.{parameter.name}"
            if process.is_fixed(parameter.name) or (term in acts_as and parameter.scale_power is None):
                continue
            columns.append(name)
            if term not in acts_as:
                reported.add(name)
    return columns, reported


def relative_jacobian(model: Model, design: Design, names: list[str] | tuple[str, ...]) -> Matrix:
    """Compute θ ∂ν_j²/∂θ (J, p) for the parameters `names`."""
    jacobian = model.jacobian(design.levels, design.rate, design.filter)
    place = {name: k for k, name in enumerate(model.names)}
    values = sizes_of(model, names)
    return np.asarray(jacobian[:, [place[name] for name in names]] * values)


def sizes_of(model: Model, names: list[str] | tuple[str, ...]) -> Vector:
    """Return the values of parameters, with `NO_COEFFICIENT` for a coefficient of exactly zero."""
    values = np.array([model.parameters[name] for name in names], dtype=np.float64)
    return np.where(values == 0, NO_COEFFICIENT, values)
