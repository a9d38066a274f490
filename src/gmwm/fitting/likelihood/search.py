"""Maximise a likelihood by damped Fisher scoring, and set terms to zero that the recording does not support."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.likelihood.problem import LikelihoodPoint, LikelihoodProblem

# These constants decide which terms are zero, and which return (tests/likelihood/test_fit_ml.py pins both).


@dataclass(frozen=True, eq=False)
class Maximum:
    """Local maximum at `z` (q,), −inf for a zero scale; `active` coordinates are free, `at_end` is ±1 at bounds."""

    z: Vector
    active: tuple[int, ...]
    at_end: dict[int, int]
    evaluation: LikelihoodPoint
    evaluations: int
    converged: bool


Progress = Callable[[int, float], None]


class LikelihoodSearch:
    """Search for a local maximum in all coordinates but `held`, until the expected increase is below `tolerance`;
    `revive` tries to add terms that became zero."""

    def __init__(
        self,
        problem: LikelihoodProblem,
        held: tuple[int, ...] = (),
        progress: Progress | None = None,
        # The search ends when the expected increase of the log-likelihood is below this value.
        tolerance: float = 1e-9,
        revive: bool = True,
    ) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.revive = revive
        self.held = frozenset(held)
        self.progress = progress
        self.count = 0
        self.gone: set[int] = set()  # numbers of the terms that are zero
        self.scales = {c.term: k for k, c in enumerate(problem.coordinates) if c.shape is None}

    def run(self, start: Vector) -> Maximum | None:
        """Return the local maximum that the search reaches; None if the likelihood is undefined at `start`."""
        z = self._apart(np.clip(start, *self.problem.bounds.T))
        self.gone = {c.term for c, value in zip(self.problem.coordinates, start, strict=True) if value == -math.inf}
        z, evaluation, converged = self._climb(z)
        if evaluation is None:
            return None
        z, evaluation = self._tidy(z, evaluation)
        # A zero term may be supported after others changed, and so may another after it: two passes.
        for term in [*sorted(self.gone)] * 2 if self.revive else ():
            tried = self._back(z, evaluation, term) if term in self.gone else None
            if tried is not None:
                z, evaluation, converged = tried
        active = self._active(z)
        ends = {
            k: side
            for k, side in ((k, self._side(z, k)) for k in range(z.size))
            if side and self.problem.coordinates[k].term not in self.gone and k not in self.held
        }
        return Maximum(
            z=z, active=tuple(k for k in active if k not in ends), at_end=ends, evaluation=evaluation,
            evaluations=self.count, converged=converged,
        )  # fmt: skip

    def _active(self, z: Vector) -> list[int]:
        return [k for k, c in enumerate(self.problem.coordinates) if k not in self.held and c.term not in self.gone]

    def _side(self, z: Vector, k: int) -> int:
        low, high = self.problem.bounds[k]
        return -1 if z[k] <= low else 1 if z[k] >= high else 0

    def _evaluate(self, z: Vector, active: list[int]) -> LikelihoodPoint | None:
        self.count += 1
        evaluation = self.problem.evaluate(z, active)
        if self.progress is not None and evaluation is not None:
            self.progress(self.count, evaluation.value)
        return evaluation

    def _climb(self, z: Vector) -> tuple[Vector, LikelihoodPoint | None, bool]:
        """Climb by d = (I + μ diag I)⁻¹ g (gradient, information, damping) to a negligible expected increase."""
        active = self._active(z)
        now = self._evaluate(z, active)
        if now is None:
            return z, None, False
        damping, converged = 0.0, not active
        # Largest number of steps. A search that reaches it is reported as not converged.
        for _ in range(200 if active else 0):
            step, gain = self._step(now, z, active, damping)
            if gain < 0.0 and damping < 1e6:
                damping = max(
                    10.0 * damping, 1e-2
                )  # the step was too long, because there is little information about some direction
                continue
            if gain <= max(self.tolerance, 8e-16 * abs(now.value)):
                converged = gain >= 0.0
                break
            if self._give_up(now, z, active):
                z = self._without(z)
                active = self._active(z)
                again = self._evaluate(z, active)
                if again is None:
                    return z, None, False
                now, damping = again, 0.0
                if not active:
                    converged = True
                    break
                continue
            trial = z.copy()
            trial[active] += step
            trial = np.clip(trial, *self.problem.bounds.T)
            after = self._evaluate(trial, active)
            if after is not None and after.value > now.value:
                ratio = (after.value - now.value) / gain
                damping = 0.0 if ratio > 0.5 and damping < 1e-3 else damping * (0.2 if ratio > 0.5 else 1.0)
                z, now = trial, after
            elif gain <= 1e-5 and damping > 1e3:
                converged = True  # the remaining gain is below the rounding error of the likelihood
                break
            else:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e12:
                    break
        return z, now, converged

    def _step(self, now: LikelihoodPoint, z: Vector, active: list[int], damping: float) -> tuple[Vector, float]:
        """Return a step of the active coordinates inside their bounds, and the expected increase."""
        # Longest step in a coordinate. In the logarithm of a scale, it is a factor of seven.
        longest_step = 2.0
        bounds, at = self.problem.bounds[active], z[active]
        low = np.maximum(bounds[:, 0] - at, -longest_step)
        high = np.minimum(bounds[:, 1] - at, longest_step)
        step = box_step(now.information, now.gradient, low=low, high=high, damping=damping)
        return step, float(now.gradient @ step - 0.5 * step @ now.information @ step)

    def _give_up(self, now: LikelihoodPoint, z: Vector, active: list[int]) -> bool:
        """Mark terms as zero whose scale no longer affects the likelihood, and return whether there are any."""
        # Derivative and information of the logarithm of a scale below which its term is set to zero.
        negligible = 1e-7
        gone = set()
        for term, k in self.scales.items():
            if k not in active:
                continue
            slope = now.gradient[active.index(k)]
            if -negligible < slope <= 0 and now.information[active.index(k), active.index(k)] < negligible:
                gone.add(term)
        if not gone or len(self.gone | gone) >= len(self.problem.model.processes):
            return False
        self.gone |= gone
        return True

    def _tidy(self, z: Vector, now: LikelihoodPoint) -> tuple[Vector, LikelihoodPoint]:
        """Set small terms to zero if this does not decrease the likelihood."""
        active = self._active(z)
        for term, k in self.scales.items():
            # A scale is zero on trial if the relative standard error is above 4.
            if k not in active or now.information[active.index(k), active.index(k)] > 0.05:
                continue
            if len(self.gone) + 1 >= len(self.problem.model.processes):
                break
            tried = z.copy()
            tried[k] = -math.inf
            self.gone.add(term)
            remaining = self._active(tried)
            after = self._evaluate(tried, remaining)
            if after is None or after.value < now.value - 1e-6:
                self.gone.discard(term)
                continue
            z, now, active = tried, after, remaining
        return z, now

    def _without(self, z: Vector) -> Vector:
        z = z.copy()
        for term in self.gone:
            z[self.scales[term]] = -math.inf
        return z

    def _apart(self, z: Vector) -> Vector:
        """Separate the starting values of repeated terms: with equal gradients they would remain equal."""
        z = z.copy()
        seen: list[tuple[type, Vector]] = []
        for term, process in enumerate(self.problem.model.processes):
            mine = [i for i, c in enumerate(self.problem.coordinates) if c.term == term and c.shape is not None]
            if not mine or not np.all(np.isfinite(z[mine])) or self.held.intersection(mine):
                continue
            while any(kind is type(process) and np.allclose(at, z[mine], atol=1e-3) for kind, at in seen):
                z[mine[0]] += 0.7
            z[mine] = np.clip(z[mine], *self.problem.bounds[mine].T)
            seen.append((type(process), z[mine].copy()))
        return z

    def _back(self, z: Vector, now: LikelihoodPoint, term: int) -> tuple[Vector, LikelihoodPoint, bool] | None:
        """Return the maximum with a zero term added, if better: expected increase g²/2I, gradient g, information I,
        over the whole range of one shape parameter."""
        k = self.scales.get(term)
        if k is None or k in self.held:
            return None
        # A term that is zero is added again if the expected increase of the log-likelihood is above this value.
        most, best = 0.01, None
        for at in self._places(z, term):
            at[k] = self.problem.faint(at, k, now.model, 1e-4)
            tried = self._evaluate(at, [k])
            if tried is None or tried.information[0, 0] <= 0 or tried.gradient[0] <= 0:
                continue
            slope, information = float(tried.gradient[0]), float(tried.information[0, 0])
            if slope * slope / (2.0 * information) > most:
                most, best = slope * slope / (2.0 * information), at
                # Move to the maximum of the quadratic approximation in the scale itself.
                best[k] += min(max(math.log(slope / information), 0.0), 9.0)
        if best is None:
            return None
        before = set(self.gone)
        self.gone.discard(term)
        at, evaluation, converged = self._climb(best)
        if evaluation is not None and evaluation.value > now.value + 1e-6 and term not in self.gone:
            return at, evaluation, converged
        self.gone = before
        return None

    def _places(self, z: Vector, term: int) -> list[Vector]:
        """Return points (q,) at which to try a term, over the range of its shape parameter if it has one."""
        # Number of values of the shape parameter at which a term that is zero is tried.
        places = 12
        mine = [i for i, c in enumerate(self.problem.coordinates) if c.term == term and c.shape is not None]
        if len(mine) != 1:
            return [z.copy()]
        process = self.problem.model.processes[term]
        low, high = type(process).scan(self.problem.record.values.size, self.problem.rate)[0]
        # Beyond a wavelet fit's range (a factor of 5 in β), likelihood detects processes that decay within a sample.
        high += 1.6
        out = []
        for share in (np.arange(places) + 0.5) / places:
            at = z.copy()
            at[mine[0]] = np.clip(low + share * (high - low), *self.problem.bounds[mine[0]])
            out.append(at)
        return out


def box_step(information: Matrix, gradient: Vector, low: Vector, high: Vector, damping: float) -> Vector:
    """Return the step d between `low` and `high` that maximises g·d − ½ dᵀ(I + μ diag I)d, by an active-set method: a
    coordinate that would leave the bounds is held there, and released if the gradient points inwards."""
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    scaled = information / np.outer(size, size)
    scaled = scaled + damping * np.diag(np.diag(scaled))
    g, least, most = gradient / size, low * size, high * size
    step, free = np.zeros(g.size), np.ones(g.size, dtype=np.bool_)
    for _ in range(4 * g.size + 4):
        step[free] = solve_stable(scaled[np.ix_(free, free)], g[free] - scaled[np.ix_(free, ~free)] @ step[~free])
        out = free & ((step < least) | (step > most))
        if np.any(out):
            step = np.clip(step, least, most)
            free &= ~out
            continue
        slope = g - scaled @ step
        back = ~free & (((step <= least) & (slope > 0)) | ((step >= most) & (slope < 0))) & (least < most)
        if not np.any(back):
            break
        free |= back
    return np.asarray(np.clip(step, least, most) / size)


def solve_stable(matrix: Matrix, vector: Vector) -> Vector:
    """Return M⁻¹ v for a matrix M with unit diagonal. Directions with eigenvalues near zero are left out."""
    if not vector.size:
        return vector
    values, vectors = np.linalg.eigh(matrix)
    able = values > 1e-12 * values[-1]
    return np.asarray(vectors[:, able] @ ((vectors[:, able].T @ vector) / values[able]))
