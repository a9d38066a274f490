"""Fit a joint model with weights that agree with the estimate, and the covariance and tests of the estimates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.several.conic import Cone
from gmwm.applications.several.matrices import (
    WaveletMatrices,
    chosen_names,
    entries,
    lag_products,
    moment_covariance,
    stack,
    symmetric,
    synchronous_signals,
    wavelet_matrices,
)
from gmwm.applications.several.search import (
    EXACT_TOLERANCE,
    ROUGH_TOLERANCE,
    JointEstimate,
    JointProblem,
    JointTerm,
    first,
    resume,
    search,
)
from gmwm.base.arrays import Booleans, Matrix, Vector
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.lazy import scipy
from gmwm.fitting.estimation.goodness import GoodnessOfFit
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
    products: Matrix  # (P, P, J, J) G at the estimate; see `gmwm.applications.several.matrices`
    # estimated covariance matrices Γ̂ of the wavelet coefficients at the levels used, in the units of the signals
    measured: WaveletMatrices
    # Whether weights are V⁻¹ under the estimate; after `ROUNDS` rounds without convergence, inverse variances of data.
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
        # The first weights are rough, so the search is repeated. Accuracy: a tenth of the last round's change.
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
    """Parameters for the weights of the next round, extrapolated from two rounds by the secant method (Anderson 1965,
    Iterative procedures for nonlinear integral equations, J. ACM 12, 547-560, one step of memory)."""

    u: Vector  # (K,) search coordinates of the shapes
    sigmas: Matrix  # (P, d, d) covariance matrices of the terms
    implied: Matrix  # (J, d) wavelet variances of the model with these values
    # largest relative difference of the last round between fitted variances and those of its weights
    change: float = np.inf
    # estimated coordinates and matrices of the last round, and log ratio of fitted variances to those of its weights
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
    size = np.sqrt(np.diag(wavelet))
    if np.all(size > 0):
        try:
            factor = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))
        except np.linalg.LinAlgError:
            pass
        else:
            if float(np.diag(factor).min()) > 1e-5:  # without noise, rounding leaves 3e-7
                return np.asarray(scipy.linalg.lapack.dtrtri(factor, lower=1)[0] / size)
    raise ModelError(
        "the model as estimated has no noise in some combination of the signals, so its weights do not exist",
        argument="model", advice="Add own noise of all signals to the model, for example WN.",
    )  # fmt: skip


def chosen_levels(design: Design, levels: int | Sequence[int] | None, least: float = LEAST_PER_SCALE) -> Booleans:
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


SINGULAR_SHARE = 1e-6
"""Share of the trace below which an eigenvalue is zero. The barrier method leaves about 1e-9 (tests/joint)."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Covariance of the estimates of a joint fit, in scaled units, for m = d(d + 1)/2 entries of a matrix."""

    bases: tuple[Matrix, ...]  # for each term, a basis of the directions in which the entries of its matrix may vary
    # (k, k) covariance of the coefficients of all these directions, followed by the search coordinates of the shapes
    covariance: Matrix
    shapes: tuple[int, ...]  # numbers of the terms whose shape has a standard error

    def of_matrix(self, place: int) -> Matrix:
        """Return the covariance (m, m) of the entries of the matrix of one term."""
        first = sum(basis.shape[1] for basis in self.bases[:place])
        basis = self.bases[place]
        place_slice = slice(first, first + basis.shape[1])
        return np.asarray(basis @ self.covariance[place_slice, place_slice] @ basis.T)

    def of_shape(self, place: int) -> float:
        """Return the variance of the search coordinate of a shape, or NaN if the data do not determine it."""
        if place not in self.shapes:
            return float("nan")
        at = sum(basis.shape[1] for basis in self.bases) + self.shapes.index(place)
        return float(self.covariance[at, at])


def errors(settled: JointSolution, *, inside: bool = False) -> Errors:
    """Return B V Bᵀ of the estimates, V of the moments, B the derivatives by moments. Singular matrices vary only in
    directions that keep their rank, or, with `inside`, in all entries."""
    problem, estimate = settled.problem, settled.estimate
    blocks = problem.blocks(problem.shapes(estimate.u))
    bases = tuple(
        _whole(problem.cone, place) if inside else _tangent(problem.cone, place, sigma, term.kind == "common")
        for place, (sigma, term) in enumerate(zip(estimate.sigmas, problem.terms, strict=True))
    )
    low, high = problem.limits
    moved = problem.directions(estimate.u, estimate.sigmas)
    seen = [
        k for k, place in enumerate(problem.search_places)
        if np.any(bases[place]) and low[k] < estimate.u[k] < high[k] and np.linalg.norm(moved[k]) > 0
    ]  # fmt: skip
    jacobian = np.concatenate(
        [*(block.T @ basis for block, basis in zip(blocks, bases, strict=True)), moved[seen].T], axis=1
    )
    scatter = problem.root @ settled.wavelet() @ problem.root.T
    length = np.linalg.norm(jacobian, axis=0)
    # The variance of directions that the data do not determine is infinite; the pseudo-inverse leaves these out.
    gain = np.linalg.pinv(jacobian / length, rcond=1e-9) / length[:, None]
    return Errors(bases, gain @ scatter @ gain.T, tuple(problem.search_places[k] for k in seen))


def _whole(cone: Cone, place: int) -> Matrix:
    """Return the unit directions of all free entries of the matrix of a term."""
    rows, columns = entries(cone.d)
    return np.eye(rows.size)[:, np.ones(rows.size, bool) if cone.full[place] else rows == columns]


def _tangent(cone: Cone, place: int, sigma: Matrix, single: bool) -> Matrix:
    """Return the directions (m, k) that keep the rank of the matrix of a term, or the zeros of a diagonal matrix."""
    rows, columns = entries(cone.d)
    if not cone.full[place]:
        return np.eye(rows.size)[:, (rows == columns) & (sigma[rows, columns] > 0)]
    values, vectors = np.linalg.eigh(sigma)
    rank = 1 if single else int(np.count_nonzero(values > SINGULAR_SHARE * values.sum()))
    if rank == cone.d or values[-1] <= 0:
        return _whole(cone, place)
    factor = vectors[:, -rank:] * np.sqrt(values[-rank:])
    eye = np.eye(cone.d)
    moves = np.einsum("ac,br->crab", eye, factor)
    moves = (moves + moves.transpose(0, 1, 3, 2)).reshape(-1, cone.d, cone.d)[:, rows, columns].T
    basis, size, _ = np.linalg.svd(moves, full_matrices=False)
    return basis[:, size > 1e-9 * size[0]]


def misfit(settled: JointSolution) -> GoodnessOfFit:
    """Compute the goodness-of-fit test. Coarse moments are skewed: with η coefficients of d signals and Wishart S =
    W/η, (η/2) tr(S − I)² has the mean d(d + 1)/2 and the variance d(d + 1) + d(2d² + 5d + 5)/η, less leverage h_j."""
    problem = settled.problem
    rows, _ = entries(problem.d)
    # Two terms with the same shape count once. A common term counts with all entries of its matrix.
    whitened = _white_columns(settled)
    basis, residual = _regression(whitened[:, :-1], whitened[:, -1])
    taken = np.mean(np.sum(basis**2, axis=1).reshape(rows.size, -1), axis=0)
    d, df = problem.d, residual.size - basis.shape[1]
    # (∫S²)²/∫S⁴ of a level: 1.34 for RW, 1.69 for WN. With 1.34, 2 to 6 % of right models are rejected.
    freedom = 1.34 * settled.measured.design.degrees_of_freedom
    excess = d * (2 * d**2 + 5 * d + 5) * float(np.sum((1 - taken) ** 2 / freedom))
    # The p-value is that of a multiple of a chi-square variable with the same mean and variance.
    inflation = 1 + excess / (2 * df) if df else 1.0
    statistic = float(residual @ residual)
    pvalue = float(scipy.special.gammaincc(df / inflation / 2, statistic / inflation / 2))
    return GoodnessOfFit(
        statistic=statistic, df=df, pvalue=pvalue, levels=problem.design.levels.copy(), left_out=(),
        method="asymptotic",
    )  # fmt: skip


def _white_columns(settled: JointSolution, *more: Matrix) -> Matrix:
    """Return the columns for all free entries and searched shapes, `more` columns and the moments, whitened by V."""
    problem, estimate, wavelet = settled.problem, settled.estimate, settled.wavelet()
    rows, columns = entries(problem.d)
    shapes = problem.shapes(estimate.u)
    each = np.einsum("pj,im->pijm", shapes, np.eye(rows.size)).transpose(0, 1, 3, 2)
    parts = [each.reshape(len(shapes) * rows.size, -1)[problem.cone.free].T]
    for place, slope in zip(problem.search_places, problem.slopes(estimate.u), strict=True):
        parts.append(np.outer(estimate.sigmas[place][rows, columns], slope).ravel()[:, None])
    size = np.sqrt(np.diag(wavelet))
    factor = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))
    return np.asarray(np.linalg.solve(factor, np.column_stack([*parts, *more, problem.moments]) / size[:, None]))


def _regression(columns: Matrix, target: Vector) -> tuple[Matrix, Vector]:
    """Return an orthonormal basis (n, k) of the space that the columns span, and the residuals of a target (n,)."""
    directions, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    basis = directions[:, size > 1e-9 * size[0]]
    return basis, target - basis @ (basis.T @ target)


def sharing(null: JointSolution, place: int) -> tuple[float, int]:
    """Return the statistic of the test that term number `place` is not shared, and its degrees of freedom. It is the
    decrease of the weighted residuals of `null`, where the term is independent, when its other entries are added."""
    rows, columns = entries(null.problem.d)
    off = np.eye(rows.size)[rows != columns]
    shape = null.problem.shapes(null.estimate.u)[place]
    whitened = _white_columns(null, np.einsum("im,j->mji", off, shape).reshape(-1, len(off)))
    less, null_residual = _regression(whitened[:, : -len(off) - 1], whitened[:, -1])
    more, residual = _regression(whitened[:, :-1], whitened[:, -1])
    return float(null_residual @ null_residual) - float(residual @ residual), more.shape[1] - less.shape[1]


def unconstrained_matrix(settled: JointSolution, place: int) -> Matrix:
    """Return the matrix of a term in the fit at the estimated shapes, without the condition that it is semidefinite."""
    problem = settled.problem
    columns = problem.columns(problem.shapes(settled.estimate.u))
    solution, *_ = np.linalg.lstsq(columns / (length := np.linalg.norm(columns, axis=0)), problem.target, rcond=None)
    values = np.zeros(problem.cone.free.size)
    values[problem.cone.free] = solution / length
    return np.asarray(symmetric(values.reshape(len(problem.terms), -1), problem.d)[place])


def correlation_of(sigma: Matrix) -> Matrix:
    """Return the correlations (d, d) of a covariance matrix. They are NaN for signals with variance 0."""
    size = np.sqrt(np.where(np.diag(sigma) > 0, np.diag(sigma), np.nan))
    return np.asarray(sigma / np.outer(size, size))


def correlation_errors(sigma: Matrix, scatter: Matrix) -> Matrix:
    """Return the standard errors (d, d) of the correlations of a matrix, from the covariance (m, m) of its entries."""
    d = len(sigma)
    rows, columns = entries(d)
    place = {(int(a), int(b)): k for k, (a, b) in enumerate(zip(rows, columns, strict=True))}
    r, out = correlation_of(sigma), np.zeros((d, d))
    for (a, b), k in place.items():
        if a != b:
            at = [place[a, a], k, place[b, b]]
            with np.errstate(divide="ignore", invalid="ignore"):
                slope = np.array([-r[a, b] / 2 / sigma[a, a], 1 / np.sqrt(sigma[a, a] * sigma[b, b]),
                                  -r[a, b] / 2 / sigma[b, b]])  # fmt: skip
            out[a, b] = out[b, a] = np.sqrt(max(float(slope @ scatter[np.ix_(at, at)] @ slope), 0.0))
    return out
