"""Least squares with positive semidefinite or diagonal matrices as unknowns, solved by the logarithmic barrier method.

min |b − A s|² subject to Σ_p ⪰ 0, s their free entries: Newton's method minimises |b − A s|² − μ Σ_p log det Σ_p for
decreasing μ, at most ν μ above the optimum, ν rows of all matrices (Boyd and Vandenberghe 2004, Convex Optimization,
section 11.2). As the last step ends only near this minimum, gmwm states 2 ν μ."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gmwm.applications.several.matrices import entries, symmetric
from gmwm.base.arrays import Booleans, Integers, Matrix, Vector
from gmwm.base.lazy import scipy


@dataclass(frozen=True, eq=False)
class Cone:
    """Pattern of the free entries in the covariance matrices of P terms."""

    d: int
    full: Booleans  # (P,) true if all entries of the matrix of a term are free, False if it is diagonal

    @cached_property
    def free(self) -> Booleans:
        """Mask of the free entries among the P d(d + 1)/2 entries, term by term."""
        rows, columns = entries(self.d)
        return np.concatenate([np.ones(rows.size, bool) if is_full else rows == columns for is_full in self.full])

    @cached_property
    def terms(self) -> Integers:
        """Number of the term to which each free entry belongs."""
        count = entries(self.d)[0].size
        return np.repeat(np.arange(self.full.size), count)[self.free]

    def matrices(self, unknowns: Vector) -> Matrix:
        """Return the matrices Σ (P, d, d) with the given free entries."""
        values = np.zeros(self.free.size)
        values[self.free] = unknowns
        return symmetric(values.reshape(self.full.size, -1), self.d)

    def unknowns(self, matrices: Matrix) -> Vector:
        """Return the free entries of matrices Σ (P, d, d) as a vector."""
        rows, columns = entries(self.d)
        return np.asarray(matrices[:, rows, columns].ravel()[self.free])


@dataclass(frozen=True, eq=False)
class Conic:
    """Solution of a conic least-squares problem."""

    sigmas: Matrix  # (P, d, d) covariance matrices of the terms
    objective: float  # |b − A s|² at the solution
    gap: float  # upper bound on the difference between `objective` and the optimum
    # (k, k) second derivatives of the objective plus the last barrier term, with respect to the free entries
    hessian: Matrix
    steps: int  # Newton steps
    warm: Matrix  # (P, d, d) positive definite matrices to start a similar problem from


def least_squares(
    design: Matrix, target: Vector, cone: Cone, *, gap: float = 1e-9, warm: Matrix | None = None
) -> Conic:
    """Minimise |b − A s|² subject to Σ_p ⪰ 0 to a relative `gap`; A is `design` (n, k), `warm` a similar result."""
    if warm is not None:
        try:
            return _least_squares(design, target, cone, gap=gap, warm=warm)
        except np.linalg.LinAlgError:
            pass  # The start is so near to the boundary that rounding takes a step across it.
    return _least_squares(design, target, cone, gap=gap, warm=None)


def _least_squares(design: Matrix, target: Vector, cone: Cone, *, gap: float, warm: Matrix | None) -> Conic:
    """Solve the problem from given matrices, or from multiples of the identity."""
    k = design.shape[1]
    triangle = np.asarray(np.linalg.qr(np.column_stack([design, target]), mode="r"), dtype=np.float64)
    r, reduced = triangle[:k, :k], triangle[:k, k]
    size = float(np.linalg.norm(reduced)) or 1.0
    beyond = float(np.sum(triangle[k:, k] ** 2)) / size**2
    lengths = np.zeros(cone.full.size)
    np.add.at(lengths, cone.terms, np.linalg.norm(r, axis=0) ** 2)
    unit = (size / np.sqrt(np.where(lengths > 0, lengths, 1.0)))[cone.terms]
    rows, y = r * unit / size, reduced / size
    quadratic, linear = 2 * rows.T @ rows, -2 * rows.T @ y
    barrier = _Barrier(cone)
    if (s := barrier.inside(rows, y)) is not None:
        value = float(np.sum((rows @ s - y) ** 2)) + beyond
        sigmas = cone.matrices(s * unit)
        hessian = quadratic / np.outer(unit, unit) * size**2
        return Conic(sigmas, value * size**2, gap=1e-12 * value * size**2, hessian=hessian, steps=0, warm=sigmas)
    if warm is None:
        s = cone.unknowns(np.tile(np.eye(cone.d), (cone.full.size, 1, 1))) * (0.3 / cone.full.size)
    else:
        s = cone.unknowns(warm) / unit
    rank = cone.full.size * cone.d
    # The solution at the barrier parameter μ = 1e-7 is kept as the start of a similar problem.
    mu, steps, inside = 0.1 if warm is None else 1e-7, 0, s
    for near in (1.0, 0.1):  # squared Newton decrement over μ at the end of a round: of all rounds, and of the last one
        while True:
            # 30 to 60 Newton steps are usual (tests/joint/test_conic.py).
            while steps < 300:
                gradient, hessian = barrier.at(s, mu)
                gradient += quadratic @ s + linear
                hessian += quadratic
                scale = 1 / np.sqrt(np.diag(hessian))
                step = -scale * _solve(hessian * np.outer(scale, scale), scale * gradient)
                s = s + barrier.reach(step) * step
                steps += 1
                if -float(gradient @ step) < near * mu:
                    break
            if mu >= 1e-7:
                inside = s
            value = float(np.sum((rows @ s - y) ** 2)) + beyond
            if 2 * rank * mu <= gap * value or steps >= 300 or mu < 1e-15:
                break
            mu *= 0.02
    _, hessian = barrier.at(s, mu)
    hessian = (hessian + quadratic) / np.outer(unit, unit) * size**2
    return Conic(
        sigmas=cone.matrices(s * unit), objective=value * size**2, gap=2 * rank * mu * size**2, hessian=hessian,
        steps=steps, warm=cone.matrices(inside * unit),
    )  # fmt: skip


def _solve(matrix: Matrix, vector: Vector) -> Vector:
    """Solve matrix · x = vector for a positive definite matrix, by elimination if rounding makes it indefinite."""
    _, x, failed = scipy.linalg.lapack.dposv(matrix, vector)
    return np.asarray(np.linalg.solve(matrix, vector) if failed else x)


class _Barrier:
    """The barrier −μ Σ_p log det Σ_p: its derivatives with respect to the free entries, and the allowed step length."""

    def __init__(self, cone: Cone) -> None:
        rows, columns = entries(cone.d)
        full, terms, free = cone.full, cone.terms, cone.free
        self.cone, self.count = cone, int(full.sum())
        self.in_matrix = full[terms]
        self.where = np.flatnonzero(self.in_matrix)
        self.diagonal = np.flatnonzero(~self.in_matrix)
        self.rows, self.columns = rows, columns
        self.twice = np.where(rows == columns, 1.0, 2.0)
        self.blocks = self.where.reshape(self.count, rows.size)
        assert free.size == full.size * rows.size

    def at(self, s: Vector, mu: float) -> tuple[Vector, Matrix]:
        gradient, hessian = np.zeros(s.size), np.zeros((s.size, s.size))
        variances = s[self.diagonal]
        gradient[self.diagonal] = -mu / variances
        hessian[self.diagonal, self.diagonal] = mu / variances**2
        self.s = s
        if self.count:
            sigma = symmetric(s[self.blocks], self.cone.d)
            self.root = np.linalg.inv(np.linalg.cholesky(sigma))
            inverse = np.swapaxes(self.root, 1, 2) @ self.root
            a, b = self.rows, self.columns
            gradient[self.blocks] = -mu * self.twice * inverse[:, a, b]
            weight = np.outer(self.twice, self.twice) / 2
            second = inverse[:, a[:, None], a] * inverse[:, b[:, None], b]
            second += inverse[:, a[:, None], b] * inverse[:, b[:, None], a]
            hessian[self.blocks[:, :, None], self.blocks[:, None, :]] = mu * weight * second
        return gradient, hessian

    def inside(self, rows: Matrix, y: Vector) -> Vector | None:
        """Return the solution without constraints if all its matrices are positive definite; it is then the optimum."""
        pivots = np.abs(np.diag(rows))
        if rows.shape[0] < rows.shape[1] or pivots.min() <= 1e-9 * pivots.max():
            return None
        s, _ = scipy.linalg.lapack.dtrtrs(rows, y)
        if np.any(s[self.diagonal] <= 0):
            return None
        if self.count:
            values = np.linalg.eigvalsh(symmetric(s[self.blocks], self.cone.d))
            # Closer to the boundary, the solution would be a poor start for a similar problem.
            if np.any(values[:, 0] <= 1e-4 * values[:, -1]):
                return None
        return np.asarray(s)

    def reach(self, step: Vector) -> float:
        """Return the largest factor, at most 1, with which a step keeps all matrices positive definite."""
        least = float(np.min(step[self.diagonal] / self.s[self.diagonal], initial=0.0))
        if self.count:
            moved = self.root @ symmetric(step[self.blocks], self.cone.d) @ np.swapaxes(self.root, 1, 2)
            least = min(least, float(np.linalg.eigvalsh(moved)[:, 0].min()))
        return min(1.0, -0.95 / least) if least < 0 else 1.0
