"""Standard errors of the Allan variance of a fitted model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.covariance import Design
from gmwm.estimation.linearised import COLLINEAR, columns_of, relative_jacobian
from gmwm.estimation.result import Fit
from gmwm.estimation.weighting import square_root
from gmwm.inference.intervals import free_shape
from gmwm.processes.base import Process

_STEP = 0.01
"""Relative step of the differences of order 6 for derivatives, whose error is about _STEP⁶ = 1e-12."""
ENDLESS = 300.0
"""Largest half width of an interval on the logarithm; e^300 is near the limit of double precision."""


@dataclass(frozen=True)
class Curve:
    """The free parameters of a fit and their covariance, for standard errors of its Allan variance.

    Parameters
    ----------
    moving : tuple of (process, parameter name or None)
        Logarithms of parameters, or (with None) the scale coefficients of terms that are zero.
    scatter : (p, p) array
        Covariance of the estimates of these.
    rate : float
        Sampling rate (Hz).
    """

    moving: tuple[tuple[Process, str | None], ...]
    scatter: Matrix
    rate: float

    @classmethod
    def of(cls, fit: Fit, *, sampling: bool = False) -> Curve:
        """Make the curve of a fit that has no terms that act as another process.

        With `sampling`, the covariance does not include the spread between recordings.
        """
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
        # Directions that do not change the curve are left out.
        gain = (np.linalg.pinv(weighted / length, rcond=COLLINEAR) / length[:, None]) @ root
        split = (name.rpartition(".") for name in names)
        moving: list[tuple[Process, str | None]] = [(processes[term], name) for term, _, name in split]
        moving += [(process, None) for process in unseen]
        return cls(tuple(moving), gain @ sandwich.wavelet @ gain.T, design.rate)

    def without_lines(self) -> Curve:
        """Return the curve of the noise alone, without sinusoids."""
        kept = [k for k, (process, _) in enumerate(self.moving) if process.line(self.rate) is None]
        return replace(self, moving=tuple(self.moving[k] for k in kept), scatter=self.scatter[np.ix_(kept, kept)])

    def slopes(self, n: int) -> Vector:
        """Return derivatives (p,) of σ²(n) at n samples."""
        return np.array([slope(process, name, n, self.rate) for process, name in self.moving])

    def error(self, slopes: Vector) -> float:
        """Return the standard error of a quantity with these derivatives (p,)."""
        return math.sqrt(max(float(slopes @ self.scatter @ slopes), 0.0))


def slope(process: Process, name: str | None, n: int, rate: float) -> float:
    """Return ∂σ²(n)/∂ ln θ for one process."""
    return sensitivity(process, name, lambda p: float(p.allan_variance([n], rate)[0]))


def sensitivity(process: Process, name: str | None, of: Callable[[Process], float]) -> float:
    """Return ∂f/∂ ln θ of a variance f of one process: exact for the scale, by differences of order 6 for the shape."""
    if name is None:
        return of(process)
    parameter = next(p for p in process.parameters if p.name == name)
    if parameter.scale_power is not None:
        return parameter.scale_power * of(process)
    at = process.value(name)
    place = [p.name for p in process.nonlinear_parameters()].index(name)
    room = float(process.room(process.nonlinear.reshape(1, -1))[0, place])
    total = 0.0
    for distance, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        for sign in (1, -1):
            moved = process.with_values(**{name: at + sign * distance * _STEP * room})
            total += sign * weight * of(moved)
    return at * total / (60.0 * _STEP * room)
