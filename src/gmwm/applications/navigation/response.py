"""Error equations of unaided inertial navigation, and the mean squares of the errors that sensor noise causes.

For a level vehicle at rest, with x north, y east and z down, small errors of attitude φ, velocity v and position p obey

    dφ/dt = −ω × φ + δω − e_g,    dv/dt = f × φ − 2ω × v + δg + e_a,    dp/dt = v.

e_g and e_a are the errors of the sensors, ω = Ω (cos L, 0, −sin L) the rotation of the Earth at latitude L, δω its
error from v, p and the radius R (Schuler oscillation, 84 min), f = (0, 0, −g), and δg = (0, 0, 2g/R) p_z. Accelerations
of the vehicle are not included. Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd ed., chapter
12."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.axis_names import AXES
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import start_at_zero
from gmwm.theory.statespace import StateSpace

EARTH_RADIUS_M = 6.371e6
"""Mean radius of the Earth (m)."""
EARTH_RATE = 7.292115e-5
"""Rotation rate of the Earth (rad/s), WGS 84."""


@dataclass(frozen=True, eq=False)
class Response:
    """Linear system dn/dt = a n + drive e for the navigation errors n that the error e of one sensor causes."""

    a: Matrix  # (q, q) system matrix, in 1/s
    drive: Vector  # (q,) effect of e on the derivative of each error
    at_start: Vector  # (q,) errors n at the start per unit of the mean of e over the rest before
    removed: bool  # whether the mean over the rest is subtracted from the sensor

    def step(self, dt: float) -> tuple[Matrix, Vector]:
        """Return the transition matrix over a sample of `dt` (s), and the effect of a constant e during the sample."""
        from scipy.linalg import expm

        q = self.drive.size
        joint = np.zeros((q + 1, q + 1))
        joint[:q, :q], joint[:q, q] = self.a, self.drive
        joint = expm(joint * dt)
        return joint[:q, :q], joint[:q, q]


def navigation(axis: str, gravity: float, latitude: float) -> Response:
    """Return the error equations of (φ, v, p) for the sensor of one axis. The latitude is in rad."""
    sine, cosine = math.sin(latitude), math.cos(latitude)
    earth = EARTH_RATE * np.array([cosine, 0.0, -sine])
    a = np.zeros((9, 9))
    a[:3, :3] = -_cross_matrix(earth)
    a[:3, 3:6] = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -sine / cosine, 0.0]]) / EARTH_RADIUS_M
    a[:3, 6] = EARTH_RATE * np.array([-sine, 0.0, -cosine]) / EARTH_RADIUS_M
    a[3:6, :3] = _cross_matrix(np.array([0.0, 0.0, -gravity]))
    a[3:6, 3:6] = -2.0 * _cross_matrix(earth)
    a[5, 8] = 2.0 * gravity / EARTH_RADIUS_M
    a[6:, 3:6] = np.eye(3)
    place = AXES.index(axis)
    drive, at_start = np.zeros(9), np.zeros(9)
    drive[place] = -1.0 if place < 3 else 1.0
    # Levelling chooses the tilt so that the mean m of the horizontal accelerometers becomes zero: f × φ = −m.
    if axis == "accel_x":
        at_start[1] = -1.0 / gravity
    if axis == "accel_y":
        at_start[0] = 1.0 / gravity
    return Response(a, drive, at_start, removed=axis not in ("accel_x", "accel_y"))


MEAN = Response(np.zeros((1, 1)), np.ones(1), np.zeros(1), removed=False)
"""Response that integrates the error of a sensor. The integral divided by the time is its mean."""


def _cross_matrix(v: Vector) -> Matrix:
    """Return the (3, 3) matrix M with M u = v × u for every vector u."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def mean_squares(process: Process, rate: float, motion: Response, steps: Sequence[int], *, rest: int = 0) -> Matrix:
    """Return the mean squares (T, q) of the errors that a process causes after each number of samples, in ascending
    order. Stationary processes start in their stationary distribution. Random walks start at zero, and so does flicker
    noise if there is no rest. After a rest whose mean is removed, the time at which flicker noise starts has no effect,
    except on the tilt from levelling. For this tilt, it is assumed to start at zero at the beginning of the rest."""
    if rest and process.approximate and not process.stationary:
        old = _mean_squares(process.state_space(rate), rate, motion, steps, rest=rest)
        if np.any(motion.at_start):
            old[:, :3] = _mean_squares(start_at_zero(process, rate), rate, motion, steps, rest=rest)[:, :3]
        return old
    return _mean_squares(start_at_zero(process, rate), rate, motion, steps, rest=rest)


def _mean_squares(space: StateSpace, rate: float, motion: Response, steps: Sequence[int], *, rest: int) -> Matrix:
    p, q = space.states, motion.drive.size
    moment = np.zeros((p + 1 + q, p + 1 + q))
    moment[:p, :p] = space.P0 + np.outer(space.m0, space.m0)
    if rest:
        moment = _Powers(*_resting(space, rest, q)).after(moment, rest)
        turn = np.eye(p + 1 + q)
        turn[p + 1 :, p] = motion.at_start
        moment = turn @ moment @ turn.T
    moving = _Powers(*_moving(space, motion, 1.0 / rate))
    squares, at = np.empty((len(steps), q)), 0
    for k, step in enumerate(steps):
        moment = moving.after(moment, step - at)
        squares[k], at = np.diag(moment)[p + 1 :], step
    return np.maximum(squares, 0.0)


def _resting(space: StateSpace, rest: int, q: int) -> tuple[Matrix, Matrix]:
    """Return the transition matrix and noise covariance of (x, m, n) for one sample of the rest. x are the states of
    the process, m is its mean over the rest so far, and n are the q navigation errors, still zero."""
    p = space.states
    transition, noise = np.eye(p + 1 + q), np.zeros((p + 1 + q, p + 1 + q))
    transition[:p, :p], transition[p, :p] = space.F, space.H[0] / rest
    noise[:p, :p], noise[p, p] = space.Q, space.R[0, 0] / rest**2
    return transition, noise


def _moving(space: StateSpace, motion: Response, dt: float) -> tuple[Matrix, Matrix]:
    """Return the transition matrix and noise covariance of (x, m, n), as in `_resting`, for a sample of navigation."""
    p, q = space.states, motion.drive.size
    motion_step, drive = motion.step(dt)
    transition, noise = np.eye(p + 1 + q), np.zeros((p + 1 + q, p + 1 + q))
    transition[:p, :p], transition[p + 1 :, p + 1 :] = space.F, motion_step
    transition[p + 1 :, :p] = np.outer(drive, space.H[0])
    if motion.removed:
        transition[p + 1 :, p] = -drive
    noise[:p, :p], noise[p + 1 :, p + 1 :] = space.Q, np.outer(drive, drive) * space.R[0, 0]
    return transition, noise


class _Powers:
    """Linear system whose second moment after many steps is computed by repeated squaring."""

    def __init__(self, transition: Matrix, noise: Matrix) -> None:
        self.powers = [(transition, noise)]

    def after(self, moment: Matrix, count: int) -> Matrix:
        """Return the second moment of the state after `count` steps that start from `moment`."""
        for k in range(count.bit_length()):
            if k == len(self.powers):
                transition, noise = self.powers[-1]
                self.powers.append((transition @ transition, transition @ noise @ transition.T + noise))
            if count >> k & 1:
                transition, noise = self.powers[k]
                moment = transition @ moment @ transition.T + noise
        return moment
