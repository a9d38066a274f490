"""Covariance of the estimates of a joint fit, its goodness-of-fit test, and the test whether a term is shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.applications.several.conic import Cone
from gmwm.applications.several.fitting import Settled
from gmwm.applications.several.moments import entries, symmetric
from gmwm.base.arrays import Matrix, Vector

SINGULAR = 1e-6
"""An eigenvalue of a covariance matrix counts as zero if it is below this share of the trace. The barrier method leaves
about 1e-9 in place of zero (tests/joint)."""

FOURTH = 1.34
"""(∫S²)²/∫S⁴ of the wavelet coefficients of one level, in units of M_j/2^j, with S their spectral density: 1.34 for RW
and 1.69 for WN. With the smaller one, the test of the model rejects 2 to 6 % of right models
(docs/validation/joint.md), without the correction up to 7.5 %."""


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
        own = slice(first, first + basis.shape[1])
        return np.asarray(basis @ self.covariance[own, own] @ basis.T)

    def of_shape(self, place: int) -> float:
        """Return the variance of the search coordinate of a shape, or NaN if the data do not determine it."""
        if place not in self.shapes:
            return float("nan")
        at = sum(basis.shape[1] for basis in self.bases) + self.shapes.index(place)
        return float(self.covariance[at, at])


def errors(settled: Settled, *, inside: bool = False) -> Errors:
    """Return the covariance of the estimates, B V Bᵀ, with V the covariance of the moments and B the derivatives of the
    estimates with respect to the moments.

    Estimated matrices may be singular. The estimates then vary only in directions that keep the rank of each matrix;
    with `inside`, all entries vary, as without the condition that the matrices are positive semidefinite."""
    problem, found = settled.problem, settled.found
    blocks = problem.blocks(problem.shapes(found.u))
    bases = tuple(
        _whole(problem.cone, place) if inside else _tangent(problem.cone, place, sigma, term.kind == "common")
        for place, (sigma, term) in enumerate(zip(found.sigmas, problem.terms, strict=True))
    )
    low, high = problem.limits
    moved = problem.directions(found.u, found.sigmas)
    seen = [
        k for k, place in enumerate(problem.searched)
        if np.any(bases[place]) and low[k] < found.u[k] < high[k] and np.linalg.norm(moved[k]) > 0
    ]  # fmt: skip
    jacobian = np.concatenate(
        [*(block.T @ basis for block, basis in zip(blocks, bases, strict=True)), moved[seen].T], axis=1
    )
    scatter = problem.root @ settled.wavelet() @ problem.root.T
    length = np.linalg.norm(jacobian, axis=0)
    # The variance of directions that the data do not determine is infinite; the pseudo-inverse leaves these out.
    gain = np.linalg.pinv(jacobian / length, rcond=1e-9) / length[:, None]
    return Errors(bases, gain @ scatter @ gain.T, tuple(problem.searched[k] for k in seen))


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
    rank = 1 if single else int(np.count_nonzero(values > SINGULAR * values.sum()))
    if rank == cone.d or values[-1] <= 0:
        return _whole(cone, place)
    factor = vectors[:, -rank:] * np.sqrt(values[-rank:])
    eye = np.eye(cone.d)
    moves = np.einsum("ac,br->crab", eye, factor)
    moves = (moves + moves.transpose(0, 1, 3, 2)).reshape(-1, cone.d, cone.d)[:, rows, columns].T
    left, size, _ = np.linalg.svd(moves, full_matrices=False)
    return left[:, size > 1e-9 * size[0]]


@dataclass(frozen=True)
class Misfit:
    """The goodness-of-fit test of a model."""

    statistic: float  # weighted sum of squared residuals of a fit that does not require positive semidefinite matrices
    df: int  # its degrees of freedom
    inflation: float  # its variance for a correct model, divided by 2·df, the variance of a chi-square variable

    @property
    def pvalue(self) -> float:
        """p-value by the multiple of a chi-square variable that has the same mean and variance."""
        from scipy.special import gammaincc

        return float(gammaincc(self.df / self.inflation / 2, self.statistic / self.inflation / 2))


def misfit(settled: Settled) -> Misfit:
    """Compute the goodness-of-fit test of the model.

    The moments of coarse levels are skewed, so the variance of the statistic is larger than that of a chi-square
    variable. For η independent coefficients of d signals, S = W/η has a Wishart distribution, and the part (η/2) tr(S −
    I)² of a level has the mean d(d + 1)/2 and the variance d(d + 1) + d(2d² + 5d + 5)/η. The estimated parameters
    reduce this part by the mean leverage h_j of the level."""
    problem, found = settled.problem, settled.found
    factor = np.linalg.cholesky(_unit(settled.wavelet()))
    size = np.sqrt(np.diag(settled.wavelet()))
    shapes = problem.shapes(found.u)
    rows, columns = entries(problem.d)
    # Two terms with the same shape count once. A common term counts with all entries of its matrix.
    parts = problem_columns(problem.cone, shapes)
    slopes = problem.slopes(found.u)
    for place, slope in zip(problem.searched, slopes, strict=True):
        parts = np.column_stack([parts, np.outer(found.sigmas[place][rows, columns], slope).ravel()])
    whitened = np.linalg.solve(factor, np.column_stack([parts, problem.moments]) / size[:, None])
    basis, rest = _regressed(whitened[:, :-1], whitened[:, -1])
    taken = np.mean(np.sum(basis**2, axis=1).reshape(rows.size, -1), axis=0)
    d, df = problem.d, rest.size - basis.shape[1]
    freedom = FOURTH * settled.measured.design.degrees_of_freedom
    excess = d * (2 * d**2 + 5 * d + 5) * float(np.sum((1 - taken) ** 2 / freedom))
    return Misfit(float(rest @ rest), df, 1 + excess / (2 * df) if df else 1.0)


def _unit(wavelet: Matrix) -> Matrix:
    size = np.sqrt(np.diag(wavelet))
    return np.asarray(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))


def problem_columns(cone: Cone, shapes: Matrix) -> Matrix:
    """Return the columns (n, k) of the unweighted design matrix, one for each free entry."""
    rows, _ = entries(cone.d)
    whole = np.einsum("pj,im->pijm", shapes, np.eye(rows.size)).transpose(0, 1, 3, 2)
    return np.asarray(whole.reshape(shapes.shape[0] * rows.size, -1)[cone.free].T)


def _regressed(columns: Matrix, target: Vector) -> tuple[Matrix, Vector]:
    """Return an orthonormal basis (n, k) of the space that the columns span, and the residuals of a target (n,)."""
    left, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    basis = left[:, size > 1e-9 * size[0]]
    return basis, target - basis @ (basis.T @ target)


def _residual(columns: Matrix, target: Vector) -> tuple[float, int]:
    """Return the residual sum of squares of the regression of a target on columns, and its degrees of freedom."""
    basis, rest = _regressed(columns, target)
    return float(rest @ rest), target.size - basis.shape[1]


def sharing(null: Settled, place: int) -> tuple[float, int]:
    """Return the statistic of the test that term number `place` is not shared, and its degrees of freedom.

    It is the decrease of the weighted residuals of `null`, where the term is independent, when its other entries are
    added."""
    problem, found = null.problem, null.found
    wavelet = null.wavelet()
    size = np.sqrt(np.diag(wavelet))
    factor = np.linalg.cholesky(_unit(wavelet))
    shapes = problem.shapes(found.u)
    rows, columns = entries(problem.d)
    parts = [problem_columns(problem.cone, shapes)]
    for at, slope in zip(problem.searched, problem.slopes(found.u), strict=True):
        parts.append(np.outer(found.sigmas[at][rows, columns], slope).ravel()[:, None])
    off = np.eye(rows.size)[rows != columns]
    added = np.einsum("im,j->mji", off, shapes[place]).reshape(-1, len(off))
    whitened = np.linalg.solve(factor, np.column_stack([*parts, added, problem.moments]) / size[:, None])
    less = _residual(whitened[:, : -len(off) - 1], whitened[:, -1])
    more = _residual(whitened[:, :-1], whitened[:, -1])
    return less[0] - more[0], less[1] - more[1]


def unconstrained(settled: Settled, place: int) -> Matrix:
    """Return the matrix of a term in the fit at the estimated shapes, without the condition that it is semidefinite."""
    problem = settled.problem
    columns = problem.columns(problem.shapes(settled.found.u))
    found, *_ = np.linalg.lstsq(columns / (length := np.linalg.norm(columns, axis=0)), problem.target, rcond=None)
    values = np.zeros(problem.cone.free.size)
    values[problem.cone.free] = found / length
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
