"""Fit all candidates to one recording with the weighting matrix Ω of the general model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm.covariance import Design, covariance
from gmwm.estimation.atoms import grid
from gmwm.estimation.estimator import as_fit
from gmwm.estimation.problem import Problem, pose, to_find
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import Settled, nearly_settled
from gmwm.estimation.solver import Solution, solve
from gmwm.estimation.weighting import precision
from gmwm.processes.model import Model
from gmwm.selection.structure import freedom, of_lower_order, structure_of, without_values
from gmwm.variance.pooling import without
from gmwm.variance.result import WaveletVariance

NOT_LOWER = 1e-9
"""Relative difference below which two objectives are equal (tests/selection/test_nested_objectives.py)."""

EVERY = 8
"""Step through the grid of correlation times. Neighbours then differ by 20 % (used in docs/validation/selection.md)."""

Progress = Callable[[int, int], None]
"""Progress callback: called with the number of candidates done and the number of all candidates."""


@dataclass(frozen=True, eq=False)
class Explored:
    """All candidates, fitted to one recording.

    Attributes
    ----------
    general : Fit
        The fit of the largest model with at most as many parameters as levels; its Ω and V are used for all others.
    matrix, wavelet : (J, J) arrays
        Ω, and the covariance V of ν̂².
    fits : tuple of Fit
        One for each candidate. A candidate with terms that are zero may share the fit of a smaller one.
    """

    general: Fit
    matrix: Matrix
    wavelet: Matrix
    fits: tuple[Fit, ...]

    def __post_init__(self) -> None:
        freeze(self.wavelet)

    @cached_property
    def columns(self) -> tuple[Matrix, int]:
        """The result of `relaxed_columns`, which all tests of equivalence use."""
        return relaxed_columns(self)


def explore(
    general: Model,
    candidates: Sequence[Model],
    wv: WaveletVariance,
    weighting: str,
    *,
    progress: Progress | None = None,
) -> Explored:
    """Fit every candidate with the Ω of the general model.

    If the optimum of a sum has terms that are zero, it is also the optimum of every sum in between, which saves most of
    the work. A sum never has a larger objective than one of its parts; `mend` ensures this.
    """
    largest = general if freedom(general) <= len(wv) else max(candidates, key=freedom)
    settled, wavelet = nearly_settled(largest, wv, weighting)
    matrix = settled.problem.matrix
    search = _Exploration(wv, matrix, weighting)
    search.take(largest, settled.problem, settled.solution)
    order = sorted(range(len(candidates)), key=lambda k: -len(candidates[k].processes))
    for done, k in enumerate(order):
        search.add(candidates[k])
        if progress is not None:
            progress(done + 1, len(candidates))
    search.mend()
    fits = tuple(search.fit(model) for model in candidates)
    return Explored(as_fit(settled, wv, weighting), matrix, wavelet, fits)


def losses_left_out(explored: Explored, candidates: Sequence[Model], weighting: str) -> Vector | None:
    """Return the mean loss of each candidate on a recording that its fit did not use; None for a single recording.

    Each recording is left out once. The fits to the others have the Ω of the general model, and the loss has that of
    the recording: (ν̂_r − ν)ᵀ Ω_r (ν̂_r − ν).
    """
    wv = explored.general.wavelet_variance
    if len(wv.recordings) < 2:
        return None
    losses = []
    for name, one in wv.recordings.items():
        fits = _explored_again(explored, candidates, without(wv, name), weighting)
        design = replace(Design.of(one), model_error=wv.model_error)
        design = design.only(one.levels <= len(fits[0].wavelet_variance))
        scatter = covariance(explored.general.model, design)
        matrix, reach = _inverse(scatter, weighting), design.levels.size
        miss = [one.variance[:reach] - fit.implied[:reach] for fit in fits]
        losses.append([float(m @ matrix @ m) for m in miss])
    return np.asarray(np.mean(losses, axis=0))


def _explored_again(explored: Explored, candidates: Sequence[Model], wv: WaveletVariance, weighting: str) -> list[Fit]:
    """Fit the candidates to other data, with the weights of `explored`."""
    matrix = explored.matrix
    if len(wv) < len(matrix):
        matrix = _inverse(explored.wavelet[: len(wv), : len(wv)], weighting)
    search = _Exploration(wv, matrix, weighting)
    fitting = [model for model in candidates if freedom(model) <= len(wv)]
    for model in sorted(fitting, key=lambda model: -len(model.processes)):
        search.add(model)
    search.mend()
    # A model with more parameters than the other recordings have levels has the fit of the largest one.
    return [search.fit(model if freedom(model) <= len(wv) else max(fitting, key=freedom)) for model in candidates]


def _inverse(scatter: Matrix, weighting: str) -> Matrix:
    return precision(scatter) if weighting == "optimal" else np.diag(1 / np.diag(scatter))


@dataclass(frozen=True, eq=False)
class _Solved:
    model: Model
    structure: Counter[str]
    shown: Counter[str]
    problem: Problem
    solution: Solution


class _Exploration:
    """The solutions for one Ω, by structure of the sum."""

    def __init__(self, wv: WaveletVariance, matrix: Matrix, weighting: str) -> None:
        self.wv, self.matrix, self.weighting = wv, matrix, weighting
        self.solved: dict[frozenset[tuple[str, int]], _Solved] = {}
        self.fits: dict[int, Fit] = {}

    def take(self, model: Model, problem: Problem, solution: Solution) -> _Solved:
        """Store a solution, also for the smaller model without terms that are zero."""
        structure = structure_of(model)
        shown = _shown(model, problem, solution)
        found = _Solved(model, structure, shown=shown, problem=problem, solution=solution)
        self.solved[_key(structure)] = found
        if shown != structure and shown and _key(shown) not in self.solved:
            self.solved[_key(shown)] = self._part(found)
        return found

    def add(self, model: Model) -> None:
        """Solve a candidate, unless its solution is known."""
        structure = structure_of(model)
        if _key(structure) in self.solved:
            return
        for known in self.solved.values():
            if known.shown and known.shown <= structure <= known.structure:
                self.solved[_key(structure)] = replace(self.solved[_key(known.shown)], structure=structure)
                return
        problem = pose(without_values(model), self.wv, self.matrix)
        self.take(model, problem, solve(problem, certify=False))

    def mend(self) -> None:
        """Replace a solution whose objective is larger than the objective of a model that it contains."""
        for key, found in sorted(self.solved.items(), key=lambda item: item[1].structure.total()):
            square, reached = found.problem.unit**2, found.solution.objective
            most = found.structure.total()
            lower = sorted(
                (p for p in self.solved.values() if p.solution.objective < reached and p.structure.total() <= most),
                key=lambda p: p.solution.objective,
            )
            best = next((p for p in lower if of_lower_order(p.structure, found.structure)), found)
            if not found.problem.as_low(reached / square, best.solution.objective / square, NOT_LOWER):
                self.solved[key] = replace(best, structure=found.structure)

    def fit(self, model: Model) -> Fit:
        """Return the fit of a candidate; sums with the same optimum share one fit."""
        found = self.solved[_key(structure_of(model))]
        if id(found.solution) not in self.fits:
            self.fits[id(found.solution)] = as_fit(Settled(found.problem, found.solution), self.wv, self.weighting)
        return self.fits[id(found.solution)]

    def _part(self, found: _Solved) -> _Solved:
        """Return the solution without the terms that are zero."""
        old = found.problem
        linear = [k for k, scale in zip(old.linear, found.solution.scales, strict=True) if scale > 0]
        moving = [k for k, term in zip(old.shaped, found.solution.terms, strict=True) if term.scale > 0]
        free = {*old.linear, *old.shaped}
        places = sorted([*linear, *moving, *(k for k in range(len(old.model.processes)) if k not in free)])
        model = Model(tuple(old.model.processes[k] for k in places))
        problem = pose(without_values(model), self.wv, self.matrix)
        scales = np.array([s for s in found.solution.scales if s > 0], dtype=np.float64)
        terms = tuple(t for t in found.solution.terms if t.scale > 0)
        solution = replace(found.solution, scales=scales, terms=terms)
        return _Solved(model, found.shown, shown=found.shown, problem=problem, solution=solution)


def _shown(model: Model, problem: Problem, solution: Solution) -> Counter[str]:
    """Return the structure without the terms that are zero."""
    structure = structure_of(model)
    zero = [k for k, scale in zip(problem.linear, solution.scales, strict=True) if scale == 0]
    zero += [k for k, term in zip(problem.shaped, solution.terms, strict=True) if term.scale == 0]
    bare = without_values(problem.model).processes
    return structure - Counter(str(bare[k]) for k in zero)


def _key(structure: Counter[str]) -> frozenset[tuple[str, int]]:
    return frozenset(structure.items())


def relaxed_columns(explored: Explored) -> tuple[Matrix, int]:
    """Return wavelet variances (n, J) that the general model can add, and the number of those without shape parameters.

    Those without shape parameters come first. A process with a search is evaluated on a grid over its domain. For other
    processes with shape parameters, such a grid would allow more than their parameters can reach; they have their
    estimate and its derivatives.
    """
    wv = explored.general.wavelet_variance
    problem = pose(without_values(explored.general.model), wv, explored.matrix)
    rows = [problem.shapes, *_ways(explored.general, problem)]
    if problem.curved_class is not None:
        rows.append(
            grid(problem.curved_class, wv.levels, samples=wv.longest, rate=wv.rate, filter=problem.filter).values[
                ::EVERY
            ]
        )
    return np.concatenate(rows), len(problem.shapes)


def _ways(general: Fit, problem: Problem) -> list[Matrix]:
    """Return the estimated shape of each free process, and its derivatives with both signs."""
    rows = []
    for process in general.model.processes:
        moving = to_find(process)
        if not moving or type(process) is problem.curved_class or process.scale == 0:
            continue
        at = process.nonlinear.reshape(1, -1)
        slopes = process.shape_jacobian(at, problem.levels, problem.rate, problem.filter)[0, :, list(moving)]
        rows += [process.shape(at, problem.levels, problem.rate, problem.filter), slopes, -slopes]
    return rows
