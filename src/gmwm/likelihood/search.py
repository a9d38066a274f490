"""The way up a likelihood: Fisher scoring, damped where it fails, on the terms that the record shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.likelihood.problem import Evaluation, Problem

LONGEST = 2.0
"""Of a step in a coordinate: a factor of seven in a scale."""
TOLERANCE = 1e-9
"""Of the log-likelihood that may still be gained."""
_ROUNDS = 200
_WORTH = 0.01
"""Log-likelihood that a term must promise to be tried again."""
_PLACES = 12
"""Along the range of a shape, where a term is looked for."""
_BEYOND = 1.6
"""Above the range in which wavelets see a shape: samples also see a process that is gone within one."""
_FAINT = 0.05
"""Information on the logarithm of a scale below which its error is more than four times itself: is it there at all?"""
_GONE = 1e-7
"""Log-likelihood that a term can still lose by shrinking, from which on it counts as zero."""


@dataclass(frozen=True, eq=False)
class Maximum:
    """The local maximum of the likelihood that one search reached.

    Attributes
    ----------
    z : (q,) array
        Coordinates; −inf for the scale of a term that is zero.
    active : tuple of int
        Coordinates that are neither held at an end nor of a term that is zero.
    at_end : mapping of coordinate to side
        −1 or 1 for shapes that rest at an end.
    """

    z: Vector
    active: tuple[int, ...]
    at_end: dict[int, int]
    evaluation: Evaluation
    evaluations: int
    converged: bool


Progress = Callable[[int, float], None]


class Search:
    """One search; `held` coordinates stay where they are, and it ends where less than `tolerance` is to be gained.

    `revive`: whether terms that were given up are tried once more at the end.
    """

    def __init__(
        self,
        problem: Problem,
        held: tuple[int, ...] = (),
        progress: Progress | None = None,
        tolerance: float = TOLERANCE,
        revive: bool = True,
    ) -> None:
        self.problem = problem
        self.tolerance = tolerance
        self.revive = revive
        self.held = frozenset(held)
        self.progress = progress
        self.count = 0
        self.gone: set[int] = set()  # terms
        self.scales = {c.term: k for k, c in enumerate(problem.coordinates) if c.shape is None}

    def run(self, start: Vector) -> Maximum | None:
        """The optimum that `start` leads to; None where the start has no likelihood."""
        z = self._apart(np.clip(start, *self.problem.bounds.T))
        self.gone = {c.term for c, value in zip(self.problem.coordinates, start, strict=True) if value == -math.inf}
        z, found, converged = self._climb(z)
        if found is None:
            return None
        z, found = self._tidy(z, found)
        # A term that is at zero may have a place once the others have found theirs, and then another one too.
        for term in [*sorted(self.gone)] * 2 if self.revive else ():
            tried = self._back(z, found, term) if term in self.gone else None
            if tried is not None:
                z, found, converged = tried
        active = self._active(z)
        ends = {
            k: side
            for k, side in ((k, self._side(z, k)) for k in range(z.size))
            if side and self.problem.coordinates[k].term not in self.gone and k not in self.held
        }
        return Maximum(
            z=z,
            active=tuple(k for k in active if k not in ends),
            at_end=ends,
            evaluation=found,
            evaluations=self.count,
            converged=converged,
        )

    # --- inside ---------------------------------------------------------------------------------------

    def _active(self, z: Vector) -> list[int]:
        return [k for k, c in enumerate(self.problem.coordinates) if k not in self.held and c.term not in self.gone]

    def _side(self, z: Vector, k: int) -> int:
        low, high = self.problem.bounds[k]
        return -1 if z[k] <= low else 1 if z[k] >= high else 0

    def _evaluate(self, z: Vector, active: list[int]) -> Evaluation | None:
        self.count += 1
        found = self.problem.evaluate(z, active)
        if self.progress is not None and found is not None:
            self.progress(self.count, found.value)
        return found

    def _climb(self, z: Vector) -> tuple[Vector, Evaluation | None, bool]:
        """Steps d = (I + μ diag I)⁻¹ g until nothing is to be gained that rounding would not hide."""
        active = self._active(z)
        now = self._evaluate(z, active)
        if now is None:
            return z, None, False
        damping, converged = 0.0, not active
        for _ in range(_ROUNDS if active else 0):
            step, gain = self._step(now, z, active, damping)
            if gain < 0.0 and damping < 1e6:
                damping = max(10.0 * damping, 1e-2)  # a direction that is hardly known spoilt the step
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
                converged = True  # the likelihood's own rounding is all that is left
                break
            else:
                damping = max(10.0 * damping, 1e-2)
                if damping > 1e12:
                    break
        return z, now, converged

    def _step(self, now: Evaluation, z: Vector, active: list[int], damping: float) -> tuple[Vector, float]:
        """The step of the active coordinates, inside their bounds, and what it promises to gain."""
        bounds, at = self.problem.bounds[active], z[active]
        low = np.maximum(bounds[:, 0] - at, -LONGEST)
        high = np.minimum(bounds[:, 1] - at, LONGEST)
        step = boxed(now.information, now.gradient, low=low, high=high, damping=damping)
        return step, float(now.gradient @ step - 0.5 * step @ now.information @ step)

    def _give_up(self, now: Evaluation, z: Vector, active: list[int]) -> bool:
        """Whether a term has shrunk to where it no longer matters, and goes."""
        gone = set()
        for term, k in self.scales.items():
            if k not in active:
                continue
            slope = now.gradient[active.index(k)]
            if -_GONE < slope <= 0 and now.information[active.index(k), active.index(k)] < _GONE:
                gone.add(term)
        if not gone or len(self.gone | gone) >= len(self.problem.model.processes):
            return False
        self.gone |= gone
        return True

    def _tidy(self, z: Vector, now: Evaluation) -> tuple[Vector, Evaluation]:
        """Terms that came to rest so small that they might as well be zero are zero."""
        active = self._active(z)
        for term, k in self.scales.items():
            if k not in active or now.information[active.index(k), active.index(k)] > _FAINT:
                continue
            if len(self.gone) + 1 >= len(self.problem.model.processes):
                break
            tried = z.copy()
            tried[k] = -math.inf
            self.gone.add(term)
            rest = self._active(tried)
            after = self._evaluate(tried, rest)
            if after is None or after.value < now.value - 1e-6:
                self.gone.discard(term)
                continue
            z, now, active = tried, after, rest
        return z, now

    def _without(self, z: Vector) -> Vector:
        z = z.copy()
        for term in self.gone:
            z[self.scales[term]] = -math.inf
        return z

    def _apart(self, z: Vector) -> Vector:
        """Terms of a kind that start at one place would stay together: there they are a single one."""
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

    def _back(self, z: Vector, now: Evaluation, term: int) -> tuple[Vector, Evaluation, bool] | None:
        """The optimum with a term that is at zero, if the likelihood rises where it comes back.

        It is looked at while it is so small that it changes nothing: its slope g and information I on the logarithm of
        the scale say that g²/2I is to be gained. A shape of one parameter is tried all along its range.
        """
        k = self.scales.get(term)
        if k is None or k in self.held:
            return None
        most, best = _WORTH, None
        for at in self._places(z, term):
            at[k] = self.problem.faint(at, k, now.model, 1e-4)
            tried = self._evaluate(at, [k])
            if tried is None or tried.information[0, 0] <= 0 or tried.gradient[0] <= 0:
                continue
            slope, information = float(tried.gradient[0]), float(tried.information[0, 0])
            if slope * slope / (2.0 * information) > most:
                most, best = slope * slope / (2.0 * information), at
                # Where the parabola has its top: c/I of the scale itself.
                best[k] += min(max(math.log(slope / information), 0.0), 9.0)
        if best is None:
            return None
        before = set(self.gone)
        self.gone.discard(term)
        at, found, converged = self._climb(best)
        if found is not None and found.value > now.value + 1e-6 and term not in self.gone:
            return at, found, converged
        self.gone = before
        return None

    def _places(self, z: Vector, term: int) -> list[Vector]:
        """Where to look for a term: all along its shape if that has one parameter, else where it stands."""
        mine = [i for i, c in enumerate(self.problem.coordinates) if c.term == term and c.shape is not None]
        if len(mine) != 1:
            return [z.copy()]
        process = self.problem.model.processes[term]
        low, high = type(process).scan(self.problem.record.values.size, self.problem.rate)[0]
        high += _BEYOND
        out = []
        for share in (np.arange(_PLACES) + 0.5) / _PLACES:
            at = z.copy()
            at[mine[0]] = np.clip(low + share * (high - low), *self.problem.bounds[mine[0]])
            out.append(at)
        return out


def boxed(information: Matrix, gradient: Vector, low: Vector, high: Vector, damping: float) -> Vector:
    """The d between `low` and `high` that gains most, g·d − ½ dᵀ(I + μ diag I)d: what leaves the box rests on its side.

    Coordinates come off a side again where the slope there points inwards.
    """
    size = np.sqrt(np.diag(information))
    size = np.where(size > 0, size, 1.0)
    scaled = information / np.outer(size, size)
    scaled = scaled + damping * np.diag(np.diag(scaled))
    g, least, most = gradient / size, low * size, high * size
    step, free = np.zeros(g.size), np.ones(g.size, dtype=np.bool_)
    for _ in range(4 * g.size + 4):
        step[free] = solved(scaled[np.ix_(free, free)], g[free] - scaled[np.ix_(free, ~free)] @ step[~free])
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


def solved(matrix: Matrix, vector: Vector) -> Vector:
    """M⁻¹ v of a matrix with ones on its diagonal; directions in which it is nothing are left out."""
    if not vector.size:
        return vector
    values, vectors = np.linalg.eigh(matrix)
    kept = values > 1e-12 * values[-1]
    return np.asarray(vectors[:, kept] @ ((vectors[:, kept].T @ vector) / values[kept]))
