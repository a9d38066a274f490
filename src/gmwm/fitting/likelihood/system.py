"""State-space matrices of a model for the Kalman filter, their derivatives, and regressors for unknown levels.

Unknowns without a distribution, the level (with a walk's initial value) and the slope of a drift, follow from least
squares after the filter has run, as for an infinite prior variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import MissingTheoryError
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model
from gmwm.theory.statespace import StateSpace, powers

LEVEL = "level"  # label of the constant level of the recording, which a random walk of the model includes
DIFFERENCE_STEP = 0.02
"""Step of sixth-order differences, with an error of about STEP⁶ = 6e-11 (tests/likelihood/test_score.py)."""


@dataclass(frozen=True, eq=False)
class Regressor:
    """A known function of time (`course`, N) with an unknown coefficient, labelled LEVEL or by its term or condition.
    The coefficient is integrated out if `flat` (a level or a condition), else a parameter of the model (a drift)."""

    course: Vector
    label: str
    flat: bool


@dataclass(frozen=True, eq=False)
class TermBlock:
    """One term of a model in the joint state vector, with the states first … last − 1."""

    label: str
    process: Process
    space: StateSpace
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class System:
    """The random terms of a model with values as one state space with a finite initial covariance."""

    blocks: tuple[TermBlock, ...]
    F: Matrix
    Q: Matrix
    H: Vector
    R: float
    P0: Matrix

    @property
    def matrices(self) -> tuple[Matrix, Matrix, Vector, float, Matrix]:
        """F, Q, H, R and P0, in the order of the arguments of the C++ functions."""
        return self.F, self.Q, self.H, self.R, self.P0


def require_state(process: Process) -> None:
    """Raise MissingTheoryError if a process has no state-space form."""
    if not process.has("state_space"):
        raise MissingTheoryError(
            f"{process.name} does not define state_space, which the likelihood and the Kalman filter need",
            advice="Define it if the process has a finite state, or fit the wavelet variance.",
        )


@lru_cache(maxsize=64)
def is_ramp(process: Process, rate: float) -> bool:
    """Return whether a process is deterministic except for its scale, like a drift."""
    unit = type(process).standard(process.nonlinear) if process.nonlinear_parameters() else type(process).standard()
    if not unit.has("state_space"):
        return False
    space = unit.state_space(rate)
    return _certain(space) and bool(np.any(space.m0))


def _certain(space: StateSpace) -> bool:
    """Return whether a state space has no noise and a known initial state."""
    return not (np.any(space.Q) or np.any(space.R) or np.any(space.P0))


def assemble(model: Model, rate: float) -> System:
    """Assemble the state space of the random terms; raises MissingTheoryError if a term has none."""
    blocks, at = [], 0
    for label, process in model.by_term.items():
        require_state(process)
        space = process.state_space(rate)
        if _certain(space) and is_ramp(process, rate):
            continue
        blocks.append(TermBlock(label, process, space=space, first=at, last=at + space.states))
        at += space.states
    joined = StateSpace.sum(block.space for block in blocks)
    return System(
        blocks=tuple(blocks), F=np.ascontiguousarray(joined.F), Q=np.ascontiguousarray(joined.Q),
        H=np.ascontiguousarray(joined.H[0]), R=float(joined.R[0, 0]), P0=_start(joined),
    )  # fmt: skip


def _start(space: StateSpace) -> Matrix:
    """Return the initial covariance of the states: one step for an unknown level, which itself is a regressor."""
    start = np.array(space.P0)
    unknown = space.diffuse
    start[unknown, :] = 0.0
    start[:, unknown] = 0.0
    start[unknown, unknown] = np.diag(space.Q)[unknown]
    return start


def regressors(model: Model, rate: float, samples: int, mean: float | None) -> list[Regressor]:
    """Return the regressors of a model: unknown levels, and drifts whose slope is free."""
    levels, ramps = [], []
    level = mean is None
    for label, process in model.by_term.items():
        if is_ramp(process, rate):
            if not process.is_fixed(process.scale_parameter().name):
                course = type(process).standard(process.nonlinear).mean(np.arange(samples))
                ramps.append(Regressor(np.asarray(course, dtype=np.float64), label, flat=False))
            continue
        space = process.state_space(rate)
        # A term whose scale is fixed at zero has no level; a free scale may become positive.
        wanders = process.scale > 0 or not process.is_fixed(process.scale_parameter().name)
        for state in np.flatnonzero(space.diffuse) if wanders else ():
            course = _course(space, int(state), samples)
            # The level of a random walk is a constant, so a second constant regressor would be redundant.
            level = level and bool(np.any(course != course[0]))
            levels.append(Regressor(course, label, flat=True))
    if level:
        levels.append(Regressor(np.ones(samples), LEVEL, flat=True))
    return [*levels, *ramps]


def _course(space: StateSpace, state: int, samples: int) -> Vector:
    """Return the response H Fᵗ e (N,) of the output to an initial state vector e with a 1 for one state."""
    start = np.zeros(space.states)
    start[state] = 1.0
    if np.array_equal(space.F @ start, start):
        return np.full(samples, space.H[0, state])
    return np.asarray(space.H[0] @ powers(space.F, start, samples))


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of F, Q, H, R and P0 of the joint state space with respect to q coordinates (first axis)."""

    F: Matrix
    Q: Matrix
    H: Matrix
    R: Vector
    P0: Matrix


@dataclass(frozen=True)
class FreeCoordinate:
    """A free coordinate: the number of its term, and of the shape coordinate (None for the logarithm of the scale)."""

    term: int
    shape: int | None = None


def slopes(model: Model, system: System, coordinates: Sequence[FreeCoordinate], rate: float) -> Slopes:
    """Compute the derivatives of the state-space matrices of a model with respect to its coordinates."""
    p, q = system.H.size, len(coordinates)
    out = Slopes(np.zeros((q, p, p)), np.zeros((q, p, p)), H=np.zeros((q, p)), R=np.zeros(q), P0=np.zeros((q, p, p)))
    by_label = {block.label: block for block in system.blocks}
    for k, coordinate in enumerate(coordinates):
        block = by_label[model.terms[coordinate.term]]
        here = slice(block.first, block.last)
        if coordinate.shape is None:
            out.Q[k, here, here], out.R[k], out.P0[k, here, here] = (
                block.space.Q, block.space.R[0, 0], _start(block.space),
            )  # fmt: skip
            continue
        for distance, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
            for sign in (1, -1):
                space = move_shape(block.process, coordinate.shape, sign * distance * DIFFERENCE_STEP).state_space(rate)
                share = sign * weight / (60.0 * DIFFERENCE_STEP)
                out.F[k, here, here] += share * space.F
                out.Q[k, here, here] += share * space.Q
                out.H[k, here] += share * space.H[0]
                out.R[k] += share * space.R[0, 0]
                out.P0[k, here, here] += share * _start(space)
    return out


def move_shape(process: Process, shape: int, distance: float) -> Process:
    """Return a process with one shape coordinate changed by `distance`."""
    z = type(process).coordinates(process.nonlinear.reshape(1, -1))
    z[0, shape] += distance
    return at_shape(process, z[0])


def at_shape(process: Process, z: Vector) -> Process:
    """Return a process with the shape parameters at coordinates z."""
    values = type(process).at_coordinates(np.asarray(z, dtype=np.float64).reshape(1, -1))[0].tolist()
    names = [p.name for p in process.nonlinear_parameters()]
    return process.with_values(**dict(zip(names, values, strict=True)))
