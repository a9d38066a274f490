"""Fit one model to recordings at known conditions, such as the rates of a turntable or the plateaus of a chamber.

The variance of a term at the condition c is Σ_m s_m φ_m(c), with known functions φ_m ≥ 0 and unknown coefficients
s_m ≥ 0. The curves of all conditions, one after another, are therefore a non-negative sum of known vectors. The problem
is solved like the problem for one curve, with the same certificate.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError, OptionError
from gmwm.fitting.estimation.branch_and_bound import FittedTerm
from gmwm.fitting.estimation.conditions_fit import ConditionsFit, Estimate
from gmwm.fitting.estimation.linearised import relative_covariance, square_of_rest, usable_in
from gmwm.fitting.estimation.problem import Problem, by_kind, divide_shaped, unit_shape, weigh
from gmwm.fitting.estimation.reweighting import implied_weights
from gmwm.fitting.estimation.solver import Solution, resume, solve
from gmwm.fitting.estimation.varies import Varies, parse_varies
from gmwm.fitting.estimation.weighting import Weights, precision, square_root, weighting_matrix
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.model import Model


@dataclass(frozen=True, eq=False)
class Stack:
    """Measured curves of all conditions, one after another, and a model. `factors` has, for the index of each process
    that varies, the values φ_m(c_s) of its functions at the conditions."""

    model: Model
    curves: tuple[WaveletVariance, ...]
    factors: Mapping[int, Matrix]

    @cached_property
    def levels(self) -> NDArray[np.int64]:
        """Levels of all curves, one curve after another."""
        return np.concatenate([wv.levels for wv in self.curves])

    @cached_property
    def rows(self) -> list[tuple[int, int]]:
        """Index of the process and index m of its function φ_m, for each linear coefficient s_m."""
        linear, _, _ = by_kind(self.model)
        return [(place, m) for place in linear for m in range(len(self.factors.get(place, [0])))]

    @cached_property
    def shapes(self) -> Matrix:
        """Wavelet variances (rows, levels of all curves) that each linear coefficient multiplies."""
        curves = []
        for place, m in self.rows:
            process, phi = self.model.processes[place], self.factors.get(place)
            parts = [
                (1.0 if phi is None else phi[m, s]) * unit_shape(process, wv.levels, wv.rate, find_filter(wv.filter))
                for s, wv in enumerate(self.curves)
            ]
            curves.append(np.concatenate(parts))
        return np.array(curves).reshape(len(curves), self.levels.size)

    def pose(self, matrix: Matrix) -> Problem:
        """Return the estimation problem with the weighting matrix Ω of all levels."""
        first = self.curves[0]
        _, shaped, held = by_kind(self.model)
        curved, free = divide_shaped(self.model, shaped)
        if free:
            raise ModelError(
                f"{self.model.processes[free[0]]} has several shape parameters, or another class than "
                "the search covers",
                advice="Hold its shape with `fixed(…)`, or leave it out.",
            )
        count = len(self.rows) + 2 * len(curved)
        if not 0 < count <= self.levels.size:
            raise ModelError(
                f"{self.model} has {count} free parameters at {self.levels.size} levels of all conditions",
                advice="Free a parameter." if count == 0 else "Record longer, or use a smaller model.",
            )
        offset = np.zeros(self.levels.size)
        for place in held:
            process = self.model.processes[place]
            offset += np.concatenate([process.wavelet_variance(wv.levels, wv.rate, wv.filter) for wv in self.curves])
        observed = np.concatenate([wv.variance for wv in self.curves]) - offset
        weights = Weights(matrix)
        unit, target = weigh(observed, weights)
        return Problem(
            model=self.model, levels=self.levels, rate=first.rate, filter=find_filter(first.filter),
            samples=max(wv.longest for wv in self.curves), observed=observed, weights=weights, unit=unit,
            target=target, linear=tuple(range(len(self.rows))), curved=curved, free=(), shapes=self.shapes,
        )  # fmt: skip

    def models(self, solution: Solution) -> tuple[Model, ...]:
        """Return, for each condition, the model with the values of a solution."""
        _, shaped, _ = by_kind(self.model)
        models = []
        for s in range(len(self.curves)):
            processes = list(self.model.processes)
            scales: dict[int, float] = {}
            for (place, m), scale in zip(self.rows, solution.scales.tolist(), strict=True):
                phi = self.factors.get(place)
                scales[place] = scales.get(place, 0.0) + scale * (1.0 if phi is None else float(phi[m, s]))
            for place, term in zip(shaped, solution.terms, strict=True):
                names = [p.name for p in processes[place].nonlinear_parameters()]
                processes[place] = processes[place].with_values(**dict(zip(names, term.values, strict=True)))
                scales[place] = term.scale
            for place, scale in scales.items():
                name = processes[place].scale_parameter().name
                processes[place] = processes[place].with_values(**{name: processes[place].value_from(scale)})
            models.append(Model(tuple(processes)))
        return tuple(models)

    def implied(self, models: tuple[Model, ...]) -> Vector:
        """Return the wavelet variances that the models of the conditions imply, one after another."""
        return np.concatenate(
            [m.wavelet_variance(wv.levels, wv.rate, wv.filter) for m, wv in zip(models, self.curves, strict=True)]
        )

    def covariance(self, models: tuple[Model, ...]) -> Matrix:
        """Return the covariance V of all measured curves, which are independent of each other."""
        return _blocks(covariance(m, Design.of(wv)) for m, wv in zip(models, self.curves, strict=True))

    def weights(self, weighting: str, models: tuple[Model, ...]) -> Matrix:
        """Return the weighting matrix Ω of all curves that the models of the conditions imply."""
        return _blocks(
            implied_weights(weighting, m, Design.of(wv), wv.variance) for m, wv in zip(models, self.curves, strict=True)
        )

    def slopes(self, solution: Solution) -> tuple[list[tuple[int, str | int]], Matrix]:
        """Return the names and the columns of the derivatives of the curves: ∂ν²/∂s for the linear coefficients s, then
        relative ones of terms with free shapes. The shape of a term that acts as another process or is zero has
        none."""
        _, shaped, _ = by_kind(self.model)
        names: list[tuple[int, str | int]] = list(self.rows)
        columns = list(self.shapes)
        for place, term in zip(shaped, solution.terms, strict=True):
            process = self.model.processes[place]
            theta = np.array([term.values])
            if term.scale > 0 and term.acts_as is None:
                for k, parameter in enumerate(process.nonlinear_parameters()):
                    curves = [
                        term.scale * term.values[k]
                        * process.shape_jacobian(theta, wv.levels, wv.rate, find_filter(wv.filter))[0, :, k]
                        for wv in self.curves
                    ]  # fmt: skip
                    names.append((place, parameter.name))
                    columns.append(np.concatenate(curves))
            if term.scale > 0:
                curves = [process.shape(theta, wv.levels, wv.rate, find_filter(wv.filter))[0] for wv in self.curves]
                names.append((place, process.scale_parameter().name))
                columns.append(np.concatenate(curves))
        return names, np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class SolvedStack:
    """Solution of a stack with its final weights, and the fitted model of each condition."""

    stack: Stack
    problem: Problem
    solution: Solution
    models: tuple[Model, ...]


def _blocks(parts: Iterable[Matrix]) -> Matrix:
    """Return the block-diagonal matrix of the given blocks."""
    from scipy.linalg import block_diag

    return np.asarray(block_diag(*parts))


def fit_conditions(
    model: Model, curves: Mapping[float, WaveletVariance], varies: Mapping[str, str], *, weighting: str = "diagonal",
    certify: bool = True,
) -> ConditionsFit:  # fmt: skip
    """Fit a model to the wavelet variances of recordings at known conditions; see `gmwm.fit`."""
    functions, name = parse_varies(varies)
    _check(model, curves, functions)
    conditions = np.array(list(curves), dtype=np.float64)
    places = {model.terms.index(term): term for term in functions}
    factors = {place: functions[term].at(conditions, term) for place, term in places.items()}
    solved = _settle(Stack(model, tuple(curves.values()), factors), weighting, certify=certify)
    statistic, df, pvalue = _goodness(solved, weighting)
    change = _no_change(solved, weighting) if factors else None
    return ConditionsFit(
        condition=name, structure=str(model), varies=dict(varies), curves=dict(curves),
        models=dict(zip(curves, solved.models, strict=True)),
        estimates=_estimates(solved, functions), objective=solved.solution.objective,
        lower_bound=solved.solution.lower_bound, weighting=weighting, statistic=statistic, df=df, pvalue=pvalue,
        pvalue_constant=change,
    )  # fmt: skip


def _check(model: Model, curves: Mapping[float, WaveletVariance], functions: Mapping[str, Varies]) -> None:
    if len(curves) < 2:
        raise OptionError(argument="data", expected="recordings at two or more conditions", got=len(curves))
    first = next(iter(curves.values()))
    for condition, wv in curves.items():
        if (wv.rate, wv.filter, wv.unit) != (first.rate, first.filter, first.unit):
            raise OptionError(
                f"the recording at {condition:g} has {wv.rate:g} Hz, filter {wv.filter} and unit {wv.unit or 'none'}, "
                f"but the first one has {first.rate:g} Hz, {first.filter} and {first.unit or 'none'}",
                argument="data",
            )
    linear, _, _ = by_kind(model)
    for term in functions:
        if term not in model.terms:
            raise OptionError(argument="varies", expected=f"terms of the model ({', '.join(model.terms)})", got=term)
        process = model.processes[model.terms.index(term)]
        if model.terms.index(term) not in linear or process.scale_parameter().scale_power != 1:
            raise OptionError(
                f"varies: only the variance of a term with a known shape can vary; {term} has a free or "
                "no variance parameter",
                argument="varies",
                got=term,
                advice="Hold its shape with `fixed(…)`.",
            )


def _settle(stack: Stack, weighting: str, *, certify: bool) -> SolvedStack:
    """Iterate estimate and weights until they agree, and then solve the problem with the final weights."""
    problem = stack.pose(_blocks(weighting_matrix("diagonal", wv) for wv in stack.curves))
    solution = solve(problem, certify=False, quick=True)
    models = stack.models(solution)
    before = stack.implied(models)
    for _ in range(100):
        problem = problem.under(stack.weights(weighting, models))
        solution = resume(problem, solution)
        models = stack.models(solution)
        after = stack.implied(models)
        # Relative change of the fitted curves below which the iteration of estimate and weights ends.
        if np.max(np.abs(after - before) / np.maximum(after, before)) < 1e-9:
            break
        before = after
    solution = solve(problem, certify=certify, near=solution)
    return SolvedStack(stack, problem, solution, stack.models(solution))


def _estimates(solved: SolvedStack, functions: Mapping[str, Varies]) -> dict[str, Estimate]:
    """Return the estimated parameters and coefficients by name, with standard errors from the sandwich formula."""
    stack, solution = solved.stack, solved.solution
    names, columns = stack.slopes(solution)
    spread = relative_covariance(columns, solved.problem.matrix, stack.covariance(solved.models))
    errors = np.sqrt(np.diag(spread))
    _, shaped, _ = by_kind(stack.model)
    terms: dict[int, FittedTerm] = dict(zip(shaped, solution.terms, strict=True))
    estimates = {}
    for k, (place, which) in enumerate(names):
        label, process = stack.model.terms[place], stack.model.processes[place]
        scale = process.scale_parameter()
        power = scale.scale_power or 1.0
        if isinstance(which, int):
            amount = float(solution.scales[k])
            varied = functions.get(label)
            name = f"{label}.{scale.name}" + ("" if varied is None else f" ({varied.functions[which].text})")
        elif which == scale.name:
            amount, name = terms[place].scale, f"{label}.{scale.name}"
        else:
            value = terms[place].values[[p.name for p in process.nonlinear_parameters()].index(which)]
            estimates[f"{label}.{which}"] = Estimate(value, float(errors[k]) * abs(value), shape=True)
            continue
        if (shaped_term := terms.get(place)) is not None and shaped_term.acts_as is not None:
            estimates[name] = Estimate(process.value_from(amount), math.inf, acts_as=shaped_term.acts_as)
            continue
        value = process.value_from(amount)
        error = float(errors[k]) if power == 1 else float(errors[k]) * value / (power * amount) if amount else math.inf
        estimates[name] = Estimate(value, error)
    for place, term in terms.items():
        if term.scale == 0:
            process = stack.model.processes[place]
            estimates[f"{stack.model.terms[place]}.{process.scale_parameter().name}"] = Estimate(0.0, math.inf)
    return estimates


def _short(stack: Stack) -> Stack:
    """Return the stack with only the levels that have enough degrees of freedom for a test."""
    curves = [wv.first(int(np.count_nonzero(usable_in(Design.of(wv))))) for wv in stack.curves]
    return replace(stack, curves=tuple(curves))


def _goodness(solved: SolvedStack, weighting: str) -> tuple[float, int, float]:
    """Return the statistic, the degrees of freedom and the p-value of the chi-square test of the model."""
    from scipy.special import gammaincc

    short = _settle(_short(solved.stack), weighting, certify=False)
    statistic, count = _misfit(short)
    df = short.stack.levels.size - count
    return statistic, df, float(gammaincc(df / 2, statistic / 2)) if df > 0 else 1.0


def _no_change(solved: SolvedStack, weighting: str) -> float:
    """Return the p-value of the hypothesis that no term varies, from the residuals of a constant model that functions
    explain."""
    from scipy.special import gammaincc

    short = _short(solved.stack)
    constant = _settle(replace(short, factors={}), weighting, certify=False)
    total, rank = _misfit(constant)
    remainder, full_rank = _misfit(constant, short.shapes.T)
    return float(gammaincc((full_rank - rank) / 2, (total - remainder) / 2))


def _misfit(solved: SolvedStack, further: Matrix | None = None) -> tuple[float, int]:
    """Return the weighted sum of squares of the residuals that the derivatives and the columns `further` do not
    explain, and the rank of these columns."""
    stack = solved.stack
    root = square_root(precision(stack.covariance(solved.models)))
    _, columns = stack.slopes(solved.solution)
    columns = columns if further is None else np.column_stack([columns, further])
    observed = np.concatenate([wv.variance for wv in stack.curves])
    return square_of_rest(root @ (observed - stack.implied(solved.models)), root @ columns)
