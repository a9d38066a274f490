"""Prove by branch and bound over the shapes of the terms that no other parameters of a joint model fit better.

A node has intervals of shapes (unit wavelet variances); its relaxation allows any mixture. With a residual r, and z of
positive products with allowed columns, y = r − δ z without positive products bounds every objective by (yᵀb)²/(yᵀy),
data b. The largest product with a shape κ is the largest eigenvalue of A = Σ_j κ_j R_j, R_j of y at level j. Between
tabulated coordinates κ is a convex combination of four control points plus a bounded error, and the eigenvalue is
convex, so the control points bound it."""

from __future__ import annotations

import heapq
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.several.conic import Cone, least_squares
from gmwm.applications.several.matrices import entries, symmetric
from gmwm.applications.several.search import JointEstimate, JointProblem, descend
from gmwm.base.arrays import Matrix, Vector
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Branch

LARGEST_GAP = 1e-3  # the search ends when the relative gap between the objective and its lower bound is at most this


@dataclass(frozen=True, eq=False)
class ShapeTable:
    """Table of the shapes of a term as a function of its search coordinate."""

    kind: type[Process]  # class of the process of the term
    branch: Branch  # map from the search coordinate to the shape parameter
    nodes: Vector  # (n,) tabulated search coordinates
    # (n,) distance from the first tabulated shape along the curve of logarithms, without factors
    length: Vector
    # (n − 1, 4, J) control points of the cubic in each cell between neighbouring tabulated coordinates
    controls: NDArray[np.float64]
    margin: Matrix  # (n − 1, J) bound on the error of the cubic

    @classmethod
    def of(cls, problem: JointProblem, place: int, weights: Vector) -> ShapeTable:
        """Tabulate the shapes κ of term number `place`, normalised to Σ_j w_j κ_j = 1 with positive weights w (J,)."""
        branch, kind = problem.branches[place], type(problem.terms[place].process)
        assert branch is not None
        levels, rate = problem.design.levels, problem.design.rate
        # 5 % in β, a relative error of about 1e-8 (tests/joint/test_certificate.py).
        cells = int(np.ceil((branch.high - branch.low) / 0.05))
        u = np.linspace(branch.low, branch.high, 2 * cells + 1)
        values = kind.shape(branch.values(u), levels, rate)
        slopes = kind.shape_jacobian(branch.values(u[::2]), levels, rate)[:, :, 0] * branch.slope(u[::2])
        size = values @ weights
        values = values / size[:, None]
        slopes = (slopes - values[::2] * (slopes @ weights)[:, None]) / size[::2, None]
        step, ends = u[2] - u[0], values[::2]
        inner = np.stack([ends[:-1] + step * slopes[:-1] / 3, ends[1:] - step * slopes[1:] / 3], axis=1)
        controls = np.concatenate([ends[:-1, None], inner, ends[1:, None]], axis=1)
        middle = (ends[:-1] + ends[1:]) / 2 + step * (slopes[:-1] - slopes[1:]) / 8
        # The error at the middle of a cell, with a margin for the whole cell.
        margin = 4.0 * np.abs(values[1::2] - middle) + 1e-14 * ends.max(axis=1)[1:, None]
        logs = np.log(ends)
        logs = logs - logs.mean(axis=1, keepdims=True)
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(logs, axis=0), axis=1))])
        return cls(kind, branch, nodes=u[::2], length=length, controls=controls, margin=margin)

    def cells(self, low: float, high: float) -> NDArray[np.int64]:
        """Return the numbers of the cells that overlap an interval of `length`."""
        first = max(int(np.searchsorted(self.length, low, side="right")) - 1, 0)
        last = min(int(np.searchsorted(self.length, high, side="left")), self.length.size - 1)
        return np.arange(first, max(last, first + 1))

    def pieces(self, low: float, high: float) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the cells that overlap an interval of `length`, and control points (k, 4, J) of their parts in it."""
        cells = self.cells(low, high)
        controls = self.controls[cells]
        first, last = (self._inside(cells[k], at) for k, at in ((0, low), (-1, high)))
        if cells.size == 1:
            controls[0] = _part(controls[0], first, last)
        else:
            controls[0], controls[-1] = _part(controls[0], first, 1.0), _part(controls[-1], 0.0, last)
        return cells, controls

    def _inside(self, cell: int, length: float) -> float:
        """Return the relative position of a length in a cell, from 0 to 1."""
        low, high = self.length[cell], self.length[cell + 1]
        return float(np.clip((length - low) / (high - low), 0.0, 1.0)) if high > low else float(length > low)

    def at(self, length: Vector) -> Vector:
        """Return the search coordinates that belong to values of `length`."""
        return np.asarray(np.interp(length, self.length, self.nodes))


def _part(controls: Matrix, first: float, last: float) -> Matrix:
    """Return the control points (4, J) of the part of a cubic between two positions, as values of its blossom."""

    def blossom(*at: float) -> Vector:
        points = controls
        for t in at:
            points = (1 - t) * points[:-1] + t * points[1:]
        return np.asarray(points[0])

    return np.array([blossom(*[first] * (3 - k), *[last] * k) for k in range(4)])


@dataclass(frozen=True, eq=False)
class Certificate:
    """Lower bounds on the objective of a model, and the best fit that the search found."""

    lower_bound: float  # no parameter values of the model have a smaller objective
    # lower bound on the objective if the model may have any number of terms of each searched process
    relaxed_bound: float
    nodes: int  # number of bounded nodes
    best: JointEstimate


Intervals = tuple[tuple[float, float], ...]


class Prover:
    """Branch-and-bound search for one weighted least-squares problem."""

    def __init__(self, problem: JointProblem) -> None:
        self.problem = problem
        self.whole = [problem.terms[place].kind != "own" for place in problem.search_places]
        self.linear = [k for k, branch in enumerate(problem.branches) if branch is None]
        self.fixed_whole = [problem.terms[k].kind != "own" for k in self.linear]
        rows, columns = entries(problem.d)
        size = np.sqrt(np.sum(problem.root**2, axis=0)).reshape(rows.size, -1)
        self.positive = size * (rows == columns)[:, None]
        self.lift = np.linalg.solve(problem.root.T, self.positive.ravel())
        self.own = self.positive[rows == columns]
        weights = self.own.mean(axis=0)
        self.curves = [ShapeTable.of(problem, place, weights) for place in problem.search_places]
        self.fixed = problem.shapes(np.array([curve.nodes[0] for curve in self.curves]))[self.linear]

    def prove(self, estimate: JointEstimate, seconds: float = np.inf) -> Certificate:
        """Compute a lower bound on the objective within a time limit (s), and the best fit that the search finds."""
        end = time.monotonic() + seconds
        root: Intervals = tuple((0.0, float(curve.length[-1])) for curve in self.curves)
        best, ticket = estimate, count()
        bound, places = self.bound(root, 0.0)
        relaxed = bound
        heap: list[tuple[float, int, Intervals]] = [(bound, next(ticket), root)]
        seen, nodes, low = {root}, 1, bound
        while heap:
            low, _, node = heapq.heappop(heap)
            if low >= best.objective * (1 - LARGEST_GAP) or nodes >= 2000 or time.monotonic() > end:
                break
            for child in self._children(node):
                if child in seen:
                    continue
                seen.add(child)
                bound, places = self.bound(child, best.objective * (1 - LARGEST_GAP))
                nodes += 1
                if bound < best.objective * (1 - LARGEST_GAP):
                    heapq.heappush(heap, (max(bound, low), next(ticket), child))
                    if nodes % 4 == 0 or nodes < 12:
                        local = descend(self.problem, places)
                        best = min(best, local, key=lambda one: one.objective)
        else:
            low = best.objective * (1 - LARGEST_GAP)
        return Certificate(min(max(low, relaxed), best.objective), relaxed, nodes, best)

    def _children(self, node: Intervals) -> list[Intervals]:
        """Split a node at the middle of its longest interval. The intervals of interchangeable terms are sorted."""
        longest = int(np.argmax([high - low for low, high in node]))
        low, high = node[longest]
        middle = (low + high) / 2
        children = []
        for part in ((low, middle), (middle, high)):
            child = [*node[:longest], part, *node[longest + 1 :]]
            groups: dict[tuple[str, bool], list[int]] = {}
            for k, curve in enumerate(self.curves):
                groups.setdefault((curve.kind.name, self.whole[k]), []).append(k)
            for members in groups.values():
                for k, interval in zip(members, sorted(child[k] for k in members), strict=True):
                    child[k] = interval
            children.append(tuple(child))
        return children

    def bound(self, node: Intervals, enough: float) -> tuple[float, Vector]:
        """Return a node's lower bound, up to `enough`, and the coordinate of each term's largest relaxed shape."""
        problem = self.problem
        chosen = [np.linspace(low, high, 7) for low, high in node]
        best, parts = 0.0, np.array([float(np.mean(interval)) for interval in node])
        warm = None
        for _ in range(6):
            shapes = [curve.kind.shape(curve.branch.values(curve.at(s)), problem.design.levels, problem.design.rate)
                      for curve, s in zip(self.curves, chosen, strict=True)]  # fmt: skip
            every = np.concatenate([self.fixed, *shapes])
            full = self.fixed_whole + [w for w, s in zip(self.whole, chosen, strict=True) for _ in s]
            cone = Cone(problem.d, np.array(full))
            solution = least_squares(problem.columns(every, cone), problem.target, cone, gap=1e-5, warm=warm)
            residual = problem.residual(every, solution.sigmas)
            value, peaks = self._dual(residual, node)
            best = max(best, value)
            share = np.max(np.trace(solution.sigmas, axis1=1, axis2=2)[:, None] * every, axis=1)[len(self.linear) :]
            pieces = np.split(share, np.cumsum([s.size for s in chosen])[:-1])
            parts = np.array([s[np.argmax(part)] for s, part in zip(chosen, pieces, strict=True)])
            if best >= enough > 0 or solution.objective - best <= 0.1 * LARGEST_GAP * solution.objective:
                break
            active = [s[part >= min(1e-6 * share.max(), part.max())] for s, part in zip(chosen, pieces, strict=True)]
            new = [np.unique(np.concatenate([s, peak])) for s, peak in zip(active, peaks, strict=True)]
            if all(np.array_equal(a, b) for a, b in zip(new, chosen, strict=True)):
                break
            chosen = new
        return best, np.array([float(curve.at(np.array([s]))[0]) for curve, s in zip(self.curves, parts, strict=True)])

    def _dual(self, residual: Vector, node: Intervals) -> tuple[float, list[Vector]]:
        """Return the bound from a residual, and for each term the values of `length` at which to add shapes."""
        problem = self.problem
        rows, columns = entries(problem.d)
        pull = (problem.root.T @ residual).reshape(rows.size, -1) / np.where(rows == columns, 1.0, 2.0)[:, None]
        levels = symmetric(pull.T, problem.d)
        norms = np.max(np.abs(np.linalg.eigvalsh(levels)), axis=1)
        excess = max(self._scores(self.fixed, levels, whole=self.fixed_whole), default=0.0)
        peaks = []
        for curve, full, (low, high) in zip(self.curves, self.whole, node, strict=True):
            cells, controls = curve.pieces(low, high)
            gains = self._largest(controls.reshape(-1, controls.shape[2]), levels, full).reshape(-1, 4)
            gains = gains.max(axis=1) + curve.margin[cells] @ norms
            least = (controls @ self.own.T).min(axis=(1, 2)) - (curve.margin[cells] @ self.own.T).max(axis=1)
            score = gains / np.maximum(least, 1e-300)
            excess = max(excess, float(score.max()))
            peaks.append(self._peaks(curve, cells, score, low=low, high=high))
        y = residual - max(excess, 0.0) * self.lift
        product = float(y @ problem.target)
        return (product**2 / float(y @ y) if product > 0 else 0.0), peaks

    def _largest(self, shapes: Matrix, levels: Matrix, whole: bool) -> Vector:
        """Return the largest product of the residual with a unit column of each shape."""
        gradients = np.tensordot(shapes, levels, axes=1)
        if whole:
            return np.asarray(np.linalg.eigvalsh(gradients)[:, -1])
        return np.asarray(np.einsum("naa->na", gradients).max(axis=1))

    def _scores(self, shapes: Matrix, levels: Matrix, *, whole: Sequence[bool]) -> list[float]:
        least = (shapes @ self.own.T).min(axis=1)
        return [float(self._largest(shape[None], levels, w)[0] / z)
                for shape, w, z in zip(shapes, whole, least, strict=True)]  # fmt: skip

    @staticmethod
    def _peaks(curve: ShapeTable, cells: NDArray[np.int64], score: Vector, *, low: float, high: float) -> Vector:
        """Return the values of `length` at the three highest local maxima of a score."""
        padded = np.concatenate([[-np.inf], score, [-np.inf]])
        local = np.flatnonzero((score >= padded[:-2]) & (score >= padded[2:]) & (score > 0))
        highest = local[np.argsort(-score[local])[:3]]
        middle = (curve.length[cells[highest]] + curve.length[cells[highest] + 1]) / 2
        return np.clip(middle, low, high)
