"""Estimation problem, formulated with weighted vectors: the data, and a vector, curve or surface for each process."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from math import sqrt

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import ModelError
from gmwm.fitting.estimation.weighting import Weights
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import WaveletFilter, find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Relative error of each product L_jk ν_k², four times the measured one (tests/estimation/test_last_places.py)."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Problem of estimating non-negative scales of all processes and the shapes of some.

    (ν̂ − ν)ᵀ Ω (ν̂ − ν) = `unit`² |target − Σ c a − Σ x g|², with unit vectors a (known shape) and g (free). `unit` is
    a power of two, so that scaled data give the same problem. Indices `linear`, `curved` (branch and bound, one class)
    and `free` are sorted by name. `shapes` are for scale coefficient 1; `observed` is ν̂² minus fixed processes."""

    model: Model
    levels: Integers
    rate: float
    filter: WaveletFilter
    samples: int
    observed: Vector
    weights: Weights
    unit: float
    target: Vector
    linear: tuple[int, ...]
    curved: tuple[int, ...]
    free: tuple[int, ...]
    shapes: Matrix

    @property
    def matrix(self) -> Matrix:
        """Weighting matrix Ω (J, J)."""
        return self.weights.matrix

    @property
    def root(self) -> Matrix:
        """Matrix L (J, J) with LᵀL = Ω."""
        return self.weights.root

    @property
    def shaped(self) -> tuple[int, ...]:
        """Indices of all processes with a free shape, the curved ones first."""
        return (*self.curved, *self.free)

    @cached_property
    def curved_class(self) -> type[Process] | None:
        """Class of the curved processes; None if there are none."""
        return type(self.model.processes[self.curved[0]]) if self.curved else None

    @cached_property
    def fixed(self) -> Matrix:
        """Unit vectors a (n linear, J) of the linear processes."""
        return self.unit_rows(self.shapes)

    @cached_property
    def rounding(self) -> float:
        """Length of the rounding error of the residual, in units of `target`."""
        size = np.linalg.norm(np.abs(self.root) @ np.abs(self.observed))
        return ROUNDING * float(size) / self.unit

    def as_low(self, objective: float, least: float, share: float) -> bool:
        """Return whether an objective exceeds `least` by at most a relative `share` plus the rounding error of the
        residual. If the data equal the curve of a model, the order of summation would otherwise decide."""
        return objective <= (1 + share) * (sqrt(least) + self.rounding) ** 2

    def under(self, matrix: Matrix) -> Problem:
        """Return the same problem with another weighting matrix Ω."""
        weights = Weights(matrix)
        unit, target = weigh(self.observed, weights)
        return replace(self, weights=weights, unit=unit, target=target)

    def observing(self, observed: Vector) -> Problem:
        """Return the same problem for other data."""
        unit, target = weigh(observed, self.weights)
        return replace(self, observed=observed, unit=unit, target=target)

    def unit_rows(self, shapes: Matrix) -> Matrix:
        """Multiply each row of wavelet variances by L, and scale it to length one."""
        rows = shapes @ self.root.T
        return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))

    def scales(self, shapes: Matrix, weights: Vector) -> Vector:
        """Return the scale coefficients from c or x of unit vectors; `shapes` are for scale coefficient 1."""
        return np.asarray(weights * self.unit / np.linalg.norm(shapes @ self.root.T, axis=1))


def pose(model: Model, wv: WaveletVariance, matrix: Matrix | Weights) -> Problem:
    """Return the problem of fitting `model` to `wv` with the weighting matrix Ω, or with shared weights. Raises
    ModelError unless 1 to J parameters are free, each with a free scale, and the filter removes no process."""
    linear, shaped, held = by_kind(model)
    curved, free = divide_shaped(model, shaped)
    count = len(linear) + sum(1 + len(to_find(model.processes[place])) for place in shaped)
    if count == 0:
        raise ModelError(
            f"there is nothing to estimate: every parameter of {model} is fixed",
            advice="Free a parameter by leaving out `fixed(…)`.",
        )
    if count > len(wv):
        raise ModelError(
            f"{model} has {count} free parameters, but the wavelet variance has only {len(wv)} levels",
            advice="Record longer, or use a smaller model.",
        )
    levels, rate, filter = wv.levels, wv.rate, find_filter(wv.filter)
    offset = np.zeros(len(wv))
    for place in held:
        offset += model.processes[place].wavelet_variance(levels, rate, filter)
    shapes = [unit_shape(model.processes[place], levels, rate, filter) for place in linear]
    observed = wv.variance - offset
    weights = matrix if isinstance(matrix, Weights) else Weights(matrix)
    unit, target = weigh(observed, weights)
    return Problem(
        model=model, levels=levels, rate=rate, filter=filter, samples=wv.longest, observed=observed, weights=weights,
        unit=unit, target=target, linear=linear, curved=curved, free=free,
        shapes=np.array(shapes).reshape(len(shapes), len(wv)),
    )  # fmt: skip


def weigh(observed: Vector, weights: Weights) -> tuple[float, Vector]:
    """Return the `unit` of the problem, and the weighted data in this unit."""
    weighted = weights.root @ observed
    largest = float(np.abs(weighted).max())
    unit = 2.0 ** np.floor(np.log2(largest)) if largest > 0 else 1.0
    return unit, weighted / unit


def unit_shape(process: Process, levels: Integers, rate: float, filter: WaveletFilter) -> Vector:
    """Return the variance (J,) of a known shape for scale coefficient 1; ModelError if it is zero."""
    shape = process.unit_shape(levels, rate, filter)
    if not np.any(shape > 0):
        raise ModelError(
            f"the wavelet variance of {process} ({process.title.lower()}) is zero at {rate:g} Hz under the filter "
            f"{filter.name}, which has {filter.vanishing_moments} vanishing moments",
            advice="Leave it out of the model, or use {--filter=haar}."
            if filter.vanishing_moments > 1
            else "Leave it out of the model.",
        )
    return shape


def to_find(process: Process) -> tuple[int, ...]:
    """Return the indices of the free nonlinear parameters of a process."""
    return tuple(k for k, p in enumerate(process.nonlinear_parameters()) if not process.is_fixed(p.name))


def divide_shaped(model: Model, shaped: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Divide processes with a free shape into those of the class with most terms (branch and bound) and others."""
    kinds = {place: type(model.processes[place]) for place in shaped}
    with_search = [kind for kind in kinds.values() if _has_search(kind)]
    chosen = max(with_search, key=lambda kind: (with_search.count(kind), kind.name), default=None)
    curved = tuple(place for place in shaped if kinds[place] is chosen)
    free = sorted((place for place in shaped if kinds[place] is not chosen), key=lambda k: str(model.processes[k]))
    return curved, tuple(free)


@cache
def _has_search(kind: type[Process]) -> bool:
    return len(kind.nonlinear_parameters()) == 1 and bool(kind.search(1024, 1.0))


def by_kind(model: Model) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Return the indices of processes with only a free scale, with a free shape, and with fixed parameters only."""
    linear: list[int] = []
    shaped: list[int] = []
    held: list[int] = []
    for place, process in enumerate(model.processes):
        scale = process.scale_parameter().name
        free = [p.name for p in process.nonlinear_parameters() if not process.is_fixed(p.name)]
        if process.is_fixed(scale):
            if free:
                raise ModelError(
                    f"{process}: {scale} is fixed while {', '.join(free)} is free",
                    advice="Fix {free} too, or free {scale}.", free=tuple(free), scale=scale,
                )  # fmt: skip
            held.append(place)
        else:
            (shaped if free else linear).append(place)
    return tuple(linear), tuple(shaped), tuple(held)
