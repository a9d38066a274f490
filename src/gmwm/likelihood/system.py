"""A model as the Kalman filter takes it: matrices, their derivatives, and what is regressed on.

What is unknown without a distribution enters as a regressor: the constant that each record has (an offset, gravity),
on which a walk's unknown level falls as well; and a drift, whose slope is a parameter. Their coefficients are known by
least squares once the filter has run, exactly as if their variance were infinite.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm._text import is_own
from gmwm.errors import MissingTheoryError
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.statespace import StateSpace, powers

LEVEL = "level"
"""The label of the record's constant mean, where no walk takes it up."""
STEP = 0.02
"""Of a coordinate, in which matrices are differentiated by differences of order 6."""


@dataclass(frozen=True, eq=False)
class Regressor:
    """A known course of which only the size is unknown.

    Attributes
    ----------
    course : (N,) array
    label : str
        LEVEL, or the label of the term it belongs to.
    flat : bool
        Whether its size is integrated out (a level of no interest) rather than estimated (a drift).
    """

    course: Vector
    label: str
    flat: bool


@dataclass(frozen=True, eq=False)
class TermBlock:
    """The block of one term in the joint state: its label, process and state space, and the range of its states."""

    label: str
    process: Process
    space: StateSpace
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class System:
    """The random terms of a model with values, as one state space whose start has a covariance."""

    blocks: tuple[TermBlock, ...]
    F: Matrix
    Q: Matrix
    H: Vector
    R: float
    P0: Matrix

    @property
    def matrices(self) -> tuple[Matrix, Matrix, Vector, float, Matrix]:
        """F, Q, H, R, P0, as the kernels take them."""
        return self.F, self.Q, self.H, self.R, self.P0


def require_state(process: Process) -> None:
    """An error where a process has no state-space form, with the way out."""
    if not process.has("state_space"):
        if not is_own(type(process)):
            raise MissingTheoryError(
                f"{process.name} defines no state_space, which the likelihood and the Kalman filter need; give the "
                "class one if the process has a finite state, or stay with the fit to the wavelet variance"
            )
        raise MissingTheoryError(
            f"{process.name} has no finite state, which the likelihood and the Kalman filter need; take two or three "
            "Gauss-Markov terms in its place, or stay with the fit to the wavelet variance"
        )


def is_ramp(process: Process, rate: float) -> bool:
    """Whether a process has no chance in it, as a drift: its whole course is known but for its size."""
    one = type(process).standard(process.nonlinear) if process.nonlinear_parameters() else type(process).standard()
    if not one.has("state_space"):
        return False
    space = one.state_space(rate)
    return _certain(space) and bool(np.any(space.m0))


def _certain(space: StateSpace) -> bool:
    """Whether there is no chance in it, at these values."""
    return not (np.any(space.Q) or np.any(space.R) or np.any(space.P0))


def assemble(model: Model, rate: float) -> System:
    """The system of a model's random terms at their values.

    Raises
    ------
    MissingTheoryError
        If a term has no state-space form.
    """
    blocks, at = [], 0
    for label, process in zip(model.terms, model.processes, strict=True):
        require_state(process)
        space = process.state_space(rate)
        if _certain(space) and is_ramp(process, rate):
            continue
        blocks.append(TermBlock(label, process, space=space, first=at, last=at + space.states))
        at += space.states
    joined = StateSpace.sum(block.space for block in blocks)
    return System(
        blocks=tuple(blocks),
        F=np.ascontiguousarray(joined.F),
        Q=np.ascontiguousarray(joined.Q),
        H=np.ascontiguousarray(joined.H[0]),
        R=float(joined.R[0, 0]),
        P0=_start(joined),
    )


def _start(space: StateSpace) -> Matrix:
    """P0, with a step's own variance where the level is unknown: a level on top of it is regressed on."""
    start = np.array(space.P0)
    unknown = space.diffuse
    start[unknown, :] = 0.0
    start[:, unknown] = 0.0
    start[unknown, unknown] = np.diag(space.Q)[unknown]
    return start


def regressors(model: Model, rate: float, samples: int, mean: float | None) -> list[Regressor]:
    """What a record of this model is regressed on: levels, and drifts whose slope is not held."""
    found, ramps = [], []
    level = mean is None
    for label, process in zip(model.terms, model.processes, strict=True):
        if is_ramp(process, rate):
            if not process.is_fixed(process.scale_parameter().name):
                course = type(process).standard(process.nonlinear).mean(np.arange(samples))
                ramps.append(Regressor(np.asarray(course, dtype=np.float64), label, flat=False))
            continue
        space = process.state_space(rate)
        # One that is held at zero takes up no level; one that is sought may come to need it.
        wanders = process.scale > 0 or not process.is_fixed(process.scale_parameter().name)
        for state in np.flatnonzero(space.diffuse) if wanders else ():
            course = _course(space, int(state), samples)
            # The level of a walk is a constant, and so is the record's: one of them is enough.
            level = level and bool(np.any(course != course[0]))
            found.append(Regressor(course, label, flat=True))
    if level:
        found.append(Regressor(np.ones(samples), LEVEL, flat=True))
    return [*found, *ramps]


def _course(space: StateSpace, state: int, samples: int) -> Vector:
    """H Fᵗ e, what a state that starts at 1 is seen as."""
    start = np.zeros(space.states)
    start[state] = 1.0
    if np.array_equal(space.F @ start, start):
        return np.full(samples, space.H[0, state])
    return np.asarray(space.H[0] @ powers(space.F, start, samples))


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of a system's matrices by q coordinates: (q, p, p), (q, p, p), (q, p), (q,), (q, p, p)."""

    F: Matrix
    Q: Matrix
    H: Matrix
    R: Vector
    P0: Matrix


@dataclass(frozen=True)
class Coordinate:
    """One number that is sought: the logarithm of a term's scale coefficient, or a coordinate of its shape."""

    term: int
    shape: int | None = None


def slopes(model: Model, system: System, coordinates: Sequence[Coordinate], rate: float) -> Slopes:
    """Derivatives of the system by the coordinates of its model's terms."""
    p, q = system.H.size, len(coordinates)
    out = Slopes(np.zeros((q, p, p)), np.zeros((q, p, p)), H=np.zeros((q, p)), R=np.zeros(q), P0=np.zeros((q, p, p)))
    by_label = {block.label: block for block in system.blocks}
    for k, coordinate in enumerate(coordinates):
        block = by_label[model.terms[coordinate.term]]
        here = slice(block.first, block.last)
        if coordinate.shape is None:
            out.Q[k, here, here], out.R[k], out.P0[k, here, here] = (
                block.space.Q,
                block.space.R[0, 0],
                _start(block.space),
            )
            continue
        for distance, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            for sign in (1, -1):
                space = moved(block.process, coordinate.shape, sign * distance * STEP).state_space(rate)
                share = sign * weight / (60.0 * STEP)
                out.F[k, here, here] += share * space.F
                out.Q[k, here, here] += share * space.Q
                out.H[k, here] += share * space.H[0]
                out.R[k] += share * space.R[0, 0]
                out.P0[k, here, here] += share * _start(space)
    return out


def moved(process: Process, shape: int, distance: float) -> Process:
    """The process with one coordinate of its shape moved."""
    z = type(process).coordinates(process.nonlinear.reshape(1, -1))
    z[0, shape] += distance
    return at_shape(process, z[0])


def at_shape(process: Process, z: Vector) -> Process:
    """The process with the coordinates of its shape at z."""
    values = type(process).at_coordinates(np.asarray(z, dtype=np.float64).reshape(1, -1))[0].tolist()
    names = [p.name for p in process.nonlinear_parameters()]
    return process.with_values(**dict(zip(names, values, strict=True)))
