"""Starting values from a deterministic scan, and from random draws by Algorithms 1 to 3 of Balamuta et al."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_whole_number
from gmwm.base.documents import Documented
from gmwm.fitting.estimation.atoms import grid
from gmwm.fitting.estimation.problem import Problem
from gmwm.fitting.estimation.variable_projection import Coordinates, ShapePoint, Surface
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Dominant, Occasion
from gmwm.theory.processes.validation import as_seed

How = Literal["convex", "given", "scan", "sampled"]
"""Source of the starting point of a fit: the convex relaxation, values in the model, a scan, or random draws."""

# tests/estimation/test_arma_fits.py and test_surface.py pin the sizes of the scan below: no other start, including
# random draws, may reach a smaller objective (docs/validation/starts.md has the study).
MOST_SCANNED = 4096  # largest number of points of a scan


@dataclass(frozen=True)
class Sampled:
    """Random starting values for ``fit(…, start=Sampled())``, by Algorithms 1 to 3 of Balamuta et al.

    They are for comparison only. By default, a fit starts from the convex relaxation, needs no random numbers, and
    finds the global optimum. With random draws, the local optimisation starts from the draw with the smallest
    Σ_j (1 − ν_j²(θ)/ν̂_j²)².

    Parameters
    ----------
    draws : int
        Number G of random starting values, at least 1.
    rng : int or numpy.random.Generator
        Source of the draws; the same integer gives the same fit. From a Generator, an integer is drawn and stored.

    Raises
    ------
    OptionError
        If `draws` or `rng` has an invalid value.

    References
    ----------
    Balamuta, Guerrier, Molinari and Yang, Appendix C, with σ̂_T² = Σ_j ν̂_j².

    Examples
    --------
    >>> Sampled(draws=1000, rng=1)
    Sampled(draws=1000, rng=1)
    """

    draws: int = 20_000
    rng: int | np.random.Generator = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "draws", as_whole_number(self.draws, "draws", 1))
        object.__setattr__(self, "rng", as_seed(self.rng))


@dataclass(frozen=True, kw_only=True)
class Start(Documented):
    """Starting point of a fit, with the objective there.

    Attributes
    ----------
    how : "convex", "given", "scan" or "sampled"
        Source of the starting point: the convex relaxation, values in the model, a scan, or random draws.
    tried : int
        Number of starting points that were evaluated.
    objective : float
        Objective at the starting point, with the best scales.
    default : float or None
        Objective that a fit without random draws reaches with the same weights. None if there were no random draws, or
        if the fit was made with certify=False.
    """

    how: How
    tried: int
    objective: float
    default: float | None = None

    @property
    def in_words(self) -> str:
        """Description of the start, for summaries."""
        if self.how == "sampled":
            other = "" if self.default is None else f"; without draws {self.default:.6g}"
            return f"from the best of {self.tried} draws, objective {self.objective:.6g} there{other}"
        if self.how == "convex":
            return f"from the convex relaxation, objective {self.objective:.6g} there"
        which = "the given one" if self.how == "given" else f"objective {self.objective:.6g} there"
        return f"best of the optima reached from {self.tried} starting points ({which})"


def scanned_points(
    problem: Problem, surface: Surface, alone: list[Alone] | None, kept: int
) -> tuple[list[tuple[How, ShapePoint]], int]:
    """Return the points from which descents start, and the number of evaluated points: the values in the model, the
    point of `alone`, and the best of a sequence of points that fills the box of free coordinates evenly."""
    count = sum(free.size for free in surface.frees)
    # If a parameter is fixed, only a few points of the box belong to a valid process, so more points are needed.
    held = any(not free.together for free in surface.frees)
    # 64 points for one coordinate, and four times as many for each additional one.
    number = min(MOST_SCANNED, 64 * 4 ** (count - 1 + 2 * held))
    share, columns = _even(number, count), []
    at = 0
    for free in surface.frees:
        columns.append(_over_its_scan(free, share[:, at : at + free.size], problem))
        at += free.size
    chosen = _best(problem, surface, columns, share=share, kept=kept)
    points: list[tuple[How, ShapePoint]] = []
    if (start := given_point(problem, surface)) is not None:
        points.append(("given", start))
    if alone is not None:
        points.append(("scan", _with_curved(problem, surface, _one_by_one(problem, surface, alone))))
    for k in chosen:
        z = [free.of(values[k : k + 1])[0] for free, values in zip(surface.frees, columns, strict=True)]
        if all(np.all(np.isfinite(part)) for part in z):
            points.append(("scan", _with_curved(problem, surface, z)))
    return points, number + len(points) - len(chosen)


def given_point(problem: Problem, surface: Surface) -> ShapePoint | None:
    """Return the starting point that the values in the model give; None if a free process has no values."""
    coordinates = [free.start_values() for free in surface.frees]
    values = [z for z in coordinates if z is not None]
    return _with_curved(problem, surface, values) if len(values) == len(coordinates) else None


def _over_its_scan(free: Coordinates, share: Matrix, problem: Problem) -> Matrix:
    """Return the nonlinear parameters (n, q), including fixed ones, at relative positions (n, d) in the scanned box."""
    ends = free.scan_range(problem.samples, problem.rate)
    return np.asarray(free.values(ends[:, 0] + share * (ends[:, 1] - ends[:, 0])), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Alone:
    """Scan of a single free process, with n sets of nonlinear parameters (n, q) and their unit vectors (n, J)."""

    values: Matrix
    units: Matrix

    def best(self, others: Matrix, problem: Problem, count: int = 1) -> list[int]:
        """Return the `count` best points of the scan, not close to each other, combined with the vectors `others`."""
        rows = np.ascontiguousarray(np.concatenate([others, self.units[:1]]))
        objectives = np.empty(len(self.units))
        for k, unit in enumerate(self.units):
            rows[-1] = unit
            objectives[k] = _core.nonnegative_least_squares(problem.target, rows)[1]
        chosen: list[int] = []
        for k in np.argsort(objectives, kind="stable").tolist():
            # Inner product of two unit vectors above which their points are treated as one.
            if len(chosen) < count and all(self.units[k] @ self.units[other] < 0.9999 for other in chosen):
                chosen.append(k)
        return chosen


def scans_alone(problem: Problem, surface: Surface) -> list[Alone] | None:
    """Scan each free process separately; return None if there is only one, or if one has no valid point."""
    if len(surface.frees) < 2:
        return None
    every = []
    for free in surface.frees:
        # 256 points for one coordinate of a single process, and four times as many for each additional one.
        values = _over_its_scan(free, _even(min(MOST_SCANNED, 256 * 4 ** (free.size - 1)), free.size), problem)
        shapes = free.kind.moments(values, problem.levels, problem.rate, problem.filter)
        able = free.possible(values) & np.all(np.isfinite(shapes), axis=1) & np.any(shapes > 0, axis=1)
        if not able.any():
            return None
        every.append(Alone(values[able], problem.unit_rows(shapes[able])))
    return every


def _one_by_one(problem: Problem, surface: Surface, every: list[Alone]) -> list[Vector]:
    """Return coordinates after optimising each free process in turn: joint scans miss several narrow bands."""
    base = _dictionary(problem)
    at: dict[int, int] = {}
    for _ in range(4):
        before = dict(at)
        for place, scan in enumerate(every):
            others = [every[k].units[row : row + 1] for k, row in at.items() if k != place]
            at[place] = scan.best(np.concatenate([base, *others]), problem)[0]
        if at == before:
            break
    scans = zip(surface.frees, every, strict=True)
    return [free.of(scan.values[at[k] : at[k] + 1])[0] for k, (free, scan) in enumerate(scans)]


def moved_points(problem: Problem, surface: Surface, every: list[Alone], point: ShapePoint) -> Iterator[ShapePoint]:
    """Yield points at which one free process is moved to one of the best points of its own scan."""
    _, z = surface.split(point)
    base, shapes = _dictionary(problem), surface.free_shapes(z)
    for place, scan in enumerate(every):
        here = [problem.unit_rows(shapes[k : k + 1]) for k in range(len(z)) if k != place and np.any(shapes[k] > 0)]
        # Number of points of its scan to which each process is moved after the first descent.
        for row in scan.best(np.concatenate([base, *here]), problem, 4):
            coordinates = surface.frees[place].of(scan.values[row : row + 1])[0]
            yield _with_curved(problem, surface, [*z[:place], coordinates, *z[place + 1 :]])


def _best(problem: Problem, surface: Surface, columns: list[Matrix], *, share: Matrix, kept: int) -> list[int]:
    """Return the indices of the `kept` points with the smallest objectives, no two of them close to each other."""
    base, units, possible = _dictionary(problem), [], np.ones(len(share), dtype=np.bool_)
    for free, values in zip(surface.frees, columns, strict=True):
        possible &= free.possible(values)
        shapes = free.kind.moments(values, problem.levels, problem.rate, problem.filter)
        possible &= np.all(np.isfinite(shapes), axis=1)
        rows = np.where(possible[:, None], shapes, 1.0) @ problem.root.T
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        units.append(rows / np.where(length > 0, length, 1.0))
    objectives = np.full(len(share), np.inf)
    rows = np.ascontiguousarray(np.concatenate([base, np.zeros((len(units), base.shape[1]))]))
    for k in np.flatnonzero(possible):
        for place, unit in enumerate(units):
            rows[len(base) + place] = unit[k]
        objectives[k] = _core.nonnegative_least_squares(problem.target, rows)[1]
    near = 1.5 * len(share) ** (-1.0 / max(share.shape[1], 1))
    chosen: list[int] = []
    # Descents start from these best points of a scan, no two of them close to each other.
    for k in np.argsort(objectives, kind="stable")[:256].tolist():
        if not np.isfinite(objectives[k]) or len(chosen) == kept:
            break
        if all(np.abs(share[k] - share[other]).max() > near for other in chosen):
            chosen.append(k)
    return chosen


def _dictionary(problem: Problem) -> Matrix:
    """Return the unit vectors of the linear processes, and of the curved processes at places in their whole domain."""
    if problem.curved_class is None:
        return problem.fixed
    values = grid(
        problem.curved_class, problem.levels, samples=problem.samples, rate=problem.rate, filter=problem.filter
    ).values
    # Number of places that represent a curved process during a scan.
    places = np.unique(np.linspace(0, len(values) - 1, 48).astype(np.int64))
    return np.concatenate([problem.fixed, problem.unit_rows(values[places])])


def _with_curved(problem: Problem, surface: Surface, z: list[Vector]) -> ShapePoint:
    """Return the point with the coordinates `z` of the free processes and the best places of the curved processes."""
    places = [] if problem.curved_class is None else surface.curved_alone(z).tabulated()
    u = np.array([u for _, u in places], dtype=np.float64)
    return ShapePoint(tuple(branch for branch, _ in places), np.concatenate([u, *z]))


def _even(count: int, size: int) -> Matrix:
    """Return points (count, size) that fill the unit cube evenly: an additive recurrence modulo 1 with powers of 1/x,
    where x^(d+1) = x + 1 for d = `size` (Roberts 2018, The unreasonable effectiveness of quasirandom sequences)."""
    root = 2.0
    for _ in range(60):
        root = (1.0 + root) ** (1.0 / (size + 1))
    steps = root ** -np.arange(1.0, size + 1)
    return np.asarray((0.5 + np.outer(np.arange(1.0, count + 1), steps)) % 1.0)


def sampled_point(problem: Problem, wv: WaveletVariance, sampled: Sampled, spread: float) -> ShapePoint:
    """Return the random draw closest to the data; `spread` = (max x − min x)/N scales drifts."""
    surface = Surface(problem)
    rng = np.random.default_rng(sampled.rng)
    occasion = _occasion(wv, spread, sampled.draws, rng)
    drawn: dict[int, Matrix] = {}
    before: dict[type[Process], tuple[Matrix, ...]] = {}
    total = np.tile(wv.variance - problem.observed, (sampled.draws, 1))
    order = [k for k in range(len(problem.model.processes)) if k in (*problem.linear, *problem.shaped)]
    for place in order:
        process = problem.model.processes[place]
        kind = type(process)
        rows = kind.drawn(occasion, rng, sampled.draws, before.get(kind, ()))
        if place in problem.linear:
            rows[:, 1:] = process.nonlinear
        for k, parameter in enumerate(process.nonlinear_parameters()):
            if process.is_fixed(parameter.name):
                rows[:, 1 + k] = process.value(parameter.name)
        before[kind] = (*before.get(kind, ()), rows[:, 1:])
        drawn[place] = rows
        shapes = kind.moments(rows[:, 1:], problem.levels, problem.rate, problem.filter)
        total += rows[:, :1] * shapes
    with np.errstate(invalid="ignore"):
        distance = np.sum((1.0 - total / wv.variance) ** 2, axis=1)
    best = int(np.nanargmin(distance))
    branches, u = [], []
    if problem.curved_class is not None:
        for place in problem.curved:
            value = float(drawn[place][best, 1])
            for branch in problem.curved_class.search(problem.samples, problem.rate):
                at = branch.coordinate(value)
                if at is not None:
                    branches.append(branch)
                    u.append(min(max(at, branch.low), branch.high))
                    break
    z = [free.of(drawn[k][best : best + 1, 1:])[0] for free, k in zip(surface.frees, problem.free, strict=True)]
    return ShapePoint(tuple(branches), np.concatenate([np.array(u, dtype=np.float64), *z]))


def _occasion(wv: WaveletVariance, spread: float, draws: int, rng: np.random.Generator) -> Occasion:
    """Run Algorithms 1 and 2 of Balamuta et al.: the process that dominates two levels, and each draw's condition."""
    dominant = _dominant(wv)
    first = np.ones(draws, dtype=np.int64)
    if dominant == "quantization":
        first[rng.random(draws) <= 0.75] = 2
    elif dominant == "white":
        first[:] = 2
    return Occasion(
        total=float(wv.variance.sum()), spread=spread, dominant=dominant, first=first, levels=wv.levels,
        samples=wv.samples, rate=wv.rate, filter=find_filter(wv.filter),
    )  # fmt: skip


def _dominant(wv: WaveletVariance) -> Dominant:
    if len(wv) < 2 or not np.all(wv.variance[:2] > 0):
        return "markov"
    low, high = chi_square_limits(wv.variance[1:2], wv.degrees_of_freedom[1:2], 0.95)
    slopes = [(math.log(float(a[0])) - math.log(float(wv.variance[0]))) / math.log(4.0) for a in (low, high)]
    if max(slopes) < -0.5:
        return "quantization"
    return "markov" if min(slopes) > -0.5 else "white"
