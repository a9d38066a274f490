"""Iteration of weights and estimate until they agree.

Weights from the data bias all estimates: a level that is low by chance gets too much weight. Weights from the exact
covariance under the fitted model do not, as Σ_jk (ν̂_j² − ν_j²) Ω_jk(θ) ∂ν_k²/∂θ has mean zero at the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.base.remarks import Remark
from gmwm.base.threads import check_stop
from gmwm.fitting.estimation.exponential_search import reweight, search_for_weights, search_of
from gmwm.fitting.estimation.problem import Problem, pose
from gmwm.fitting.estimation.solver import Solution, final, model_of, move, resume, solve
from gmwm.fitting.estimation.weighting import no_noise, precision, weighting_matrix
from gmwm.measuring.covariance import Design, covariance, variances
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

REWEIGHTED = ("diagonal", "optimal")  # weightings that depend on the estimate


@dataclass(frozen=True)
class FixedPointLimits:
    """Limits of the iteration of the weights (tests/estimation/test_fit_laws.py)."""

    tolerance: float = 1e-11
    """Relative change of the curve that ends the iteration; tests/estimation/test_fit_laws.py compares fits to 1e-9."""
    curve_freedom: float = 1000.0
    """Degrees of freedom of the fitted curve in the average with the data that scales the covariance, against large
    weights of levels far above the model. It biases a level by at most 4 / (η + 1000), small against √(2/η), with η
    degrees of freedom; docs/validation/weighting.md has the effect on estimates and intervals."""
    mixed_iterations: int = 5  # largest number of previous iterations that are combined into the next one
    singular_cutoff: float = 1e-6  # relative singular value below which a direction of the combination counts as zero
    longest_step: float = 0.7
    """Largest change of the logarithm of a parameter by the combination, which is a factor of two."""


LIMITS = FixedPointLimits()


First = Callable[[Problem], Solution]  # function that solves the problem for the first time


@dataclass(frozen=True, eq=False)
class WeightedSolution:
    """Solved problem with its final weights, and remarks about these weights."""

    problem: Problem
    solution: Solution
    remarks: tuple[Remark, ...] = ()


def settle(
    model: Model, wv: WaveletVariance, weighting: str, *, certify: bool, start: Model | None = None,
    fixed: float = LIMITS.tolerance, first: First | None = None, search: bool = True, returns: int = 4,
) -> WeightedSolution:  # fmt: skip
    """Iterate estimate and weights until they agree (relative change `fixed`), from weights of the data or of `start`.
    A last `search` with the final Ω proves the optimum, unless `start` is from almost the same data; if that is another
    one, they are iterated again (`returns`). If estimates alternate, weights come from the likeliest mixture."""
    # Relative change of the curve below which weights and estimate agree, if `fixed` is not larger.
    agreement = 1e-6

    def finish(problem: Problem, solution: Solution) -> Solution:
        return final(problem, solution, certify=certify) if search else resume(problem, solution)

    design = Design.of(wv)
    if start is None:
        problem = pose(model, wv, weighting_matrix("diagonal", wv))
    else:
        problem = pose(model, wv, implied_weights(weighting, start, design, wv.variance))
    solution = solve(problem, certify=False, quick=True) if first is None else first(problem)
    for _ in range(returns):
        iteration = _iterate(problem, solution, wv, weighting, design=design, fixed=fixed)
        problem, solution = iteration.problem, iteration.solution
        if iteration.reason is not None:
            remark = Remark.of("weights-from-data", wv.axis, case="no-autocovariance", reason=iteration.reason)
            return WeightedSolution(problem, finish(problem, solution), (remark,))
        before, solution = _implied_curve(problem, solution, wv), finish(problem, solution)
        change = _change(before, _implied_curve(problem, solution, wv))
        if change <= max(agreement, iteration.change):
            break
    if iteration.expected <= max(agreement, fixed) and change <= max(agreement, fixed):
        return WeightedSolution(problem, solution)
    # Two estimates may alternate, each with the other's weights; weights without a model end this.
    problem = problem.under(_weights_of_the_data(weighting, wv, design))
    return WeightedSolution(
        problem, finish(problem, solution), (Remark.of("weights-from-data", wv.axis, case="iteration"),)
    )


@dataclass(frozen=True, eq=False)
class _Iterated:
    """Iterated problem and solution, last and `expected` change, and the `reason` for a model without weights."""

    problem: Problem
    solution: Solution
    change: float = math.inf
    expected: float = math.inf
    reason: str | None = None


def _iterate(
    problem: Problem, solution: Solution, wv: WaveletVariance, weighting: str, *, design: Design, fixed: float
) -> _Iterated:
    """Iterate weights and estimate until the relative change of the curve is at most `fixed`, or until they diverge."""
    # Iterations in which the change must fall to a half; otherwise two estimates probably alternate.
    patience = 12
    # Largest number of iterations, enough for `LIMITS.tolerance` although a weak drift only halves the change.
    rounds = 60
    search = search_for_weights(problem, design) if weighting == "diagonal" else None
    if search is not None:
        limits = LIMITS.curve_freedom, fixed, LIMITS.longest_step, LIMITS.singular_cutoff
        options = np.array([*limits, rounds, patience, LIMITS.mixed_iterations], dtype=np.float64)
        result = reweight(search, solution, design.for_weights, options)
        if result is not None:
            best, weights, change, expected = result
            problem = problem.under(np.diag(weights))
            return _Iterated(problem, move(search_of(problem), solution, best), change, expected)
    at = model_of(problem, solution, wv.slope)
    ahead, implied, poor_start = _Ahead(), _curve(at, wv), weighting == "optimal"
    history: list[float] = []
    for _ in range(rounds):
        check_stop()
        try:
            matrix = implied_weights(weighting, ahead.of(at.sorted(wv.rate)), design, wv.variance)
        except (MissingTheoryError, ModelError) as error:
            if poor_start and isinstance(error, ModelError):
                # The weights of a poor first estimate led to a model without noise.
                problem, poor_start = problem.under(_weights_of_the_data(weighting, wv, design)), False
                solution, ahead = solve(problem, certify=False), _Ahead()
                at = model_of(problem, solution, wv.slope)
                continue
            if weighting == "optimal":
                raise
            return _Iterated(problem, solution, reason=error.reason)
        problem = problem.under(matrix)
        solution = resume(problem, solution)
        at = model_of(problem, solution, wv.slope)
        before, implied = implied, _curve(at, wv)
        change = _change(before, implied)
        history.append(change)
        # The next change is expected to be smaller by the last ratio of changes.
        expected = change * min(1.0, change / history[-2]) if len(history) > 1 and history[-2] > 0 else change
        if expected <= fixed or (len(history) > patience and change > history[-patience - 1] / 2):
            break
    return _Iterated(problem, solution, change, expected)


def nearly_settled(model: Model, wv: WaveletVariance, weighting: str) -> tuple[WeightedSolution, Matrix]:
    """Fit a model with weights that have nearly converged; also return the covariance V behind the weights. The last
    fits are cached, because a search for a model and the ranking after it begin with the same fit."""
    return _nearly_settled(model.processes, wv, weighting)


@lru_cache(maxsize=12)
def _nearly_settled(
    processes: tuple[Process, ...], wv: WaveletVariance, weighting: str
) -> tuple[WeightedSolution, Matrix]:
    model = Model(processes)
    design = Design.of(wv)
    problem = pose(model, wv, weighting_matrix("diagonal", wv))
    solution = solve(problem, certify=False, quick=True)
    first, at = (problem, solution), model_of(problem, solution, wv.slope)
    wavelet = drawn_covariance(at.sorted(wv.rate), design, wv.variance)
    if not np.all(np.diag(wavelet) > 0):
        raise no_noise(model.structure)
    # Weights have then converged to a few per cent, sufficient to compare models.
    last = 2
    for k in range(last + 1):
        problem = problem.under(precision(wavelet) if weighting == "optimal" else np.diag(1 / np.diag(wavelet)))
        # The first weights differ so much from those of the data that rounding decides where a descent from the last
        # optimum ends. The scan for free processes would take as long as all the rest.
        solution = resume(problem, solution) if k or problem.free else solve(problem, certify=False)
        at = model_of(problem, solution, wv.slope)
        after = wavelet if k == last else drawn_covariance(at.sorted(wv.rate), design, wv.variance)
        if not (_has_noise(at, design) if k == last else np.all(np.diag(after) > 0)):
            # Under the full weights of a poor estimate, a model without noise can be the best one, for example a ramp
            # alone; under their variances seldom, and under the weights of the data never.
            wavelet = np.diag(np.diag(wavelet))
            problem = problem.under(precision(wavelet))
            solution = resume(problem, solution)
            if not _has_noise(model_of(problem, solution, wv.slope), design):
                problem, solution = first
                wavelet = np.diag(1 / np.diag(problem.matrix))
            break
        wavelet = after
    solution = solve(problem, certify=False, near=solution)
    # Cached objects exist until Python exits, and nanobind reports kernel objects that exist then.
    problem.weights.tables.clear()
    return WeightedSolution(problem, solution), freeze(wavelet)


def _has_noise(model: Model, design: Design) -> bool:
    return bool(np.all(variances(model, design) > 0))


def _weights_of_the_data(weighting: str, wv: WaveletVariance, design: Design) -> Matrix:
    """Return the weights Ω that the mixture of all processes with the largest likelihood implies."""
    _, model = mixture(wv.variance, wv.degrees_of_freedom, design)
    return implied_weights(weighting, model, design, wv.variance)


class _Ahead:
    """Anderson mixing of log parameters: the next model combines the last estimates g of x so that g − x would be
    smallest for a linear map (Anderson 1965, J. ACM 12, 547-560)."""

    def __init__(self) -> None:
        self.given: dict[str, float] = {}
        self.pairs: list[tuple[Vector, Vector]] = []

    def of(self, model: Model) -> Model:
        logarithms = _logarithms(model)
        if list(logarithms) != list(self.given):
            self.pairs = []
        else:
            self.pairs.append((np.array(list(self.given.values())), np.array(list(logarithms.values()))))
        self.given = logarithms
        if len(self.pairs) < 2:
            return model
        inputs, outputs = (np.array(each) for each in zip(*self.pairs[-LIMITS.mixed_iterations :], strict=True))
        residuals = outputs - inputs
        share, *_ = np.linalg.lstsq(np.diff(residuals, axis=0).T, residuals[-1], rcond=LIMITS.singular_cutoff)
        reach = np.clip(-share @ np.diff(outputs, axis=0), -LIMITS.longest_step, LIMITS.longest_step)
        moved = {name: (model.parameters[name] or 0.0) * math.exp(d) for name, d in zip(logarithms, reach, strict=True)}
        try:
            extrapolation = model.with_values(moved)
        except ModelError:  # extrapolated coefficients of an AR process may not be stationary
            return model
        self.given = _logarithms(extrapolation)
        return extrapolation


def _logarithms(model: Model) -> dict[str, float]:
    """Return the logarithms of the absolute values of the free parameters by label; zero parameters are left out."""
    values = {name: abs(value) for name, value in model.parameters.items() if value and name not in model.fixed_names}
    return {name: math.log(value) for name, value in values.items() if 0 < value < math.inf}


def implied_weights(weighting: str, model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """Compute 1 / V_jj ("diagonal") or V⁻¹ ("optimal") under a model; data `observed` rescale V from ν² to ν̄² = (ην̂²
    + 1000ν²)/(η + 1000). Raises ModelError at a level without noise."""
    if weighting == "optimal":
        return precision(drawn_covariance(model, design, observed))
    scale = _drawn_scale(model, design, observed)
    return np.diag(reciprocal(variances(model, design.for_weights) * scale**2, model))


def reciprocal(variance: Vector, model: Model) -> Vector:
    """Return the weights 1 / V_jj (J,); raises ModelError if the model has no noise at some level."""
    with np.errstate(over="ignore", divide="ignore"):
        weights = 1 / variance
    if not np.all(np.isfinite(weights)):
        raise no_noise(model.structure)
    return np.asarray(weights)


def drawn_covariance(model: Model, design: Design, observed: Vector | None = None) -> Matrix:
    """Return the covariance V (J, J) under a model, scaled to ν̄² if `observed` is given; see `implied_weights`."""
    scale = _drawn_scale(model, design, observed)
    return covariance(model, design.for_weights) * np.outer(scale, scale)


def _drawn_scale(model: Model, design: Design, observed: Vector | None) -> Vector:
    """Return the ratio ν̄² / ν² (J,) by which V is scaled; see `implied_weights`."""
    if observed is not None:
        curve = model.wavelet_variance(design.levels, design.rate, design.filter)
        freedom = design.degrees_of_freedom
        if np.all(curve > 0):
            return np.asarray((freedom * observed / curve + LIMITS.curve_freedom) / (freedom + LIMITS.curve_freedom))
    return np.ones(design.levels.size)


def _implied_curve(problem: Problem, solution: Solution, wv: WaveletVariance) -> Vector:
    return _curve(model_of(problem, solution, wv.slope), wv)


def _curve(model: Model, wv: WaveletVariance) -> Vector:
    return model.wavelet_variance(wv.levels, wv.rate, wv.filter)


def _change(before: Vector, after: Vector) -> float:
    """Return the largest relative change of a curve at any level; levels with zero variance are left out."""
    scale = np.maximum(before, after)
    return float(np.max(np.abs(after - before) / np.where(scale > 0, scale, 1.0)))
