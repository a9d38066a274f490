"""Newton's method, which determines the parameters of a local optimum to all digits.

The value of the objective determines them to half of the digits only, because it hardly changes near the optimum.
"""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.estimation.atoms import Place, shape_at, slope_at
from gmwm.fitting.estimation.problem import Problem
from gmwm.theory.processes.base import Process


def sharpen(
    problem: Problem, curved_class: type[Process], places: list[Place], weights: Vector, steps: int, reach: float
) -> list[Place] | None:
    """Refine the places of a local optimum by at most `steps` Newton steps; return None if the steps diverge. The
    objective |target − Σ w a − Σ x g(u)|² is minimised over the weights w and x and the places u together, where a are
    the unit vectors of the linear processes and g(u) those of the curved processes. Weights that are zero stay zero,
    places at an end of their branch stay there, and no step of a place may be longer than `reach`."""
    linear = len(problem.linear)
    moving = np.array([b.low < u < b.high for b, u in places], dtype=bool)
    if not moving.any() or np.any(weights[linear:] <= 0):
        return None
    fixed = problem.fixed[weights[:linear] > 0]
    x = np.concatenate([weights[:linear][weights[:linear] > 0], weights[linear:]])
    length: Matrix | None = None
    for _ in range(steps):
        value, slope, bend = _derivatives(problem, curved_class, places)
        if length is None:
            length = np.linalg.norm(value, axis=1, keepdims=True)
        value, slope, bend = value / length, slope / length, bend / length
        step = _step(problem.target, fixed, value=value, slope=slope, bend=bend, x=x, moving=moving)
        if step is None:
            return None
        x = x + step[: x.size]
        moves = np.zeros(len(places))
        moves[moving] = step[x.size :]
        places = [(b, float(u + d)) for (b, u), d in zip(places, moves, strict=True)]
        if not np.all(np.abs(moves) <= reach) or any(not b.low <= u <= b.high for b, u in places):
            return None
        # Change of the search coordinate below which the iteration ends. It is near the rounding error of the
        # parameter.
        if np.all(np.abs(moves) < 1e-12):
            break
    return places


def _step(
    target: Vector, fixed: Matrix, value: Matrix, slope: Matrix, bend: Matrix, x: Vector, moving: Vector
) -> Vector | None:
    """Return the Newton step of all weights, followed by the steps of the places that `moving` marks. `value`, `slope`
    and `bend` are the unit vectors of the curved processes and their first two derivatives, and `x` are the weights."""
    rows = np.concatenate([fixed, value])
    residual = target - x @ rows
    weight = x[fixed.shape[0] :, None]
    jacobian = np.concatenate([rows, (weight * slope)[moving]])
    hessian = jacobian @ jacobian.T
    at = rows.shape[0] + np.arange(int(np.count_nonzero(moving)))
    which = fixed.shape[0] + np.flatnonzero(moving)
    hessian[at, at] -= (weight * bend)[moving] @ residual
    hessian[which, at] -= slope[moving] @ residual
    hessian[at, which] = hessian[which, at]
    try:
        return np.asarray(np.linalg.solve(hessian, jacobian @ residual))
    except np.linalg.LinAlgError:
        return None


def _derivatives(problem: Problem, curved_class: type[Process], places: list[Place]) -> tuple[Matrix, Matrix, Matrix]:
    """Return the wavelet variances (n, J) of the curved processes at places, and their first two derivatives. The
    derivatives are with respect to the search coordinate, and all three arrays are multiplied by L."""
    # Step of the finite differences that give second derivatives. Their errors only slow the convergence.
    count, d = len(places), 1e-3
    points = [(b, np.array([u + shift])) for shift in (0.0, d, -d) for b, u in places]
    parameters = np.concatenate([b.values(u) for b, u in points])
    by_u = np.concatenate([b.slope(u) for b, u in points])
    values = shape_at(curved_class, parameters[:count], problem.levels, rate=problem.rate, filter=problem.filter)
    slopes = slope_at(curved_class, parameters, problem.levels, rate=problem.rate, filter=problem.filter) * by_u
    bends = (slopes[count : 2 * count] - slopes[2 * count :]) / (2 * d)
    root = problem.root.T
    return values @ root, slopes[:count] @ root, bends @ root
