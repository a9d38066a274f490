"""Least squares over sums of positive semidefinite and diagonal matrices, by the logarithmic barrier.

Given the shapes κ_p of all terms, the moments are linear in the covariance matrices Σ_p:

    min |b − A s|²   with all Σ_p ⪰ 0.

Newton's method minimises |b − A s|² − μ Σ_p log det Σ_p for falling μ. The minimum for μ is at most ν μ above the
optimum, with ν the number of rows of all matrices (Boyd and Vandenberghe 2004, Convex Optimization, section 11.2).
The last Newton steps end near it, so 2 ν μ is stated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.joint.moments import entries, symmetric

STEPS = 300
"""Newton steps, at most; 30 to 60 are usual (tests/joint/test_conic.py)."""
SHRINK = 0.02
"""Factor of μ from one round to the next."""
WARM = 1e-7
"""μ of the point from which a similar problem starts."""
NEAR = (1.0, 0.1)
"""Newton decrement, in units of μ, at which a round and the last round end."""


@dataclass(frozen=True, eq=False)
class Cone:
    """Which entries of the covariance matrices of P terms are unknown.

    Attributes
    ----------
    d : int
        Number of signals.
    full : (P,) array of bool
        Whether a term has a whole matrix; otherwise it is diagonal.
    """

    d: int
    full: NDArray[np.bool_]

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """Which of the P d(d + 1)/2 entries are unknown, term by term."""
        rows, columns = entries(self.d)
        return np.concatenate([np.ones(rows.size, bool) if whole else rows == columns for whole in self.full])

    @cached_property
    def terms(self) -> NDArray[np.int64]:
        """The term of each unknown."""
        count = entries(self.d)[0].size
        return np.repeat(np.arange(self.full.size), count)[self.free]

    def matrices(self, unknowns: Vector) -> Matrix:
        """Σ (P, d, d) from the unknowns."""
        values = np.zeros(self.free.size)
        values[self.free] = unknowns
        return symmetric(values.reshape(self.full.size, -1), self.d)

    def unknowns(self, matrices: Matrix) -> Vector:
        """The unknowns of Σ (P, d, d)."""
        rows, columns = entries(self.d)
        return np.asarray(matrices[:, rows, columns].ravel()[self.free])


@dataclass(frozen=True, eq=False)
class Conic:
    """The solution of a conic problem.

    Attributes
    ----------
    sigmas : (P, d, d) array
    objective : float
    gap : float
        Bound on how much smaller the objective can be.
    hessian : (k, k) array
        Second derivatives of the objective with the last barrier, with respect to the unknowns.
    steps : int
    warm : (P, d, d) array
        Matrices inside the cone, from which a similar problem is solved faster.
    """

    sigmas: Matrix
    objective: float
    gap: float
    hessian: Matrix
    steps: int
    warm: Matrix


def least_squares(
    design: Matrix, target: Vector, cone: Cone, *, gap: float = 1e-9, warm: Matrix | None = None
) -> Conic:
    """Solve the problem to a relative gap.

    Parameters
    ----------
    design : (n, k) array
        A: a column for each unknown.
    target : (n,) array
        b.
    cone : Cone
    gap : float
        Bound on the error of the objective, relative to it.
    warm : (P, d, d) array, optional
        `Conic.warm` of a similar problem.
    """
    k = design.shape[1]
    triangle = np.asarray(np.linalg.qr(np.column_stack([design, target]), mode="r"), dtype=np.float64)
    r, reduced = triangle[:k, :k], triangle[:k, k]
    size = float(np.linalg.norm(reduced)) or 1.0
    beyond = float(np.sum(triangle[k:, k] ** 2)) / size**2
    lengths = np.zeros(cone.full.size)
    np.add.at(lengths, cone.terms, np.linalg.norm(r, axis=0) ** 2)
    unit = (size / np.sqrt(np.where(lengths > 0, lengths, 1.0)))[cone.terms]
    rows, y = r * unit / size, reduced / size
    barrier = _Barrier(cone)
    if warm is None:
        s = cone.unknowns(np.tile(np.eye(cone.d), (cone.full.size, 1, 1))) * (0.3 / cone.full.size)
    else:
        s = cone.unknowns(warm) / unit
    quadratic, linear = 2 * rows.T @ rows, -2 * rows.T @ y
    rank = cone.full.size * cone.d
    mu, steps, inside = 0.1 if warm is None else WARM, 0, s
    for near in NEAR:
        while True:
            while steps < STEPS:
                gradient, hessian = barrier.at(s, mu)
                gradient += quadratic @ s + linear
                hessian += quadratic
                scale = 1 / np.sqrt(np.diag(hessian))
                step = -scale * np.linalg.solve(hessian * np.outer(scale, scale), scale * gradient)
                s = s + barrier.reach(step) * step
                steps += 1
                if -float(gradient @ step) < near * mu:
                    break
            if mu >= WARM:
                inside = s
            value = float(np.sum((rows @ s - y) ** 2)) + beyond
            if 2 * rank * mu <= gap * value or steps >= STEPS or mu < 1e-15:
                break
            mu *= SHRINK
    _, hessian = barrier.at(s, mu)
    hessian = (hessian + quadratic) / np.outer(unit, unit) * size**2
    return Conic(
        sigmas=cone.matrices(s * unit),
        objective=value * size**2,
        gap=2 * rank * mu * size**2,
        hessian=hessian,
        steps=steps,
        warm=cone.matrices(inside * unit),
    )


class _Barrier:
    """−μ Σ log det Σ_p with its derivatives with respect to the unknowns."""

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
        own = s[self.diagonal]
        gradient[self.diagonal] = -mu / own
        hessian[self.diagonal, self.diagonal] = mu / own**2
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

    def reach(self, step: Vector) -> float:
        """The longest step, at most 1, that stays well inside the cone."""
        least = float(np.min(step[self.diagonal] / self.s[self.diagonal], initial=0.0))
        if self.count:
            moved = self.root @ symmetric(step[self.blocks], self.cone.d) @ np.swapaxes(self.root, 1, 2)
            least = min(least, float(np.linalg.eigvalsh(moved)[:, 0].min()))
        return min(1.0, -0.95 / least) if least < 0 else 1.0
