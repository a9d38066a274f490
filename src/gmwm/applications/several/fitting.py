"""Prepare the data of a joint fit, and repeat the weighted fit until estimate and weights agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.applications.several.matrices import WaveletMatrices, wavelet_matrices
from gmwm.applications.several.moments import lag_products, moment_covariance, stack, symmetric
from gmwm.applications.several.search import (
    EXACT_TOLERANCE,
    ROUGH_TOLERANCE,
    JointEstimate,
    JointProblem,
    first,
    resume,
    search,
)
from gmwm.applications.several.synchronous import chosen_names, synchronous_signals
from gmwm.applications.several.terms import JointTerm
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.measuring.covariance.design import Design
from gmwm.recording.signals import Imu, Signal

LEAST_PER_SCALE = 5.0
"""Least coefficients per scale of a level. With 3, the test rejects up to 8 % at 5 % (docs/validation/joint.md)."""
MOST_SIGNALS = 12
"""Largest number of signals. The covariance matrix of all moments takes 10 MB for 12 signals and 0.5 GB for 28."""
MEMORY = (-3.0, 0.9)
"""Limits of the extrapolation. It reduces the change of six signals in round 12 from 0.4 % to 0.004–0.06 %."""


@dataclass(frozen=True, eq=False)
class JointSolution:
    """The weighted least-squares problem of a joint fit with its final weights, and its solution."""

    problem: JointProblem  # the problem, in scaled units
    estimate: JointEstimate  # the solution, in scaled units
    unit: Vector  # (d,) factors by which the signals were multiplied
    products: Matrix  # (P, P, J, J) G at the estimate; see `gmwm.several.moments`
    # estimated covariance matrices Γ̂ of the wavelet coefficients at the levels used, in the units of the signals
    measured: WaveletMatrices
    # Whether the weights are the inverse of the covariance V under the estimate. If weights and estimate do not agree
    # after `ROUNDS` rounds, the weights are inverse variances of the moments, estimated from the data.
    converged: bool

    @property
    def sigmas(self) -> Matrix:
        """Covariance matrices Σ (P, d, d) of the terms, in products of the units of the signals."""
        return np.asarray(self.estimate.sigmas / np.outer(self.unit, self.unit))

    def wavelet(self) -> Matrix:
        """Return the covariance V (n, n) of the stacked moments under the estimated model, in scaled units."""
        return self.problem.design.loss_factor * moment_covariance(self.estimate.sigmas, self.products)


def settle(terms: tuple[JointTerm, ...], measured: WaveletMatrices) -> JointSolution:
    """Fit the terms to measured covariance matrices, and update the weights until estimate and weights agree."""
    gamma, design = measured.values, replace(measured.design, filled=0)
    variances = np.einsum("jaa->ja", gamma)
    if not np.all(variances > 0):
        raise DataError("a signal has no noise at some scales", argument="x")
    unit = np.exp(-0.5 * np.mean(np.log(variances), axis=0))
    moments = stack(gamma * np.outer(unit, unit))
    from_data = _first_root(gamma * np.outer(unit, unit), design)
    problem = JointProblem(terms, moments, root=from_data, design=design, d=unit.size)
    estimate = first(problem)
    weights = _Mixed.of(problem, estimate.u, estimate.sigmas)
    accuracy = ROUGH_TOLERANCE
    # Rounds of new weights and a new estimate: 3 to 5 are usual.
    for k in range(12):
        products = lag_products(problem.processes(weights.u), design)
        wavelet = measured.design.loss_factor * moment_covariance(weights.sigmas, products)
        problem = replace(problem, root=_root(wavelet * _scale(problem, weights.implied)))
        # The first weights are rough, so the search is repeated once with better weights. The accuracy of the other
        # rounds keeps the error of the fitted variances at a tenth of their change in the last round.
        accuracy = (
            EXACT_TOLERANCE if k == 1 else float(np.clip(0.01 * weights.change**2, EXACT_TOLERANCE, ROUGH_TOLERANCE))
        )
        estimate = search(problem) if k == 1 else resume(problem, estimate, accuracy=accuracy)
        weights = weights.after(problem, estimate, restart=k <= 1)
        if k > 1 and weights.change < 1e-4:
            break
    converged = weights.change <= 0.01  # correct models end below 0.001 (tests/joint)
    if not converged:
        problem = replace(problem, root=from_data)
        estimate = search(problem)
    elif accuracy > EXACT_TOLERANCE:
        estimate = resume(problem, estimate)
    products = lag_products(problem.processes(estimate.u), design)
    return JointSolution(problem, estimate, unit=unit, products=products, measured=measured, converged=converged)


@dataclass(frozen=True, eq=False)
class _Mixed:
    """The parameter values from which the weights of the next round are computed. They are extrapolated from the
    estimates of the last two rounds by the secant method (Anderson 1965, Iterative procedures for nonlinear integral
    equations, J. ACM 12, 547-560, with one step of memory)."""

    u: Vector  # (K,) search coordinates of the shapes
    sigmas: Matrix  # (P, d, d) covariance matrices of the terms
    implied: Matrix  # (J, d) wavelet variances of the model with these values
    # largest relative difference, in the last round, between the wavelet variances that gave the weights and the fitted
    # ones
    change: float = np.inf
    # coordinates and matrices estimated in the last round, and the difference of two logarithms: of the fitted wavelet
    # variances, and of the wavelet variances that gave the weights of this round
    last: tuple[Vector, Matrix, Matrix] | None = None

    @classmethod
    def of(cls, problem: JointProblem, u: Vector, sigmas: Matrix) -> _Mixed:
        return cls(u, sigmas, _implied_variances(problem, u, sigmas))

    def after(self, problem: JointProblem, estimate: JointEstimate, *, restart: bool) -> _Mixed:
        """Return the values for the weights of the next round, given the estimate of this round."""
        miss = np.log(_implied_variances(problem, estimate.u, estimate.sigmas) / self.implied)
        u, sigmas = estimate.u, estimate.sigmas
        if self.last is not None and not restart:
            before, matrices, missed = self.last
            turn = miss - missed
            size = max(float(np.sum(turn**2)), 1e-300)
            share = float(np.clip(np.sum(miss * turn) / size, *MEMORY))
            u = np.clip(u - share * (u - before), *problem.limits)
            values, vectors = np.linalg.eigh(sigmas - share * (sigmas - matrices))
            sigmas = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        change = float(np.max(np.abs(np.expm1(miss))))
        return replace(_Mixed.of(problem, u, sigmas), change=change, last=(estimate.u, estimate.sigmas, miss))


def _implied_variances(problem: JointProblem, u: Vector, sigmas: Matrix) -> Matrix:
    """Return the wavelet variances (J, d) of the model."""
    return np.asarray(np.einsum("pj,paa->ja", problem.shapes(u), sigmas))


def _first_root(gamma: Matrix, design: Design) -> Matrix:
    """Return diagonal weights for the first round from the data alone: Var γ̂_ab ≈ (ν_a² ν_b² + γ_ab²)/η."""
    variances = np.einsum("jaa->ja", gamma)
    # The wavelet variance of a level cannot be far below the variances of both neighbouring levels.
    padded = np.concatenate([variances[:1], variances, variances[-1:]])
    smooth = np.maximum(variances, np.sqrt(padded[:-2] * padded[2:]) / 2)
    products = smooth[:, :, None] * smooth[:, None, :] + gamma**2
    return np.diag(1 / np.sqrt(stack(products / design.degrees_of_freedom[:, None, None])))


def _scale(problem: JointProblem, implied: Matrix) -> Matrix:
    """Return the factors (n, n) that scale V to averages of fitted and measured variances, like `implied_weights`."""
    freedom = problem.design.degrees_of_freedom[:, None]
    gamma = symmetric(problem.moments.reshape(-1, problem.design.levels.size).T, problem.d)
    observed = np.einsum("jaa->ja", gamma)
    # The fitted variances have 1000 degrees of freedom in the average that scales V; see `gmwm.estimation.reweighting`.
    ratio = np.sqrt((freedom * observed / implied + 1000.0) / (freedom + 1000.0))
    scale = stack(ratio[:, :, None] * ratio[:, None, :])
    return np.outer(scale, scale)


def _root(wavelet: Matrix) -> Matrix:
    """Return L with LᵀL = V⁻¹."""
    from scipy.linalg.lapack import dtrtri

    size = np.sqrt(np.diag(wavelet))
    if np.all(size > 0):
        try:
            factor = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))
        except np.linalg.LinAlgError:
            pass
        else:
            if float(np.diag(factor).min()) > 1e-5:  # without noise, rounding leaves 3e-7
                return np.asarray(dtrtri(factor, lower=1)[0] / size)
    raise ModelError(
        "the model as estimated has no noise in some combination of the signals, so its weights do not exist",
        argument="model", advice="Add own noise of all signals to the model, for example WN.",
    )  # fmt: skip


def chosen_levels(
    design: Design, levels: int | Sequence[int] | None, least: float = LEAST_PER_SCALE
) -> NDArray[np.bool_]:
    """Return the mask of the levels: those listed, a number of finest ones, or those with `least` freedom."""
    if levels is None:
        return np.asarray(design.degrees_of_freedom >= least)
    numbers = list(range(1, levels + 1)) if isinstance(levels, int) else list(levels)
    unknown = [level for level in numbers if level not in design.levels]
    if unknown or not numbers:
        expected = f"levels from 1 to {design.levels[-1]} of this recording"
        raise OptionError(argument="levels", expected=expected, got=levels)
    return np.isin(design.levels, numbers)


def chosen_signals(
    x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None, axes: str | Sequence[str] | None
) -> dict[str, Signal]:
    """Return the synchronous signals of the selected axes, with short gaps filled."""
    signals = synchronous_signals(x, rate)
    signals = {name: signals[name] for name in chosen_names(tuple(signals), axes)}
    if len(signals) > MOST_SIGNALS:
        raise DataError(f"a joint model has at most {MOST_SIGNALS} signals; got {len(signals)}", argument="x")
    return signals


def measured_at(
    signals: Mapping[str, Signal], levels: int | Sequence[int] | None, unknowns: int, *, least: float = LEAST_PER_SCALE
) -> WaveletMatrices:
    """Return the estimated covariance matrices Γ̂ of the wavelet coefficients at the chosen levels."""
    matrices = wavelet_matrices(signals)
    mask = chosen_levels(matrices.design, levels, least)
    if np.count_nonzero(mask) <= unknowns:
        raise DataError(
            f"a model with {unknowns} parameters of each signal needs more than {unknowns} levels; the recording has "
            f"{np.count_nonzero(mask)}",
            argument="x", advice="Use a longer recording, or a simpler model.",
        )  # fmt: skip
    return WaveletMatrices(names=matrices.names, values=matrices.values[mask], design=matrices.design.only(mask))
