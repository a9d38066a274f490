"""Compiled iteration of diagonal weights, for sums of processes with exponential autocovariances and simple
processes."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.fitting.estimation.branch_and_bound import Optimum
from gmwm.fitting.estimation.exponential_search import ExponentialSearch, search_of
from gmwm.fitting.estimation.problem import ROUNDING, Problem
from gmwm.fitting.estimation.solver import Solution
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.segments import lengths_of
from gmwm.theory.processes.base import Process

_KINDS = ("white", "walk", "spike", "drift")


def search_for_weights(problem: Problem, design: Design) -> ExponentialSearch | None:
    """Return the search whose kernel can iterate the weights; None if the covariance of a process is not in the
    kernel."""
    if not design.running_sum or design.efficiency is not None or any(stride > 1 for stride in design.strides):
        return None
    if problem.free or not problem.curved or len(problem.linear) + len(problem.curved) < len(problem.model.processes):
        return None
    if any(_kind(problem.model.processes[place]) is None for place in problem.linear):
        return None
    search = search_of(problem)
    return search if isinstance(search, ExponentialSearch) else None


def _kind(process: Process) -> int | None:
    """Return the number by which the kernel knows a process without a shape, from its attribute `elementary`; else
    None. The attribute is not inherited, because a subclass may have another `coefficient_covariance`."""
    form = vars(type(process)).get("elementary")
    return None if form is None else _KINDS.index(form)


def reweight(
    search: ExponentialSearch, solution: Solution, design: Design, options: Vector
) -> tuple[Optimum, Vector, float, float] | None:
    """Iterate the estimate and the weights 1 / V_jj from `solution`, with a design for weights. `options` (7,) are
    PRIOR, FIXED, FAR, CUTOFF, ROUNDS, HOPE and MIXED of `gmwm.estimation.reweighting`."""
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
        problem.observed, design.degrees_of_freedom, counts, np.zeros(counts.size) if added is None else np.diag(added),
    ]  # fmt: skip
    result = search.kernel.reweight(
        design.levels, np.array(data, dtype=np.float64), np.array(segments, dtype=np.float64),
        np.array([_kind(process) for process in linear], dtype=np.int64), np.array(powers, dtype=np.float64),
        problem.shapes, np.array([design.loss_factor, ROUNDING, cumulant, *options]), solution.scales,
        np.array([(term.values[0], term.scale) for term in solution.terms], dtype=np.float64),
        *search.coordinates(solution.places),
    )  # fmt: skip
    return None if result is None else (search.optimum_of(*result[0]), *result[1:])
