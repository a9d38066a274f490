"""Wavelet information criterion, the expected loss of a fit on another recording: its objective plus its optimism."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.documents import Documented
from gmwm.fitting.estimation.asymptotic import noise_covariance
from gmwm.fitting.estimation.bootstrap import DRAWS, bootstrap
from gmwm.fitting.estimation.intervals import Method
from gmwm.fitting.estimation.linearised import COLLINEAR_SINGULAR_VALUE
from gmwm.fitting.estimation.problem import Problem, pose, unit_shape
from gmwm.fitting.estimation.solver import model_of, solve
from gmwm.fitting.estimation.weighting import Weights
from gmwm.measuring.covariance import Design
from gmwm.recording.options import one_of
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.base import Process

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit


@dataclass(frozen=True, kw_only=True)
class Criterion(Documented):
    """Expected loss of a fitted model on another recording of the same kind, WIC = loss + optimism.

    Attributes
    ----------
    loss : float
        Loss (ν̂ − ν(θ̂))ᵀ Ω (ν̂ − ν(θ̂)) for the recording to which the model was fitted.
    optimism : float
        Mean increase 2 tr[Cov(ν̂, ν(θ̂)) Ω] of the loss for another recording.
    method : "asymptotic" or "bootstrap"
        Method by which the optimism was computed.
    """

    loss: float
    optimism: float
    method: Method
    document_keys = ("value", "loss", "optimism", "method")

    @property
    def value(self) -> float:
        """Sum of the loss and the optimism; smaller is better."""
        return self.loss + self.optimism


def wic(
    fit: Fit, method: Method = "asymptotic", *, draws: int = DRAWS, rng: int | np.random.Generator = 0
) -> Criterion:
    """Compute the wavelet information criterion, which is the expected loss of the fit on another recording.

    Values of several models are only comparable for the same Ω; `gmwm.rank` and `gmwm.select` ensure this.

    Parameters
    ----------
    method : "asymptotic" or "bootstrap"
        Source of the optimism, the amount by which the fit to the data has a smaller loss than to another
        recording. For "asymptotic" it is 2 tr[ΩDH⁻¹DᵀΩV] with H = DᵀΩD − Σ_k [Ω(ν̂ − ν)]_k ∂²ν_k/∂θ∂θᵀ. For
        "bootstrap" it is
        2 Σ_jk Ω_jk Cov(ν̂_j*, ν_k(θ̂*)) over `draws` recordings (*) that are simulated from the fit.
    draws, rng
        The same as for `Fit.bootstrap`.

    Returns
    -------
    Criterion
        Value of the criterion, and the loss and the optimism, whose sum it is.

    Raises
    ------
    OptionError, ModelError, MissingTheoryError
        The same as for `Fit.confidence_intervals`, or if a process cannot be simulated ("bootstrap").

    References
    ----------
    Efron (2004), The estimation of prediction error, JASA 99, 619-632; equation 5 of Balamuta, Guerrier, Molinari
    and Yang.

    Examples
    --------
    >>> from gmwm import RW, WN, fit
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-2)).simulate(20_000, 100.0, rng=1)
    >>> round(fit(WN() + RW(), x, rate=100.0, weighting="optimal").wic().optimism)  # two for each parameter
    4
    """
    one_of(method, "method", get_args(Method))
    if method == "bootstrap":
        drawn = bootstrap(fit, draws, rng)
        share = covariance_trace(drawn.variances, drawn.implied, fit.weighting_matrix)
        return Criterion(loss=float(fit.objective), optimism=share, method=method)
    wavelet = noise_covariance(fit.model, Design.of(fit.wavelet_variance))
    return Criterion(loss=float(fit.objective), optimism=optimism(fit, wavelet), method=method)


def optimism(fit: Fit, wavelet: Matrix, weights: Weights | None = None) -> float:
    """Compute the optimism 2 tr[ΩDH⁻¹DᵀΩV], D = ∂ν²/∂θ, H = DᵀΩD − Σ_k [Ω(ν̂ − ν)]_k ∂²ν_k/∂θ∂θᵀ, first order."""
    wv = fit.wavelet_variance
    root = (Weights(fit.weighting_matrix) if weights is None else weights).root
    design = Design.of(wv)
    pull = fit.weighting_matrix @ (wv.variance - fit.implied)
    slopes, bends = _derivatives(fit, design.levels, rate=design.rate, filter=design.filter, pull=pull)
    if slopes.shape[1] == 0:
        return 0.0
    weighted = root @ slopes
    length = np.linalg.norm(weighted, axis=0)
    seen = length > 0
    weighted = weighted[:, seen] / length[seen]
    gauss = weighted.T @ weighted
    inverse = _inverse(gauss - bends[np.ix_(seen, seen)] / np.outer(length[seen], length[seen]))
    if inverse is None:
        inverse = np.linalg.pinv(gauss, rcond=COLLINEAR_SINGULAR_VALUE, hermitian=True)
    moved = weighted.T @ root
    return float(2 * np.trace(inverse @ moved @ wavelet @ moved.T))


def _inverse(hessian: Matrix) -> Matrix | None:
    """Return the inverse of the Hessian H; None if H is not positive definite, for example at the end of a domain."""
    strength, axes = np.linalg.eigh(hessian)
    if strength[0] <= COLLINEAR_SINGULAR_VALUE * strength[-1]:
        return None
    return np.asarray((axes / strength) @ axes.T)


def _derivatives(fit: Fit, levels: Integers, rate: float, filter: WaveletFilter, pull: Vector) -> tuple[Matrix, Matrix]:
    """Return D (J, p) and Σ_k pull_k ∂²ν_k/∂θ∂θᵀ (p, p); θ are the free scale coefficients and nonlinear parameters."""
    columns: list[Vector] = []
    blocks: list[Matrix] = []
    for term, process in fit.model.by_term.items():
        if process.scale == 0:
            continue
        free = [
            not process.is_fixed(p.name) and term not in fit.diagnostics.acts_as for p in process.nonlinear_parameters()
        ]
        slope, bend = _of_process(process, levels, rate=rate, filter=filter, pull=pull, free=np.flatnonzero(free))
        if process.is_fixed(process.scale_parameter().name):
            slope, bend = slope[:, 1:], bend[1:, 1:]
        columns += list(slope.T)
        blocks.append(bend)
    size = sum(len(block) for block in blocks)
    bends, at = np.zeros((size, size)), 0
    for block in blocks:
        bends[at : at + len(block), at : at + len(block)] = block
        at += len(block)
    return np.array(columns).reshape(size, levels.size).T, bends


def _of_process(
    process: Process, levels: Integers, rate: float, filter: WaveletFilter, pull: Vector,
    free: NDArray[np.intp],
) -> tuple[Matrix, Matrix]:  # fmt: skip
    """Return `_derivatives` of one process: by the scale coefficient, then by the parameters `free`."""
    if not process.nonlinear_parameters():
        return unit_shape(process, levels, rate, filter)[:, None], np.zeros((1, 1))
    at = process.nonlinear
    moved = [at]
    steps, room = np.empty(free.size), process.room(at.reshape(1, -1))[0] if free.size else at
    for i, k in enumerate(free):
        # ε^(1/4) is the best order of magnitude of central differences (tests/inference/test_criterion.py, by
        # bootstrap).
        steps[i] = 1e-4 * room[k]
        moved += [at + steps[i] * np.eye(at.size)[k], at - steps[i] * np.eye(at.size)[k]]
    shape = process.unit_shape(levels, rate, filter)
    slope = np.empty((levels.size, 1 + free.size))
    bend = np.zeros((1 + free.size, 1 + free.size))
    slope[:, 0] = shape
    if free.size:
        jacobian = process.moments_jacobian(np.array(moved), levels, rate, filter)[:, :, free]
        slope[:, 1:] = process.scale * jacobian[0]
        bend[0, 1:] = bend[1:, 0] = pull @ jacobian[0]
        for i in range(free.size):
            bend[1 + i, 1:] = process.scale * (pull @ (jacobian[1 + 2 * i] - jacobian[2 + 2 * i])) / (2 * steps[i])
        bend[1:, 1:] = (bend[1:, 1:] + bend[1:, 1:].T) / 2
    return slope, bend


def covariance_trace(variances: Matrix, implied: Matrix, matrix: Matrix) -> float:
    """Compute the optimism 2 tr[Cov(ν̂*, ν(θ̂*)) Ω] from B simulated curves and the fitted ones (B, J)."""
    centred = variances - variances.mean(axis=0)
    fitted = implied - implied.mean(axis=0)
    return float(2 * np.einsum("bj,jk,bk->", fitted, matrix, centred) / (len(variances) - 1))


def implied_by_refits(
    problem: Problem, known: Vector, variances: Matrix, progress: Callable[[int], None] | None = None
) -> Matrix:
    """Return ν(θ̂*) (B, J) of models fitted to `variances` (B, J); `known` (J,) is that of fixed processes."""
    rows = np.empty_like(variances)
    for k, variance in enumerate(variances):
        drawn = problem.observing(variance - known)
        model = model_of(drawn, solve(drawn, certify=False), None)
        rows[k] = model.wavelet_variance(problem.levels, problem.rate, problem.filter)
        if progress is not None:
            progress(k + 1)
    return rows


def problem_of(fit: Fit) -> tuple[Problem, Vector]:
    """Return the problem that a fit solved, and the wavelet variance (J,) of the processes that are entirely fixed."""
    problem = pose(fit.model, fit.wavelet_variance, fit.weighting_matrix)
    return problem, fit.wavelet_variance.variance - problem.observed
