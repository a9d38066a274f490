"""Fit one model to recordings at known conditions, such as the rates of a turntable or the plateaus of a chamber.

With the variance Σ_m s_m φ_m(c) of a term at the condition c, known φ_m ≥ 0 and unknown s_m ≥ 0, the curves of all
conditions are a non-negative sum of known vectors, solved and certified as one curve. A shape that follows a link, β(c)
= exp(a + b c), is searched over a bounded grid of a and b, without a certificate."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError, OptionError
from gmwm.base.lazy import scipy
from gmwm.fitting.estimation.branch_and_bound import FittedTerm
from gmwm.fitting.estimation.conditions_fit import ConditionsFit, Estimate
from gmwm.fitting.estimation.linearised import relative_covariance, square_of_rest, usable_in
from gmwm.fitting.estimation.moving_condition import ConditionBins
from gmwm.fitting.estimation.problem import Problem, by_kind, divide_shaped, unit_shape, weigh
from gmwm.fitting.estimation.reweighting import implied_weights
from gmwm.fitting.estimation.solver import Solution, resume, solve
from gmwm.fitting.estimation.varies import Link, Varies, parse_varies
from gmwm.fitting.estimation.weighting import Weights, precision, square_root, weighting_matrix
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

_STEEPEST = 3.0  # largest b of a link over half of the range of the condition: the shape changes by a factor of 400


@dataclass(frozen=True, eq=False)
class Follows:
    """Link of a term, with z = a + b u, and the conditions u (S, J, K) of the parts of each curve, scaled to −1 … 1."""

    link: Link
    a: float
    b: float
    u: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Stack:
    """Measured curves of all conditions, one after another, and a model.

    `factors` are, for processes that vary, means (m, S, J, K) of φ_m over K parts of each level (J = 1 if equal), and
    `follows` links of shapes. `whole` is the curve of a recording with `shares` in bins, for its higher levels."""

    model: Model
    curves: tuple[WaveletVariance, ...]
    factors: Mapping[int, NDArray[np.float64]]
    follows: Mapping[int, Follows] = field(default_factory=dict)
    whole: WaveletVariance | None = None
    shares: Vector = field(default_factory=lambda: np.zeros(0))

    @property
    def samples(self) -> int:
        """Length of the longest part without a gap."""
        return max(wv.longest for wv in (*self.curves, *filter(None, [self.whole])))

    @cached_property
    def coarse(self) -> WaveletVariance | None:
        """The levels of the whole recording above those of the curves; None if there are none."""
        above = () if self.whole is None else self.whole.levels[self.whole.levels > len(self.curves[0])].tolist()
        return self.whole.only(above) if self.whole is not None and above else None

    def each(self, curve_of: Callable[[int, WaveletVariance], Vector]) -> Vector:
        """Return the values of all curves, one after another. Those of the whole recording are means over its bins."""
        parts = [curve_of(s, wv) for s, wv in enumerate(self.curves)]
        if (coarse := self.coarse) is not None:
            parts.append(np.sum([share * curve_of(s, coarse) for s, share in enumerate(self.shares)], axis=0))
        return np.concatenate(parts)

    @property
    def observed(self) -> Vector:
        """Measured wavelet variances of all curves."""
        return np.concatenate([wv.variance for wv in (*self.curves, *filter(None, [self.coarse]))])

    @cached_property
    def levels(self) -> NDArray[np.int64]:
        """Levels of all curves, one curve after another."""
        return np.concatenate([wv.levels for wv in (*self.curves, *filter(None, [self.coarse]))])

    @cached_property
    def rows(self) -> list[tuple[int, int]]:
        """Index of the process and index m of its function φ_m, for each linear coefficient s_m."""
        linear, _, _ = by_kind(self.model)
        return [(place, m) for place in linear for m in range(len(self.factors.get(place, [0])))]

    @cached_property
    def shapes(self) -> Matrix:
        """Wavelet variances (rows, levels of all curves) of each linear coefficient: means over the parts."""

        def shape(place: int, m: int, s: int, wv: WaveletVariance) -> Vector:
            process, filter = self.model.processes[place], find_filter(wv.filter)
            follow, weights = self.follows.get(place), np.ones((1, 1))
            if place in self.factors:
                phi = self.factors[place][m, s]
                weights = phi[_parts_of(wv, len(phi))]
            if follow is None:
                return np.asarray(np.mean(weights, axis=1) * unit_shape(process, wv.levels, wv.rate, filter))
            part = moments[place][s, _parts_of(wv, follow.u.shape[1]), :, wv.levels - 1]
            return np.asarray(np.mean(weights * part, axis=1))

        moments = {place: self._moments(place, follow) for place, follow in self.follows.items()}
        rows = [self.each(partial(shape, place, m)) for place, m in self.rows]
        return np.array(rows).reshape(len(self.rows), self.levels.size)

    def _moments(self, place: int, follow: Follows) -> NDArray[np.float64]:
        """Return the wavelet variances (S, J, K, L) of a process at the conditions of each part, at the levels 1 to
        L."""
        process, first = self.model.processes[place], self.curves[0]
        theta = follow.link.values(process, follow.a + follow.b * follow.u.reshape(-1, 1))
        levels = np.arange(1, int(self.levels.max()) + 1)
        values = process.moments(theta, levels, first.rate, find_filter(first.filter))
        return values.reshape(*follow.u.shape, levels.size)

    def pose(self, matrix: Matrix) -> Problem:
        """Return the estimation problem with the weighting matrix Ω of all levels."""
        first = self.curves[0]
        _, shaped, _ = by_kind(self.model)
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
        observed = self.observed - self.offset
        weights = Weights(matrix)
        unit, target = weigh(observed, weights)
        return Problem(
            model=self.model, levels=self.levels, rate=first.rate, filter=find_filter(first.filter),
            samples=self.samples, observed=observed, weights=weights, unit=unit,
            target=target, linear=tuple(range(len(self.rows))), curved=curved, free=(), shapes=self.shapes,
        )  # fmt: skip

    @property
    def offset(self) -> Vector:
        """Wavelet variances of the processes without a free parameter, at all levels."""
        _, _, held = by_kind(self.model)
        if not held:
            return np.zeros(self.levels.size)
        constant = Model(tuple(self.model.processes[place] for place in held))
        return self.each(lambda _, wv: constant.wavelet_variance(wv.levels, wv.rate, wv.filter))

    def parts(self, solution: Solution) -> list[list[Model]]:
        """Return, for each part of each curve, the model with the values of a solution."""
        arrays = [*self.factors.values(), *(follow.u for follow in self.follows.values())]
        count = max((array.shape[-1] for array in arrays), default=1)
        return [[self._model(solution, s, slice(k, k + 1)) for k in range(count)] for s in range(len(self.curves))]

    def models(self, solution: Solution) -> tuple[Model, ...]:
        """Return, for each condition, the model with the values of a solution."""
        return tuple(self._model(solution, s, slice(None)) for s in range(len(self.curves)))

    def _model(self, solution: Solution, s: int, part: slice) -> Model:
        """Return the model at the mean condition of parts of a curve."""
        _, shaped, _ = by_kind(self.model)
        processes = list(self.model.processes)
        for place, follow in self.follows.items():
            z = follow.a + follow.b * float(np.mean(follow.u[s, 0, part]))
            processes[place] = follow.link.at(processes[place], z)
        scales: dict[int, float] = {}
        for (place, m), scale in zip(self.rows, solution.scales.tolist(), strict=True):
            mean = float(np.mean(self.factors[place][m, s, 0, part])) if place in self.factors else 1.0
            scales[place] = scales.get(place, 0.0) + scale * mean
        for place, term in zip(shaped, solution.terms, strict=True):
            names = [p.name for p in processes[place].nonlinear_parameters()]
            processes[place] = processes[place].with_values(**dict(zip(names, term.values, strict=True)))
            scales[place] = term.scale
        for place, scale in scales.items():
            name = processes[place].scale_parameter().name
            processes[place] = processes[place].with_values(**{name: processes[place].value_from(scale)})
        return Model(tuple(processes))

    def implied(self, solution: Solution) -> Vector:
        """Return the wavelet variances that a solution implies, one condition after another."""
        curve = self.offset + solution.scales @ self.shapes
        _, shaped, _ = by_kind(self.model)
        for place, term in zip(shaped, solution.terms, strict=True):
            curve += term.scale * self.each(partial(_shape, self.model.processes[place], np.array([term.values])))
        return np.asarray(curve)

    def covariance(self, solution: Solution) -> Matrix:
        """Return the covariance V of all measured, independent curves: means over the parts, as squares of their
        variances count. A whole recording has the same covariance with a bin as a recording at the bin's conditions."""
        parts = self.parts(solution)
        result = _blocks(_mean_covariance(models, wv) for models, wv in zip(parts, self.curves, strict=True))
        if self.whole is None or self.coarse is None:
            return result
        above = self.whole.levels > len(self.curves[0])
        joint = np.array([_mean_covariance(models, self.whole) for models in parts])
        covariance = np.concatenate(joint[:, ~above][:, :, above])
        return np.block(
            [[result, covariance], [covariance.T, np.tensordot(self.shares, joint[:, above][:, :, above], 1)]]
        )

    def weights(self, weighting: str, models: tuple[Model, ...]) -> Matrix:
        """Return the weighting matrix Ω of all curves that the models of the conditions imply."""
        blocks = [implied_weights(weighting, m, Design.of(wv), wv.variance)
                  for m, wv in zip(models, self.curves, strict=True)]  # fmt: skip
        if (coarse := self.coarse) is not None:
            each = [implied_weights(weighting, m, Design.of(coarse)) for m in models]
            blocks.append(np.linalg.inv(np.tensordot(self.shares, np.linalg.inv(each), 1)))
        return _blocks(blocks)

    def slopes(self, solution: Solution) -> tuple[list[tuple[int, str | int]], Matrix]:
        """Return names and columns of ∂ν²/∂s of linear coefficients, then relative ones of free shapes (none for terms
        that are zero or act as another process)."""
        _, shaped, _ = by_kind(self.model)
        names: list[tuple[int, str | int]] = list(self.rows)
        columns = list(self.shapes)
        for place, term in zip(shaped, solution.terms, strict=True):
            process = self.model.processes[place]
            theta = np.array([term.values])
            if term.scale > 0 and term.acts_as is None:
                for k, parameter in enumerate(process.nonlinear_parameters()):
                    names.append((place, parameter.name))
                    columns.append(term.scale * term.values[k] * self.each(partial(_shape_slope, process, theta, k)))
            if term.scale > 0:
                names.append((place, process.scale_parameter().name))
                columns.append(self.each(partial(_shape, process, theta)))
        for place, follow in self.follows.items():
            scale = float(solution.scales[self.rows.index((place, 0))])
            for which in ("a", "b"):
                # Central differences, of relative accuracy 1e-6.
                ends = [replace(self, follows={**self.follows, place: replace(follow, **{which: value})}).shapes
                        for value in (getattr(follow, which) + 1e-3, getattr(follow, which) - 1e-3)]  # fmt: skip
                names.append((place, which))
                columns.append(scale * (ends[0] - ends[1])[self.rows.index((place, 0))] / 2e-3)
        return names, np.column_stack(columns)


@dataclass(frozen=True, eq=False)
class SolvedStack:
    """Solution of a stack with its final weights, and its covariance V."""

    stack: Stack
    problem: Problem
    solution: Solution

    @cached_property
    def covariance(self) -> Matrix:
        """Covariance V of all measured curves under the solution."""
        return self.stack.covariance(self.solution)


def _shape(process: Process, theta: Matrix, _: int, wv: WaveletVariance) -> Vector:
    """Return the wavelet variance of a process with the shape `theta` (1, q) and scale 1 at a curve's levels."""
    return np.asarray(process.shape(theta, wv.levels, wv.rate, find_filter(wv.filter))[0])


def _shape_slope(process: Process, theta: Matrix, k: int, _: int, wv: WaveletVariance) -> Vector:
    """Return the derivative of `_shape` with respect to the shape parameter k."""
    return np.asarray(process.shape_jacobian(theta, wv.levels, wv.rate, find_filter(wv.filter))[0, :, k])


def _condition(u: Matrix, s: int, wv: WaveletVariance) -> Vector:
    """Return the mean condition `u` (S, J) of curve s at each of its levels."""
    return np.asarray(u[s, _parts_of(wv, u.shape[1])])


def _parts_of(wv: WaveletVariance, count: int) -> NDArray[np.int64]:
    """Return the index of the parts of each level of a curve: those of level 1 above the last of `count` levels."""
    return np.where(wv.levels <= count, wv.levels - 1, 0)


def _mean_covariance(models: list[Model], wv: WaveletVariance) -> Matrix:
    """Return the mean of the covariances of a curve under the models of its parts."""
    return np.asarray(np.mean([covariance(model, Design.of(wv)) for model in models], axis=0))


def _blocks(parts: Iterable[Matrix]) -> Matrix:
    """Return the block-diagonal matrix of the given blocks."""
    return np.asarray(scipy.linalg.block_diag(*parts))


def fit_conditions(
    model: Model, curves: Mapping[float, WaveletVariance], varies: Mapping[str, str], *, weighting: str = "diagonal",
    certify: bool = True, bins: ConditionBins | None = None,
) -> ConditionsFit:  # fmt: skip
    """Fit a model to recordings at known conditions, or to the `bins` of one recording; see `gmwm.fit`."""
    functions, links, name = parse_varies(varies)
    _check(model, curves, functions, links)
    parts = np.array(list(curves)).reshape(-1, 1, 1, 1) if bins is None else bins.parts
    _, middle, half = _scaled(np.mean(parts, axis=-1))
    stack = _stack(model, tuple(curves.values()), functions, links, bins=bins, parts=parts)
    solved = _settle(stack, weighting, certify=certify)
    statistic, df, pvalue = _goodness(solved, weighting)
    change = _no_change(solved.stack, model, weighting) if functions or links else None
    estimates = _estimates(solved, functions, np.array([[1.0, -middle / half], [0.0, 1 / half]]))
    return ConditionsFit(
        condition=name, structure=str(model), varies=dict(varies), curves=dict(curves),
        models=dict(zip(curves, solved.stack.models(solved.solution), strict=True)), estimates=estimates,
        objective=solved.solution.objective, lower_bound=solved.solution.lower_bound, weighting=weighting,
        statistic=statistic, df=df, pvalue=pvalue, pvalue_constant=change,
        whole=solved.stack.coarse, shares=tuple(stack.shares.tolist()),
        range=(min(curves), max(curves)) if bins is None else bins.range,
    )  # fmt: skip


def constancy_pvalue(model: Model, bins: ConditionBins, varies: Mapping[str, str]) -> float:
    """Return the p-value of the hypothesis that no term varies with a condition that moves, without the fit."""
    functions, links, _ = parse_varies(varies)
    return _no_change(_stack(model, bins.curves, functions, links, bins=bins, parts=bins.parts), model, "diagonal")


def _stack(
    model: Model, curves: tuple[WaveletVariance, ...], functions: Mapping[str, Varies], links: Mapping[str, Link], *,
    bins: ConditionBins | None, parts: NDArray[np.float64],
) -> Stack:  # fmt: skip
    factors = {model.terms.index(term): each.means(parts, term) for term, each in functions.items()}
    u, _, _ = _scaled(np.mean(parts, axis=-1))
    follows = {model.terms.index(term): Follows(link, 0.0, 0.0, u) for term, link in links.items()}
    # The parameters that follow the condition are held, so that only scales are free.
    held = [follows[k].link.at(p, 0.0) if k in follows else p for k, p in enumerate(model.processes)]
    stack = Stack(Model(tuple(held)), curves, factors, follows)
    return stack if bins is None else replace(stack, whole=bins.whole, shares=bins.shares)


def _scaled(conditions: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, float]:
    """Return the conditions scaled to −1 … 1, the middle of their range, and half of it."""
    low, high = float(np.min(conditions)), float(np.max(conditions))
    middle, half = (low + high) / 2, (high - low) / 2
    return (conditions - middle) / half, middle, half


def _check(
    model: Model, curves: Mapping[float, WaveletVariance], functions: Mapping[str, Varies], links: Mapping[str, Link]
) -> None:  # fmt: skip
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
    linear, shaped, _ = by_kind(model)
    for term in (*functions, *links):
        if term not in model.terms:
            raise OptionError(argument="varies", expected=f"terms of the model ({', '.join(model.terms)})", got=term)
    for term, link in links.items():
        names = [p.name for p in model.by_term[term].nonlinear_parameters()]
        if names != [link.name] or shaped != (model.terms.index(term),):
            raise OptionError(
                f"varies: {term}.{link.name} must be the only free shape of the model", argument="varies", got=term,
                advice="Hold the shapes of the other terms with `fixed(…)`.",
            )  # fmt: skip
    for term in functions:
        process = model.by_term[term]
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
    blocks = (weighting_matrix("diagonal", wv) for wv in (*stack.curves, *filter(None, [stack.coarse])))
    matrix = _blocks(blocks)
    for _ in range(4 if stack.follows else 0):  # the weights hardly depend on the link after the first search
        stack = _search(stack, matrix)
        solution = solve(stack.pose(matrix), certify=False)
        matrix = stack.weights(weighting, stack.models(solution))
    problem = stack.pose(matrix)
    solution = solve(problem, certify=False, quick=True)
    models = stack.models(solution)
    before = stack.implied(solution)
    for _ in range(100):
        problem = problem.under(stack.weights(weighting, models))
        solution = resume(problem, solution)
        models = stack.models(solution)
        after = stack.implied(solution)
        # Relative change of the fitted curves below which the iteration of estimate and weights ends.
        if np.max(np.abs(after - before) / np.maximum(after, before)) < 1e-9:
            break
        before = after
    solution = solve(problem, certify=certify and not stack.follows, near=solution)
    return SolvedStack(stack, problem, solution)


def _search(stack: Stack, matrix: Matrix) -> Stack:
    """Return the stack with the best link under fixed weights: refined from a bounded grid or the previous link."""
    ((place, follow),) = stack.follows.items()
    low, high = follow.link.limits(stack.model.processes[place], stack.samples, stack.curves[0].rate)

    def at(x: Vector) -> Stack:
        a, b = float(np.clip(x[0], low, high)), float(np.clip(x[1], -_STEEPEST, _STEEPEST))
        return replace(stack, follows={place: replace(follow, a=a, b=b)})

    def objective(x: Vector) -> float:
        return solve(at(x).pose(matrix), certify=False).objective

    starts = [np.array([follow.a, follow.b])]
    if follow.a == follow.b == 0.0:
        grid = [np.array([a, b]) for a in np.linspace(low, high, 15) for b in np.linspace(-2.0, 2.0, 7)]
        starts = sorted(grid, key=objective)[:3]
    simplex = 0.3 * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    ends = [
        scipy.optimize.fmin(objective, start, xtol=1e-5, ftol=1e-8, disp=False, initial_simplex=start + simplex)
        for start in starts
    ]
    return at(min(ends, key=objective))


def _estimates(solved: SolvedStack, functions: Mapping[str, Varies], turn: Matrix) -> dict[str, Estimate]:
    """Return estimates with sandwich standard errors; `turn` (2, 2) turns link coefficients to unscaled conditions."""
    stack, solution = solved.stack, solved.solution
    names, columns = stack.slopes(solution)
    spread = relative_covariance(columns, solved.problem.matrix, solved.covariance)
    errors = np.sqrt(np.diag(spread))
    _, shaped, _ = by_kind(stack.model)
    terms: dict[int, FittedTerm] = dict(zip(shaped, solution.terms, strict=True))
    estimates = {}
    for k, (place, which) in enumerate(names):
        if which in ("a", "b"):
            continue  # both together below
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
    for place, follow in stack.follows.items():
        pair = [k for k, (_, which) in enumerate(names) if which in ("a", "b")]
        block, label = spread[np.ix_(pair, pair)], f"{stack.model.terms[place]}.{follow.link.name}"
        # The covariance is infinite if the term is zero.
        errors = np.sqrt(np.diag(turn @ block @ turn.T)) if np.all(np.isfinite(block)) else np.full(2, math.inf)
        for name, number, error in zip("ab", turn @ [follow.a, follow.b], errors, strict=True):
            estimates[f"{label} ({name})"] = Estimate(float(number), float(error), signed=True)
    return estimates


def _short(stack: Stack) -> Stack:
    """Return the stack with only the levels that have enough degrees of freedom for a test."""
    counts = [int(np.count_nonzero(usable_in(Design.of(wv)))) for wv in stack.curves]
    if stack.whole is None:
        return replace(stack, curves=tuple(wv.first(n) for wv, n in zip(stack.curves, counts, strict=True)))
    coarse = stack.whole.first(int(np.count_nonzero(usable_in(Design.of(stack.whole)))))
    return replace(stack, curves=tuple(wv.first(min(counts)) for wv in stack.curves), whole=coarse)


def _goodness(solved: SolvedStack, weighting: str) -> tuple[float, int, float]:
    """Return the statistic, the degrees of freedom and the p-value of the chi-square test of the model."""
    short = _settle(_short(solved.stack), weighting, certify=False)
    statistic, count = _misfit(short)
    df = short.stack.levels.size - count
    return statistic, df, float(scipy.special.gammaincc(df / 2, statistic / 2)) if df > 0 else 1.0


def _no_change(stack: Stack, model: Model, weighting: str) -> float:
    """Return the p-value that no term varies, from the residuals of a constant model that functions explain."""
    short = _short(stack)
    constant = _settle(replace(short, model=model, factors={}, follows={}), weighting, certify=False)
    names, slopes = constant.stack.slopes(constant.solution)
    columns = list(short.shapes.T.T) if short.factors else []
    for place, follow in short.follows.items():
        if (place, follow.link.name) in names:
            slope = slopes[:, names.index((place, follow.link.name))]
            columns.append(np.asarray(slope * short.each(partial(_condition, np.mean(follow.u, axis=2)))))
    if not columns:
        return 1.0  # the term whose shape could change is zero
    total, rank = _misfit(constant)
    remainder, full_rank = _misfit(constant, np.array(columns).T)
    return float(scipy.special.gammaincc((full_rank - rank) / 2, (total - remainder) / 2)) if full_rank > rank else 1.0


def _misfit(solved: SolvedStack, further: Matrix | None = None) -> tuple[float, int]:
    """Return the weighted square of residuals beyond derivatives and `further` columns, and their rank."""
    stack = solved.stack
    root = square_root(precision(solved.covariance))
    _, columns = stack.slopes(solved.solution)
    columns = columns if further is None else np.column_stack([columns, further])
    return square_of_rest(root @ (stack.observed - stack.implied(solved.solution)), root @ columns)
