"""Errors of a joint fit, the test of its model, and the test whether a term is shared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.joint.conic import Cone
from gmwm.joint.fitting import Settled
from gmwm.joint.moments import entries, symmetric

SINGULAR = 1e-6
"""Share of the trace below which an eigenvalue counts as zero: the barrier leaves some 1e-9 (tests/joint)."""


@dataclass(frozen=True, eq=False)
class Errors:
    """Covariance of the estimates of a joint fit, in the units of the problem.

    Attributes
    ----------
    bases : tuple of (m, k_p) arrays
        For each term, the directions in which its matrix can move.
    covariance : (k, k) array
        Covariance of the coefficients of all directions, and of the coordinates of the shapes after them.
    shapes : tuple of int
        Places of the terms whose shape has an error.
    """

    bases: tuple[Matrix, ...]
    covariance: Matrix
    shapes: tuple[int, ...]

    def of_matrix(self, place: int) -> Matrix:
        """Covariance (m, m) of the entries of the matrix of one term."""
        first = sum(basis.shape[1] for basis in self.bases[:place])
        basis = self.bases[place]
        own = slice(first, first + basis.shape[1])
        return np.asarray(basis @ self.covariance[own, own] @ basis.T)

    def of_shape(self, place: int) -> float:
        """Variance of the coordinate of the shape of a term; NaN if the data do not determine it."""
        if place not in self.shapes:
            return float("nan")
        at = sum(basis.shape[1] for basis in self.bases) + self.shapes.index(place)
        return float(self.covariance[at, at])


def errors(settled: Settled, *, inside: bool = False) -> Errors:
    """The sandwich covariance B V Bᵀ on the tangent of the face on which the estimate lies.

    Parameters
    ----------
    settled : Settled
    inside : bool
        Whether to ignore that matrices are singular: the errors of the estimate without the cone.
    """
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
    # Directions that the data do not determine have infinite errors; the pseudo-inverse leaves them out.
    gain = np.linalg.pinv(jacobian / length, rcond=1e-9) / length[:, None]
    return Errors(bases, gain @ scatter @ gain.T, tuple(problem.searched[k] for k in seen))


def _whole(cone: Cone, place: int) -> Matrix:
    """All directions of a matrix, or of its diagonal."""
    rows, columns = entries(cone.d)
    return np.eye(rows.size)[:, np.ones(rows.size, bool) if cone.full[place] else rows == columns]


def _tangent(cone: Cone, place: int, sigma: Matrix, single: bool) -> Matrix:
    """Directions (m, k) that keep the rank of a matrix; variances of zero do not move."""
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


def misfit(settled: Settled) -> tuple[float, int]:
    """Return the statistic of the test of the model, the weighted residual without the cone, and its degrees of
    freedom."""
    problem, found = settled.problem, settled.found
    factor = np.linalg.cholesky(_unit(settled.wavelet()))
    size = np.sqrt(np.diag(settled.wavelet()))
    shapes = problem.shapes(found.u)
    rows, columns = entries(problem.d)
    # Two terms of one shape count once, and a common term as a whole matrix.
    parts = problem_columns(problem.cone, shapes)
    slopes = problem.slopes(found.u)
    for place, slope in zip(problem.searched, slopes, strict=True):
        parts = np.column_stack([parts, np.outer(found.sigmas[place][rows, columns], slope).ravel()])
    whitened = np.linalg.solve(factor, np.column_stack([parts, problem.moments]) / size[:, None])
    return _residual(whitened[:, :-1], whitened[:, -1])


def _unit(wavelet: Matrix) -> Matrix:
    size = np.sqrt(np.diag(wavelet))
    return np.asarray(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size))


def problem_columns(cone: Cone, shapes: Matrix) -> Matrix:
    """Columns (n, k) of all unknown entries, without weights."""
    rows, _ = entries(cone.d)
    whole = np.einsum("pj,im->pijm", shapes, np.eye(rows.size)).transpose(0, 1, 3, 2)
    return np.asarray(whole.reshape(shapes.shape[0] * rows.size, -1)[cone.free].T)


def _residual(columns: Matrix, target: Vector) -> tuple[float, int]:
    """Return the squared length of the part of the target that the columns do not explain, and its degrees of
    freedom."""
    left, size, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    basis = left[:, size > 1e-9 * size[0]]
    rest = target - basis @ (basis.T @ target)
    return float(rest @ rest), target.size - basis.shape[1]


def sharing(null: Settled, place: int) -> tuple[float, int]:
    """Test that a term is not shared: what its off-diagonal entries explain beyond the fit without them.

    Parameters
    ----------
    null : Settled
        The fit in which each signal has the term independently.
    place : int
        Place of the term.
    """
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
    """The matrix of one term in the least-squares fit without the cone, at the estimated shapes."""
    problem = settled.problem
    columns = problem.columns(problem.shapes(settled.found.u))
    found, *_ = np.linalg.lstsq(columns / (length := np.linalg.norm(columns, axis=0)), problem.target, rcond=None)
    values = np.zeros(problem.cone.free.size)
    values[problem.cone.free] = found / length
    return np.asarray(symmetric(values.reshape(len(problem.terms), -1), problem.d)[place])


def correlation_of(sigma: Matrix) -> Matrix:
    """Correlations (d, d) of a covariance matrix; NaN for signals without variance."""
    size = np.sqrt(np.where(np.diag(sigma) > 0, np.diag(sigma), np.nan))
    return np.asarray(sigma / np.outer(size, size))


def correlation_errors(sigma: Matrix, scatter: Matrix) -> Matrix:
    """Standard errors (d, d) of the correlations from the covariance (m, m) of the entries of a matrix."""
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
