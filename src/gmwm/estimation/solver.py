"""Solve the estimation problem.

The model curve is linear in all parameters except the shape parameters. Non-negative least squares eliminates the
linear parameters. What remains is one search coordinate for each Gauss-Markov process, and the coordinates of each
process with several shape parameters (variable projection). `branch_and_bound` finds the former with a proof;
`variable_projection` finds both from starting values, if there are any of the latter or if the user asks for draws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gmwm import _core
from gmwm._arrays import Vector
from gmwm.errors import ModelError
from gmwm.estimation.atoms import Place
from gmwm.estimation.branch_and_bound import Optimum, Search, Term
from gmwm.estimation.exponential_search import search_of
from gmwm.estimation.problem import Problem
from gmwm.estimation.starts import (
    Alone,
    Sampled,
    Start,
    given_point,
    moved_points,
    sampled_point,
    scanned_points,
    scans_alone,
)
from gmwm.estimation.variable_projection import NOISE, Curvature, Point, Projection, Surface
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.variance.result import WaveletVariance

RETURNS = 3
"""Number of alternating searches of the curved processes with the free ones held, and of the free ones; pinned by
tests/estimation/test_arma_fits.py (two lines are both found)."""

KEPT = 10
"""Number of points of a scan from which descents start."""
KEPT_QUICK = 3
"""The same number if the weights will change."""
SCOUTED = 5
"""Number of steps of each descent, after which the better half continues for as many steps. Pinned by
tests/estimation/test_arma_fits.py: descents followed to the end from every point reach no smaller objective."""
SCOUTED_BESIDE = 10
"""The same number with several free processes: lines have many optima close to each other
(test_two_lines_are_both_found)."""
FOLLOWED = 3
"""Number of descents that are followed to the end."""
TOGETHER = 0.03
"""Difference of every coordinate below which two descents are treated as one."""


@dataclass(frozen=True)
class Solution:
    """An optimum: scales of the linear processes, terms with a shape and their places, objective and bounds."""

    objective: float
    lower_bound: float | None
    relaxed_bound: float
    scales: Vector
    terms: tuple[Term, ...]
    places: tuple[Place, ...]
    nodes: int
    start: Start
    point: Point | None = None
    curvature: Curvature | None = None
    origin: Point | None = None
    """The point from which the descent to `point` started."""


def solve(problem: Problem, *, certify: bool, quick: bool = False, near: Solution | None = None) -> Solution:
    """Find the optimum of a problem from deterministic starting points.

    It is the global optimum, with its certificate if `certify`, unless a process has several shape parameters. It is
    then the best of the local optima that a scan leads to, and of the one next to the solution `near`. If `quick`, only
    the best points of the scan are used: enough for weights that will change.
    """
    if problem.free:
        return _scanned(problem, quick=quick, near=near)
    square = problem.unit**2
    if problem.curved_class is None:
        weights, objective = _core.nonnegative_least_squares(problem.target, problem.fixed)
        # Without a curve the problem is convex: the optimum is its own certificate.
        value = objective * square
        scales = problem.scales(problem.shapes, weights)
        return Solution(
            objective=value,
            lower_bound=value if certify else None,
            relaxed_bound=value,
            scales=scales,
            terms=(),
            places=(),
            nodes=0,
            start=Start(how="convex", tried=1, objective=float(value)),
        )
    search = search_of(problem)
    found = search.optimum(certify=certify)
    best = found.best
    return Solution(
        objective=best.objective * square,
        lower_bound=min(found.bound, best.objective) * square if certify else None,
        relaxed_bound=min(found.relaxed, best.objective) * square,
        scales=problem.scales(problem.shapes, best.weights[: len(problem.linear)]),
        terms=search.terms(best),
        places=tuple(best.places),
        nodes=found.nodes,
        start=Start(how="convex", tried=found.nodes or 1, objective=float(found.table * square)),
    )


def solve_near(problem: Problem) -> Solution:
    """Find the optimum near the values of the model, without a scan, for data near those that gave the values."""
    if not problem.free:
        return solve(problem, certify=False)
    surface = Surface(problem)
    point = given_point(problem, surface)
    found = None if point is None else surface.downhill(point)
    if point is None or found is None:
        return solve(problem, certify=False)
    start = Start(how="given", tried=1, objective=_value(surface.at(point), problem))
    best, curvature = surface.sharpened(found)
    return replace(_solution(problem, surface, best, start), curvature=curvature)


def resume(problem: Problem, solution: Solution, *, ends: bool = False) -> Solution:
    """Find the local optimum next to the solution of a problem with other weights; exact to first order if near.

    If `ends`, also find out which process each curved term acts as.
    """
    if solution.point is not None:
        return _resumed(problem, solution, ends=ends)
    if problem.curved_class is None:
        return solve(problem, certify=False)
    search = search_of(problem)
    return moved(search, solution, search.followed(list(solution.places), ends=ends), ends=ends)


def moved(search: Search, solution: Solution, best: Optimum, *, ends: bool = False) -> Solution:
    """Return a solution with another local optimum of the places; without bounds."""
    problem = search.problem
    scales = problem.scales(problem.shapes, best.weights[: len(problem.linear)])
    return replace(
        solution, objective=best.objective * problem.unit**2, lower_bound=None, relaxed_bound=0.0, scales=scales,
        terms=search.terms(best, ends=ends), places=tuple(best.places), nodes=0,
    )  # fmt: skip


def solve_sampled(problem: Problem, wv: WaveletVariance, sampled: Sampled, spread: float) -> Solution:
    """Find the local optimum next to the best of random draws."""
    surface = Surface(problem)
    point = sampled_point(problem, wv, sampled, spread)
    before, found = surface.at(point), surface.downhill(point)
    if before is None or found is None:
        raise ModelError(
            f"none of {sampled.draws} random draws gives a valid process of {problem.model}",
            advice="Increase the number of draws.",
        )
    start = Start(how="sampled", tried=sampled.draws, objective=_value(before, problem))
    best, curvature = surface.sharpened(found)
    return replace(_solution(problem, surface, best, start), curvature=curvature)


def final(problem: Problem, solution: Solution, *, certify: bool) -> Solution:
    """Solve the problem under the final weights: by the global search, or from the optimum that draws led to.

    After draws, the bounds belong to the global optimum, which the draws may have missed. The start then has the
    objective that the deterministic search reaches under the same weights.
    """
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
    """Return the objective, in the unit of the data."""
    assert found is not None
    return float(found.objective * problem.unit**2)


def _scanned(problem: Problem, *, quick: bool, near: Solution | None) -> Solution:
    """Return the best of the local optima that descents from the points of a scan reach."""
    surface = Surface(problem)
    alone = scans_alone(problem, surface)
    points, tried = scanned_points(problem, surface, alone, KEPT_QUICK if quick else KEPT)
    known = None if near is None or near.point is None else surface.downhill(near.point)
    found = _lowest(problem, surface, [point for _, point in points], count=1 if quick else FOLLOWED, known=known)
    if found is None:
        raise ModelError(
            f"no starting values were found for {problem.model}", advice="Write starting values into the model."
        )
    place, best = found
    how, origin = points[place or 0]
    if place is None and near is not None and near.origin is not None:
        how, origin = near.start.how, near.origin
    start = Start(how=how, tried=tried, objective=_value(surface.at(origin), problem))
    if alone is not None and not quick:
        best = _rearranged(problem, surface, alone, best)
    best, curvature = surface.sharpened(_elsewhere(problem, surface, best))
    return replace(_solution(problem, surface, best, start), curvature=curvature, origin=origin)


def _lowest(
    problem: Problem, surface: Surface, points: list[Point], *, count: int = FOLLOWED, known: Projection | None = None
) -> tuple[int | None, Projection] | None:
    """Return the lowest local optimum that descents from points reach, with the index of its point; or the `known` one.

    A few steps from each point show which half of the descents is worth a few more, and these which `count` of them are
    worth following to the end.
    """
    steps = SCOUTED if len(surface.frees) == 1 else SCOUTED_BESIDE
    scouts = [(k, found) for k, point in enumerate(points) if (found := surface.downhill(point, steps)) is not None]
    scouts.sort(key=lambda scout: scout[1].objective)
    halved = scouts[: max((len(scouts) + 1) // 2, count)]
    scouts = [(k, found) for k, scout in halved if (found := surface.downhill(scout, steps)) is not None]
    reached: list[Projection] = [] if known is None else [known]
    best: tuple[int | None, Projection] | None = None if known is None else (None, known)
    for k, scout in sorted(scouts, key=lambda scout: scout[1].objective):
        if count == 0:
            break
        if any(_together(scout.point, other.point) for other in reached):
            continue
        found = surface.downhill(scout)
        if found is None:
            continue
        count -= 1
        reached += [scout, found]
        if best is None or not problem.as_low(best[1].objective, found.objective, NOISE):
            best = k, found
    return best


def _together(one: Point, other: Point) -> bool:
    """Return whether two points are so close that descents from them reach the same optimum."""
    return one.branches == other.branches and bool(np.all(np.abs(one.x - other.x) < TOGETHER))


def _rearranged(problem: Problem, surface: Surface, alone: list[Alone], best: Projection) -> Projection:
    """Return the optimum after moving one free process at a time to the best places of its own scan."""
    for _ in range(RETURNS):
        moved = list(moved_points(problem, surface, alone, best.point))
        found = _lowest(problem, surface, moved, known=best)
        if found is None or problem.as_low(best.objective, found[1].objective, NOISE):
            break
        best = found[1]
    return best


def _elsewhere(problem: Problem, surface: Surface, best: Projection) -> Projection:
    """Return the optimum after a new search for the curved processes with the free ones held."""
    for _ in range(RETURNS if problem.curved_class is not None else 0):
        _, z = surface.split(best.point)
        search = surface.curved_alone(z)
        candidates, _, _, _ = search.branch_and_bound(certify=False)
        places = search.located(candidates[0][1])
        there = Point(tuple(b for b, _ in places), np.concatenate([np.array([u for _, u in places]), *z]))
        found = surface.downhill(there)
        if found is None or problem.as_low(best.objective, found.objective, NOISE):
            break
        best = found
    return best


def _resumed(problem: Problem, solution: Solution, *, ends: bool) -> Solution:
    surface = Surface(problem)
    assert solution.point is not None
    here = surface.at(solution.point)
    found, curvature = (None, None) if here is None else surface.sharpened(here, solution.curvature)
    if found is None or not _at_rest(surface, found):
        found = surface.downhill(solution.point)
        assert found is not None  # the point was a process under the weights before, too
        found, curvature = surface.sharpened(found)
    there = _solution(problem, surface, found, solution.start, ends=ends)
    return replace(there, curvature=curvature, origin=solution.origin)


def _at_rest(surface: Surface, found: Projection) -> bool:
    """Return whether the gradient is zero to rounding: at most 1e-10 of the product of the lengths of its factors."""
    slopes = surface.slopes(found)
    gradient = -slopes @ found.residual
    able = surface.moving(found, gradient)
    size = np.linalg.norm(slopes, axis=1) * np.linalg.norm(surface.problem.target)
    return bool(np.all(np.abs(gradient[able]) <= 1e-10 * size[able]))


def _solution(problem: Problem, surface: Surface, found: Projection, start: Start, *, ends: bool = True) -> Solution:
    """Make the solution from an optimum; if `ends`, with the process that each curved term acts as."""
    linear = len(problem.linear)
    u, z = surface.split(found.point)
    terms: tuple[Term, ...] = ()
    places = tuple(zip(found.point.branches, u.tolist(), strict=True))
    if problem.curved_class is not None:
        search = surface.curved_alone(z)
        # That search leaves out processes whose wavelet variance is zero.
        terms = search.terms(search.at(list(places)), ends=ends)
    # `unit` over the length of the weighted shape.
    scales = found.weights[linear:] * problem.unit / np.where(found.lengths > 0, found.lengths, 1.0)
    for free, part, scale in zip(surface.frees, z, scales[len(places) :], strict=True):
        values = tuple(free.values(part.reshape(1, -1))[0].tolist())
        terms = (*terms, Term(values, float(scale)))
    linear_scales = problem.scales(problem.shapes, found.weights[:linear])
    value = float(found.objective * problem.unit**2)
    return Solution(
        objective=value,
        lower_bound=None,
        relaxed_bound=0.0,
        scales=linear_scales,
        terms=terms,
        places=places,
        nodes=0,
        start=start,
        point=found.point,
    )


def estimated(problem: Problem, solution: Solution, slope: float | None) -> Model:
    """Return the model with the values of a solution, in the same order of terms.

    A signed parameter has the sign of the `slope` of the data, if that is known.
    """
    processes = list(problem.model.processes)
    for place, scale in zip(problem.linear, solution.scales, strict=True):
        processes[place] = _with_scale(processes[place], float(scale), slope)
    for place, term in zip(problem.shaped, solution.terms, strict=True):
        process = processes[place]
        names = [p.name for p in process.nonlinear_parameters()]
        shaped = process.with_values(**dict(zip(names, term.values, strict=True)))
        processes[place] = _with_scale(shaped, term.scale, slope)
    return Model(tuple(processes))


def _with_scale(process: Process, scale: float, slope: float | None) -> Process:
    parameter = process.scale_parameter()
    value = process.value_from(scale)
    if parameter.domain == "real" and slope is not None and slope < 0:
        value = -value
    return process.with_values(**{parameter.name: value})
