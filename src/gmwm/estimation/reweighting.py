"""Iterated weights: the exact covariance of ν̂² under the fitted model, and a fit with these weights, repeated to
convergence.

Weights from the data alone depend on the errors of the data. A level that is too small by chance then has too large a
weight, and all estimates become too small. Weights from the fitted model do not have this bias. An estimate that is
optimal under its own weights solves Σ_j (ν̂_j² − ν_j²) Ω_jk(θ) ∂ν_k²/∂θ = 0, and the left side has mean zero at the true
parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm._threads import check_stop
from gmwm.covariance import Design, covariance, variances
from gmwm.covariance.mixture import mixture
from gmwm.errors import MissingTheoryError, ModelError
from gmwm.estimation.exponential_search import search_of
from gmwm.estimation.exponential_weights import reweighted, search_for_weights
from gmwm.estimation.problem import Problem, pose
from gmwm.estimation.solver import Solution, estimated, final, moved, resume, solve
from gmwm.estimation.weighting import precision, weighting_matrix
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.variance.result import WaveletVariance

REWEIGHTED = ("diagonal", "optimal")
"""The weightings that depend on the estimate."""
FIXED = 1e-11
"""Relative change of the fitted curve at which the iteration ends, 100 times smaller than the 1e-9 to which
tests/estimation/test_fit_laws.py compares fits of scaled data."""
ROUNDS = 60
"""Largest number of iterations. From one to the next the change falls to a tenth, or to a half if a drift is weak, so
that 60 iterations reach `FIXED`."""
PRIOR = 1000.0
"""Degrees of freedom of the fitted curve when it is averaged with the data to scale the covariance.

Without the average, a level would have the more weight, the further the model lies below the data. The average costs a
relative bias of at most 4 / (η + 1000) of a level, which is small beside its scatter √(2/η). The resulting bias and
coverage of the estimates are in docs/validation/weighting.md.
"""
HOPE = 12
"""Number of iterations in which the change must fall to a half. If it does not, two estimates probably alternate. Slow
convergence by a factor of up to 0.94 per iteration still passes."""
NEARLY = 3
"""Number of iterations after which the weights have converged to a few per cent, which is sufficient to compare
models."""
MIXED = 5
"""Largest number of iterations that are combined for the next one."""
CUTOFF = 1e-6
"""Relative singular value below which a direction of the combination counts as zero."""
FAR = 0.7
"""Largest change of the logarithm of a parameter by the combination: a factor of two."""
RETURNS = 4
"""Number of times that the iteration is repeated if the global search finds another optimum."""
CLOSE = 1e-6
"""Relative change of the curve, beyond `fixed`, at which weights and estimate are treated as equal."""


First = Callable[[Problem], Solution]
"""A function that solves the problem for the first time."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A solved problem with its final weights, and remarks about these."""

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
    returns: int = RETURNS,
) -> Settled:
    """Iterate estimate and weights until they agree.

    The iteration starts with weights from the data. The final weights are held for the global search and its
    certificate, so that the estimate is the proven optimum of the objective with the recorded Ω.

    Estimate and weights may fail to agree, for example if two estimates alternate because each implies weights that
    lead to the other. The final weights then come from the most likely mixture of all processes, without the model.

    Parameters
    ----------
    weighting : "diagonal" or "optimal"
        1 / V_jj, or V⁻¹.
    certify : bool
        Compute the lower bound on the objective.
    start : Model, optional
        A model near the estimate, for the first weights.
    fixed : float
        The iteration ends when the relative change of the curve is at most this.
    first : callable, optional
        Replaces the first global search.
    search : bool
        Search again under the final weights. Not needed if `start` is an estimate from almost the same data.
    returns : int
        Largest number of iterations, each of which ends with a search.

    Raises
    ------
    MissingTheoryError
        If the weighting is "optimal" and the covariance of a process is unknown.
    ModelError
        If the weighting is "optimal" and the model has no noise at some level.
    """

    def finish(problem: Problem, solution: Solution) -> Solution:
        return final(problem, solution, certify=certify) if search else resume(problem, solution)

    design = Design.of(wv)
    if start is None:
        problem = pose(model, wv, weighting_matrix("diagonal", wv))
    else:
        problem = pose(model, wv, implied_weights(weighting, start, design, wv.variance))
    solution = solve(problem, certify=False, quick=True) if first is None else first(problem)
    implied = _implied(problem, solution, wv)
    for _ in range(returns):
        found = _iterated(problem, solution, wv, weighting, design=design, fixed=fixed)
        problem, solution = found.problem, found.solution
        if found.reason is not None:
            remark = Remark.of("weights-from-data", wv.axis, reason=found.reason)
            return Settled(problem, finish(problem, solution), (remark,))
        implied = _implied(problem, solution, wv)
        last = finish(problem, solution)
        change = _change(implied, _implied(problem, last, wv))
        solution, implied = last, _implied(problem, last, wv)
        if change <= max(CLOSE, found.change):
            break
    if found.expected <= max(CLOSE, fixed) and change <= max(CLOSE, fixed):
        return Settled(problem, solution)
    # Two estimates may alternate, each with weights that lead to the other. Weights without the model end this.
    problem = problem.under(_weights_of_the_data(weighting, wv, design))
    return Settled(problem, finish(problem, solution), (Remark.of("weights-not-converged", wv.axis),))


@dataclass(frozen=True, eq=False)
class _Iterated:
    """A problem with iterated weights and its solution, the last and the expected next relative change of the curve,
    and the reason why the model has no weights, if it has none."""

    problem: Problem
    solution: Solution
    change: float = math.inf
    expected: float = math.inf
    reason: str | None = None


def _iterated(
    problem: Problem, solution: Solution, wv: WaveletVariance, weighting: str, *, design: Design, fixed: float
) -> _Iterated:
    """Iterate weights and estimate until the curve changes by `fixed`, or does not converge; in a kernel if it has the
    covariance of every process."""
    search = search_for_weights(problem, design) if weighting == "diagonal" else None
    if search is not None:
        options = np.array([PRIOR, fixed, FAR, CUTOFF, ROUNDS, HOPE, MIXED], dtype=np.float64)
        found = reweighted(search, solution, design.for_weights, options)
        if found is not None:
            best, weights, change, expected = found
            problem = problem.under(np.diag(weights))
            return _Iterated(problem, moved(search_of(problem), solution, best), change, expected)
    ahead, implied = _Ahead(), _implied(problem, solution, wv)
    history: list[float] = []
    for _ in range(ROUNDS):
        check_stop()
        try:
            matrix = implied_weights(weighting, ahead.of(problem, solution, wv), design, wv.variance)
        except (MissingTheoryError, ModelError) as error:
            if weighting == "optimal":
                raise
            return _Iterated(problem, solution, reason=error.reason)
        problem = problem.under(matrix)
        solution = resume(problem, solution)
        before, implied = implied, _implied(problem, solution, wv)
        change = _change(before, implied)
        history.append(change)
        # The steps shrink by at least the last ratio.
        expected = change * min(1.0, change / history[-2]) if len(history) > 1 and history[-2] > 0 else change
        if expected <= fixed or (len(history) > HOPE and change > history[-HOPE - 1] / 2):
            break
    return _Iterated(problem, solution, change, expected)


def nearly_settled(model: Model, wv: WaveletVariance, weighting: str) -> tuple[Settled, Matrix]:
    """Fit with weights that have nearly converged, to compare models; also return V (J, J), which determines them.

    The last fits are kept, because a search for a model and the ranking after it begin with the same fit.
    """
    return _nearly_settled(model.processes, wv, weighting)


@lru_cache(maxsize=12)
def _nearly_settled(processes: tuple[Process, ...], wv: WaveletVariance, weighting: str) -> tuple[Settled, Matrix]:
    model = Model(processes)
    design = Design.of(wv)
    problem = pose(model, wv, weighting_matrix("diagonal", wv))
    solution = solve(problem, certify=False, quick=True)
    for _ in range(NEARLY):
        at = estimated(problem, solution, wv.slope).sorted(wv.rate)
        wavelet = drawn_covariance(at, design, wv.variance)
        if not np.all(np.diag(wavelet) > 0):
            raise _no_noise(model)
        problem = problem.under(precision(wavelet) if weighting == "optimal" else np.diag(1 / np.diag(wavelet)))
        solution = resume(problem, solution)
    return Settled(problem, solve(problem, certify=False, near=solution)), freeze(wavelet)


def _weights_of_the_data(weighting: str, wv: WaveletVariance, design: Design) -> Matrix:
    """Return Ω of the most likely mixture of all processes, which does not depend on the fitted model."""
    _, model = mixture(wv.variance, wv.degrees_of_freedom, design)
    return implied_weights(weighting, model, design, wv.variance)


class _Ahead:
    """Accelerate the fixed-point iteration by Anderson mixing of the logarithms of the parameters.

    Each iteration maps a model x to the estimate g under the weights of x. The next model is the combination of the
    last estimates whose residual g − x would be least if the map were linear (Anderson 1965, J. ACM 12, 547-560).
    """

    def __init__(self) -> None:
        self.given: dict[str, float] = {}
        self.pairs: list[tuple[Vector, Vector]] = []

    def of(self, problem: Problem, solution: Solution, wv: WaveletVariance) -> Model:
        model = estimated(problem, solution, wv.slope).sorted(wv.rate)
        found = _logarithms(model)
        if list(found) != list(self.given):
            self.pairs = []
        else:
            self.pairs.append((np.array(list(self.given.values())), np.array(list(found.values()))))
        self.given = found
        if len(self.pairs) < 2:
            return model
        inputs, outputs = (np.array(each) for each in zip(*self.pairs[-MIXED:], strict=True))
        residuals = outputs - inputs
        share, *_ = np.linalg.lstsq(np.diff(residuals, axis=0).T, residuals[-1], rcond=CUTOFF)
        reach = np.clip(-share @ np.diff(outputs, axis=0), -FAR, FAR)
        moved = {name: (model.parameters[name] or 0.0) * math.exp(d) for name, d in zip(found, reach, strict=True)}
        try:
            there = model.with_values(moved)
        except ModelError:  # extrapolated coefficients of an AR process may not be stationary
            return model
        self.given = _logarithms(there)
        return there


def _logarithms(model: Model) -> dict[str, float]:
    """Return the logarithms of the absolute values of the free parameters that are not zero, by label."""
    values = {name: abs(value) for name, value in model.parameters.items() if value and name not in model.fixed_names}
    return {name: math.log(value) for name, value in values.items() if 0 < value < math.inf}


def implied_weights(weighting: str, model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """Compute the weights Ω of a model: V⁻¹ ("optimal"), or 1 / V_jj ("diagonal").

    Parameters
    ----------
    weighting : "diagonal" or "optimal"
    model : Model
        Model with all values.
    design : Design
    observed : (J,) array, optional
        Data ν̂². V is then scaled from the curve ν² of the model to ν̄² = (ην̂² + 1000ν²)/(η + 1000). This changes little
        if the model is right, and makes V larger where the model lies below the data.

    Raises
    ------
    ModelError
        If the model has no noise at some level.
    MissingTheoryError
        If the covariance of a process is unknown.
    """
    if weighting == "optimal":
        return precision(drawn_covariance(model, design, observed))
    scale = _drawn_scale(model, design, observed)
    variance = variances(model, design.for_weights) * scale**2
    with np.errstate(over="ignore", divide="ignore"):
        weights = 1 / variance
    if not np.all(np.isfinite(weights)):
        raise _no_noise(model)
    return np.diag(weights)


def _no_noise(model: Model) -> ModelError:
    return ModelError(
        f"{model.structure} as estimated has no noise at some level",
        advice="Add a term to the model, for example WN.",
    )


def drawn_covariance(model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """Return the covariance V (J, J) of a model, scaled to ν̄² if there are data (see `implied_weights`)."""
    scale = _drawn_scale(model, design, observed)
    return covariance(model, design.for_weights) * np.outer(scale, scale)


def _drawn_scale(model: Model, design: Design, observed: Vector | None) -> Vector:
    """Return the scale ν̄² / ν² (J,), see `implied_weights`."""
    if observed is not None:
        curve = model.wavelet_variance(design.levels, design.rate, design.filter)
        freedom = design.degrees_of_freedom
        if np.all(curve > 0):
            return np.asarray((freedom * observed / curve + PRIOR) / (freedom + PRIOR))
    return np.ones(design.levels.size)


def _implied(problem: Problem, solution: Solution, wv: WaveletVariance) -> Vector:
    return estimated(problem, solution, wv.slope).wavelet_variance(wv.levels, wv.rate, wv.filter)


def _change(before: Vector, after: Vector) -> float:
    """Return the largest relative change over the levels; levels without variance are left out."""
    scale = np.maximum(before, after)
    return float(np.max(np.abs(after - before) / np.where(scale > 0, scale, 1.0)))
