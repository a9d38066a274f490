"""Fit all candidate models to a recording with the weighting matrix Ω of the general model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from gmwm.base.arrays import FrozenArrays, Matrix, Vector
from gmwm.choosing.selection.structure import containing, freedom, names_of, structure_of, without_values
from gmwm.fitting.estimation.atoms import grid
from gmwm.fitting.estimation.problem import Problem, pose, to_find
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import WeightedSolution, nearly_settled
from gmwm.fitting.estimation.solver import Solution, solve
from gmwm.fitting.estimation.weighting import Weights, precision
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.pooling import without
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.model import Model

GRID_STRIDE = 8
"""Stride of the grid of correlation times, so that neighbours differ by 20 % (used in docs/validation/selection.md)."""

Progress = Callable[[int, int], None]
"""Progress callback, which is called with the number of fitted candidates and the number of all candidates."""


@dataclass(frozen=True, eq=False)
class Explored(FrozenArrays):
    """Fits of all candidates with Ω (`weights`) and V (`wavelet`) of `general`, the largest model with at most as many
    parameters as levels. With zero terms, a candidate may share a smaller one's fit."""

    general: Fit
    weights: Weights
    wavelet: Matrix
    fits: tuple[Fit, ...]

    @cached_property
    def columns(self) -> Matrix:
        """Result of `relaxed_columns`, which all tests of equivalence use."""
        return relaxed_columns(self)


def explore(
    general: Model, candidates: Sequence[Model], wv: WaveletVariance, weighting: str, *,
    progress: Progress | None = None,
) -> Explored:  # fmt: skip
    """Fit every candidate with Ω of the general model. An optimum with terms that are zero is the optimum of the
    smaller models too, and `mend` ensures that no objective is larger than the one of a contained model."""
    largest = general if freedom(general) <= len(wv) else max(candidates, key=freedom)
    settled, wavelet = nearly_settled(largest, wv, weighting)
    weights = Weights(settled.problem.matrix)
    search = _Exploration(wv, weights, weighting)
    search.take(largest, settled.problem, settled.solution)
    order = sorted(range(len(candidates)), key=lambda k: -len(candidates[k].processes))
    for done, k in enumerate(order):
        search.add(candidates[k])
        if progress is not None:
            progress(done + 1, len(candidates))
    search.mend()
    fits = tuple(search.fit(model) for model in candidates)
    return Explored(Fit.of(settled, wv, weighting), weights, wavelet, fits)


def losses_left_out(explored: Explored, candidates: Sequence[Model], weighting: str) -> Vector | None:
    """Return the mean loss (ν̂²_r − ν²)ᵀ Ω_r (ν̂²_r − ν²) of each candidate, fitted without recording r, over the
    recordings r; None for a single one. Ω_r is the weighting matrix for a recording of this length."""
    wv = explored.general.wavelet_variance
    if len(wv.recordings) < 2:
        return None
    losses = []
    for name, recording in wv.recordings.items():
        fits = _explored_again(explored, candidates, without(wv, name), weighting)
        design = replace(Design.of(recording), model_error=wv.model_error)
        design = design.only(recording.levels <= len(fits[0].wavelet_variance))
        scatter = covariance(explored.general.model, design)
        matrix, reach = _inverse(scatter, weighting), design.levels.size
        miss = [recording.variance[:reach] - fit.implied[:reach] for fit in fits]
        losses.append([float(m @ matrix @ m) for m in miss])
    return np.asarray(np.mean(losses, axis=0))


def _explored_again(explored: Explored, candidates: Sequence[Model], wv: WaveletVariance, weighting: str) -> list[Fit]:
    """Fit the candidates to other data with the weighting matrix of `explored`."""
    weights = explored.weights
    if len(wv) < len(explored.wavelet):
        weights = Weights(_inverse(explored.wavelet[: len(wv), : len(wv)], weighting))
    search = _Exploration(wv, weights, weighting)
    fitting = [model for model in candidates if freedom(model) <= len(wv)]
    for model in sorted(fitting, key=lambda model: -len(model.processes)):
        search.add(model)
    search.mend()
    # If a model has more parameters than the other recordings have levels, the largest possible fit is used.
    return [search.fit(model if freedom(model) <= len(wv) else max(fitting, key=freedom)) for model in candidates]


def _inverse(scatter: Matrix, weighting: str) -> Matrix:
    return precision(scatter) if weighting == "optimal" else np.diag(1 / np.diag(scatter))


@dataclass(frozen=True, eq=False)
class _CandidateSolution:
    model: Model
    structure: Counter[str]
    shown: Counter[str]
    problem: Problem
    solution: Solution

    @cached_property
    def keys(self) -> tuple[frozenset[tuple[str, int]], frozenset[tuple[str, int]]]:
        """Keys of the terms that are not zero, and of the structure."""
        return _key(self.shown), _key(self.structure)


class _Exploration:
    """Solutions for one weighting matrix Ω, by structure of the model."""

    def __init__(self, wv: WaveletVariance, weights: Weights, weighting: str) -> None:
        self.wv, self.weights, self.weighting = wv, weights, weighting
        self.solved: dict[frozenset[tuple[str, int]], _CandidateSolution] = {}
        self.fits: dict[int, Fit] = {}

    def take(self, model: Model, problem: Problem, solution: Solution) -> _CandidateSolution:
        """Store the solution of a model. If terms are zero, also store it for the smaller model without them."""
        structure = structure_of(model)
        shown = _shown_structure(model, problem, solution)
        solved = _CandidateSolution(model, structure, shown=shown, problem=problem, solution=solution)
        self.solved[_key(structure)] = solved
        if shown != structure and shown and _key(shown) not in self.solved:
            self.solved[_key(shown)] = self._part(solved)
        return solved

    def add(self, model: Model) -> None:
        """Fit a candidate, unless its solution is already known."""
        structure = structure_of(model)
        key = _key(structure)
        if key in self.solved:
            return
        for solved in self.solved.values():
            shown, largest = solved.keys
            if shown and shown <= key <= largest:
                self.solved[key] = replace(self.solved[shown], structure=structure)
                return
        problem = pose(without_values(model), self.wv, self.weights)
        self.take(model, problem, solve(problem, certify=False))

    def mend(self) -> None:
        """Replace each solution whose objective is larger than the objective of a model that it contains."""
        lowest = sorted(self.solved.items(), key=lambda item: item[1].solution.objective)
        # The first structure that a structure contains has the smallest objective of all that it contains.
        first = np.argmax(containing([solved.structure for _, solved in lowest]), axis=1)
        for (key, solved), place in zip(lowest, first.tolist(), strict=True):
            square, other = solved.problem.unit**2, lowest[place][1]
            # Objectives that count as equal (tests/selection/test_nested_objectives.py).
            if not solved.problem.as_low(solved.solution.objective / square, other.solution.objective / square, 1e-9):
                self.solved[key] = replace(other, structure=solved.structure)

    def fit(self, model: Model) -> Fit:
        """Return the fit of a candidate. Models with the same optimum share one fit."""
        solved = self.solved[_key(structure_of(model))]
        if id(solved.solution) not in self.fits:
            self.fits[id(solved.solution)] = Fit.of(
                WeightedSolution(solved.problem, solved.solution), self.wv, self.weighting
            )
        return self.fits[id(solved.solution)]

    def _part(self, solved: _CandidateSolution) -> _CandidateSolution:
        """Return a solution in the form of the smaller model without the terms that are zero."""
        old = solved.problem
        linear = [k for k, scale in zip(old.linear, solved.solution.scales, strict=True) if scale > 0]
        moving = [k for k, term in zip(old.shaped, solved.solution.terms, strict=True) if term.scale > 0]
        free = {*old.linear, *old.shaped}
        places = sorted([*linear, *moving, *(k for k in range(len(old.model.processes)) if k not in free)])
        model = Model(tuple(old.model.processes[k] for k in places))
        problem = pose(without_values(model), self.wv, self.weights)
        scales = np.array([s for s in solved.solution.scales if s > 0], dtype=np.float64)
        terms = tuple(t for t in solved.solution.terms if t.scale > 0)
        solution = replace(solved.solution, scales=scales, terms=terms)
        return _CandidateSolution(model, solved.shown, shown=solved.shown, problem=problem, solution=solution)


def _shown_structure(model: Model, problem: Problem, solution: Solution) -> Counter[str]:
    """Return the structure of a solved model without the terms that are zero; empty if all that are estimated are."""
    structure = structure_of(model)
    zero = [k for k, scale in zip(problem.linear, solution.scales, strict=True) if scale == 0]
    zero += [k for k, term in zip(problem.shaped, solution.terms, strict=True) if term.scale == 0]
    everything = len(zero) == len(problem.linear) + len(problem.shaped)
    return Counter() if everything else structure - names_of(problem.model.processes[k] for k in zero)


def _key(structure: Counter[str]) -> frozenset[tuple[str, int]]:
    """Return the names of the terms with their numbers, so that the key of a smaller model is a subset."""
    return _key_of(tuple(structure.items()))


@lru_cache(maxsize=1024)
def _key_of(counts: tuple[tuple[str, int], ...]) -> frozenset[tuple[str, int]]:
    return frozenset((name, number) for name, count in counts for number in range(count))


def relaxed_columns(explored: Explored) -> Matrix:
    """Return curves (n, J) that the general model can add: those without shape, GM on a grid, and others' estimated
    shape and its derivatives, because mixtures of grid points describe more curves than one process."""
    wv = explored.general.wavelet_variance
    problem = pose(without_values(explored.general.model), wv, explored.weights)
    rows = [problem.shapes, *_ways(explored.general, problem)]
    if problem.curved_class is not None:
        rows.append(
            grid(problem.curved_class, wv.levels, samples=wv.longest, rate=wv.rate, filter=problem.filter).values[
                ::GRID_STRIDE
            ]
        )
    return np.concatenate(rows)


def _ways(general: Fit, problem: Problem) -> list[Matrix]:
    """Return the shape of each other process with free shape parameters, and its derivatives with both signs."""
    rows = []
    for process in general.model.processes:
        moving = to_find(process)
        if not moving or type(process) is problem.curved_class or process.scale == 0:
            continue
        at = process.nonlinear.reshape(1, -1)
        slopes = process.moments_jacobian(at, problem.levels, problem.rate, problem.filter)[0, :, list(moving)]
        rows += [process.moments(at, problem.levels, problem.rate, problem.filter), slopes, -slopes]
    return rows
