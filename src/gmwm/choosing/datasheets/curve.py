"""Standard errors of the Allan variance of a fitted model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.estimation.intervals import free_shape
from gmwm.fitting.estimation.linearised import COLLINEAR_SINGULAR_VALUE, columns_of, relative_jacobian
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.weighting import square_root
from gmwm.measuring.covariance import Design
from gmwm.theory.processes.base import Process

T = TypeVar("T", float, Vector)

_STEP = 0.01
"""Relative step of the differences of order 6 that approximate derivatives, with an error of about _STEP⁶ = 1e-12."""
UNBOUNDED_HALF_WIDTH = 300.0
"""Largest half width of an interval on a logarithmic scale, because e^300 is near the limit of double precision."""


@dataclass(frozen=True)
class FitCurve:
    """The p free parameters of a fit and their covariance `scatter`, for standard errors of its Allan variance.
    `moving` has each parameter with its process. A name means the logarithm of this parameter. None means the scale of
    a term that is estimated as zero."""

    moving: tuple[tuple[Process, str | None], ...]
    scatter: Matrix
    rate: float

    @classmethod
    def of(cls, fit: Fit, *, sampling: bool = False) -> FitCurve:
        """Return the parameters and covariance of a fit, with terms that act as others replaced, and without spread if
        `sampling`."""
        sandwich = fit.sandwich.sampling if sampling else fit.sandwich
        design, model = Design.of(fit.wavelet_variance), fit.model
        processes = dict(zip(model.terms, model.processes, strict=True))
        names, _ = columns_of(model, {})
        unseen = [
            p.with_values(**{p.scale_parameter().name: p.value_from(1.0)})
            for p in model.processes
            if p.scale == 0 and not p.is_fixed(p.scale_parameter().name) and not free_shape(p)
        ]
        columns = [p.wavelet_variance(design.levels, design.rate, design.filter) for p in unseen]
        root = square_root(fit.weighting_matrix)
        weighted = root @ np.column_stack([relative_jacobian(model, design, names), *columns])
        length = np.linalg.norm(weighted, axis=0)
        length[length == 0] = 1.0
        # The pseudoinverse leaves out directions in which the wavelet variance does not change.
        gain = (np.linalg.pinv(weighted / length, rcond=COLLINEAR_SINGULAR_VALUE) / length[:, None]) @ root
        split = (name.rpartition(".") for name in names)
        moving: list[tuple[Process, str | None]] = [(processes[term], name) for term, _, name in split]
        moving += [(process, None) for process in unseen]
        return cls(tuple(moving), gain @ sandwich.wavelet @ gain.T, design.rate)

    def without_lines(self) -> FitCurve:
        """Return the parameters and covariance without those of oscillations."""
        kept = [k for k, (process, _) in enumerate(self.moving) if process.oscillation() is None]
        return replace(self, moving=tuple(self.moving[k] for k in kept), scatter=self.scatter[np.ix_(kept, kept)])

    def slopes(self, n: int) -> Vector:
        """Return the derivatives (p,) of the Allan variance at n samples with respect to the parameters."""
        return np.array([slope(process, name, n, self.rate) for process, name in self.moving])

    def error(self, slopes: Vector) -> float:
        """Return the standard error of a quantity that has these derivatives (p,) with respect to the parameters."""
        return math.sqrt(max(float(slopes @ self.scatter @ slopes), 0.0))


def slope(process: Process, name: str | None, n: int, rate: float) -> float:
    """Return ∂σ²(n)/∂ ln θ of the Allan variance at n samples for the parameter `name`, or by the scale itself for
    None."""
    return sensitivity(process, name, lambda p: float(p.allan_variance([n], rate)[0]))


def sensitivity(process: Process, name: str | None, of: Callable[[Process], T]) -> T:
    """Return ∂f/∂ ln θ of a variance f (or an array) for the parameter `name`, exact for scales, by differences of
    order 6 for shapes, and with respect to the scale itself for None."""
    if name is None:
        return of(process)
    parameter = next(p for p in process.parameters if p.name == name)
    if parameter.scale_power is not None:
        return parameter.scale_power * of(process)
    at = process.value(name)
    place = [p.name for p in process.nonlinear_parameters()].index(name)
    room = float(process.room(process.nonlinear.reshape(1, -1))[0, place])

    def moved(distance: int) -> T:
        return of(process.with_values(**{name: at + distance * _STEP * room}))

    near, middle, far = (moved(distance) - moved(-distance) for distance in (1, 2, 3))
    return at / (60.0 * _STEP * room) * (45.0 * near - 9.0 * middle + far)
