"""Global search for the nonlinear parameters of processes that have one, called the curved processes.

A convex relaxation, with any number of these processes, gives the start. Branch and bound over the search coordinate of
a tabulated curve proves that no better fit exists. A refinement on the exact curve gives all digits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.threads import check_stop
from gmwm.fitting.estimation.atoms import Place, close_up, grid, shape_at, shapes, slope_at, table, values_at
from gmwm.fitting.estimation.problem import Problem
from gmwm.theory.processes.base import Process


@dataclass(frozen=True)
class SearchLimits:
    """Limits of the search and of the refinement (docs/validation/optimum.md)."""

    certified_gap: float = 1e-4
    """Relative gap between objective and lower bound at which the search stops (docs/validation/optimum.md)."""
    certify_nodes: int = 20_000  # largest number of nodes of the search tree in a search with a certificate
    quick_nodes: int = 24
    """Largest number of nodes without a certificate; the fits are equally good (tests/estimation/test_fit_laws.py)."""
    table_error: float = 1e-5
    """Relative excess of the objective up to which optima on the tabulated curve are refined on the exact curve."""
    settled: float = 1e-12  # relative decrease of the objective below which a refinement ends
    polishes: int = 8  # largest number of successive cells through which a refinement follows one optimum
    newton_steps: int = 5  # largest number of Newton steps at the end of a refinement
    longest_step: float = 0.05  # longest Newton step in the search coordinate after the weights have changed
    flat: float = 1e-10
    """Relative increase of the objective below which the end of a domain replaces the optimum (test_last_places.py)."""
    acts_as: float = 1e-6
    """Relative increase below which a process acts as the process at the end of its domain (test_last_places.py)."""


LIMITS = SearchLimits()

WIDTHS = (0.4, 0.06, 1e-2, 1e-3)
"""Widths, in the search coordinate, of the cells of the refinement; the last cells are exact to rounding. Only an
optimum with other weights may be so far away that the first cells are needed (test_exponential_search.py)."""


@dataclass(frozen=True)
class FittedTerm:
    """Fitted process with free shape parameters; `acts_as` is a process that the data cannot distinguish from it."""

    values: tuple[float, ...]
    scale: float
    acts_as: str | None = None


@dataclass(frozen=True)
class Optimum:
    """Local optimum on the exact curve, with the places of the curved processes and the weights of all unit vectors."""

    objective: float
    places: list[Place]
    weights: Vector
    ends: tuple[int, ...] | None = None
    """For each place, the indistinguishable end of its branch: 1 (high), −1 (low) or 0; None if unknown."""


@dataclass(frozen=True)
class SearchResult:
    """Optimum, lower bounds of the tree and the relaxation, best tabulated objective, and number of nodes."""

    best: Optimum
    bound: float
    relaxed: float
    table: float
    nodes: int


class Search:
    """Search for the places of the curved processes of one problem."""

    def __init__(self, problem: Problem, curved_class: type[Process]) -> None:
        self.problem = problem
        self.curved_class = curved_class
        self.grid = grid(
            curved_class, problem.levels, samples=problem.samples, rate=problem.rate, filter=problem.filter
        )
        self.fixed = problem.fixed
        self.positive = problem.weights.positive

    def optimum(self, *, certify: bool) -> SearchResult:
        """Return the global optimum on the exact curve, with lower bounds that prove it if `certify`."""
        candidates, bound, relaxed, nodes = self.branch_and_bound(certify=certify)
        least = candidates[0][0]
        lowest = [positions for value, positions in candidates if value <= (1 + LIMITS.table_error) * least]
        best = min((self.polish(self.places_of(p)) for p in lowest), key=lambda found: found.objective)
        return SearchResult(self.snap_to_ends(best), bound, relaxed, table=least, nodes=nodes)

    def branch_and_bound(self, *, certify: bool) -> tuple[list[tuple[float, Vector]], float, float, int]:
        """Search the tabulated curve; return objectives and places of local optima, best first, bounds and nodes."""
        tables, key = self.problem.weights.tables, (table, self.grid)
        curve = tables[key] = tables.get(key) or table(self.grid, self.problem.root)
        return _core.cone_search(
            self.problem.target, self.fixed, self.positive, curve.values, curve.slopes, curve.margins,
            len(self.problem.curved), LIMITS.certified_gap,
            LIMITS.certify_nodes if certify else LIMITS.quick_nodes, self.starts(),
        )  # fmt: skip

    def tabulated(self) -> list[Place]:
        """Return the places of the best optimum on the tabulated curve that a search without a certificate finds."""
        return self.places_of(self.branch_and_bound(certify=False)[0][0][1])

    def starts(self) -> Vector:
        """Return the starting values on the tabulated curve; empty unless every curved process has one."""
        name = self.curved_class.nonlinear_parameters()[0].name
        positions = []
        for place in self.problem.curved:
            value = self.problem.model.processes[place].values[name]
            for index, branch in enumerate(self.grid.branches):
                u = None if value is None else branch.coordinate(value)
                if u is not None:
                    positions.append(self.grid.position(index, min(max(u, branch.low), branch.high)))
        return np.array(positions if len(positions) == len(self.problem.curved) else [], dtype=np.float64)

    def places_of(self, positions: Vector) -> list[Place]:
        """Convert positions on the tabulated curve to places."""
        cells = [self.grid.place(float(position)) for position in positions]
        return [(self.grid.branches[index], u) for index, u in cells]

    def polish(self, places: list[Place], widths: tuple[float, ...] = WIDTHS[-2:]) -> Optimum:
        """Return the local optimum on the exact curve that is nearest to `places`."""
        problem = self.problem
        for width in widths if places else ():
            before = np.inf
            for _ in range(LIMITS.polishes):
                if not places:
                    break
                piece, ends = close_up(
                    self.curved_class, places, width=width, levels=problem.levels, rate=problem.rate,
                    filter=problem.filter, root=problem.root,
                )  # fmt: skip
                share = np.array([(u - low) / width for (_, u), (low, _) in zip(places, ends, strict=True)])
                moved, objective = _core.cone_refine(
                    problem.target, self.fixed, self.positive, piece.values, piece.slopes, piece.margins,
                    np.clip(share, 0.0, 1.0) + 2 * np.arange(len(places)),
                )  # fmt: skip
                which = moved.astype(int) // 2  # the piece around place i is [2i, 2i + 1]
                share = moved - 2 * which
                places = [(places[i][0], float(ends[i, 0] + t * width)) for i, t in zip(which, share, strict=True)]
                leaving = [t in (0.0, 1.0) and b.low < u < b.high for t, (b, u) in zip(share, places, strict=True)]
                if not any(leaving) or objective >= (1 - LIMITS.settled) * before:
                    break
                before = objective
        return self._sharpen(self.at(places))

    def _sharpen(self, best: Optimum, steps: int = LIMITS.newton_steps, reach: float = WIDTHS[-1]) -> Optimum:
        """Return the optimum after Newton's method if its objective is not larger; otherwise `best`."""
        places = newton_places(
            self.problem, self.curved_class, places=best.places, weights=best.weights, steps=steps, reach=reach
        )
        if places is None:
            return best
        sharp = self.at(places)
        return sharp if self.problem.as_low(sharp.objective, best.objective, LIMITS.settled) else best

    def follow(self, places: list[Place], *, ends: bool = False) -> Optimum:
        """Return the local optimum nearest to `places`, the optimum for slightly different weights, by one Newton step
        if it is sufficient. If `ends`, a subclass also finds the ends of branches that the data cannot distinguish."""
        start = self.at(places)
        optimum = self._sharpen(start, 1, LIMITS.longest_step)
        return self.polish(places, WIDTHS) if optimum is start and places else optimum

    def _rows(self, places: list[Place]) -> Matrix:
        curved = shapes(
            self.curved_class, places, levels=self.problem.levels, rate=self.problem.rate, filter=self.problem.filter
        )
        return np.concatenate([self.fixed, self.problem.unit_rows(curved)])

    def at(self, places: list[Place]) -> Optimum:
        """Return the optimum of the weights for given places of the curved processes."""
        check_stop()
        weights, objective = _core.nonnegative_least_squares(self.problem.target, self._rows(places))
        return Optimum(objective, places, weights)

    def snap_to_ends(self, best: Optimum) -> Optimum:
        """Return the optimum with places moved to an end of their domain if the objective is flat up to this end."""
        for index, (branch, _) in enumerate(best.places):
            for end in (branch.high, branch.low):
                optimum = self.at([*best.places[:index], (branch, end), *best.places[index + 1 :]])
                if self.problem.as_low(optimum.objective, best.objective, LIMITS.flat):
                    best = optimum
                    break
        return best

    def terms(self, best: Optimum, *, ends: bool = True) -> tuple[FittedTerm, ...]:
        """Return the curved processes of an optimum and, if `ends`, the processes that fit as well as them."""
        problem, places = self.problem, best.places
        curved = shapes(self.curved_class, places, levels=problem.levels, rate=problem.rate, filter=problem.filter)
        scales = problem.scales(curved, best.weights[len(problem.linear) :]).tolist()
        acting = [self._acts_as(best, i) if ends else None for i in range(len(places))]
        # Terms without weight have no place. They get the shortest correlation time and the scale coefficient 0.
        branch, missing = self.grid.branches[0], len(problem.curved) - len(places)
        values = values_at([*places, *[(branch, branch.high)] * missing])[:, 0].tolist()
        terms = zip(values, [*scales, *[0.0] * missing], [*acting, *[None] * missing], strict=True)
        return tuple(FittedTerm((value,), scale, acts_as) for value, scale, acts_as in terms)

    def _acts_as(self, best: Optimum, index: int) -> str | None:
        """Return the process at an end of the branch that fits as well as the curved process `index`, if any."""
        branch, u = best.places[index]
        if best.ends is not None:
            return {1: branch.high_acts_as, -1: branch.low_acts_as}.get(best.ends[index])
        ends = [(branch.high, branch.high_acts_as), (branch.low, branch.low_acts_as)]
        for end, name in sorted(ends, key=lambda end: end[0] != u):  # an end at which the place already is comes first
            places = [*best.places[:index], (branch, end), *best.places[index + 1 :]]
            if name and (u == end or self.problem.as_low(self.at(places).objective, best.objective, LIMITS.acts_as)):
                return name
        return None


def newton_places(
    problem: Problem, curved_class: type[Process], places: list[Place], weights: Vector, steps: int, reach: float
) -> list[Place] | None:
    """Refine the places of a local optimum by up to `steps` Newton steps within `reach`; None if they diverge. |target
    − Σ w a − Σ x g(u)|² is minimised over w, x and u; weights of zero and places at an end stay."""
    linear = len(problem.linear)
    moving = np.array([b.low < u < b.high for b, u in places], dtype=bool)
    if not moving.any() or np.any(weights[linear:] <= 0):
        return None
    fixed = problem.fixed[weights[:linear] > 0]
    x = np.concatenate([weights[:linear][weights[:linear] > 0], weights[linear:]])
    length: Matrix | None = None
    for _ in range(steps):
        value, slope, bend = _derivatives(problem, curved_class, places)
        if length is None:
            length = np.linalg.norm(value, axis=1, keepdims=True)
        value, slope, bend = value / length, slope / length, bend / length
        step = _step(problem.target, fixed, value=value, slope=slope, bend=bend, x=x, moving=moving)
        if step is None:
            return None
        x = x + step[: x.size]
        moves = np.zeros(len(places))
        moves[moving] = step[x.size :]
        places = [(b, float(u + d)) for (b, u), d in zip(places, moves, strict=True)]
        if not np.all(np.abs(moves) <= reach) or any(not b.low <= u <= b.high for b, u in places):
            return None
        # Near the rounding error of the parameter.
        if np.all(np.abs(moves) < 1e-12):
            break
    return places


def _step(
    target: Vector, fixed: Matrix, value: Matrix, slope: Matrix, bend: Matrix, x: Vector, moving: Vector
) -> Vector | None:
    """Return the Newton step of all weights `x`, followed by the steps of the places that `moving` marks."""
    rows = np.concatenate([fixed, value])
    residual = target - x @ rows
    weight = x[fixed.shape[0] :, None]
    jacobian = np.concatenate([rows, (weight * slope)[moving]])
    hessian = jacobian @ jacobian.T
    at = rows.shape[0] + np.arange(int(np.count_nonzero(moving)))
    which = fixed.shape[0] + np.flatnonzero(moving)
    hessian[at, at] -= (weight * bend)[moving] @ residual
    hessian[which, at] -= slope[moving] @ residual
    hessian[at, which] = hessian[which, at]
    try:
        return np.asarray(np.linalg.solve(hessian, jacobian @ residual))
    except np.linalg.LinAlgError:
        return None


def _derivatives(problem: Problem, curved_class: type[Process], places: list[Place]) -> tuple[Matrix, Matrix, Matrix]:
    """Return the weighted variances (n, J) of the curved processes at places, and their derivatives by u."""
    # Step of the finite differences that give second derivatives. Their errors only slow the convergence.
    count, d = len(places), 1e-3
    points = [(b, np.array([u + shift])) for shift in (0.0, d, -d) for b, u in places]
    parameters = np.concatenate([b.values(u) for b, u in points])
    by_u = np.concatenate([b.slope(u) for b, u in points])
    values = shape_at(curved_class, parameters[:count], problem.levels, rate=problem.rate, filter=problem.filter)
    slopes = slope_at(curved_class, parameters, problem.levels, rate=problem.rate, filter=problem.filter) * by_u
    bends = (slopes[count : 2 * count] - slopes[2 * count :]) / (2 * d)
    root = problem.root.T
    return values @ root, slopes[:count] @ root, bends @ root
