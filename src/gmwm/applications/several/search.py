"""The joint estimation problem: the terms of its model, and the search for their shape parameters."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, islice, product
from typing import Any, Literal, get_args

import numpy as np

from gmwm.applications.several.conic import Cone, Conic, least_squares
from gmwm.applications.several.matrices import entries
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError
from gmwm.base.lazy import scipy
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, ModelLike
from gmwm.theory.processes.parameter import Branch
from gmwm.theory.processes.validation import function_of

Kind = Literal["own", "common", "shared"]
"""Covariance Σ of a term: diagonal ("own", independent), ℓℓᵀ ("common"), any positive semidefinite ("shared")."""
_SHARED = re.compile(r"\s*(?:(\d+)\s*\*\s*)?(own|common|shared)\s*\((.*)\)\s*(?:\*\s*(\d+)\s*)?", re.DOTALL)


@dataclass(frozen=True, kw_only=True)
class JointTerm:
    """One term of a joint model of several signals."""

    label: str  # name of the term in results, such as "RW" or "GM[1]"; "common(GM)" if the model also has a term "GM"
    kind: Kind
    process: Process  # Process of the term. Its shape parameter may have a starting value or be fixed.

    @property
    def branch(self) -> Branch | None:
        """Map from the search coordinate to the shape parameter; None if the shape has no free parameter."""
        names = [p.name for p in self.process.nonlinear_parameters()]
        if not names or self.process.is_fixed(names[0]):
            return None
        return type(self.process).search(2, 1.0)[0]

    def __str__(self) -> str:
        return str(self.process) if self.kind == "own" else f"{self.kind}({self.process})"


def joint_terms(model: ModelLike) -> tuple[JointTerm, ...]:
    """Parse a joint model of several signals, such as "common(RW) + 2*GM + WN"."""
    parts = [str(model)] if not isinstance(model, str) else _summands(model)
    kinds: list[tuple[Kind, Process]] = []
    for part in parts:
        match = _SHARED.fullmatch(part)
        kind, text, times = ("own", part, 1) if match is None else (match[2], match[3], int(match[1] or match[4] or 1))
        assert kind in get_args(Kind)
        for process in _processes(text.strip(), str(model)) * times:
            _require_shape(process)
            kinds.append((kind, process))  # type: ignore[arg-type]
    keys = Counter((kind, process.name) for kind, process in kinds if not process.repeatable)
    repeated = [key for key, count in keys.items() if count > 1]
    if repeated:
        kind, name = repeated[0]
        term = name if kind == "own" else f"{kind}({name})"
        raise ModelError(
            f'the model "{model}" has {term} twice; two terms of this kind are the same as one', argument="model",
            got=str(model), advice=f"Write {term} once.",
        )  # fmt: skip
    return _label(kinds)


def _processes(text: str, model: str) -> tuple[Process, ...]:
    """The processes of one summand; its errors name the whole model."""
    if (word := re.match(r"(own|common|shared)\b\s*(\(?)", text)) is not None:
        name = word[1]
        nested = f"{name}(…) cannot be inside another term" if word[2] else f"{name} needs parentheses"
        raise ModelError(
            f'the model "{model}" cannot be read: {nested}', argument="model", got=model,
            advice=f"Write one sum of terms, such as {name}(RW) + WN.",
        )  # fmt: skip
    try:
        return Model.parse(text).processes
    except ModelError as error:
        advice = error.advice or "Terms are processes such as WN, and own(…), common(…) or shared(…) of processes."
        why = f"is wrong: {error.reason}" if text else "is empty"
        raise ModelError(f'a term of the model "{model}" {why}', argument="model", got=model, advice=advice) from None


def _summands(text: str) -> list[str]:
    """Split the text of a model at each plus sign outside parentheses and numbers."""
    parts, opened, start = [], list[int](), 0
    for k, letter in enumerate(text):
        if letter == "(":
            opened.append(k)
        elif letter == ")":
            if not opened:
                raise _unbalanced_error(text, k, "(")
            opened.pop()
        elif letter == "+" and not opened and text[max(k - 1, 0)] not in "eE":
            parts.append(text[start:k])
            start = k + 1
    if opened:
        raise _unbalanced_error(text, opened[-1], ")")
    return [*parts, text[start:]]


def _unbalanced_error(text: str, at: int, missing: str) -> ModelError:
    return ModelError(
        f'the model "{text}" has "{text[at]}" at character {at + 1} without "{missing}"', argument="model", got=text,
        advice=f'Add the missing "{missing}".',
    )  # fmt: skip


def _require_shape(process: Process) -> None:
    """Raise a ModelError unless a process is noise with at most one unknown shape parameter and no fixed scale."""
    free = [p.name for p in process.nonlinear_parameters() if not process.is_fixed(p.name)]
    scale = process.scale_parameter().name
    kind = type(process)
    if any(function_of(getattr(kind, name)) is not function_of(getattr(Process, name)) for name in ("mean", "line")):
        raise ModelError(f"{process.name} is no random noise, and cannot be a term of a joint model", argument="model")
    if process.is_fixed(scale):
        raise ModelError(f"{process.name}.{scale} cannot be fixed in a joint model", argument="model")
    if len(free) > 1 or (free and not type(process).search(2, 1.0)):
        raise ModelError(
            f"{process.name} has shape parameters that a joint model cannot search: {', '.join(free)}",
            argument="model", advice="Fix their values.",
        )  # fmt: skip


def _label(kinds_and_processes: list[tuple[Kind, Process]]) -> tuple[JointTerm, ...]:
    names = Counter(process.name for _, process in kinds_and_processes)
    kinds = Counter((kind, process.name) for kind, process in kinds_and_processes)
    seen: Counter[tuple[Kind, str]] = Counter()
    terms = []
    for kind, process in kinds_and_processes:
        label = process.name
        if names[label] > kinds[kind, label] and kind != "own":
            label = f"{kind}({label})"
        if kinds[kind, process.name] > 1:
            seen[kind, process.name] += 1
            label += f"[{seen[kind, process.name]}]"
        terms.append(JointTerm(label=label, kind=kind, process=process))
    return tuple(terms)


def sum_model(parts: Iterable[Process]) -> Model:
    """Return the model of one signal as the sum of processes. Processes with the same shape are merged."""
    merged: dict[Any, Process] = {}
    for process in parts:
        key = (type(process), *process.nonlinear.tolist())
        merged[key] = process.with_scale(merged[key].scale + process.scale) if key in merged else process
    return Model(tuple(merged.values()))


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Moments of d signals, their weight matrix Ω, and the terms of the model."""

    terms: tuple[JointTerm, ...]  # the P terms of the model
    # (n,) Stacked entries of Γ̂. The signals are scaled so that each wavelet variance has the geometric mean 1.
    moments: Vector
    root: Matrix  # (n, n) L with LᵀL = Ω
    design: Design  # levels, sampling rate and length of the signals
    d: int
    target: Vector = field(init=False)  # (n,) weighted moments L γ̂
    # for each term, the map from the search coordinate to the shape parameter; None if the shape is not searched
    branches: tuple[Branch | None, ...] = field(init=False)
    # (P, J) Shapes κ of the terms whose shape is not searched. The other rows are not used.
    held: Matrix = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", self.root @ self.moments)
        samples, rate = self.design.longest, self.design.rate
        branches = tuple(
            None if term.branch is None else type(term.process).search(samples, rate)[0] for term in self.terms
        )
        object.__setattr__(self, "branches", branches)
        held = np.empty((len(branches), self.design.levels.size))
        for k, (term, branch) in enumerate(zip(self.terms, branches, strict=True)):
            if branch is None:
                process = type(term.process).standard(term.process.nonlinear)
                held[k] = process.wavelet_variance(self.design.levels, rate)
        object.__setattr__(self, "held", held)

    @property
    def search_places(self) -> list[int]:
        """Numbers of the terms whose shape is searched."""
        return [k for k, branch in enumerate(self.branches) if branch is not None]

    @property
    def limits(self) -> tuple[Vector, Vector]:
        """Lower and upper limits of the search coordinates, (K,) each."""
        branches = [branch for branch in self.branches if branch is not None]
        return np.array([branch.low for branch in branches]), np.array([branch.high for branch in branches])

    @cached_property
    def cone(self) -> Cone:
        """Free entries of the covariance matrices. A common term has a full matrix here; its rank is reduced later."""
        return Cone(self.d, np.array([term.kind != "own" for term in self.terms]))

    def processes(self, u: Vector) -> list[Process]:
        """Return the processes of all terms at unit scale, for search coordinates u (K,)."""
        processes, at = [], iter(u)
        for term, branch in zip(self.terms, self.branches, strict=True):
            values = term.process.nonlinear if branch is None else branch.values(np.array([next(at)]))[0]
            processes.append(type(term.process).standard(values))
        return processes

    def shapes(self, u: Vector) -> Matrix:
        """Return the shapes κ (P, J) of all terms for search coordinates u (K,)."""
        shapes = self.held.copy()
        for place, coordinate in zip(self.search_places, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            kind = type(self.terms[place].process)
            shapes[place] = kind.shape(branch.values(np.array([coordinate])), self.design.levels, self.design.rate)[0]
        return shapes

    def slopes(self, u: Vector) -> Matrix:
        """Return the derivatives ∂κ/∂u (K, J) of the searched shapes."""
        rows = []
        for place, coordinate in zip(self.search_places, u, strict=True):
            branch = self.branches[place]
            assert branch is not None
            at = np.array([coordinate])
            kind = type(self.terms[place].process)
            jacobian = kind.shape_jacobian(branch.values(at), self.design.levels, self.design.rate)
            rows.append(jacobian[0] @ branch.slope(at)[0])
        return np.array(rows).reshape(len(rows), self.design.levels.size)

    def blocks(self, shapes: Matrix) -> Matrix:
        """Return the weighted design columns L (e_i ⊗ κ_p) as an array (P, m, n), for each term p and entry i."""
        size, count = self.design.levels.size, entries(self.d)[0].size
        return np.asarray((self.root.reshape(-1, size) @ shapes.T).reshape(-1, count, len(shapes)).transpose(2, 1, 0))

    def columns(self, shapes: Matrix, cone: Cone | None = None) -> Matrix:
        """Return the weighted design matrix A (n, k), with one column for each free entry."""
        cone = cone or self.cone
        return np.ascontiguousarray(self.blocks(shapes).reshape(-1, self.target.size)[cone.free].T)

    def solve(self, u: Vector, *, gap: float = 1e-9, warm: Matrix | None = None) -> Conic:
        """Return the optimal covariance matrices for search coordinates u."""
        return least_squares(self.columns(self.shapes(u)), self.target, self.cone, gap=gap, warm=warm)

    def residual(self, shapes: Matrix, sigmas: Matrix) -> Vector:
        """Return the weighted residual L (γ̂ − γ) (n,) between measured and fitted moments."""
        rows, columns = entries(self.d)
        fitted = np.einsum("pi,pj->ij", sigmas[:, rows, columns], shapes).ravel()
        return np.asarray(self.target - self.root @ fitted)

    def directions(self, u: Vector, sigmas: Matrix) -> Matrix:
        """Return the derivatives (K, n) of the weighted fitted moments L γ with respect to the search coordinates."""
        rows, columns = entries(self.d)
        slopes = self.slopes(u)
        rows_of = [
            self.root @ np.outer(sigmas[place][rows, columns], slope).ravel()
            for place, slope in zip(self.search_places, slopes, strict=True)
        ]
        return np.array(rows_of).reshape(len(rows_of), self.target.size)


def coordinates(problem: JointProblem) -> Vector | None:
    """Return the search coordinates (K,) that the model states, or None if it does not state all."""
    values = []
    for place in problem.search_places:
        branch, process = problem.branches[place], problem.terms[place].process
        value = process.values[process.nonlinear_parameters()[0].name]
        u = None if value is None or branch is None else branch.coordinate(value)
        if u is None or branch is None:
            return None
        values.append(float(np.clip(u, branch.low, branch.high)))
    return np.array(values)


ROUGH_TOLERANCE = 1e-4
"""Relative accuracy of objectives while starts are compared; no effect on fits of docs/validation/joint.md."""
EXACT_TOLERANCE = 1e-9  # relative accuracy of the objective of a final fit


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """An estimate of the parameters of a joint model."""

    u: Vector  # (K,) search coordinates of the shapes
    sigmas: Matrix  # (P, d, d) covariance matrices of the terms
    objective: float  # weighted residual sum of squares
    gap: float = 0.0  # upper bound on the error of `objective` for these shapes
    warm: Matrix | None = None  # (P, d, d) positive definite matrices to start a similar problem from


def search(problem: JointProblem) -> JointEstimate:
    """Return the best local optimum from several starting values."""
    rough = [descend(problem, u, accuracy=ROUGH_TOLERANCE) for u in _starts(problem)]
    least = min(estimate.objective for estimate in rough)
    # If several starting values lead to the same optimum, it is refined once.
    followed: list[JointEstimate] = []
    for estimate in sorted(rough, key=lambda estimate: estimate.objective):
        new = all(np.max(np.abs(estimate.u - other.u), initial=0.0) > 0.02 for other in followed)
        if estimate.objective <= least * 1.1 and (new or not followed):
            followed.append(estimate)
    return min((resume(problem, estimate) for estimate in followed), key=lambda estimate: estimate.objective)


def first(problem: JointProblem) -> JointEstimate:
    """Return a local optimum with rough accuracy, from the best starting value."""
    return descend(problem, _starts(problem)[0], accuracy=ROUGH_TOLERANCE)


def resume(problem: JointProblem, estimate: JointEstimate, accuracy: float = EXACT_TOLERANCE) -> JointEstimate:
    """Return the local optimum near an estimate."""
    return polish(problem, descend(problem, estimate.u, warm=estimate.warm, accuracy=accuracy), accuracy)


def places(problem: JointProblem, place: int, count: int) -> Vector:
    """Return the search coordinates (count,) of shapes that are equally spaced along the curve of shapes of a term."""
    branch = problem.branches[place]
    assert branch is not None
    u = np.linspace(branch.low, branch.high, 400)
    kind = type(problem.terms[place].process)
    shapes = np.log(kind.shape(branch.values(u), problem.design.levels, problem.design.rate))
    shapes -= shapes.mean(axis=1, keepdims=True)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(shapes, axis=0), axis=1))])
    # The two ends of the curve are left out, because they have the shapes of other processes, such as WN and RW.
    return np.asarray(np.interp((np.arange(count) + 1) / (count + 1) * length[-1], length, u))


def _starts(problem: JointProblem) -> list[Vector]:
    """Return starting values (search coordinates of all searched terms), the best one first."""
    searched = problem.search_places
    if not searched:
        return [np.empty(0)]
    # A finer scan gives the same fits (tests/joint/test_joint_fit.py).
    grids = [places(problem, place, 10) for place in searched]
    # Neighbouring starting values lead to the same optimum.
    apart = 1.5 * np.array([np.max(np.diff(grid)) for grid in grids])
    if len(searched) == 1:
        scored = _scores(problem, [np.array([value]) for value in grids[0]])
        height = np.array([np.inf, *(objective for objective, _ in scored), np.inf])
        scored = [pair for k, pair in enumerate(scored) if height[k + 1] <= min(height[k], height[k + 2])]
    else:
        scored = _scores(problem, _combinations(problem, grids))
    stated = coordinates(problem)
    if stated is not None:
        scored += _scores(problem, [stated])
    scored.sort(key=lambda pair: pair[0])
    chosen: list[Vector] = []
    for _, u in scored:
        if all(np.any(np.abs(u - other) > apart) for other in chosen):
            chosen.append(u)
    return chosen[:4]


def _scores(problem: JointProblem, choices: list[Vector]) -> list[tuple[float, Vector]]:
    """Return the rough objective at each of several search coordinates, with the coordinates."""
    scores, warm = [], None
    for u in choices:
        solved = problem.solve(u, gap=1e-2, warm=warm)
        scores.append((solved.objective, u))
        warm = solved.warm
    return scores


def _combinations(problem: JointProblem, grids: list[Vector]) -> list[Vector]:
    """Return combinations of candidate shapes of two or more terms, from the mixtures of all candidates of each."""
    searched = problem.search_places
    supported = [_supported_shapes(problem, place, grid) for place, grid in zip(searched, grids, strict=True)]
    groups: dict[tuple[str, str], list[int]] = {}
    for k, place in enumerate(searched):
        groups.setdefault((problem.terms[place].process.name, problem.terms[place].kind), []).append(k)
    choices = [
        list(
            combinations(supported[group[0]] if len(supported[group[0]]) >= len(group) else grids[group[0]], len(group))
        )
        for group in groups.values()
    ]
    order = np.argsort([k for group in groups.values() for k in group])
    return [np.array([value for part in choice for value in part])[order] for choice in islice(product(*choices), 60)]


def _supported_shapes(problem: JointProblem, place: int, grid: Vector) -> Vector:
    """Return the candidate shapes of a term with the largest parts in the best-fitting mixture of all candidates."""
    branch = problem.branches[place]
    assert branch is not None
    others = [k for k, branch_of in enumerate(problem.branches) if branch_of is None]
    levels, rate = problem.design.levels, problem.design.rate
    candidates = type(problem.terms[place].process).shape(branch.values(grid), levels, rate)
    fixed = [type(problem.terms[k].process).standard(problem.terms[k].process.nonlinear) for k in others]
    shapes = np.array([*candidates, *(process.wavelet_variance(levels, rate) for process in fixed)])
    full = [problem.terms[place].kind != "own"] * grid.size + [problem.terms[k].kind != "own" for k in others]
    cone = Cone(problem.d, np.array(full))
    solution = least_squares(problem.columns(shapes, cone), problem.target, cone, gap=1e-3)
    share = np.max(solution.sigmas[: grid.size].trace(axis1=1, axis2=2)[:, None] * candidates, axis=1)
    count = max(4, sum(1 for k in problem.search_places if problem.terms[k].kind == problem.terms[place].kind) + 2)
    return np.sort(grid[np.argsort(-share)[:count]])


def descend(
    problem: JointProblem, u: Vector, *, warm: Matrix | None = None, accuracy: float = EXACT_TOLERANCE
) -> JointEstimate:
    """Minimise the objective over the search coordinates by Newton's method, with optimal matrices at each step."""
    low, high = problem.limits
    u = np.clip(u, low, high)
    now = problem.solve(u, gap=accuracy, warm=warm)
    for _ in range(40 if u.size else 0):
        gradient, curvature = _derivatives(problem, u, now)
        free = ~(((u <= low) & (gradient > 0)) | ((u >= high) & (gradient < 0)))
        if not np.any(free):
            break
        step = np.zeros_like(u)
        step[free] = -_newton(curvature[np.ix_(free, free)], gradient[free])
        step *= min(1.0, 2.0 / max(float(np.max(np.abs(step))), 1e-300))
        expected = -float(gradient @ step)
        if expected <= 0.1 * accuracy * now.objective:
            break
        for _ in range(12):
            trial = np.clip(u + step, low, high)
            new = problem.solve(trial, gap=accuracy, warm=now.warm)
            if new.objective < now.objective:
                break
            step /= 2
        else:
            break
        settled = now.objective - new.objective <= 0.01 * accuracy * now.objective
        u, now = trial, new
        if settled:
            break
    return JointEstimate(u, now.sigmas, now.objective, now.gap, warm=now.warm)


def _derivatives(problem: JointProblem, u: Vector, now: Conic) -> tuple[Vector, Matrix]:
    """Return gradient and Gauss-Newton curvature of the objective at the optimal matrices of the search coordinates."""
    shapes, cone = problem.shapes(u), problem.cone
    residual = problem.residual(shapes, now.sigmas)
    along = problem.directions(u, now.sigmas)
    mixed = 2 * along @ problem.columns(shapes)
    terms = cone.terms
    slopes = problem.blocks(problem.slopes(u)) @ residual
    rows, columns = entries(problem.d)
    for k, place in enumerate(problem.search_places):
        slope = slopes[k] if cone.full[place] else slopes[k][rows == columns]
        mixed[k, terms == place] -= 2 * slope
    scale = 1 / np.sqrt(np.diag(now.hessian))
    inner = now.hessian * np.outer(scale, scale)
    # Two terms with the same shape make the matrix singular. Any solution gives the same product.
    response = np.linalg.lstsq(inner, (mixed * scale).T)[0]
    curvature = 2 * along @ along.T - (mixed * scale) @ response
    return -2 * along @ residual, curvature


def _newton(curvature: Matrix, gradient: Vector) -> Vector:
    """Solve curvature · x = gradient, after making the curvature positive definite."""
    values, vectors = np.linalg.eigh((curvature + curvature.T) / 2)
    values = np.maximum(np.abs(values), 1e-8 * max(float(np.abs(values).max()), 1e-300))
    return np.asarray(vectors @ ((vectors.T @ gradient) / values))


def polish(problem: JointProblem, estimate: JointEstimate, accuracy: float = EXACT_TOLERANCE) -> JointEstimate:
    """Return the optimum with matrices of rank one for common terms: Σ = FFᵀ, from a fit with any rank."""
    if not any(term.kind == "common" for term in problem.terms):
        return estimate
    factors = _Factors(problem)
    start = factors.start(estimate)
    solved = scipy.optimize.least_squares(
        factors.residual, start, jac=factors.jacobian, method="lm" if start.size <= problem.target.size else "trf",
        x_scale="jac", ftol=1e-3 * accuracy, xtol=1e-3 * accuracy, gtol=1e-12, max_nfev=300,
    )  # fmt: skip
    u, sigmas = factors.of(solved.x)
    return JointEstimate(u, sigmas, 2 * float(solved.cost), warm=estimate.warm)


class _Factors:
    """Nonlinear least squares with Σ = FFᵀ: F is diagonal (own), a column (common) or a full matrix (shared)."""

    def __init__(self, problem: JointProblem) -> None:
        self.problem, self.low, self.high = problem, *problem.limits
        d = problem.d
        self.sizes = [{"own": d, "common": d, "shared": d * d}[term.kind] for term in problem.terms]

    def start(self, estimate: JointEstimate) -> Vector:
        parts = [estimate.u]
        for term, sigma in zip(self.problem.terms, estimate.sigmas, strict=True):
            if term.kind == "own":
                parts.append(np.sqrt(np.maximum(np.diag(sigma), 0.0)))
            else:
                values, vectors = np.linalg.eigh(sigma)
                factor = vectors * np.sqrt(np.maximum(values, 1e-12 * values[-1]))
                parts.append(factor[:, -1] if term.kind == "common" else factor.ravel())
        return np.concatenate(parts)

    def coordinates_and_factors(self, x: Vector) -> tuple[Vector, list[Matrix]]:
        """Split the vector of unknowns into the search coordinates and the factor (d, r) of each matrix."""
        d = self.problem.d
        u = np.clip(x[: self.low.size], self.low, self.high)
        parts = np.split(x[self.low.size :], np.cumsum(self.sizes)[:-1])
        kinds = [term.kind for term in self.problem.terms]
        return u, [np.diag(part) if kind == "own" else part.reshape(d, -1)
                   for part, kind in zip(parts, kinds, strict=True)]  # fmt: skip

    def of(self, x: Vector) -> tuple[Vector, Matrix]:
        u, factors = self.coordinates_and_factors(x)
        return u, np.array([factor @ factor.T for factor in factors])

    def residual(self, x: Vector) -> Vector:
        u, sigmas = self.of(x)
        return self.problem.residual(self.problem.shapes(u), sigmas)

    def jacobian(self, x: Vector) -> Matrix:
        u, factors = self.coordinates_and_factors(x)
        problem, (rows, columns) = self.problem, entries(self.problem.d)
        blocks = problem.blocks(problem.shapes(u))
        sigmas = np.array([factor @ factor.T for factor in factors])
        parts = [problem.directions(u, sigmas)]
        eye = np.eye(problem.d)
        for term, factor, block in zip(problem.terms, factors, blocks, strict=True):
            # d(FFᵀ)_ab / dF_ck = δ_ac F_bk + δ_bc F_ak
            change = (
                eye[rows][:, :, None] * factor[columns][:, None, :]
                + eye[columns][:, :, None] * factor[rows][:, None, :]
            )
            if term.kind == "own":
                change = np.einsum("icc->ic", change)
            parts.append(change.reshape(rows.size, -1).T @ block)
        return -np.concatenate(parts).T
