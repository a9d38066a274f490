"""Local optima of problems that have processes with several shape parameters, by variable projection.

Non-negative least squares eliminates the scales, which leaves an objective of all shapes with known gradient (Golub and
Pereyra 1973, SIAM J. Numer. Anal. 10, 413-432). After Levenberg-Marquardt, Newton steps give all digits. Both run in a
compiled kernel, which asks the classes of other processes than GM, AR1, ARMA and OSC for their shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.threads import check_stop
from gmwm.fitting.estimation.atoms import grid
from gmwm.fitting.estimation.branch_and_bound import Search
from gmwm.fitting.estimation.exponential_search import is_exponential
from gmwm.fitting.estimation.problem import Problem, to_find
from gmwm.theory.filters import HAAR
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.linear_recursion import Lagged
from gmwm.theory.processes.oscillator import OSC
from gmwm.theory.processes.parameter import Branch
from gmwm.theory.processes.rational import odd_lags

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

    def shape(self, z: Vector, problem: Problem) -> Vector | None:
        """Return the wavelet variance (J,) for scale coefficient 1 at a point z (d,); None if there is no process."""
        values = self.values(z.reshape(1, -1))
        if not (self.together or self.possible(values)[0]):
            return None
        return np.ascontiguousarray(self.kind.moments(values, problem.levels, problem.rate, problem.filter)[0])

    def slopes(self, z: Vector, problem: Problem) -> Matrix:
        """Return the derivatives (d, J) of `shape`, with complex steps for those of the parameters."""
        moved = self.values(z + 1j * _COMPLEX * np.eye(z.size))
        values = np.ascontiguousarray(moved[:1].real)
        jacobian = self.kind.moments_jacobian(values, problem.levels, problem.rate, problem.filter)[0]
        return np.ascontiguousarray((jacobian @ (moved.imag.T / _COMPLEX)).T)

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
    """Smallest objective of given shapes, with weights, and `lengths` of the weighted curves."""

    objective: float
    point: ShapePoint
    weights: Vector
    lengths: Vector


@dataclass(frozen=True, eq=False)
class Curvature:
    """Second derivatives of the objective, in the unit of the data, for the coordinates that `able` marks."""

    able: list[bool]
    hessian: Vector


class Surface:
    """Objective of one problem as a function of the coordinates of all shapes."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.frees = [Coordinates(problem.model.processes[place]) for place in problem.free]
        self.spans = list(pairwise(accumulate((free.size for free in self.frees), initial=0)))
        self.branches: tuple[Branch, ...] = ()
        self.kernel = _core.Descent(problem.target, problem.fixed, problem.root, problem.rounding)
        if problem.curved_class is not None:
            self._add_branches(problem.curved_class)
        for free in self.frees:
            self._add_free(free)

    def _add_branches(self, kind: type[Process]) -> None:
        problem = self.problem
        self.branches = grid(
            kind, problem.levels, samples=problem.samples, rate=problem.rate, filter=problem.filter
        ).branches
        for branch in self.branches:
            form = branch.exponential
            if form is not None and is_exponential(problem.filter, kind):
                ends = np.array([branch.low, branch.high, form.bend, form.least, form.sign])
                self.kernel.add_exponential(self._half_scales, ends, problem.rate, form.innovation)
            else:
                shape, slopes = partial(_shape_on, kind, branch, problem), partial(_slopes_on, kind, branch, problem)
                self.kernel.add_given(shape, slopes, np.array([[branch.low, branch.high]]), branch=True)

    def _add_free(self, free: Coordinates) -> None:
        problem = self.problem
        ends = free.ends(problem.samples, problem.rate)
        if free.together and not problem.filter.lags and _has_theory_of(free.kind, Lagged):
            self.kernel.add_arma(free.kind.full_orders(), problem.levels, odd_lags(problem.filter), ends)  # type: ignore[attr-defined]
        elif free.together and problem.filter is HAAR and _has_theory_of(free.kind, OSC):
            self.kernel.add_oscillator(self._half_scales, problem.rate, ends)
        else:
            shape, slopes = partial(free.shape, problem=problem), partial(free.slopes, problem=problem)
            self.kernel.add_given(shape, slopes, ends, branch=False)

    @property
    def _half_scales(self) -> Vector:
        return np.ldexp(1.0, self.problem.levels - 1)

    def split(self, point: ShapePoint) -> tuple[Vector, list[Vector]]:
        """Return the search coordinates of the curved processes, and the coordinates of each free process."""
        count = len(point.branches)
        return point.x[:count], [point.x[count + a : count + b] for a, b in self.spans]

    def free_shapes(self, z: list[Vector]) -> Matrix:
        """Return the wavelet variances (n, J) of the free processes with scale coefficient 1 at the coordinates `z`."""
        problem, rows = self.problem, [np.empty((0, self.problem.levels.size))]
        for free, part in zip(self.frees, z, strict=True):
            values = free.values(part.reshape(1, -1))
            rows.append(free.kind.moments(values, problem.levels, problem.rate, problem.filter))
        return np.concatenate(rows)

    def curved_alone(self, z: list[Vector]) -> Search:
        """Return the search for the curved processes with the free ones fixed, without those of zero variance."""
        problem, curves = self.problem, self.free_shapes(z)
        assert problem.curved_class is not None
        seen = np.any(curves > 0, axis=1)
        held = tuple(place for place, able in zip(problem.free, seen, strict=True) if able)
        rows = np.concatenate([problem.shapes, curves[seen]])
        return Search(replace(problem, linear=(*problem.linear, *held), free=(), shapes=rows), problem.curved_class)

    def at(self, point: ShapePoint) -> Projection | None:
        """Return the optimal weights at a point; None if a process is not valid there."""
        return self.downhill(point, 0)

    def downhill(self, start: ShapePoint | Projection, steps: int = 100) -> Projection | None:
        """Return the point that at most `steps` Levenberg-Marquardt steps reach; None if `start` is not valid."""
        check_stop()
        point = start.point if isinstance(start, Projection) else start
        optimum = self.kernel.downhill(self._indices(point), point.x, steps)
        return None if optimum is None else _projection(point, *optimum)

    def sharpen(
        self, start: ShapePoint, curvature: Curvature | None = None
    ) -> tuple[Projection, Curvature | None, bool] | None:
        """Return the optimum after Newton steps that lower the objective, the last second derivatives, kept from
        `curvature` until steps converge slowly, and whether the gradient is a rounding error."""
        check_stop()
        square = self.problem.unit**2
        second = None if curvature is None else (curvature.able, (curvature.hessian / square).tolist())
        result = self.kernel.sharpen(self._indices(start), start.x, second)
        if result is None:
            return None
        optimum, second, at_rest = result
        curvature = None if second is None else Curvature(second[0], square * np.array(second[1]))
        return _projection(start, *optimum), curvature, at_rest

    def _indices(self, point: ShapePoint) -> NDArray[np.int64]:
        names = [_name(branch) for branch in self.branches]
        return np.array([names.index(_name(branch)) for branch in point.branches], dtype=np.int64)


def _projection(start: ShapePoint, objective: float, x: Vector, weights: Vector, lengths: Vector) -> Projection:
    return Projection(objective, ShapePoint(start.branches, x), weights, lengths)


def _name(branch: Branch) -> tuple[object, ...]:
    """Return what distinguishes a branch from the others of its class; its functions differ in each table."""
    return branch.low, branch.high, branch.low_acts_as, branch.high_acts_as, branch.exponential


def _has_theory_of(kind: type[Process], base: type[Process]) -> bool:
    """Return whether the shape and the coordinates of a class are those of `base`, which the kernel knows."""
    names = ("shape", "shape_jacobian", "moments", "moments_jacobian", "at_coordinates")
    return issubclass(kind, base) and all(getattr(kind, n).__func__ is getattr(base, n).__func__ for n in names)


def _shape_on(kind: type[Process], branch: Branch, problem: Problem, u: Vector) -> Vector:
    """Return the wavelet variance (J,) for scale coefficient 1 at the coordinate u (1,) of a branch."""
    rows = kind.moments(branch.values(u), problem.levels, problem.rate, problem.filter)
    return np.ascontiguousarray(rows[0])


def _slopes_on(kind: type[Process], branch: Branch, problem: Problem, u: Vector) -> Matrix:
    """Return its derivative (1, J) by u."""
    rows = kind.moments_jacobian(branch.values(u), problem.levels, problem.rate, problem.filter)
    return np.ascontiguousarray(rows[:, :, 0] * branch.slope(u))
