"""Make virtual sensors from a joint noise model, with a Kalman filter on differences or with static weights.

The predicted variance is corrected for the estimation of the model from the same recording.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.several.conic import least_squares
from gmwm.applications.several.difference_filter import ArrayNoise, DifferenceFilter, wavelet_variance
from gmwm.applications.several.fitting import JointSolution, measured_at, settle
from gmwm.applications.several.inference import errors, misfit
from gmwm.applications.several.moments import entries, moment_covariance, stack
from gmwm.applications.several.terms import joint_terms
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError, ModelError
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import ModelLike

LEAST_FOR_WEIGHTS = 3.0
"""Least coefficients per scale of a level. Coarse levels improve the weights (docs/validation/fusion.md)."""

Design = Callable[[ArrayNoise], DifferenceFilter]
"""Function that designs a filter, or static weights, for the noise of an array."""


def fit_array(signals: Mapping[str, Signal], model: ModelLike | None) -> JointSolution:
    """Return the joint fit of a model; without one, of WN + RW + k·GM with the smallest k that fits, or fits best."""
    if model is not None:
        terms = joint_terms(model)
        return settle(terms, measured_at(signals, None, len(terms), least=LEAST_FOR_WEIGHTS))
    measured = measured_at(signals, None, 2, least=LEAST_FOR_WEIGHTS)
    best: tuple[float, JointSolution] | None = None
    for count in range(3):
        text = "shared(WN) + shared(RW)" + (f" + {count}*shared(GM)" if count else "")
        terms = joint_terms(text)
        if measured.design.levels.size <= len(terms) + count:
            break
        try:
            solution = settle(terms, measured)
        except ModelError:  # no noise in some combination of the signals, as far as the weights can tell
            continue
        tested = misfit(solution)
        if tested.pvalue >= 0.01:
            return solution
        # Like Akaike's criterion, the score adds 2 for each parameter (the degrees of freedom decrease by 1).
        score = tested.statistic - 2 * (tested.df or 0)
        if best is None or score < best[0]:
            best = score, solution
    if best is None:
        raise DataError(
            "the units have nearly the same signal: what they share, such as motion, hides the noise of each",
            argument="x", advice="Compute the weights from a recording at rest, and fuse this one with {--apply}.",
        )  # fmt: skip
    return best[1]


def noise_of(settled: JointSolution, sigmas: Matrix | None = None) -> ArrayNoise:
    """Return the noise of an array with one scale factor for all signals (see `unit_of`); equal shapes are added."""
    problem = settled.problem
    shapes = problem.processes(settled.estimate.u)
    scale = float(np.exp(np.mean(np.log(settled.unit))))
    relative = settled.unit / scale
    matrices = settled.estimate.sigmas if sigmas is None else sigmas
    terms: dict[tuple[Any, ...], tuple[Process, Matrix]] = {}
    for process, sigma in zip(shapes, matrices / np.outer(relative, relative), strict=True):
        key = (type(process), *process.nonlinear.tolist())
        terms[key] = (process, sigma + terms[key][1] if key in terms else sigma)
    processes, merged = zip(*terms.values(), strict=True)
    return ArrayNoise(processes, np.array(merged), problem.design.rate)


def shrunk(settled: JointSolution, sigmas: Matrix, scatter: Vector) -> Matrix:
    """Return the covariance matrices with those of shared and common terms shrunk towards a multiple of the identity.
    Weights depend on the inverse matrices, and shrinkage makes them more stable. Its share is the estimation variance
    of the entries over their squared distance from the multiple of the identity, at most 1 (Ledoit and Wolf 2004,
    Journal of Multivariate Analysis 88, 365-411)."""
    out = sigmas.copy()
    for place, term in enumerate(settled.problem.terms):
        if term.kind != "own":
            target = np.trace(sigmas[place]) / sigmas.shape[-1] * np.eye(sigmas.shape[-1])
            distance = float(np.sum((sigmas[place] - target) ** 2))
            share = min(1.0, scatter[place] / distance) if distance > 0 else 1.0
            out[place] = (1 - share) * sigmas[place] + share * target
    return out


def scatters(settled: JointSolution) -> Vector:
    """Return the total estimation variance (P,) of the entries of each matrix, unconstrained except if common."""
    inside, tangent = errors(settled, inside=True), errors(settled)
    choices = [tangent if term.kind == "common" else inside for term in settled.problem.terms]
    rows, columns = entries(settled.problem.d)
    times = np.where(rows == columns, 1.0, 2.0)
    return np.array([float(times @ np.diag(errors_of.of_matrix(k))) for k, errors_of in enumerate(choices)])


def best_noise(settled: JointSolution) -> ArrayNoise:
    """Return the noise model from which weights are computed: the estimate with shrunk covariance matrices."""
    return noise_of(settled, shrunk(settled, settled.estimate.sigmas, scatters(settled)))


def unit_of(settled: JointSolution) -> float:
    """Return the factor that converts variances of the model from `noise_of` to the units of the signals."""
    return float(np.exp(-2 * np.mean(np.log(settled.unit))))


def optimism(settled: JointSolution, design: Design, levels: NDArray[np.int64]) -> Vector:
    """Return the factor (J,) by which the variance in other recordings is larger than predicted, by a parametric
    bootstrap. Moments are drawn under the fitted model, and a filter is designed for the matrices estimated from them.
    The factor is the mean variance under the fitted model over the mean variance under these estimates, and at least
    1."""
    problem, scatter = settled.problem, scatters(settled)
    centre = shrunk(settled, settled.estimate.sigmas, scatter)
    truth = noise_of(settled, centre)
    fitted = stack(np.einsum("pj,pab->jab", problem.shapes(settled.estimate.u), centre))
    wavelet = problem.design.loss_factor * moment_covariance(centre, settled.products)
    size = np.sqrt(np.diag(wavelet))
    root = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size)) * size[:, None]
    columns = problem.columns(problem.shapes(settled.estimate.u))
    rng = np.random.default_rng(0)
    achieved, predicted = np.zeros(levels.size), np.zeros(levels.size)
    for _ in range(40):  # the relative error of the factor is then about 1 % (docs/validation/fusion.md)
        drawn = problem.root @ (fitted + root @ rng.standard_normal(size.size))
        sigmas = least_squares(columns, drawn, problem.cone, gap=1e-6).sigmas
        filter = design(noise_of(settled, shrunk(settled, sigmas, scatter)))
        achieved += wavelet_variance(truth, filter, levels)
        predicted += wavelet_variance(noise_of(settled, sigmas), filter, levels)
    return np.asarray(np.maximum(achieved / predicted, 1.0))
