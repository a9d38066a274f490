"""Tables of unit vectors: the wavelet variance of a process with one nonlinear parameter, as a curve in this parameter.

The solver does not know any process. Its input is the fixed vectors of the processes that are linear in their
parameters, and one curve for the repeatable process with a free nonlinear parameter (the correlation time of a
Gauss-Markov process). Between the nodes of the table it interpolates by cubics, and the table bounds their error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.filters import WaveletFilter
from gmwm.processes.base import Process
from gmwm.processes.parameter import Branch

SPACING = 0.025
"""Distance of the nodes in the search coordinate: 2.5 % in β for a Gauss-Markov process. The error of the cubics, some
1e-9 of the curve, is the only error of the bounds. tests/estimation/test_atoms.py pins the table."""
SAFETY = 2.0
"""Factor on the interpolation error at the midpoints of a cell and its neighbours, which makes it a bound
everywhere."""
NEIGHBOURS = 12
"""Number of neighbours on each side: where rounding dominates (φ near 1), one midpoint alone is not representative."""


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes of a table and the wavelet variances of a process at these nodes; independent of data and weights.

    `nodes` holds the search coordinate, one branch after another. `spacing` is the width of each cell between
    neighbouring nodes, and zero for the cell that joins two branches.
    """

    branches: tuple[Branch, ...]
    owner: NDArray[np.int64]
    nodes: Vector
    spacing: Vector
    values: Matrix
    slopes: Matrix
    middle_values: Matrix

    def position(self, branch: int, u: float) -> float:
        """Return the position of coordinate `u` of a branch, counted in cells from the first node."""
        inside = np.flatnonzero(self.owner == branch)
        return float(np.interp(u, self.nodes[inside], inside))

    def place(self, position: float) -> tuple[int, float]:
        """Return the branch and coordinate at a position counted in cells."""
        cell = min(int(position), self.nodes.size - 2)
        if self.spacing[cell] == 0 and position <= cell:
            cell -= 1
        return int(self.owner[cell]), float(self.nodes[cell] + (position - cell) * self.spacing[cell])


@dataclass(frozen=True, eq=False)
class Table:
    """A curve of unit vectors for the solver: values and slopes per cell at the nodes, and error bounds per cell."""

    values: Matrix
    slopes: Matrix
    margins: Vector


Place = tuple[Branch, float]
"""A point of the tabulated curve: a branch and the search coordinate u on it."""


def shape_at(
    process: type[Process], parameters: Matrix, levels: NDArray[np.int64], rate: float, filter: WaveletFilter
) -> Matrix:
    """Return wavelet variances (n, J) at unit scale; the levels may belong to several curves, one after another."""
    if np.all(levels[1:] > levels[:-1]):
        return process.shape(parameters, levels, rate, filter)
    ascending, place = np.unique(levels, return_inverse=True)
    return np.asarray(process.shape(parameters, ascending, rate, filter)[:, place])


def slope_at(
    process: type[Process], parameters: Matrix, levels: NDArray[np.int64], rate: float, filter: WaveletFilter
) -> Matrix:
    """Return derivatives (n, J) of `shape_at` with respect to the first nonlinear parameter."""
    ascending, place = np.unique(levels, return_inverse=True)
    return np.asarray(process.shape_jacobian(parameters, ascending, rate, filter)[:, :, 0][:, place])


def shapes(
    process: type[Process], places: list[Place], levels: NDArray[np.int64], rate: float, filter: WaveletFilter
) -> Matrix:
    """Return wavelet variances (n, J) of a process at unit scale, at n places."""
    if not places:
        return np.empty((0, levels.size))
    parameters = np.concatenate([branch.values(np.array([u])) for branch, u in places])
    return shape_at(process, parameters, levels, rate=rate, filter=filter)


@lru_cache(maxsize=16)
def _grid(process: type[Process], levels: tuple[int, ...], samples: int, rate: float, filter: WaveletFilter) -> Grid:
    branches = process.search(samples, rate)
    number = np.asarray(levels, dtype=np.int64)
    owner, nodes, spacing, values, slopes, middles = [], [], [], [], [], []
    for index, branch in enumerate(branches):
        cells = max(2, int(np.ceil((branch.high - branch.low) / SPACING)))
        u = np.linspace(branch.low, branch.high, 2 * cells + 1)
        value = shape_at(process, branch.values(u), number, rate=rate, filter=filter)
        slope = slope_at(process, branch.values(u[::2]), number, rate=rate, filter=filter) * branch.slope(u[::2])
        owner.append(np.full(cells + 1, index))
        nodes.append(u[::2])
        spacing += [np.diff(u[::2]), np.zeros(1)]
        values.append(value[::2])
        slopes.append(slope)
        middles += [value[1::2], value[:1]]
    return Grid(
        branches=branches,
        owner=np.concatenate(owner),
        nodes=np.concatenate(nodes),
        spacing=np.concatenate(spacing[:-1]),
        values=np.ascontiguousarray(np.concatenate(values)),
        slopes=np.ascontiguousarray(np.concatenate(slopes)),
        middle_values=np.ascontiguousarray(np.concatenate(middles[:-1])),
    )


def grid(process: type[Process], levels: NDArray[np.int64], samples: int, rate: float, filter: WaveletFilter) -> Grid:
    """Tabulate `process` over its search domain for a recording of `samples`; the table is cached."""
    return _grid(process, tuple(int(j) for j in levels), samples=samples, rate=rate, filter=filter)


def unit_curve(values: Matrix, slopes: Matrix, root: Matrix) -> tuple[Matrix, Matrix]:
    """Weight the rows of `values` by `root` and scale them to length one; return them with their slopes."""
    weighted = values @ root.T
    length = np.linalg.norm(weighted, axis=1, keepdims=True)
    unit = weighted / length
    slope = (slopes @ root.T) / length
    return unit, slope - unit * np.einsum("nj,nj->n", unit, slope)[:, None]


def table(grid: Grid, root: Matrix) -> Table:
    """Tabulate the curve of a grid under the weighting LᵀL, with its error bounds."""
    values, slopes = unit_curve(grid.values, grid.slopes, root)
    joined = grid.spacing == 0
    step = grid.spacing[:, None]
    middle = grid.middle_values @ root.T
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    cubic = (values[:-1] + values[1:]) / 2 + step * (slopes[:-1] - slopes[1:]) / 8
    error = np.where(joined, 0.0, np.linalg.norm(middle - cubic, axis=1))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(error, NEIGHBOURS), 2 * NEIGHBOURS + 1)
    worst = around.max(axis=1)
    margins = np.where(joined, -1.0, SAFETY * worst + 4 * np.finfo(float).eps)
    # Slopes per cell. The cells of a branch are equal, so either neighbour of a node gives its spacing.
    per_node = np.concatenate([grid.spacing, grid.spacing[-1:]])
    per_node = np.where(per_node == 0, np.concatenate([grid.spacing[:1], grid.spacing]), per_node)
    return Table(np.ascontiguousarray(values), np.ascontiguousarray(slopes * per_node[:, None]), margins)


def close_up(
    process: type[Process],
    places: list[Place],
    width: float,
    levels: NDArray[np.int64],
    rate: float,
    filter: WaveletFilter,
    root: Matrix,
) -> tuple[Table, Vector]:
    """Tabulate one short cell around each place; return the table and the (n, 2) coordinates of its ends."""
    starts = [min(max(u - width / 2, branch.low), branch.high - width) for branch, u in places]
    ends = np.array([[start, start + width] for start in starts])
    parameters = np.concatenate([branch.values(end) for (branch, _), end in zip(places, ends, strict=True)])
    by_u = np.concatenate([branch.slope(end) for (branch, _), end in zip(places, ends, strict=True)])
    values = shape_at(process, parameters, levels, rate=rate, filter=filter)
    slopes = slope_at(process, parameters, levels, rate=rate, filter=filter) * by_u
    unit, slope = unit_curve(values, slopes, root)
    margins = np.zeros(2 * len(places) - 1)
    margins[1::2] = -1.0
    return Table(np.ascontiguousarray(unit), np.ascontiguousarray(slope * width), margins), ends
