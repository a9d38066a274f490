"""Virtual sensors from a joint model: a Kalman filter on differences, or static weights, with a corrected prediction of
the noise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.joint.conic import least_squares
from gmwm.joint.difference_filter import ArrayNoise, DifferenceFilter, wavelet_variance
from gmwm.joint.fitting import Settled, measured_at, settle
from gmwm.joint.inference import errors, misfit
from gmwm.joint.moments import entries, moment_covariance, stacked
from gmwm.joint.terms import joint_terms
from gmwm.processes.base import Process
from gmwm.processes.model import ModelLike
from gmwm.signals import Signal

DRAWS = 40
"""Simulated estimates from which the optimism of a prediction follows; its relative error is then some 1 %, see
docs/validation/fusion.md."""
MOST_MARKOV = 2
"""Gauss-Markov terms that are tried for a model that fits."""
LEAST = 3.0
"""Coefficients per scale of the levels used: fewer than for a test of the model, because weights gain from coarse ones
(docs/validation/fusion.md)."""
FITS = 0.01
"""p-value from which a model fits."""

Design = Callable[[ArrayNoise], DifferenceFilter]
"""What makes a filter, or static weights, for the noise of an array."""


def fitted(signals: Mapping[str, Signal], model: ModelLike | None) -> Settled:
    """The joint fit of a model, or of the smallest one of WN + RW + k·GM that fits."""
    if model is not None:
        terms = joint_terms(model)
        return settle(terms, measured_at(signals, None, len(terms), least=LEAST))
    measured = measured_at(signals, None, 2, least=LEAST)
    best: tuple[float, Settled] | None = None
    for count in range(MOST_MARKOV + 1):
        text = "shared(WN) + shared(RW)" + (f" + {count}*shared(GM)" if count else "")
        terms = joint_terms(text)
        if measured.design.levels.size <= len(terms) + count:
            break
        found = settle(terms, measured)
        if pvalue_of(found) >= FITS:
            return found
        statistic, df = misfit(found)
        # Twice the number of unknowns makes up for what chance explains.
        score = statistic - 2 * df
        if best is None or score < best[0]:
            best = score, found
    assert best is not None
    return best[1]


def pvalue_of(settled: Settled) -> float:
    """p-value of the test of the model."""
    from scipy.special import gammaincc

    statistic, df = misfit(settled)
    return float(gammaincc(df / 2, statistic / 2))


def model_text(settled: Settled) -> str:
    """The model of a fit."""
    return " + ".join(map(str, settled.problem.terms))


def noise_of(settled: Settled, sigmas: Matrix | None = None) -> ArrayNoise:
    """The noise of the array, in the units of the problem made equal for all signals; terms of one shape added up."""
    problem = settled.problem
    own = problem.processes(settled.found.u)
    scale = float(np.exp(np.mean(np.log(settled.unit))))
    relative = settled.unit / scale
    given = settled.found.sigmas if sigmas is None else sigmas
    found: dict[tuple[Any, ...], tuple[Process, Matrix]] = {}
    for process, sigma in zip(own, given / np.outer(relative, relative), strict=True):
        key = (type(process), *process.nonlinear.tolist())
        found[key] = (process, sigma + found[key][1] if key in found else sigma)
    processes, merged = zip(*found.values(), strict=True)
    return ArrayNoise(processes, np.array(merged), problem.design.rate)


def shrunk(settled: Settled, sigmas: Matrix, scatter: Vector) -> Matrix:
    """The matrices of shared terms, averaged with a multiple of the identity, because weights depend on inverses.

    The share of the identity is the total variance of the entries over their squared distance from it, as by Ledoit
    and Wolf (2004), Journal of Multivariate Analysis 88, 365-411. It is 0 if a matrix is well known, and 1 if nothing
    is known about the differences between the signals.
    """
    out = sigmas.copy()
    for place, term in enumerate(settled.problem.terms):
        if term.kind != "own":
            target = np.trace(sigmas[place]) / sigmas.shape[-1] * np.eye(sigmas.shape[-1])
            distance = float(np.sum((sigmas[place] - target) ** 2))
            share = min(1.0, scatter[place] / distance) if distance > 0 else 1.0
            out[place] = (1 - share) * sigmas[place] + share * target
    return out


def scatters(settled: Settled) -> Vector:
    """Total variance (P,) of the entries of the matrix of each term, in the fit without the cone."""
    inside, tangent = errors(settled, inside=True), errors(settled)
    found = [tangent if term.kind == "common" else inside for term in settled.problem.terms]
    rows, columns = entries(settled.problem.d)
    times = np.where(rows == columns, 1.0, 2.0)
    return np.array([float(times @ np.diag(one.of_matrix(k))) for k, one in enumerate(found)])


def best_noise(settled: Settled) -> ArrayNoise:
    """The noise of the array for weights: the estimate with shrunk matrices."""
    return noise_of(settled, shrunk(settled, settled.found.sigmas, scatters(settled)))


def unit_of(settled: Settled) -> float:
    """Factor of the variances of `noise_of` to the units of the signals."""
    return float(np.exp(-2 * np.mean(np.log(settled.unit))))


def optimism(settled: Settled, design: Design, levels: NDArray[np.int64]) -> Vector:
    """Factor (J,) by which the variance in other recordings is larger than predicted, by a parametric bootstrap.

    Moments are drawn from their distribution under the fitted model, and the covariance matrices are estimated from
    them. The filter made for the estimate is then used for the noise of the fitted model: its variance over the one
    that was predicted for it, on average.
    """
    problem, scatter = settled.problem, scatters(settled)
    centre = shrunk(settled, settled.found.sigmas, scatter)
    truth = noise_of(settled, centre)
    fitted = stacked(np.einsum("pj,pab->jab", problem.shapes(settled.found.u), centre))
    wavelet = problem.design.loss_factor * moment_covariance(centre, settled.products)
    size = np.sqrt(np.diag(wavelet))
    root = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size)) * size[:, None]
    columns = problem.columns(problem.shapes(settled.found.u))
    rng = np.random.default_rng(0)
    achieved, predicted = np.zeros(levels.size), np.zeros(levels.size)
    for _ in range(DRAWS):
        drawn = problem.root @ (fitted + root @ rng.standard_normal(size.size))
        sigmas = least_squares(columns, drawn, problem.cone, gap=1e-6).sigmas
        filter = design(noise_of(settled, shrunk(settled, sigmas, scatter)))
        achieved += wavelet_variance(truth, filter, levels)
        predicted += wavelet_variance(noise_of(settled, sigmas), filter, levels)
    return np.asarray(np.maximum(achieved / predicted, 1.0))
