"""Tables of the wavelet variance of a process as a function of its only nonlinear parameter.

The global search uses no formulas: its input is a vector for each linear process, and a curve of weighted variances of
length one for the process with a free parameter. A table has cubics between its nodes, and bounds of their error."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Branch

BOUND_FACTOR = 2.0  # factor from the largest interpolation error at midpoints near a cell to the bound in the cell
NEIGHBOUR_CELLS = 12
"""Neighbouring cells on each side that are used, because rounding dominates single midpoints near φ = 1."""


@dataclass(frozen=True, eq=False)
class ShapeGrid:
    """Nodes of a table, one branch (`owner`) after another, with the wavelet variances and their derivatives at the
    search coordinates `nodes` and in the middle of cells. The `spacing` is 0 for a cell that joins two branches."""

    branches: tuple[Branch, ...]
    owner: Integers
    nodes: Vector
    spacing: Vector
    values: Matrix
    slopes: Matrix
    middle_values: Matrix

    def position(self, branch: int, u: float) -> float:
        """Return the position in the table, counted in cells from the first node, of the coordinate `u` of a branch."""
        inside = np.flatnonzero(self.owner == branch)
        return float(np.interp(u, self.nodes[inside], inside))

    def place(self, position: float) -> tuple[int, float]:
        """Return the index of the branch and the search coordinate at a position in the table, counted in cells."""
        cell = min(int(position), self.nodes.size - 2)
        if self.spacing[cell] == 0 and position <= cell:
            cell -= 1
        return int(self.owner[cell]), float(self.nodes[cell] + (position - cell) * self.spacing[cell])


@dataclass(frozen=True, eq=False)
class UnitCurve:
    """Curve of unit vectors by position in cells; `margins` bound the interpolation error (−1: cell joins branches)."""

    values: Matrix
    slopes: Matrix
    margins: Vector


Place = tuple[Branch, float]  # point of a curve: a branch, and the search coordinate u on this branch


def shape_at(
    process: type[Process], parameters: Matrix, levels: Integers, rate: float, filter: WaveletFilter
) -> Matrix:
    """Return the wavelet variances (n, J) for scale coefficient 1; the levels may belong to several curves."""
    if _ascend(levels.tobytes()):
        return process.moments(parameters, levels, rate, filter)
    ascending, place = np.unique(levels, return_inverse=True)
    return np.asarray(process.moments(parameters, ascending, rate, filter)[:, place])


@lru_cache(maxsize=128)
def _ascend(content: bytes) -> bool:
    """Return whether the bytes of an array are ascending levels; every place of a search asks this."""
    return bool(np.all(np.diff(np.frombuffer(content, dtype=np.int64)) > 0))


def slope_at(
    process: type[Process], parameters: Matrix, levels: Integers, rate: float, filter: WaveletFilter
) -> Matrix:
    """Return the derivatives (n, J) of `shape_at` with respect to the first nonlinear parameter."""
    ascending, place = np.unique(levels, return_inverse=True)
    return np.asarray(process.moments_jacobian(parameters, ascending, rate, filter)[:, :, 0][:, place])


def shapes(process: type[Process], places: list[Place], levels: Integers, rate: float, filter: WaveletFilter) -> Matrix:
    """Return the wavelet variances (n, J) of a process with scale coefficient 1 at n places of its curve."""
    if not places:
        return np.empty((0, levels.size))
    return shape_at(process, values_at(places), levels, rate=rate, filter=filter)


def values_at(places: list[Place]) -> Matrix:
    """Return the nonlinear parameter (n, 1) at n places."""
    first, u = places[0][0], np.array([at for _, at in places])
    if all(branch is first for branch, _ in places):
        return first.values(u)
    return np.concatenate([branch.values(np.array([at])) for branch, at in places])


@lru_cache(maxsize=16)
def _grid(
    process: type[Process], levels: tuple[int, ...], samples: int, rate: float, filter: WaveletFilter
) -> ShapeGrid:
    branches = process.search(samples, rate)
    number = np.asarray(levels, dtype=np.int64)
    owner, nodes, spacing, values, slopes, middles = [], [], [], [], [], []
    for index, branch in enumerate(branches):
        # 2.5 % of β for GM: the cubics' relative error, the only one of the lower bound, is 1e-9
        # (tests/estimation/test_atoms.py).
        cells = max(2, int(np.ceil((branch.high - branch.low) / 0.025)))
        u = np.linspace(branch.low, branch.high, 2 * cells + 1)
        value = shape_at(process, branch.values(u), number, rate=rate, filter=filter)
        slope = slope_at(process, branch.values(u[::2]), number, rate=rate, filter=filter) * branch.slope(u[::2])
        owner.append(np.full(cells + 1, index))
        nodes.append(u[::2])
        spacing += [np.diff(u[::2]), np.zeros(1)]
        values.append(value[::2])
        slopes.append(slope)
        middles += [value[1::2], value[:1]]
    return ShapeGrid(
        branches=branches, owner=np.concatenate(owner), nodes=np.concatenate(nodes),
        spacing=np.concatenate(spacing[:-1]), values=np.ascontiguousarray(np.concatenate(values)),
        slopes=np.ascontiguousarray(np.concatenate(slopes)),
        middle_values=np.ascontiguousarray(np.concatenate(middles[:-1])),
    )  # fmt: skip


def grid(process: type[Process], levels: Integers, samples: int, rate: float, filter: WaveletFilter) -> ShapeGrid:
    """Tabulate the wavelet variance of `process` over its search domain; the table is cached."""
    return _grid(process, tuple(levels.tolist()), samples=samples, rate=rate, filter=filter)


def unit_curve(values: Matrix, slopes: Matrix, root: Matrix) -> tuple[Matrix, Matrix]:
    """Multiply rows by L = `root` and scale them to length one; return these unit vectors and their derivatives."""
    weighted = values @ root.T
    length = np.linalg.norm(weighted, axis=1, keepdims=True)
    unit = weighted / length
    slope = (slopes @ root.T) / length
    return unit, slope - unit * np.einsum("nj,nj->n", unit, slope)[:, None]


def table(grid: ShapeGrid, root: Matrix) -> UnitCurve:
    """Return the table of unit vectors for the curve of a grid, with the weighting matrix Ω = LᵀL and L = `root`."""
    values, slopes = unit_curve(grid.values, grid.slopes, root)
    joined = grid.spacing == 0
    step = grid.spacing[:, None]
    middle = grid.middle_values @ root.T
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    cubic = (values[:-1] + values[1:]) / 2 + step * (slopes[:-1] - slopes[1:]) / 8
    error = np.where(joined, 0.0, np.linalg.norm(middle - cubic, axis=1))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(error, NEIGHBOUR_CELLS), 2 * NEIGHBOUR_CELLS + 1)
    worst = around.max(axis=1)
    margins = np.where(joined, -1.0, BOUND_FACTOR * worst + 4 * np.finfo(float).eps)
    # Derivatives with respect to the position in cells. All cells of a branch have the same width.
    per_node = np.concatenate([grid.spacing, grid.spacing[-1:]])
    per_node = np.where(per_node == 0, np.concatenate([grid.spacing[:1], grid.spacing]), per_node)
    return UnitCurve(np.ascontiguousarray(values), np.ascontiguousarray(slopes * per_node[:, None]), margins)


def close_up(
    process: type[Process], places: list[Place], width: float, levels: Integers, rate: float,
    filter: WaveletFilter, root: Matrix,
) -> tuple[UnitCurve, Vector]:  # fmt: skip
    """Tabulate one exact cell of a given width around each place; return the table and the ends (n, 2) of the cells."""
    starts = [min(max(u - width / 2, branch.low), branch.high - width) for branch, u in places]
    ends = np.array([[start, start + width] for start in starts])
    parameters = np.concatenate([branch.values(end) for (branch, _), end in zip(places, ends, strict=True)])
    by_u = np.concatenate([branch.slope(end) for (branch, _), end in zip(places, ends, strict=True)])
    values = shape_at(process, parameters, levels, rate=rate, filter=filter)
    slopes = slope_at(process, parameters, levels, rate=rate, filter=filter) * by_u
    unit, slope = unit_curve(values, slopes, root)
    margins = np.zeros(2 * len(places) - 1)
    margins[1::2] = -1.0
    return UnitCurve(np.ascontiguousarray(unit), np.ascontiguousarray(slope * width), margins), ends
