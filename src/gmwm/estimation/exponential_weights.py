"""The iteration of diagonal weights in a kernel, for sums of exponential and elementary processes."""

from __future__ import annotations

import numpy as np

from gmwm._arrays import Vector
from gmwm.covariance.design import Design
from gmwm.covariance.segments import lengths_of
from gmwm.estimation.branch_and_bound import Optimum
from gmwm.estimation.exponential_search import ExponentialSearch, search_of
from gmwm.estimation.problem import ROUNDING, Problem
from gmwm.estimation.solver import Solution
from gmwm.processes.base import Process

_KINDS = ("white", "walk", "spike", "drift")


def search_for_weights(problem: Problem, design: Design) -> ExponentialSearch | None:
    """Return the search whose kernel has the covariance of every process of a problem; None if there is none."""
    if not design.running_sum or design.efficiency is not None or any(stride > 1 for stride in design.strides):
        return None
    if problem.free or not problem.curved or len(problem.linear) + len(problem.curved) < len(problem.model.processes):
        return None
    if any(_kind(problem.model.processes[place]) is None for place in problem.linear):
        return None
    search = search_of(problem)
    return search if isinstance(search, ExponentialSearch) else None


def _kind(process: Process) -> int | None:
    """Return the number of the elementary form of a process; None if its class does not state one.

    A class states by `elementary` that its `coefficient_covariance` at scale 1 is a form of the kernels: "white",
    "walk", "spike" (rounding errors) or "drift". A subclass may have changed the covariance and does not inherit it.
    """
    form = vars(type(process)).get("elementary")
    return None if form is None else _KINDS.index(form)


def reweighted(
    search: ExponentialSearch, solution: Solution, design: Design, options: Vector
) -> tuple[Optimum, Vector, float, float] | None:
    """Iterate estimate and weights 1 / V_jj.

    Parameters
    ----------
    search : ExponentialSearch
    solution : Solution
        Where to start.
    design : Design
        The design for weights.
    options : (7,) array
        Degrees of freedom of the curve, change that ends the iteration, longest step and cutoff of the mixing; numbers
        of iterations, of iterations in which the change must fall to a half, and of iterations that are combined.

    Returns
    -------
    tuple of Optimum, (J,) array, float, float
        The optimum, the weights, and the last and the expected next change of the curve. None if the model has no noise
        at some level.
    """
    problem, processes = search.problem, search.problem.model.processes
    linear = [processes[place] for place in problem.linear]
    counts, added = design.counts, design.added
    segments = []
    for length, times in lengths_of(design.lengths):
        one = design.segment(length, counts) if design.segments else design
        if one is not None:
            segments.append((length, times, one.levels.size))
    powers = [process.scale_parameter().scale_power or 1 for process in linear]
    cumulant = sum(type(process).standard().error_cumulant for process in linear)
    data = [
        problem.observed,
        design.degrees_of_freedom,
        counts,
        np.zeros(counts.size) if added is None else np.diag(added),
    ]
    found = search.kernel.reweight(
        design.levels, np.array(data, dtype=np.float64), np.array(segments, dtype=np.float64),
        np.array([_kind(process) for process in linear], dtype=np.int64), np.array(powers, dtype=np.float64),
        problem.shapes, np.array([design.loss_factor, ROUNDING, cumulant, *options]), solution.scales,
        np.array([(term.values[0], term.scale) for term in solution.terms], dtype=np.float64),
        *search.coordinates(solution.places),
    )  # fmt: skip
    return None if found is None else (search.found(*found[0]), *found[1:])
