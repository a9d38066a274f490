"""The weighted least-squares problem of a model of several signals."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.covariance.design import Design
from gmwm.joint.conic import Cone, Conic, least_squares
from gmwm.joint.moments import entries
from gmwm.joint.terms import JointTerm
from gmwm.processes.base import Process
from gmwm.processes.parameter import Branch


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Moments of d signals, their weights, and the terms that explain them.

    Attributes
    ----------
    terms : tuple of JointTerm
    moments : (n,) array
        Stacked Γ̂, of signals in units in which their curves have the geometric mean 1.
    root : (n, n) array
        L with LᵀL = Ω.
    design : Design
    d : int
    held : (P, J) array
        Shapes κ of the terms whose shape is not searched; the other rows are not used.
    """

    terms: tuple[JointTerm, ...]
    moments: Vector
    root: Matrix
    design: Design
    d: int
    target: Vector = field(init=False)
    branches: tuple[Branch | None, ...] = field(init=False)
    held: Matrix = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", self.root @ self.moments)
        samples, rate = self.design.longest, self.design.rate
        branches = tuple(
            None if term.branch is None else type(term.process).search(samples, rate)[0] for term in self.terms
        )
        object.__setattr__(self, "branches", branches)
        held = np.empty((len(branches), self.design.levels.size))
        for k, (term, branch) in enumerate(zip(self.terms, branches, strict=True)):
            if branch is None:
                process = type(term.process).standard(term.process.nonlinear)
                held[k] = process.wavelet_variance(self.design.levels, rate)
        object.__setattr__(self, "held", held)

    @property
    def searched(self) -> list[int]:
        """Places of the terms whose shape is searched."""
        return [k for k, branch in enumerate(self.branches) if branch is not None]

    @property
    def limits(self) -> tuple[Vector, Vector]:
        """Range of the search coordinates (K,) each."""
        found = [branch for branch in self.branches if branch is not None]
        return np.array([branch.low for branch in found]), np.array([branch.high for branch in found])

    @cached_property
    def cone(self) -> Cone:
        """The unknown entries; a common term has a whole matrix, of which it is one face."""
        return Cone(self.d, np.array([term.kind != "own" for term in self.terms]))

    def processes(self, u: Vector) -> list[Process]:
        """The processes at unit scale for coordinates u (K,)."""
        made, at = [], iter(u)
        for term, branch in zip(self.terms, self.branches, strict=True):
            values = term.process.nonlinear if branch is None else branch.values(np.array([next(at)]))[0]
            made.append(type(term.process).standard(values))
        return made

    def shapes(self, u: Vector) -> Matrix:
        """κ (P, J)."""
        shapes = self.held.copy()
        for place, coordinate in zip(self.searched, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            kind = type(self.terms[place].process)
            shapes[place] = kind.shape(branch.values(np.array([coordinate])), self.design.levels, self.design.rate)[0]
        return shapes

    def slopes(self, u: Vector) -> Matrix:
        """∂κ/∂u (K, J) of the searched terms."""
        rows = []
        for place, coordinate in zip(self.searched, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            at = np.array([coordinate])
            kind = type(self.terms[place].process)
            jacobian = kind.shape_jacobian(branch.values(at), self.design.levels, self.design.rate)
            rows.append(jacobian[0] @ branch.slope(at)[0])
        return np.array(rows).reshape(len(rows), self.design.levels.size)

    def blocks(self, shapes: Matrix) -> Matrix:
        """Columns (P, m, n) of L (κ_p ⊗ e_i) for each term and entry."""
        size, count = self.design.levels.size, entries(self.d)[0].size
        return np.asarray((self.root.reshape(-1, size) @ shapes.T).reshape(-1, count, len(shapes)).transpose(2, 1, 0))

    def columns(self, shapes: Matrix, cone: Cone | None = None) -> Matrix:
        """A (n, k), a column for each unknown."""
        cone = cone or self.cone
        return np.ascontiguousarray(self.blocks(shapes).reshape(-1, self.target.size)[cone.free].T)

    def solve(self, u: Vector, *, gap: float = 1e-9, warm: Matrix | None = None) -> Conic:
        """The best covariance matrices for coordinates u."""
        return least_squares(self.columns(self.shapes(u)), self.target, self.cone, gap=gap, warm=warm)

    def residual(self, shapes: Matrix, sigmas: Matrix) -> Vector:
        """L (γ̂ − γ) (n,)."""
        rows, columns = entries(self.d)
        fitted = np.einsum("pi,pj->ij", sigmas[:, rows, columns], shapes).ravel()
        return np.asarray(self.target - self.root @ fitted)

    def directions(self, u: Vector, sigmas: Matrix) -> Matrix:
        """Derivatives (K, n) of L γ with respect to the coordinates."""
        rows, columns = entries(self.d)
        slopes = self.slopes(u)
        found = [
            self.root @ np.outer(sigmas[place][rows, columns], slope).ravel()
            for place, slope in zip(self.searched, slopes, strict=True)
        ]
        return np.array(found).reshape(len(found), self.target.size)


def coordinates(problem: JointProblem) -> Vector | None:
    """Search coordinates (K,) of the values that the model states; None unless it states all of them."""
    found = []
    for place in problem.searched:
        branch, process = problem.branches[place], problem.terms[place].process
        value = process.values[process.nonlinear_parameters()[0].name]
        u = None if value is None or branch is None else branch.coordinate(value)
        if u is None or branch is None:
            return None
        found.append(float(np.clip(u, branch.low, branch.high)))
    return np.array(found)
