"""Local optima of problems that have processes with several shape parameters, by variable projection.

Non-negative least squares eliminates the scales, which leaves an objective of all shapes with known gradient (Golub and
Pereyra 1973, SIAM J. Numer. Anal. 10, 413-432). After Levenberg-Marquardt, Newton steps give all digits."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Integers, Matrix, Vector, freeze
from gmwm.base.threads import check_stop
from gmwm.fitting.estimation.atoms import shape_at
from gmwm.fitting.estimation.branch_and_bound import Search
from gmwm.fitting.estimation.problem import Problem, to_find
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Branch

ROUNDING_NOISE = 1e-12  # relative difference below which two objectives are equal up to rounding
_COMPLEX = 1e-30


class Coordinates:
    """Coordinates of one free process: those of its class, or one for each free parameter if some are fixed."""

    def __init__(self, process: Process) -> None:
        self.kind = type(process)
        self.process = process
        self.moving = to_find(process)
        self.size = len(self.moving)  # number of coordinates
        parameters = process.nonlinear_parameters()
        self.together = len(self.moving) == len(parameters)
        self.parameters = [parameters[k] for k in self.moving]
        values = [process.values[p.name] for p in parameters]
        self.held = np.array([0.0 if v is None else v for v in values], dtype=np.float64)

    def values(self, z: NDArray[Any]) -> NDArray[Any]:
        """Return all nonlinear parameters (n, q), including fixed ones, at coordinates (n, d)."""
        if self.together:
            return self.kind.at_coordinates(z)
        values = np.tile(self.held.astype(z.dtype), (len(z), 1))
        for column, (k, parameter) in enumerate(zip(self.moving, self.parameters, strict=True)):
            values[:, k] = parameter.at_coordinate(z[:, column])
        return values

    def with_slopes(self, z: Vector) -> tuple[Matrix, Matrix]:
        """Return the nonlinear parameters (1, q) at a point z (d,), and their derivatives (q, d) by complex steps."""
        moved = self.values(z + 1j * _COMPLEX * np.eye(z.size))
        return np.ascontiguousarray(moved[:1].real), np.asarray(moved.imag.T / _COMPLEX)

    def of(self, values: Matrix) -> Matrix:
        """Return the coordinates (n, d) of nonlinear parameters (n, q); fixed parameters have no coordinate."""
        if self.together:
            return self.kind.coordinates(values)
        columns = [p.coordinate(values[:, k]) for k, p in zip(self.moving, self.parameters, strict=True)]
        return np.stack(columns, axis=1)

    def scan_range(self, samples: int, rate: float) -> Matrix:
        """Return the ends (d, 2) of the coordinates in a scan for starting values."""
        if self.together:
            return self.kind.scan(samples, rate)
        # The range of a bounded parameter extends close to its bounds, because fixed values may exclude other values.
        box = np.array([p.scanned(samples, rate) for p in self.parameters])
        share = np.array([p.domain == "between" for p in self.parameters])
        # The scan covers 0.9999 of a bounded domain (tests/estimation/test_arma_fits.py, a thin set of processes).
        return np.where(share[:, None], 5.0 * np.sign(box), box)

    def ends(self, samples: int, rate: float) -> Matrix:
        """Return the bounds (d, 2) of the coordinates, far beyond the scan."""
        # Distance beyond the scanned range: a factor of 160 000, or a bounded domain up to 1 − 1e-12.
        margin = 12.0
        return np.asarray(self.scan_range(samples, rate) + np.array([-margin, margin]))

    def possible(self, values: Matrix) -> NDArray[np.bool_]:
        """Return a mask of the valid rows of nonlinear parameters (n, q); joint coordinates are always valid."""
        if self.together:
            return np.ones(len(values), dtype=np.bool_)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.all(self.kind.room(values) > 0, axis=1))

    def start_values(self) -> Vector | None:
        """Return the coordinates of the values in the model; None if a value is missing."""
        if any(value is None for value in (self.process.values[p.name] for p in self.process.nonlinear_parameters())):
            return None
        return np.asarray(self.of(self.process.nonlinear.reshape(1, -1))[0])


@dataclass(frozen=True, eq=False)
class ShapePoint:
    """Point of all shapes: branches and coordinates u of the curved processes, then of the free ones."""

    branches: tuple[Branch, ...]
    x: Vector


@dataclass(frozen=True, eq=False)
class Projection:
    """Smallest objective of given shapes, with weights, unit vectors and `lengths` of the weighted curves."""

    objective: float
    point: ShapePoint
    weights: Vector
    units: Matrix
    lengths: Vector
    residual: Vector


@dataclass(frozen=True, eq=False)
class Curvature:
    """Second derivatives of the objective, in the unit of the data, for the coordinates that `able` marks."""

    able: NDArray[np.bool_]
    hessian: Matrix


class Surface:
    """Objective of one problem as a function of the coordinates of all shapes."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.fixed = problem.fixed
        self.frees = [Coordinates(problem.model.processes[place]) for place in problem.free]
        self.spans = list(pairwise(accumulate((free.size for free in self.frees), initial=0)))
        ends = [free.ends(problem.samples, problem.rate) for free in self.frees]
        self.ends = np.concatenate([np.empty((0, 2)), *ends])
        self._none = np.empty((0, problem.levels.size))
        self._owners = {0: np.repeat(np.arange(len(self.frees)), [free.size for free in self.frees])}

    def owners(self, count: int) -> Integers:
        """Return the index of the shaped process to which each coordinate belongs, if `count` processes are curved."""
        if count not in self._owners:
            self._owners[count] = np.concatenate([np.arange(count), count + self._owners[0]])
        return self._owners[count]

    def split(self, point: ShapePoint) -> tuple[Vector, list[Vector]]:
        """Return the search coordinates of the curved processes, and the coordinates of each free process."""
        count = len(point.branches)
        return point.x[:count], [point.x[count + a : count + b] for a, b in self.spans]

    def at(self, point: ShapePoint) -> Projection | None:
        """Return the optimal weights at a point; None if a process is not valid there."""
        check_stop()
        u, z = self.split(point)
        values = [free.values(part.reshape(1, -1)) for free, part in zip(self.frees, z, strict=True)]
        if any(not (free.together or free.possible(row)[0]) for free, row in zip(self.frees, values, strict=True)):
            return None
        weighted = self._rows([self._curved_shapes(point.branches, u), *self._free_shapes(values)])
        lengths = np.sqrt((weighted * weighted).sum(axis=1))
        if not np.isfinite(lengths).all():
            return None
        # A process whose wavelet variance is zero, such as a sinusoid at a zero of the filters, gets no weight.
        weighted /= np.where(lengths > 0, lengths, 1.0)[:, None]
        every = np.concatenate([self.fixed, weighted])
        weights, objective = _core.nonnegative_least_squares(self.problem.target, every)
        return Projection(
            objective=objective, point=point, weights=weights, units=every, lengths=lengths,
            residual=self.problem.target - weights @ every,
        )  # fmt: skip

    def free_shapes(self, z: list[Vector]) -> Matrix:
        """Return the wavelet variances (n, J) of the free processes with scale coefficient 1 at the coordinates `z`."""
        values = [f.values(part.reshape(1, -1)) for f, part in zip(self.frees, z, strict=True)]
        return np.concatenate([self._none, *self._free_shapes(values)])

    def _rows(self, parts: list[Matrix]) -> Matrix:
        """Return weighted rows (n, J) of parts."""
        return np.concatenate([self._none, *parts]) @ self.problem.root.T

    def _free_shapes(self, values: list[Matrix]) -> list[Matrix]:
        problem = self.problem
        return [
            free.kind.moments(row, problem.levels, problem.rate, problem.filter)
            for free, row in zip(self.frees, values, strict=True)
        ]

    def curved_alone(self, z: list[Vector]) -> Search:
        """Return the search for the curved processes with the free ones fixed, without those of zero variance."""
        problem, curves = self.problem, self.free_shapes(z)
        assert problem.curved_class is not None
        seen = np.any(curves > 0, axis=1)
        held = tuple(place for place, able in zip(problem.free, seen, strict=True) if able)
        rows = np.concatenate([problem.shapes, curves[seen]])
        return Search(replace(problem, linear=(*problem.linear, *held), free=(), shapes=rows), problem.curved_class)

    def _curved_shapes(self, branches: tuple[Branch, ...], u: Vector) -> Matrix:
        curved_class, problem = self.problem.curved_class, self.problem
        if not branches:
            return self._none
        assert curved_class is not None
        parameters = np.concatenate([branch.values(places) for branch, places in _runs(branches, u)])
        return shape_at(curved_class, parameters, levels=problem.levels, rate=problem.rate, filter=problem.filter)

    def slopes(self, found: Projection) -> Matrix:
        """Return the derivatives (d, J) of Σ weight · unit vector at constant lengths, kept for later searches."""
        if (known := found.__dict__.get("_slopes")) is None:
            known = found.__dict__["_slopes"] = freeze(self._slopes(found))
        return cast(Matrix, known)

    def _slopes(self, found: Projection) -> Matrix:
        problem, first = self.problem, len(self.fixed)
        u, z = self.split(found.point)
        branches = found.point.branches
        rows = []
        if branches:
            curved_class = problem.curved_class
            assert curved_class is not None
            pairs = _runs(branches, u)
            parameters = np.concatenate([branch.values(places) for branch, places in pairs])
            by_u = np.concatenate([branch.slope(places) for branch, places in pairs])
            rows.append(
                curved_class.moments_jacobian(parameters, problem.levels, problem.rate, problem.filter)[:, :, 0] * by_u
            )
        for free, part in zip(self.frees, z, strict=True):
            values, by_z = free.with_slopes(part)
            jacobian = free.kind.moments_jacobian(values, problem.levels, problem.rate, problem.filter)[0]
            rows.append((jacobian @ by_z).T)
        share = found.weights[first:] / np.where(found.lengths > 0, found.lengths, 1.0)
        return self._rows(rows) * share[self.owners(len(branches)), None]

    def moving(self, found: Projection, gradient: Vector) -> NDArray[np.bool_]:
        """Return a mask of the coordinates of processes with a weight for which a step does not leave the branch."""
        count = len(found.point.branches)
        able = (found.weights[len(self.fixed) :] > 0)[self.owners(count)]
        for k, (branch, u) in enumerate(zip(found.point.branches, found.point.x[:count].tolist(), strict=True)):
            if (u <= branch.low and gradient[k] > 0) or (u >= branch.high and gradient[k] < 0):
                able[k] = False
        return able

    def move(self, point: ShapePoint, step: Vector) -> ShapePoint:
        """Return the point after a step, limited to its branches and bounds."""
        x = point.x + step
        for k, branch in enumerate(point.branches):
            x[k] = min(max(x[k], branch.low), branch.high)
        count = len(point.branches)
        x[count:] = np.minimum(np.maximum(x[count:], self.ends[:, 0]), self.ends[:, 1])
        return ShapePoint(point.branches, x)

    def downhill(self, start: ShapePoint | Projection, steps: int = 100) -> Projection | None:
        """Return the point that at most `steps` Levenberg-Marquardt steps reach; None if `start` is not valid."""
        # Longest Levenberg-Marquardt step in a coordinate. It changes a correlation time by a factor of seven.
        longest_step = 2.0
        best = start if isinstance(start, Projection) else self.at(start)
        if best is None:
            return None
        damping = 1e-3
        for _ in range(steps):
            better = None
            slopes = self.slopes(best)
            gradient = -slopes @ best.residual
            able = self.moving(best, gradient)
            if not able.any():
                break
            jacobian = self._project(best, slopes[able])
            square, downward = jacobian @ jacobian.T, -gradient[able]
            ridge = np.diag(square.diagonal() + np.finfo(float).tiny)
            while damping < 1e10:
                step = np.zeros(best.point.x.size)
                step[able] = _solve(square + damping * ridge, downward).clip(-longest_step, longest_step)
                trial = self.at(self.move(best.point, step))
                if trial is not None and trial.objective < best.objective:
                    better = trial
                    break
                damping *= 8.0
            if better is None:
                break
            gain, best = 1.0 - better.objective / best.objective, better
            damping = max(damping / 10.0, 1e-9)
            # Newton steps then converge faster.
            if gain < 1e-9:
                break
        return best

    def _project(self, found: Projection, slopes: Matrix) -> Matrix:
        """Return the slopes minus their projection on the unit vectors, because the scales compensate for this part."""
        rows = found.units[found.weights > 0]
        basis, _ = np.linalg.qr(rows.T)
        return np.asarray(slopes - (slopes @ basis) @ basis.T)

    def sharpen(self, best: Projection, curvature: Curvature | None = None) -> tuple[Projection, Curvature | None]:
        """Return the optimum after Newton steps, and the last second derivatives, kept from `curvature` until steps
        converge slowly. Steps that increase the objective are rejected."""
        square, before, computed = self.problem.unit**2, np.inf, 0
        for _ in range(15):
            gradient = -self.slopes(best) @ best.residual
            able = self.moving(best, gradient)
            ends = np.array(
                [b.low < u < b.high for b, u in zip(best.point.branches, best.point.x, strict=False)], dtype=np.bool_
            )
            able[: ends.size] &= ends
            if curvature is None or not np.array_equal(curvature.able, able):
                # Largest number of times that Newton steps compute the second derivatives.
                if computed == 6 or (hessian := self._hessian(best, able)) is None:
                    break
                curvature, computed, fresh = Curvature(able, square * hessian), computed + 1, True
            else:
                fresh = False
            step = np.zeros(best.point.x.size)
            step[able] = _solve(curvature.hessian / square, -gradient[able])
            size = float(np.abs(step).max(initial=0.0))
            trial = self.at(self.move(best.point, step)) if size < 0.3 else None
            if trial is None or not self.problem.as_low(trial.objective, best.objective, ROUNDING_NOISE):
                if fresh:
                    break
                curvature = None
                continue
            best = trial
            # Change of every coordinate below which Newton steps end.
            if size < 1e-11:
                break
            # Newton steps that shrink less need new second derivatives.
            if size > 0.1 * before:
                curvature = None
            before = size
        return best, curvature

    def _hessian(self, best: Projection, able: NDArray[np.bool_]) -> Matrix | None:
        """Return the Hessian for coordinates `able`, by differences of gradients; None unless positive definite."""
        count, step = int(np.count_nonzero(able)), 1e-4
        if count == 0:
            return None
        hessian = np.empty((count, count))
        for row, k in enumerate(np.flatnonzero(able)):
            shift = np.zeros(best.point.x.size)
            shift[k] = step
            sides = [self.at(ShapePoint(best.point.branches, best.point.x + sign * shift)) for sign in (1.0, -1.0)]
            if sides[0] is None or sides[1] is None:
                return None
            up, down = (-(self.slopes(side) @ side.residual)[able] for side in sides if side is not None)
            hessian[row] = (up - down) / (2 * step)
        hessian = (hessian + hessian.T) / 2
        size = np.sqrt(np.maximum(np.diag(hessian), 0.0))
        size = np.where(size > 1e-150, size, 1.0)
        if not np.linalg.eigvalsh(hessian / np.outer(size, size))[0] > 1e-10:
            return None
        return hessian


def _runs(branches: tuple[Branch, ...], u: Vector) -> list[tuple[Branch, Vector]]:
    """Return branches with their coordinates, together if all are the same."""
    if all(branch is branches[0] for branch in branches):
        return [(branches[0], u)]
    return [(branch, u[k : k + 1]) for k, branch in enumerate(branches)]


def _solve(matrix: Matrix, right: Vector) -> Vector:
    """Solve a symmetric system, scaled to unit diagonal, with the least norm if it is singular."""
    size = np.sqrt(matrix.diagonal())
    size = np.where(size > 1e-150, size, 1.0)
    scaled = matrix / (size[:, None] * size)
    try:
        return np.asarray(np.linalg.solve(scaled, right / size) / size)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(scaled, right / size, rcond=None)[0] / size)
