"""Compiled `branch_and_bound` and iterated weights (compared in tests/estimation/test_exponential_search.py)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Integers, Vector
from gmwm.fitting.estimation.atoms import BOUND_FACTOR, NEIGHBOUR_CELLS, Place
from gmwm.fitting.estimation.branch_and_bound import LIMITS, WIDTHS, Optimum, Search, SearchResult
from gmwm.fitting.estimation.problem import ROUNDING, Problem
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.segments import lengths_of
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes.base import Process

if TYPE_CHECKING:
    from gmwm.fitting.estimation.solver import Solution

_LIMITS = np.array(
    [
        LIMITS.certified_gap,
        LIMITS.table_error,
        LIMITS.settled,
        LIMITS.flat,
        LIMITS.acts_as,
        LIMITS.longest_step,
        LIMITS.polishes,
        LIMITS.newton_steps,
    ],
    dtype=np.float64,
)


def search_of(problem: Problem) -> Search:
    """Return the search, by the kernel if it knows the wavelet variances: subclasses may have others."""
    kind = problem.curved_class
    assert kind is not None
    return ExponentialSearch(problem, kind) if is_exponential(problem.filter, kind) else Search(problem, kind)


@cache
def is_exponential(filter: WaveletFilter, kind: type[Process]) -> bool:
    """Return whether the kernel knows the wavelet variances of a class, which itself defines `search`."""
    return filter is HAAR and "search" in vars(kind) and all(branch.exponential for branch in kind.search(1024, 1.0))


class ExponentialSearch(Search):
    """Search whose steps run in a compiled kernel."""

    @cached_property
    def kernel(self) -> _core.ExponentialSearch:
        """Kernel for this problem."""
        problem, rows, innovation = self.problem, [], False
        for branch in self.grid.branches:
            form = branch.exponential
            assert form is not None
            acts = (branch.low_acts_as is not None, branch.high_acts_as is not None)
            rows.append((branch.low, branch.high, form.bend, form.least, form.sign, *acts))
            innovation = form.innovation
        return _core.ExponentialSearch(
            problem.target, self.fixed, problem.root, problem.rounding, np.ldexp(1.0, problem.levels - 1),
            np.array(rows, dtype=np.float64), problem.rate, innovation, _LIMITS, np.array(WIDTHS)
        )  # fmt: skip

    def optimum(self, *, certify: bool) -> SearchResult:
        """Return the global optimum on the exact curve, with lower bounds and the `ends` of its places."""
        grid, weights, most = self.grid, self.problem.weights, LIMITS.certify_nodes if certify else LIMITS.quick_nodes
        if grid not in weights.tables:
            weights.tables[grid] = _core.WeightedTable(
                weights.root, weights.positive, grid.owner, grid.nodes, grid.spacing, grid.values, grid.slopes,
                grid.middle_values, BOUND_FACTOR, NEIGHBOUR_CELLS
            )  # fmt: skip
        values, bound, relaxed, table, nodes = self.kernel.solve(
            weights.tables[grid], len(self.problem.curved), most, self.starts()
        )
        return SearchResult(self.optimum_of(*values), bound=bound, relaxed=relaxed, table=table, nodes=nodes)

    def follow(self, places: list[Place], *, ends: bool = False) -> Optimum:
        """Return the local optimum nearest to `places`, the optimum of the problem with slightly different weights."""
        return self.optimum_of(*self.kernel.follow(*self.coordinates(places), ends))

    def coordinates(self, places: Sequence[Place]) -> tuple[Integers, Vector]:
        """Return the indices of the branches of the places, and the search coordinates of the places."""
        forms = [branch.exponential for branch in self.grid.branches]
        owner = [forms.index(branch.exponential) for branch, _ in places]
        return np.array(owner, dtype=np.int64), np.array([u for _, u in places], dtype=np.float64)

    def optimum_of(self, objective: float, branches: list[int], u: Vector, weights: Vector, ends: list[int]) -> Optimum:
        """Return the optimum for the values that the kernel returns."""
        places = [(self.grid.branches[k], at) for k, at in zip(branches, u.tolist(), strict=True)]
        return Optimum(objective, places, weights, tuple(ends))


_KINDS = ("white", "walk", "spike", "drift")


def search_for_weights(problem: Problem, design: Design) -> ExponentialSearch | None:
    """Return the search whose kernel can iterate the weights; None if it lacks a process's covariance."""
    if not design.running_sum or design.efficiency is not None or any(stride > 1 for stride in design.strides):
        return None
    if problem.free or not problem.curved or len(problem.linear) + len(problem.curved) < len(problem.model.processes):
        return None
    if any(_kind(problem.model.processes[place]) is None for place in problem.linear):
        return None
    search = search_of(problem)
    return search if isinstance(search, ExponentialSearch) else None


def _kind(process: Process) -> int | None:
    """Return the kernel's number of a process by its own `elementary`, as a subclass may differ; else None."""
    form = vars(type(process)).get("elementary")
    return None if form is None else _KINDS.index(form)


def reweight(
    search: ExponentialSearch, solution: Solution, design: Design, options: Vector
) -> tuple[Optimum, Vector, float, float] | None:
    """Iterate estimate and weights 1 / V_jj; `options` are PRIOR, FIXED, FAR, CUTOFF, ROUNDS, HOPE and MIXED."""
    problem, processes = search.problem, search.problem.model.processes
    linear = [processes[place] for place in problem.linear]
    counts, added = design.counts, design.added
    segments = []
    for length, times in lengths_of(design.lengths):
        part = design.segment(length, counts) if design.segments else design
        if part is not None:
            segments.append((length, times, part.levels.size))
    powers = [process.scale_parameter().scale_power or 1 for process in linear]
    cumulant = sum(type(process).standard().error_cumulant for process in linear)
    data = [
        problem.observed, design.degrees_of_freedom, counts, np.zeros(counts.size) if added is None else np.diag(added)
    ]  # fmt: skip
    result = search.kernel.reweight(
        design.levels, np.array(data, dtype=np.float64), np.array(segments, dtype=np.float64),
        np.array([_kind(process) for process in linear], dtype=np.int64), np.array(powers, dtype=np.float64),
        problem.shapes, np.array([design.loss_factor, ROUNDING, cumulant, *options]), solution.scales,
        np.array([(term.values[0], term.scale) for term in solution.terms], dtype=np.float64),
        *search.coordinates(solution.places)
    )  # fmt: skip
    return None if result is None else (search.optimum_of(*result[0]), *result[1:])
