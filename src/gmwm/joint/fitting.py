"""The iteration of estimate and weights in a joint fit, and the data that it is given."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.covariance.design import Design
from gmwm.errors import DataError, ModelError, OptionError
from gmwm.joint.matrices import WaveletMatrices, wavelet_matrices
from gmwm.joint.moments import lag_products, moment_covariance, stacked, symmetric
from gmwm.joint.problem import JointProblem
from gmwm.joint.search import EXACT, ROUGH, Found, first, resume, search
from gmwm.joint.synchronous import chosen_names, synchronous_signals
from gmwm.joint.terms import JointTerm
from gmwm.signals import Imu, Signal

LEAST = 5.0
"""Coefficients per scale that a level needs to be used by default. With 3, the test of fit rejects up to 8 % of right
models at a level of 5 %, because the coarsest moments are skewed; with 5, see docs/validation/joint.md."""
MOST_SIGNALS = 12
"""Signals, at most: the covariance of all moments of 12 signals takes 10 MB, of 28 half a gigabyte."""
PRIOR = 1000.0
"""Degrees of freedom of the fitted curves when they are averaged with the data to scale V, as for one signal; see
`gmwm.estimation.reweighting`."""
ROUNDS = 12
"""Iterations of estimate and weights, at most; 3 to 5 are usual."""
DEGENERATE = 1e-5
"""Least share of the standard deviation of a moment that the moments before it must leave: V of a model without noise
in some combination of signals has 3e-7, the root of the ridge of 1e-13."""
SETTLED = 1e-5
"""Relative change of the fitted variances at which they end."""
MEMORY = (-3.0, 0.9)
"""Least and largest share of the last round but one in the weights of the next. Without it, some fits of six signals
change by 0.4 % in round 12; with it, by 0.004 % to 0.06 % (simulated RW + GM + WN + QN, 10⁵ samples)."""


@dataclass(frozen=True, eq=False)
class Settled:
    """A solved problem with its final weights.

    Attributes
    ----------
    problem : JointProblem
    found : Found
    unit : (d,) array
        Factors by which the signals were multiplied.
    products : (P, P, J, J) array
        G at the estimate.
    measured : WaveletMatrices
        Γ̂ at the levels used, in the units of the signals.
    """

    problem: JointProblem
    found: Found
    unit: Vector
    products: Matrix
    measured: WaveletMatrices

    @property
    def sigmas(self) -> Matrix:
        """Σ (P, d, d) in products of the units of the signals."""
        return np.asarray(self.found.sigmas / np.outer(self.unit, self.unit))

    def wavelet(self) -> Matrix:
        """V (n, n) of the stacked moments in the units of the problem, at the estimate."""
        return self.problem.design.loss_factor * moment_covariance(self.found.sigmas, self.products)


def settle(terms: tuple[JointTerm, ...], measured: WaveletMatrices) -> Settled:
    """Iterate estimate and weights until they agree."""
    gamma, design = measured.values, replace(measured.design, filled=0)
    variances = np.einsum("jaa->ja", gamma)
    if not np.all(variances > 0):
        raise DataError("a signal has no noise at some scales", argument="x")
    unit = np.exp(-0.5 * np.mean(np.log(variances), axis=0))
    moments = stacked(gamma * np.outer(unit, unit))
    problem = JointProblem(
        terms, moments, root=_first_root(gamma * np.outer(unit, unit), design), design=design, d=unit.size
    )
    found = first(problem)
    weights = _Mixed.of(problem, found.u, found.sigmas)
    accuracy = ROUGH
    for k in range(ROUNDS):
        products = lag_products(problem.processes(weights.u), design)
        wavelet = measured.design.loss_factor * moment_covariance(weights.sigmas, products)
        problem = replace(problem, root=_root(wavelet * _scale(problem, weights.implied)))
        # The first weights are crude, so the search is repeated once with good ones.
        accuracy = EXACT if k == 1 else _accuracy(weights.change)
        found = search(problem) if k == 1 else resume(problem, found, accuracy=accuracy)
        weights = weights.after(problem, found, restart=k <= 1)
        if k > 1 and weights.change < SETTLED:
            break
    if accuracy > EXACT:
        found = resume(problem, found)
    return Settled(
        problem, found, unit=unit, products=lag_products(problem.processes(found.u), design), measured=measured
    )


def _accuracy(change: float) -> float:
    """Accuracy of the objective of a round: its fitted variances then err by a tenth of the last change."""
    return float(np.clip(0.01 * change**2, EXACT, ROUGH))


@dataclass(frozen=True, eq=False)
class _Mixed:
    """The estimate that gives the weights of the next round: the estimate of the last round, extrapolated from two
    rounds by the secant of their changes (Anderson 1965, Iterative procedures for nonlinear integral equations,
    J. ACM 12, 547-560, with one step of memory).

    Attributes
    ----------
    u : (K,) array
    sigmas : (P, d, d) array
    implied : (J, d) array
        Fitted wavelet variances.
    change : float
        Largest relative change of the fitted variances from the weights of a round to its estimate.
    last : tuple of (K,) array, (P, d, d) array and (J, d) array, optional
        Estimate of the last round, and its difference on the logarithm from the weights.
    """

    u: Vector
    sigmas: Matrix
    implied: Matrix
    change: float = np.inf
    last: tuple[Vector, Matrix, Matrix] | None = None

    @classmethod
    def of(cls, problem: JointProblem, u: Vector, sigmas: Matrix) -> _Mixed:
        return cls(u, sigmas, _implied(problem, u, sigmas))

    def after(self, problem: JointProblem, found: Found, *, restart: bool) -> _Mixed:
        """The weights for the round after an estimate."""
        miss = np.log(_implied(problem, found.u, found.sigmas) / self.implied)
        u, sigmas = found.u, found.sigmas
        if self.last is not None and not restart:
            before, matrices, missed = self.last
            turn = miss - missed
            size = max(float(np.sum(turn**2)), 1e-300)
            share = float(np.clip(np.sum(miss * turn) / size, *MEMORY))
            u = np.clip(u - share * (u - before), *problem.limits)
            values, vectors = np.linalg.eigh(sigmas - share * (sigmas - matrices))
            sigmas = (vectors * np.maximum(values, 0.0)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        return replace(
            _Mixed.of(problem, u, sigmas),
            change=float(np.max(np.abs(np.expm1(miss)))),
            last=(found.u, found.sigmas, miss),
        )


def _implied(problem: JointProblem, u: Vector, sigmas: Matrix) -> Matrix:
    """Fitted wavelet variances (J, d)."""
    return np.asarray(np.einsum("pj,paa->ja", problem.shapes(u), sigmas))


def _first_root(gamma: Matrix, design: Design) -> Matrix:
    """Diagonal weights from the data: Var γ̂_ab ≈ (ν_a² ν_b² + γ_ab²)/η, each at least the value of a smooth curve."""
    variances = np.einsum("jaa->ja", gamma)
    # A level cannot lie far below both neighbours.
    padded = np.concatenate([variances[:1], variances, variances[-1:]])
    smooth = np.maximum(variances, np.sqrt(padded[:-2] * padded[2:]) / 2)
    products = smooth[:, :, None] * smooth[:, None, :] + gamma**2
    return np.diag(1 / np.sqrt(stacked(products / design.degrees_of_freedom[:, None, None])))


def _scale(problem: JointProblem, implied: Matrix) -> Matrix:
    """Factors (n, n) that scale V from fitted to averaged variances, see
    `gmwm.estimation.reweighting.implied_weights`."""
    freedom = problem.design.degrees_of_freedom[:, None]
    observed = np.einsum("jaa->ja", _matrices(problem))
    ratio = np.sqrt((freedom * observed / implied + PRIOR) / (freedom + PRIOR))
    scale = stacked(ratio[:, :, None] * ratio[:, None, :])
    return np.outer(scale, scale)


def _matrices(problem: JointProblem) -> Matrix:
    """The moments as matrices (J, d, d)."""
    return symmetric(problem.moments.reshape(-1, problem.design.levels.size).T, problem.d)


def _root(wavelet: Matrix) -> Matrix:
    """L with LᵀL = V⁻¹.

    Raises
    ------
    ModelError
        If the model has no noise in some combination of signals and scales.
    """
    from scipy.linalg.lapack import dtrtri

    size = np.sqrt(np.diag(wavelet))
    if np.all(size > 0):
        try:
            factor = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))
        except np.linalg.LinAlgError:
            pass
        else:
            if float(np.diag(factor).min()) > DEGENERATE:
                return np.asarray(dtrtri(factor, lower=1)[0] / size)
    raise ModelError(
        "the model as estimated has no noise in some combination of the signals, so its weights do not exist",
        argument="model", advice="Add own noise of all signals to the model, for example WN.",
    )  # fmt: skip


def chosen_levels(design: Design, levels: int | Sequence[int] | None, least: float = LEAST) -> NDArray[np.bool_]:
    """Which levels are used: given ones, the first ones up to a number, or those with enough coefficients.

    Raises
    ------
    OptionError
        If a level does not exist.
    """
    if levels is None:
        return np.asarray(design.degrees_of_freedom >= least)
    wanted = list(range(1, levels + 1)) if isinstance(levels, int) else list(levels)
    unknown = [level for level in wanted if level not in design.levels]
    if unknown or not wanted:
        raise OptionError(
            argument="levels", expected=f"levels from 1 to {design.levels[-1]} of this recording", got=levels
        )
    return np.isin(design.levels, wanted)


def chosen_signals(
    x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None, axes: str | Sequence[str] | None
) -> dict[str, Signal]:
    """The synchronous signals of the wanted axes, with short gaps filled.

    Raises
    ------
    DataError, OptionError
        If the signals are not synchronous, or too many or too few; or an axis does not exist.
    """
    signals = synchronous_signals(x, rate)
    signals = {name: signals[name] for name in chosen_names(tuple(signals), axes)}
    if len(signals) > MOST_SIGNALS:
        raise DataError(f"a joint model has at most {MOST_SIGNALS} signals; got {len(signals)}", argument="x")
    return signals


def measured_at(
    signals: Mapping[str, Signal], levels: int | Sequence[int] | None, unknowns: int, *, least: float = LEAST
) -> WaveletMatrices:
    """Γ̂ of the signals at the chosen levels.

    Raises
    ------
    DataError
        If there are fewer levels than terms.
    """
    whole = wavelet_matrices(signals)
    kept = chosen_levels(whole.design, levels, least)
    if np.count_nonzero(kept) <= unknowns:
        raise DataError(
            f"a model with {unknowns} parameters of each signal needs more than {unknowns} levels; the recording has "
            f"{np.count_nonzero(kept)}",
            argument="x", advice="Use a longer recording, or a simpler model.",
        )  # fmt: skip
    return WaveletMatrices(names=whole.names, values=whole.values[kept], design=whole.design.only(kept))
