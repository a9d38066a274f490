"""The estimation problem as geometry: a target, fixed vectors, a curve, and surfaces, all weighted by Ω."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix, Vector
from gmwm.errors import ModelError
from gmwm.estimation.weighting import square_root
from gmwm.filters import WaveletFilter, find_filter
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.variance.result import WaveletVariance

ROUNDING = 8 * float(np.finfo(np.float64).eps)
"""Relative error of each product L_jk ν_k² in the residual: up to 2 ε on exact curves, under either weighting."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Find non-negative scales of the linear processes, and scales and shapes of the others.

    The criterion (ν̂ − ν)ᵀ Ω (ν̂ − ν) is `unit`² |target − Σ c a − Σ x g|², where the vectors a and g have length
    one and `unit` is a power of two, so that data scaled by a power of two give the same problem to the last bit.

    Attributes
    ----------
    linear : tuple of int
        Places in the model of the processes that have no nonlinear parameter to find.
    curved : tuple of int
        Places of those with one, along which there is a search; all of one class.
    free : tuple of int
        Places of the others, whose shapes are found from starting values; by name, whatever their order in the sum.
    shapes : (n linear, J) array
        Wavelet variances of the linear processes at unit scale.
    observed : (J,) array, in the signal's unit²
        ν̂² less the wavelet variance of the processes that are held.
    root : (J, J) array
        L with LᵀL = Ω.
    """

    model: Model
    levels: NDArray[np.int64]
    rate: float
    filter: WaveletFilter
    samples: int
    observed: Vector
    matrix: Matrix
    root: Matrix
    unit: float
    target: Vector
    linear: tuple[int, ...]
    curved: tuple[int, ...]
    free: tuple[int, ...]
    shapes: Matrix

    @property
    def shaped(self) -> tuple[int, ...]:
        """Places of all processes with a shape to find, the curved ones first."""
        return (*self.curved, *self.free)

    @property
    def curved_class(self) -> type[Process] | None:
        """The class of the curved processes."""
        return type(self.model.processes[self.curved[0]]) if self.curved else None

    @property
    def fixed(self) -> Matrix:
        """Unit vectors of the linear processes, row by row."""
        return self.weighted(self.shapes)

    @property
    def positive(self) -> Vector:
        """z whose inner product with every weighted wavelet variance is positive: L⁻ᵀ √diag Ω."""
        return np.ascontiguousarray(np.linalg.solve(self.root.T, np.sqrt(np.diag(self.matrix))))

    @cached_property
    def rounding(self) -> float:
        """Length of the rounding error of the residual, in units of `target`."""
        size = np.linalg.norm(np.abs(self.root) @ np.abs(self.observed))
        return ROUNDING * float(size) / self.unit

    def as_low(self, objective: float, least: float, share: float) -> bool:
        """Whether an objective exceeds `least` by no more than this share and the rounding error of the residual.

        Objectives of data that follow the model exactly are rounding errors squared: a share alone would let the
        processor's order of summation decide.
        """
        return objective <= (1 + share) * (sqrt(least) + self.rounding) ** 2

    def under(self, matrix: Matrix) -> Problem:
        """The same problem under another weighting matrix Ω."""
        root, unit, target = _weighed(self.observed, matrix)
        return replace(self, matrix=matrix, root=root, unit=unit, target=target)

    def observing(self, observed: Vector) -> Problem:
        """The same problem for other data."""
        _, unit, target = _weighed(observed, self.matrix)
        return replace(self, observed=observed, unit=unit, target=target)

    def weighted(self, shapes: Matrix) -> Matrix:
        """L times each row, scaled to length one."""
        rows = shapes @ self.root.T
        return np.ascontiguousarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))

    def scales(self, shapes: Matrix, weights: Vector) -> Vector:
        """Scale coefficients of processes from the weights of their unit vectors."""
        return np.asarray(weights * self.unit / np.linalg.norm(shapes @ self.root.T, axis=1))


def pose(model: Model, wv: WaveletVariance, matrix: Matrix) -> Problem:
    """The problem of fitting `model` to `wv` under the weighting matrix Ω.

    Raises
    ------
    ModelError
        If the model has nothing to estimate, or more parameters than there are levels, or a scale that is held
        while the shape it multiplies is to be found; or if the filter does not see one of the processes.
    """
    linear, shaped, held = _sorted_out(model)
    curved, free = _searched(model, shaped)
    count = len(linear) + sum(1 + len(to_find(model.processes[place])) for place in shaped)
    if count == 0:
        raise ModelError(f"nothing to estimate: every parameter of {model} is held; free one by leaving out fixed(…)")
    if count > len(wv):
        raise ModelError(
            f"{model} has {count} parameters to estimate, but the wavelet variance has only {len(wv)} levels; "
            "record longer, or take a smaller model"
        )
    levels, rate, filter = wv.levels, wv.rate, find_filter(wv.filter)
    known = np.zeros(len(wv))
    for place in held:
        known += model.processes[place].wavelet_variance(levels, rate, filter)
    shapes = [_shape(model.processes[place], levels, rate, filter) for place in linear]
    observed = wv.variance - known
    root, unit, target = _weighed(observed, matrix)
    return Problem(
        model=model,
        levels=levels,
        rate=rate,
        filter=filter,
        samples=wv.longest,
        observed=observed,
        matrix=matrix,
        root=root,
        unit=unit,
        target=target,
        linear=linear,
        curved=curved,
        free=free,
        shapes=np.array(shapes).reshape(len(shapes), len(wv)),
    )


def _weighed(observed: Vector, matrix: Matrix) -> tuple[Matrix, float, Vector]:
    root = square_root(matrix)
    weighted = root @ observed
    largest = float(np.abs(weighted).max())
    unit = 2.0 ** np.floor(np.log2(largest)) if largest > 0 else 1.0
    return root, unit, weighted / unit


def _shape(process: Process, levels: NDArray[np.int64], rate: float, filter: WaveletFilter) -> Vector:
    shape = np.asarray(process.shape(process.nonlinear.reshape(1, -1), levels, rate, filter)[0])
    if not np.any(shape > 0):
        way = ", or measure with filter='haar'" if filter.vanishing_moments > 1 else ""
        raise ModelError(
            f"{process} ({process.title.lower()}) leaves no trace at {rate:g} Hz under filter={filter.name!r}, whose "
            f"{filter.vanishing_moments} vanishing moments remove what it is: leave it out of the model{way}"
        )
    return shape


def to_find(process: Process) -> tuple[int, ...]:
    """Which of a process' nonlinear parameters are to be estimated, by number."""
    return tuple(k for k, p in enumerate(process.nonlinear_parameters()) if not process.is_fixed(p.name))


def _searched(model: Model, shaped: tuple[int, ...]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Places of the processes along whose one parameter there is a search, and of all others.

    The search is along the curve of one class. Should there be two, it is that which the model has more terms of.
    """
    kinds = {place: type(model.processes[place]) for place in shaped}
    with_search = [kind for kind in kinds.values() if len(kind.nonlinear_parameters()) == 1 and kind.search(1024, 1.0)]
    chosen = max(with_search, key=lambda kind: (with_search.count(kind), kind.name), default=None)
    curved = tuple(place for place in shaped if kinds[place] is chosen)
    free = sorted((place for place in shaped if kinds[place] is not chosen), key=lambda k: str(model.processes[k]))
    return curved, tuple(free)


def _sorted_out(model: Model) -> tuple[tuple[int, ...], tuple[int, ...], tuple[int, ...]]:
    """Places of the processes that are linear in what is to be found, have a shape to be found, and are held."""
    linear: list[int] = []
    shaped: list[int] = []
    held: list[int] = []
    for place, process in enumerate(model.processes):
        scale = process.scale_parameter().name
        free = [p.name for p in process.nonlinear_parameters() if not process.is_fixed(p.name)]
        if process.is_fixed(scale):
            if free:
                raise ModelError(
                    f"{process}: {scale} is held while {', '.join(free)} is to be estimated; "
                    f"hold {', '.join(free)} too, or free {scale}"
                )
            held.append(place)
        else:
            (shaped if free else linear).append(place)
    return tuple(linear), tuple(shaped), tuple(held)
