"""Covariance of the estimates of a joint fit, its goodness-of-fit test, and the test whether a term is shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.applications.several.conic import Cone
from gmwm.applications.several.fitting import JointSolution
from gmwm.applications.several.moments import entries, symmetric
from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.estimation.goodness import GoodnessOfFit

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
    """Return the covariance of the estimates, B V Bᵀ, with V the covariance of the moments and B the derivatives of the
    estimates with respect to the moments. Estimated matrices may be singular. The estimates then vary only in
    directions that keep the rank of each matrix; with `inside`, all entries vary, as without the condition that the
    matrices are positive semidefinite."""
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
    """Compute the goodness-of-fit test of the model. The moments of coarse levels are skewed, so the variance of the
    statistic is larger than that of a chi-square variable. For η independent coefficients of d signals, S = W/η has a
    Wishart distribution, and the part (η/2) tr(S − I)² of a level has the mean d(d + 1)/2 and the variance d(d + 1) +
    d(2d² + 5d + 5)/η. The estimated parameters reduce this part by the mean leverage h_j of the level."""
    from scipy.special import gammaincc

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
    return GoodnessOfFit(
        statistic=statistic, df=df, pvalue=float(gammaincc(df / inflation / 2, statistic / inflation / 2)),
        levels=problem.design.levels.copy(), left_out=(), method="asymptotic",
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
