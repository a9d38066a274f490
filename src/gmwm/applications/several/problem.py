"""The weighted least-squares problem of a joint model of several signals."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gmwm.applications.several.conic import Cone, Conic, least_squares
from gmwm.applications.several.moments import entries
from gmwm.applications.several.terms import JointTerm
from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Branch


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Moments of d signals, their weight matrix Ω, and the terms of the model."""

    terms: tuple[JointTerm, ...]  # the P terms of the model
    # (n,) Stacked entries of Γ̂. The signals are scaled so that each wavelet variance has the geometric mean 1.
    moments: Vector
    root: Matrix  # (n, n) L with LᵀL = Ω
    design: Design  # levels, sampling rate and length of the signals
    d: int
    target: Vector = field(init=False)  # (n,) weighted moments L γ̂
    # for each term, the map from the search coordinate to the shape parameter; None if the shape is not searched
    branches: tuple[Branch | None, ...] = field(init=False)
    # (P, J) Shapes κ of the terms whose shape is not searched. The other rows are not used.
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
    def search_places(self) -> list[int]:
        """Numbers of the terms whose shape is searched."""
        return [k for k, branch in enumerate(self.branches) if branch is not None]

    @property
    def limits(self) -> tuple[Vector, Vector]:
        """Lower and upper limits of the search coordinates, (K,) each."""
        branches = [branch for branch in self.branches if branch is not None]
        return np.array([branch.low for branch in branches]), np.array([branch.high for branch in branches])

    @cached_property
    def cone(self) -> Cone:
        """Free entries of the covariance matrices. A common term has a full matrix here; its rank is reduced later."""
        return Cone(self.d, np.array([term.kind != "own" for term in self.terms]))

    def processes(self, u: Vector) -> list[Process]:
        """Return the processes of all terms at unit scale, for search coordinates u (K,)."""
        processes, at = [], iter(u)
        for term, branch in zip(self.terms, self.branches, strict=True):
            values = term.process.nonlinear if branch is None else branch.values(np.array([next(at)]))[0]
            processes.append(type(term.process).standard(values))
        return processes

    def shapes(self, u: Vector) -> Matrix:
        """Return the shapes κ (P, J) of all terms for search coordinates u (K,)."""
        shapes = self.held.copy()
        for place, coordinate in zip(self.search_places, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            kind = type(self.terms[place].process)
            shapes[place] = kind.shape(branch.values(np.array([coordinate])), self.design.levels, self.design.rate)[0]
        return shapes

    def slopes(self, u: Vector) -> Matrix:
        """Return the derivatives ∂κ/∂u (K, J) of the searched shapes."""
        rows = []
        for place, coordinate in zip(self.search_places, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            at = np.array([coordinate])
            kind = type(self.terms[place].process)
            jacobian = kind.shape_jacobian(branch.values(at), self.design.levels, self.design.rate)
            rows.append(jacobian[0] @ branch.slope(at)[0])
        return np.array(rows).reshape(len(rows), self.design.levels.size)

    def blocks(self, shapes: Matrix) -> Matrix:
        """Return the weighted design columns L (e_i ⊗ κ_p) as an array (P, m, n), for each term p and entry i."""
        size, count = self.design.levels.size, entries(self.d)[0].size
        return np.asarray((self.root.reshape(-1, size) @ shapes.T).reshape(-1, count, len(shapes)).transpose(2, 1, 0))

    def columns(self, shapes: Matrix, cone: Cone | None = None) -> Matrix:
        """Return the weighted design matrix A (n, k), with one column for each free entry."""
        cone = cone or self.cone
        return np.ascontiguousarray(self.blocks(shapes).reshape(-1, self.target.size)[cone.free].T)

    def solve(self, u: Vector, *, gap: float = 1e-9, warm: Matrix | None = None) -> Conic:
        """Return the optimal covariance matrices for search coordinates u."""
        return least_squares(self.columns(self.shapes(u)), self.target, self.cone, gap=gap, warm=warm)

    def residual(self, shapes: Matrix, sigmas: Matrix) -> Vector:
        """Return the weighted residual L (γ̂ − γ) (n,) between measured and fitted moments."""
        rows, columns = entries(self.d)
        fitted = np.einsum("pi,pj->ij", sigmas[:, rows, columns], shapes).ravel()
        return np.asarray(self.target - self.root @ fitted)

    def directions(self, u: Vector, sigmas: Matrix) -> Matrix:
        """Return the derivatives (K, n) of the weighted fitted moments L γ with respect to the search coordinates."""
        rows, columns = entries(self.d)
        slopes = self.slopes(u)
        rows_of = [
            self.root @ np.outer(sigmas[place][rows, columns], slope).ravel()
            for place, slope in zip(self.search_places, slopes, strict=True)
        ]
        return np.array(rows_of).reshape(len(rows_of), self.target.size)


def coordinates(problem: JointProblem) -> Vector | None:
    """Return the search coordinates (K,) that the model states, or None if it does not state all."""
    values = []
    for place in problem.search_places:
        branch, process = problem.branches[place], problem.terms[place].process
        value = process.values[process.nonlinear_parameters()[0].name]
        u = None if value is None or branch is None else branch.coordinate(value)
        if u is None or branch is None:
            return None
        values.append(float(np.clip(u, branch.low, branch.high)))
    return np.array(values)
