"""Solve the estimation problem.

Non-negative least squares eliminates the scales. Unknown are a coordinate for each curved process, such as GM, and
several for each free process. With only curved ones, `branch_and_bound` proves the global optimum; otherwise, or for
random draws, `variable_projection` finds local optima."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Vector
from gmwm.base.errors import ModelError
from gmwm.fitting.estimation.atoms import Place
from gmwm.fitting.estimation.branch_and_bound import FittedTerm, Optimum, Search
from gmwm.fitting.estimation.exponential_search import search_of
from gmwm.fitting.estimation.problem import Problem
from gmwm.fitting.estimation.starts import (
    Alone,
    Sampled,
    Start,
    given_point,
    moved_points,
    sampled_point,
    scanned_points,
    scans_alone,
)
from gmwm.fitting.estimation.variable_projection import ROUNDING_NOISE, Curvature, Projection, ShapePoint, Surface
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

MOST_SEARCHES = 3
"""Largest number of repeated searches (tests/estimation/test_arma_fits.py: two lines are both found)."""

DESCENT_STARTS = 10  # number of points of a scan from which descents start
FOLLOWED_DESCENTS = 3  # number of descents that are followed to the end


@dataclass(frozen=True)
class Solution:
    """Optimum of a problem with terms and places; `point` and `curvature` belong to free processes."""

    objective: float
    lower_bound: float | None
    relaxed_bound: float
    scales: Vector
    terms: tuple[FittedTerm, ...]
    places: tuple[Place, ...]
    nodes: int
    start: Start
    point: ShapePoint | None = None
    curvature: Curvature | None = None
    origin: ShapePoint | None = None  # point from which the descent to `point` started


def solve(problem: Problem, *, certify: bool, quick: bool = False, near: Solution | None = None) -> Solution:
    """Find the optimum from deterministic starts: global and certified without free processes, otherwise the best from
    a scan (few points if `quick`) and from `near`."""
    if problem.free:
        return _solve_by_scan(problem, quick=quick, near=near)
    square = problem.unit**2
    if problem.curved_class is None:
        weights, objective = _core.nonnegative_least_squares(problem.target, problem.fixed)
        # Without curved processes the problem is convex, so the optimum is the lower bound.
        value = objective * square
        scales = problem.scales(problem.shapes, weights)
        return Solution(
            objective=value, lower_bound=value if certify else None, relaxed_bound=value, scales=scales, terms=(),
            places=(), nodes=0, start=Start(how="convex", tried=1, objective=float(value)),
        )  # fmt: skip
    search = search_of(problem)
    result = search.optimum(certify=certify)
    best = result.best
    return Solution(
        objective=best.objective * square, lower_bound=min(result.bound, best.objective) * square if certify else None,
        relaxed_bound=min(result.relaxed, best.objective) * square,
        scales=problem.scales(problem.shapes, best.weights[: len(problem.linear)]), terms=search.terms(best),
        places=tuple(best.places), nodes=result.nodes,
        start=Start(how="convex", tried=result.nodes or 1, objective=float(result.table * square)),
    )  # fmt: skip


def solve_near(problem: Problem) -> Solution:
    """Find the optimum near the model's values without a scan, enough for almost the same data."""
    if not problem.free:
        return solve(problem, certify=False)
    surface = Surface(problem)
    point = given_point(problem, surface)
    optimum = None if point is None else surface.downhill(point)
    if point is None or optimum is None:
        return solve(problem, certify=False)
    start = Start(how="given", tried=1, objective=_value(surface.at(point), problem))
    return _sharpened(problem, surface, optimum, start)


def follow(problem: Problem) -> Solution:
    """Find a solution near the model's values from which to iterate weights; curved processes move by a Newton step.
    Without values, or if a process is zero, only a search finds places."""
    processes = [problem.model.processes[place] for place in problem.curved]
    if problem.free or not processes or not all(process.is_complete and process.scale > 0 for process in processes):
        return solve_near(problem)
    search = search_of(problem)
    positions = search.starts()
    if not positions.size:
        return solve_near(problem)
    places = search.places_of(positions)
    start = Start(how="given", tried=1, objective=search.at(places).objective * problem.unit**2)
    near = Solution(
        objective=start.objective, lower_bound=None, relaxed_bound=0.0, scales=np.empty(0), terms=(), places=(),
        nodes=0, start=start,
    )  # fmt: skip
    return move(search, near, search.follow(places, ends=True), ends=True)


def resume(problem: Problem, solution: Solution, *, ends: bool = False) -> Solution:
    """Find the nearest local optimum for slightly different weights; `ends` also finds indistinguishable ends."""
    if solution.point is not None:
        return _resume_free(problem, solution, ends=ends)
    if problem.curved_class is None:
        return solve(problem, certify=False)
    search = search_of(problem)
    return move(search, solution, search.follow(list(solution.places), ends=ends), ends=ends)


def move(search: Search, solution: Solution, best: Optimum, *, ends: bool = False) -> Solution:
    """Return a solution in which `best` replaces the places, the scales and the objective; it has no lower bound."""
    problem = search.problem
    scales = problem.scales(problem.shapes, best.weights[: len(problem.linear)])
    return replace(
        solution, objective=best.objective * problem.unit**2, lower_bound=None, relaxed_bound=0.0, scales=scales,
        terms=search.terms(best, ends=ends), places=tuple(best.places), nodes=0,
    )  # fmt: skip


def solve_sampled(problem: Problem, wv: WaveletVariance, sampled: Sampled, spread: float) -> Solution:
    """Find the local optimum that a descent from the best of random draws reaches."""
    surface = Surface(problem)
    point = sampled_point(problem, wv, sampled, spread)
    before, optimum = surface.at(point), surface.downhill(point)
    if before is None or optimum is None:
        raise ModelError(
            f"none of {sampled.draws} random draws gives a valid process of {problem.model}",
            advice="Increase the number of draws.",
        )
    start = Start(how="sampled", tried=sampled.draws, objective=_value(before, problem))
    return _sharpened(problem, surface, optimum, start)


def final(problem: Problem, solution: Solution, *, certify: bool) -> Solution:
    """Solve the problem with the final weights, by the global search or from the optimum that random draws led to.
    After draws, the bounds and `Start.default` come from the global search, because draws may miss the optimum."""
    if solution.start.how != "sampled":
        return solve(problem, certify=certify, near=solution)
    followed = resume(problem, solution, ends=True)
    if not certify:
        return followed
    other = solve(problem, certify=True)
    return replace(
        followed, lower_bound=other.lower_bound, relaxed_bound=other.relaxed_bound, nodes=other.nodes,
        start=replace(followed.start, default=float(other.objective)),
    )  # fmt: skip


def _value(found: Projection | None, problem: Problem) -> float:
    """Return the objective of an optimum in the unit of the data."""
    assert found is not None
    return float(found.objective * problem.unit**2)


def _solve_by_scan(problem: Problem, *, quick: bool, near: Solution | None) -> Solution:
    """Return the best of the local optima that descents from the points of a scan reach."""
    surface = Surface(problem)
    alone = scans_alone(problem, surface)
    # Number of points of a scan from which descents start if the weights will change.
    points, tried = scanned_points(problem, surface, alone, 3 if quick else DESCENT_STARTS)
    previous = None if near is None or near.point is None else surface.downhill(near.point)
    lowest = _lowest(
        problem, surface, [point for _, point in points], count=1 if quick else FOLLOWED_DESCENTS, known=previous
    )
    if lowest is None:
        raise ModelError(
            f"no starting values were found for {problem.model}", advice="Write starting values into the model."
        )
    place, best = lowest
    how, origin = points[place or 0]
    if place is None and near is not None and near.origin is not None:
        how, origin = near.start.how, near.origin
    start = Start(how=how, tried=tried, objective=_value(surface.at(origin), problem))
    if alone is not None and not quick:
        best = _rearrange(problem, surface, alone, best)
    best = _elsewhere(problem, surface, best)
    return replace(_sharpened(problem, surface, best, start), origin=origin)


def _lowest(
    problem: Problem, surface: Surface, points: list[ShapePoint], *, count: int = FOLLOWED_DESCENTS,
    known: Projection | None = None,
) -> tuple[int | None, Projection] | None:  # fmt: skip
    """Return the best local optimum of descents and its index, or None if `known` is better. After a few steps the
    better half continues, then the best `count`."""
    # Steps before the worse half of descents is dropped, and of the others after: all to the end are no better
    # (tests/estimation/test_arma_fits.py). Lines have many close optima, so several free processes keep 5
    # (test_two_lines_are_both_found).
    steps = 5 if len(surface.frees) == 1 else 10
    scouts = [(k, optimum) for k, point in enumerate(points) if (optimum := surface.downhill(point, steps)) is not None]
    scouts.sort(key=lambda scout: scout[1].objective)
    halved = scouts[: max((len(scouts) + 1) // 2, count)]
    scouts = [(k, optimum) for k, scout in halved if (optimum := surface.downhill(scout, steps)) is not None]
    reached: list[Projection] = [] if known is None else [known]
    best: tuple[int | None, Projection] | None = None if known is None else (None, known)
    for k, scout in sorted(scouts, key=lambda scout: scout[1].objective):
        if count == 0:
            break
        if any(_together(scout.point, other.point) for other in reached):
            continue
        optimum = surface.downhill(scout)
        if optimum is None:
            continue
        count -= 1
        reached += [scout, optimum]
        if best is None or not problem.as_low(best[1].objective, optimum.objective, ROUNDING_NOISE):
            best = k, optimum
    return best


def _together(one: ShapePoint, other: ShapePoint) -> bool:
    """Return whether two points are so close that descents from them reach the same optimum."""
    # Difference of every coordinate below which two descents are treated as one.
    return one.branches == other.branches and bool(np.all(np.abs(one.x - other.x) < 0.03))


def _rearrange(problem: Problem, surface: Surface, alone: list[Alone], best: Projection) -> Projection:
    """Return the optimum after each free process in turn was moved to the best points of its own scan."""
    for _ in range(MOST_SEARCHES):
        moved = list(moved_points(problem, surface, alone, best.point))
        lowest = _lowest(problem, surface, moved, known=best)
        if lowest is None or problem.as_low(best.objective, lowest[1].objective, ROUNDING_NOISE):
            break
        best = lowest[1]
    return best


def _elsewhere(problem: Problem, surface: Surface, best: Projection) -> Projection:
    """Return the optimum after another search for the curved processes with fixed shapes of the free processes."""
    for _ in range(MOST_SEARCHES if problem.curved_class is not None else 0):
        _, z = surface.split(best.point)
        places = surface.curved_alone(z).tabulated()
        point = ShapePoint(tuple(b for b, _ in places), np.concatenate([np.array([u for _, u in places]), *z]))
        optimum = surface.downhill(point)
        if optimum is None or problem.as_low(best.objective, optimum.objective, ROUNDING_NOISE):
            break
        best = optimum
    return best


def _resume_free(problem: Problem, solution: Solution, *, ends: bool) -> Solution:
    surface = Surface(problem)
    assert solution.point is not None
    sharp = surface.sharpen(solution.point, solution.curvature)
    if sharp is not None and sharp[2]:
        result = replace(_solution(problem, surface, sharp[0], solution.start, ends=ends), curvature=sharp[1])
    else:
        optimum = surface.downhill(solution.point)
        assert (
            optimum is not None
        )  # the point was valid with the previous weights, and validity does not depend on them
        result = _sharpened(problem, surface, optimum, solution.start, ends=ends)
    return replace(result, origin=solution.origin)


def _sharpened(problem: Problem, surface: Surface, found: Projection, start: Start, *, ends: bool = True) -> Solution:
    """Return the solution after Newton steps from an optimum."""
    sharp = surface.sharpen(found.point)
    assert sharp is not None
    best, curvature, _ = sharp
    return replace(_solution(problem, surface, best, start, ends=ends), curvature=curvature)


def _solution(problem: Problem, surface: Surface, found: Projection, start: Start, *, ends: bool = True) -> Solution:
    """Return the solution and, if `ends`, the processes that the data cannot distinguish from curved terms."""
    linear = len(problem.linear)
    u, z = surface.split(found.point)
    terms: tuple[FittedTerm, ...] = ()
    places = tuple(zip(found.point.branches, u.tolist(), strict=True))
    if problem.curved_class is not None:
        search = surface.curved_alone(z)
        # The search leaves out processes whose wavelet variance is zero.
        terms = search.terms(search.at(list(places)), ends=ends)
    # A scale is the weight times `unit`, divided by the length of the weighted shape.
    scales = found.weights[linear:] * problem.unit / np.where(found.lengths > 0, found.lengths, 1.0)
    for free, part, scale in zip(surface.frees, z, scales[len(places) :], strict=True):
        values = tuple(free.values(part.reshape(1, -1))[0].tolist())
        terms = (*terms, FittedTerm(values, float(scale)))
    linear_scales = problem.scales(problem.shapes, found.weights[:linear])
    value = float(found.objective * problem.unit**2)
    return Solution(
        objective=value, lower_bound=None, relaxed_bound=0.0, scales=linear_scales, terms=terms, places=places, nodes=0,
        start=start, point=found.point,
    )  # fmt: skip


def model_of(problem: Problem, solution: Solution, slope: float | None) -> Model:
    """Return the model of a solution; signs come from the `slope` of the data."""
    processes = list(problem.model.processes)
    for place, scale in zip(problem.linear, solution.scales, strict=True):
        processes[place] = _with_scale(processes[place], float(scale), slope)
    for place, term in zip(problem.shaped, solution.terms, strict=True):
        names = [p.name for p in processes[place].nonlinear_parameters()]
        shape = dict(zip(names, term.values, strict=True))
        processes[place] = _with_scale(processes[place], term.scale, slope, **shape)
    return Model(tuple(processes))


def _with_scale(process: Process, scale: float, slope: float | None, **shape: float) -> Process:
    parameter = process.scale_parameter()
    value = process.value_from(scale)
    if parameter.domain == "real" and slope is not None and slope < 0:
        value = -value
    return process.with_values(**shape, **{parameter.name: value})
