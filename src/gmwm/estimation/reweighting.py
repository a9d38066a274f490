"""Weights that hang on the estimate: the exact covariance of ν̂ under the fitted model, iterated to a fixed point.

Weights from the data alone hang on their errors: a level that is too small by chance weighs too much, and all
estimates are pulled down. Those of the fitted model do not, and the estimate that is optimal under the weights it
implies itself solves Σ_j (ν̂_j² − ν_j²) Ω_jk(θ) ∂ν_k²/∂θ = 0, whose mean is zero at the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.covariance import Design, covariance, variances
from gmwm.covariance.mixture import mixture
from gmwm.errors import MissingTheoryError, ModelError
from gmwm.estimation.problem import Problem, pose
from gmwm.estimation.solver import Solution, estimated, final, resume, solve
from gmwm.estimation.weighting import precision, weighting_matrix
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.variance.result import WaveletVariance

REWEIGHTED = ("diagonal", "optimal")
"""The weightings that hang on the estimate."""
FIXED = 1e-11
"""Largest relative change of the implied wavelet variance from which on the weights stand still."""
ROUNDS = 60
"""Rounds of local fits; the change falls to a tenth from one to the next, to a half where a drift is weak."""
PRIOR = 1000.0
"""Degrees of freedom that the fitted curve counts for beside those of a level, where its covariance is scaled.

A level that the model misses by a factor would otherwise weigh the more, the more it is missed. It costs the estimates
a bias of 4 / (η + 1000) of a level at most, nothing beside its scatter.
"""
HOPE = 12
"""Rounds in which the change must fall to a half; it does not where two answers take turns."""
NEARLY = 3
"""Rounds after which the weights are those of the estimate to a few per cent."""
RETURNS = 4
"""How often the global optimum may turn out to lie elsewhere than where the rounds led."""


First = Callable[[Problem], Solution]
"""The way to a first solution."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A solved problem under its final weights, and what to know of these."""

    problem: Problem
    solution: Solution
    remarks: tuple[Remark, ...] = ()


def settle(
    model: Model,
    wv: WaveletVariance,
    weighting: str,
    *,
    certify: bool,
    start: Model | None = None,
    fixed: float = FIXED,
    first: First | None = None,
    search: bool = True,
) -> Settled:
    """The estimate that is optimal under the weights that it implies.

    Rounds begin with weights from the data. The last weights are held for the global search and its certificate,
    so that the estimate is the proven optimum of the criterion with the Ω that is recorded. Where estimate and weights
    do not come to agree, as when each of two answers makes weights that lead to the other, the weights are those of
    the likeliest mixture of all processes.

    Parameters
    ----------
    weighting : "diagonal" or "optimal"
        1 / V_jj, or V⁻¹.
    start : Model, optional
        A model near the estimate, whose weights the rounds begin with.
    fixed : float
        The weights stand still where the curve changes by less (relative).
    first : callable, optional
        The solution that the rounds begin with, in place of the global search.
    search : bool
        Whether to search again under the last weights; not needed next to an estimate for almost the same data.

    Raises
    ------
    MissingTheoryError
        If "optimal" is wanted of a process whose covariance is not known.
    ModelError
        If "optimal" is wanted of a model without noise.
    """

    def finish(problem: Problem, solution: Solution) -> Solution:
        return final(problem, solution, certify=certify) if search else resume(problem, solution)

    design = Design.of(wv)
    if start is None:
        problem = pose(model, wv, weighting_matrix("diagonal", wv))
    else:
        problem = pose(model, wv, implied_weights(weighting, start, design, wv.variance))
    solution = solve(problem, certify=False) if first is None else first(problem)
    implied = _implied(problem, solution, wv)
    ahead = _Ahead()
    for _ in range(RETURNS):
        history: list[float] = []
        for _ in range(ROUNDS):
            try:
                matrix = implied_weights(weighting, ahead.of(problem, solution, wv), design, wv.variance)
            except (MissingTheoryError, ModelError) as error:
                if weighting == "optimal":
                    raise
                remark = Remark.of("weights-from-data", wv.axis, reason=str(error).rstrip("."))
                return Settled(problem, finish(problem, solution), (remark,))
            problem = problem.under(matrix)
            solution = resume(problem, solution)
            before, implied = implied, _implied(problem, solution, wv)
            change = _change(before, implied)
            history.append(change)
            if change <= fixed or (len(history) > HOPE and change > history[-HOPE - 1] / 2):
                break
        last = finish(problem, solution)
        moved = _change(implied, _implied(problem, last, wv))
        solution, implied = last, _implied(problem, last, wv)
        if moved <= max(1e-6, change):
            break
    if change <= max(1e-6, fixed) and moved <= max(1e-6, fixed):
        return Settled(problem, solution)
    # Each of two answers may make weights that lead to the other. A curve that no model of the user's shapes decides.
    problem = problem.under(_weights_of_the_data(weighting, wv, design))
    return Settled(problem, finish(problem, solution), (Remark.of("weights-not-converged", wv.axis),))


def nearly_settled(model: Model, wv: WaveletVariance, weighting: str) -> tuple[Settled, Matrix]:
    """An estimate under weights that it nearly implies, and V (J, J), of which they are made; for comparing models."""
    design = Design.of(wv)
    problem = pose(model, wv, weighting_matrix("diagonal", wv))
    solution = solve(problem, certify=False)
    for _ in range(NEARLY):
        at = estimated(problem, solution, wv.slope).sorted(wv.rate)
        wavelet = drawn_covariance(at, design, wv.variance)
        if not np.all(np.diag(wavelet) > 0):
            raise ModelError(f"{model.structure} as estimated has no noise at some level; give it more terms, as WN()")
        problem = problem.under(precision(wavelet) if weighting == "optimal" else np.diag(1 / np.diag(wavelet)))
        solution = resume(problem, solution)
    return Settled(problem, solve(problem, certify=False)), wavelet


def _weights_of_the_data(weighting: str, wv: WaveletVariance, design: Design) -> Matrix:
    """Ω of the likeliest mixture of all processes: no model is asked for."""
    _, model = mixture(wv.variance, wv.degrees_of_freedom, design)
    return implied_weights(weighting, model, design, wv.variance)


class _Ahead:
    """The model whose weights come next: the last estimate, or where the last steps lead in the end.

    The steps of a fixed-point iteration shrink by about the same factor ρ each: what remains is ρ/(1 − ρ) of the last.
    """

    def __init__(self) -> None:
        self.logs: list[dict[str, float]] = []

    def of(self, problem: Problem, solution: Solution, wv: WaveletVariance) -> Model:
        model = estimated(problem, solution, wv.slope).sorted(wv.rate)
        values = {
            name: abs(value) for name, value in model.parameters.items() if value and name not in model.fixed_names
        }
        self.logs.append({name: math.log(value) for name, value in values.items() if 0 < value < math.inf})
        if len(self.logs) < 3:
            return model
        names = list(self.logs[-1])
        if any(list(logs) != names for logs in self.logs[-3:]):
            return model
        points = np.array([[logs[name] for name in names] for logs in self.logs[-3:]])
        first, last = np.diff(points, axis=0)
        if not abs(ratio := float(first @ last / max(first @ first, 1e-300))) < 0.95:
            return model
        self.logs.clear()
        reach = np.clip(last * ratio / (1 - ratio), -0.7, 0.7)
        moved = {name: (model.parameters[name] or 0.0) * math.exp(d) for name, d in zip(names, reach, strict=True)}
        try:
            return model.with_values(moved)
        except ModelError:  # coefficients that are none together
            return model


def implied_weights(weighting: str, model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """Ω = V⁻¹ ("optimal"), or 1 / V_jj, of a model.

    Where there are data ν̂² (J,), V is scaled from the model's curve ν² to ν̄² = (ην̂² + 1000ν²)/(η + 1000): equal to it
    but for its own errors where the model is right, and wider where the model misses the data.

    Raises
    ------
    ModelError
        If the model has no noise at some level.
    MissingTheoryError
        If the covariance of a process is not known.
    """
    if weighting == "optimal":
        return precision(drawn_covariance(model, design, observed))
    scale = _drawn_scale(model, design, observed)
    variance = variances(model, design) * scale**2
    with np.errstate(over="ignore", divide="ignore"):
        weights = 1 / variance
    if not np.all(np.isfinite(weights)):
        raise ModelError(f"{model.structure} as estimated has no noise at some level")
    return np.diag(weights)


def drawn_covariance(model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """V (J, J) of a model, scaled to ν̄² where there are data (see `implied_weights`)."""
    scale = _drawn_scale(model, design, observed)
    return covariance(model, design) * np.outer(scale, scale)


def _drawn_scale(model: Model, design: Design, observed: Vector | None) -> Vector:
    """ν̄² / ν²."""
    if observed is not None:
        curve = model.wavelet_variance(design.levels, design.rate, design.filter)
        freedom = design.degrees_of_freedom
        if np.all(curve > 0):
            return np.asarray((freedom * observed / curve + PRIOR) / (freedom + PRIOR))
    return np.ones(design.levels.size)


def _implied(problem: Problem, solution: Solution, wv: WaveletVariance) -> Vector:
    return estimated(problem, solution, wv.slope).wavelet_variance(wv.levels, wv.rate, wv.filter)


def _change(before: Vector, after: Vector) -> float:
    """Largest relative change; of levels without any variance there is none."""
    scale = np.maximum(before, after)
    return float(np.max(np.abs(after - before) / np.where(scale > 0, scale, 1.0)))
