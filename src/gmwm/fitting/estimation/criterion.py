"""Wavelet information criterion, the expected loss of a fit on another recording: its objective plus its optimism."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.documents import Documented
from gmwm.fitting.estimation.asymptotic import noise_covariance
from gmwm.fitting.estimation.bootstrap import DRAWS, bootstrap
from gmwm.fitting.estimation.intervals import Method
from gmwm.fitting.estimation.linearised import COLLINEAR_SINGULAR_VALUE
from gmwm.fitting.estimation.problem import Problem, pose, to_find
from gmwm.fitting.estimation.solver import model_of, solve
from gmwm.fitting.estimation.weighting import Weights
from gmwm.measuring.covariance import Design
from gmwm.recording.options import one_of
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
    pull = fit.weighting_matrix @ (wv.variance - fit.implied)
    slopes, bends = _derivatives(fit, Design.of(wv), pull)
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
    return float(2 * np.sum(inverse * (moved @ wavelet @ moved.T)))


def _inverse(hessian: Matrix) -> Matrix | None:
    """Return the inverse of the Hessian H; None if H is not positive definite, for example at the end of a domain."""
    strength, axes = np.linalg.eigh(hessian)
    if strength[0] <= COLLINEAR_SINGULAR_VALUE * strength[-1]:
        return None
    return np.asarray((axes / strength) @ axes.T)


def _derivatives(fit: Fit, design: Design, pull: Vector) -> tuple[Matrix, Matrix]:
    """Return D (J, p) and Σ_k pull_k ∂²ν_k/∂θ∂θᵀ (p, p); θ are the free scales, relative to the estimates, and then the
    free nonlinear parameters."""
    rows, alike = list[Vector](), dict[type[Process], list[tuple[int, Process]]]()
    for term, process in fit.model.by_term.items():
        if process.scale == 0 or process.is_fixed(process.scale_parameter().name):
            continue
        if term not in fit.diagnostics.acts_as and not process.shape_is_fixed:
            alike.setdefault(type(process), []).append((len(rows), process))
        rows.append(fit.decomposition[term])
    blocks = []
    for group in alike.values():
        parts = _of_shapes([process for _, process in group], design, pull)
        for (place, process), (slope, cross, bend) in zip(group, parts, strict=True):
            free = list(to_find(process))
            blocks.append((place, len(rows), process.scale * cross[free], process.scale * bend[free][:, free]))
            rows += list(process.scale * slope[free])
    bends = np.zeros((len(rows), len(rows)))
    for place, at, cross, bend in blocks:
        block = slice(at, at + len(bend))
        bends[place, block] = bends[block, place] = cross
        bends[block, block] = bend
    return np.array(rows).reshape(-1, design.levels.size).T, bends


def _of_shapes(processes: list[Process], design: Design, pull: Vector) -> Iterator[tuple[Matrix, Vector, Matrix]]:
    """Yield for the shape of each process of one class its derivatives (q, J), and for the sum of the shape weighted
    with `pull` the derivatives (q,) and second derivatives (q, q)."""
    at = np.array([process.nonlinear for process in processes])
    count = at.shape[1]
    # ε^(1/4) is the best order of magnitude of central differences (tests/inference/test_criterion.py, by bootstrap).
    steps = 1e-4 * processes[0].room(at)
    sides = np.concatenate([np.zeros((1, count)), np.eye(count), -np.eye(count)])
    moved = (at[:, None] + sides * steps[:, None]).reshape(-1, count)
    slopes = processes[0].moments_jacobian(moved, design.levels, design.rate, design.filter)
    slopes = slopes.reshape(len(at), len(sides), -1, count)
    pulled = pull @ slopes
    bends = (pulled[:, 1 : 1 + count] - pulled[:, 1 + count :]) / (2 * steps[:, :, None])
    for slope, cross, bend in zip(slopes[:, 0], pulled[:, 0], bends, strict=True):
        yield slope.T, cross, (bend + bend.T) / 2


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
