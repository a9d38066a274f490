"""The search for processes with exponential autocovariances, in a kernel: the same steps as `branch_and_bound`.

The kernel has the shapes of these processes, so that a search is one call. tests/estimation/test_exponential_search.py
holds its results to those of the open search.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gmwm import _core
from gmwm._arrays import Vector
from gmwm.estimation.atoms import NEIGHBOURS, SAFETY, Place
from gmwm.estimation.branch_and_bound import (
    ACTS_AS,
    CERTIFIED_GAP,
    CERTIFY_NODES,
    FLAT,
    FOLLOWED,
    NEWTON_STEPS,
    POLISHES,
    QUICK_NODES,
    SETTLED,
    TABLE_ERROR,
    WIDTHS,
    Found,
    Optimum,
    Search,
)
from gmwm.estimation.problem import Problem
from gmwm.filters import HAAR

_LIMITS = np.array(
    [CERTIFIED_GAP, TABLE_ERROR, SETTLED, FLAT, ACTS_AS, FOLLOWED, SAFETY, NEIGHBOURS, POLISHES, NEWTON_STEPS]
)


def search_of(problem: Problem) -> Search:
    """Return the search for the curved processes of a problem: in the kernel if it has their shapes.

    A class that inherits its search may have changed the shape, so the class must state the branches itself.
    """
    kind = problem.curved_class
    assert kind is not None
    closed = problem.filter is HAAR and "search" in vars(kind)
    if closed and all(branch.exponential for branch in kind.search(problem.samples, problem.rate)):
        return ExponentialSearch(problem, kind)
    return Search(problem, kind)


class ExponentialSearch(Search):
    """The search with the shapes in the kernel."""

    @cached_property
    def kernel(self) -> _core.ExponentialSearch:
        """The kernel for this problem."""
        problem, rows, innovation = self.problem, [], False
        for branch in self.grid.branches:
            form = branch.exponential
            assert form is not None
            acts = (branch.low_acts_as is not None, branch.high_acts_as is not None)
            rows.append((branch.low, branch.high, form.bend, form.least, form.sign, *acts))
            innovation = form.innovation
        return _core.ExponentialSearch(
            problem.target, self.fixed, problem.root, problem.rounding, np.ldexp(1.0, problem.levels - 1),
            np.array(rows, dtype=np.float64), problem.rate, innovation, _LIMITS, np.array(WIDTHS),
        )  # fmt: skip

    def optimum(self, *, certify: bool) -> Found:
        """Return the global optimum on the exact curve, with its bounds and the ends as which its places act."""
        grid = self.grid
        found, bound, relaxed, table, nodes = self.kernel.solve(
            grid.owner, grid.nodes, grid.spacing, grid.values, grid.slopes, grid.middle_values, self.positive,
            len(self.problem.curved), CERTIFY_NODES if certify else QUICK_NODES, self._starts(),
        )  # fmt: skip
        return Found(self.found(*found), bound=bound, relaxed=relaxed, table=table, nodes=nodes)

    def followed(self, places: list[Place], *, ends: bool = False) -> Optimum:
        """Return the local optimum next to the optimum of a problem with other weights."""
        return self.found(*self.kernel.follow(*self.coordinates(places), ends))

    def coordinates(self, places: Sequence[Place]) -> tuple[NDArray[np.int64], Vector]:
        """Return the indices of the branches of places, and their search coordinates."""
        known = [branch.exponential for branch in self.grid.branches]
        owner = [known.index(branch.exponential) for branch, _ in places]
        return np.array(owner, dtype=np.int64), np.array([u for _, u in places], dtype=np.float64)

    def found(self, objective: float, branches: list[int], u: Vector, weights: Vector, ends: list[int]) -> Optimum:
        """Make an optimum of what the kernel returns."""
        places = [(self.grid.branches[k], at) for k, at in zip(branches, u.tolist(), strict=True)]
        return Optimum(objective, places, weights, tuple(ends))
