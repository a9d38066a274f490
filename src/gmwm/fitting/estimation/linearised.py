"""Linearisation of a fit near its estimate, for the covariance of the parameters and for tests of the residuals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Booleans, Matrix, Vector, freeze
from gmwm.fitting.estimation.weighting import square_root
from gmwm.measuring.covariance import Design
from gmwm.theory.processes.model import Model

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit

COLLINEAR_SINGULAR_VALUE = 1e-9
"""Relative singular value of the Jacobian below which a direction is not determined (tests/inference/test_plan.py)."""


def relative_covariance(slopes: Matrix, matrix: Matrix, wavelet: Matrix) -> Matrix:
    """Compute the covariance B V Bᵀ (p, p) of parameters, B = (DᵀΩD)⁻¹DᵀΩ, from D = `slopes`, Ω = `matrix` and V =
    `wavelet`. The variance of a parameter that the Jacobian does not determine is infinite."""
    if slopes.shape[1] == 0:
        return np.zeros((0, 0))
    root = square_root(matrix)
    gain, lost = parameter_gain(root @ slopes)
    gain = gain @ root
    result = np.asarray(gain @ wavelet @ gain.T)
    result[lost] = result[:, lost] = 0.0
    result[lost, lost] = np.inf
    return (result + result.T) / 2


def usable_in(design: Design) -> Booleans:
    """Return a mask (J,) of the levels with enough degrees of freedom for a test, which then has its size
    (docs/validation/goodness.md and recordings.md). The two coarsest levels of a recording are left out."""
    return np.asarray(design.degrees_of_freedom > 3.0)


def parameter_gain(weighted: Matrix) -> tuple[Matrix, Booleans]:
    """Return the pseudoinverse (p, J) of a weighted Jacobian (J, p), and a mask (p,) of undetermined ones."""
    length = np.linalg.norm(weighted, axis=0)
    seen = length > 0
    axes, strength, right = np.linalg.svd(weighted[:, seen] / length[seen], full_matrices=False)
    clear = strength > COLLINEAR_SINGULAR_VALUE * strength.max(initial=0.0)
    gain = np.zeros(weighted.shape[::-1])
    gain[seen] = (right[clear].T / strength[clear]) @ axes[:, clear].T / length[seen, None]
    lost = ~seen
    lost[seen] = 1 - np.sum(right[clear] ** 2, axis=0) > 1e-12
    return gain, lost


def square_of_rest(left: Vector, slopes: Matrix) -> tuple[float, int]:
    """Return the squared length of a vector (J,) orthogonal to columns (J, p), and their rank."""
    length = np.linalg.norm(slopes, axis=0)
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    clear = strength > COLLINEAR_SINGULAR_VALUE * strength.max(initial=0.0)
    taken = axes[:, clear].T @ left
    return float(left @ left - taken @ taken), int(np.count_nonzero(clear))


def columns_of(model: Model, acts_as: Mapping[str, str]) -> tuple[list[str], set[str]]:
    """Return the names of the estimated parameters, and the set of those that are reported. Of a term that acts as
    another process, the shape is not estimated and the scale is not reported."""
    columns, reported = [], set()
    for term, process in model.by_term.items():
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
    """Compute the derivatives θ ∂ν_j²/∂θ (J, p) with respect to the logarithms of the parameters `names`."""
    if not names:
        return np.empty((design.levels.size, 0))
    return np.asarray(model.jacobian(design.levels, design.rate, design.filter, names) * sizes_of(model, names))


def slopes_of(fit: Fit) -> Matrix:
    """Return the derivatives of `relative_jacobian` (J, p) for the estimated parameters of a fit; they are cached."""
    if "_slopes" not in fit.__dict__:
        columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
        fit.__dict__["_slopes"] = freeze(relative_jacobian(fit.model, Design.of(fit.wavelet_variance), columns))
    slopes: Matrix = fit.__dict__["_slopes"]
    return slopes


def sizes_of(model: Model, names: list[str] | tuple[str, ...]) -> Vector:
    """Return the values of the parameters `names`, with `NO_COEFFICIENT` for a coefficient of exactly zero."""
    parameters = model.parameters
    values = np.array([parameters[name] for name in names], dtype=np.float64)
    # Value that replaces a coefficient of exactly zero, because errors are relative to the values of parameters.
    return np.where(values == 0, 1e-8, values)
