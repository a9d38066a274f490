"""Error equations of unaided inertial navigation, and the mean squares of the errors that sensor noise causes.

For a level vehicle at rest, with x north, y east and z down, small errors of attitude φ, velocity v and position p obey

    dφ/dt = −ω × φ + δω − e_g,    dv/dt = f × φ − 2ω × v + δg + e_a,    dp/dt = v.

e_g and e_a are the errors of the sensors, ω = Ω (cos L, 0, −sin L) the rotation of the Earth at latitude L, δω its
error from v, p and the radius R (Schuler oscillation, 84 min), f = (0, 0, −g), and δg = (0, 0, 2g/R) p_z. Accelerations
of the vehicle are not included. Titterton and Weston (2004), Strapdown Inertial Navigation Technology, 2nd ed., chapter
12."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gmwm.base.arrays import Matrix, Vector, as_rate
from gmwm.base.axis_names import AXES
from gmwm.base.errors import GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.units import SI_UNIT
from gmwm.choosing.datasheets.bias import FitCurve
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.choosing.datasheets.limits import variance_limit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks, start_at_zero
from gmwm.theory.processes.model import Model, as_model
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
    at_start: Vector  # (q,) errors n at the start per unit of the bias e that the rest before gives
    removed: bool  # whether this bias is subtracted from the sensor

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


def mean_squares(
    process: Process, rate: float, motion: Response, steps: Sequence[int], *, rest: int = 0, gain: float = 0.0
) -> Matrix:
    """Return the mean squares (T, q) of the errors that a process causes after each number of samples, in ascending
    order. After a rest, the noise is old: its start has no effect on a sensor whose estimated bias is removed. The tilt
    from levelling, and all errors without a rest, are those since a known bias: all noise except oscillations is zero
    at the start. `gain` is that of the filter that estimates the bias in the rest."""
    if not rest:
        return _mean_squares(start_at_zero(process, rate), rate, motion, steps, (0, gain))
    squares = _mean_squares(process.state_space(rate), rate, motion, steps, (rest, gain))
    if np.any(motion.at_start):
        known = _mean_squares(start_at_zero(process, rate), rate, motion, steps, (rest, gain))
        squares[:, :3] = known[:, :3]
    return squares


def _mean_squares(
    space: StateSpace, rate: float, motion: Response, steps: Sequence[int], rest_and_gain: tuple[int, float]
) -> Matrix:
    p, q = space.states, motion.drive.size
    moment = np.zeros((p + 1 + q, p + 1 + q))
    moment[:p, :p] = space.P0 + np.outer(space.m0, space.m0)
    rest, gain = rest_and_gain
    if rest:
        # The gain of a filter that starts without a bias is 1/k until its time constant, and constant after it.
        first = min(rest, max(1, round(1 / gain))) if gain > 0 else rest
        moment = _Powers(*_resting(space, 1 / first, 1.0, q)).after(moment, first)
        moment = _Powers(*_resting(space, gain, 1 - gain, q)).after(moment, rest - first)
        turn = np.eye(p + 1 + q)
        turn[p + 1 :, p] = motion.at_start
        moment = turn @ moment @ turn.T
    moving = _Powers(*_moving(space, motion, 1.0 / rate))
    squares, at = np.empty((len(steps), q)), 0
    for k, step in enumerate(steps):
        moment = moving.after(moment, step - at)
        squares[k], at = np.diag(moment)[p + 1 :], step
    return np.maximum(squares, 0.0)


def _resting(space: StateSpace, gain: float, keep: float, q: int) -> tuple[Matrix, Matrix]:
    """Return the transition matrix and noise covariance of (x, m, n) for one sample of the rest. x are the states of
    the process, m is the estimated bias, and n are the q navigation errors, still zero."""
    p = space.states
    transition, noise = np.eye(p + 1 + q), np.zeros((p + 1 + q, p + 1 + q))
    transition[:p, :p], transition[p, :p], transition[p, p] = space.F, gain * space.H[0], keep
    noise[:p, :p], noise[p, p] = space.Q, gain**2 * space.R[0, 0]
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


@dataclass(frozen=True, eq=False)
class BudgetAxis:
    """The noise of one axis."""

    axis: str
    terms: Mapping[str, Process]  # the terms of the model that are not zero
    rate: float  # Hz
    # the estimated parameters and their covariance; None if the values were given, or have no standard errors
    curve: FitCurve | None = None
    wavelet_variance: WaveletVariance | None = None  # that of the recording; None if the values were given
    longest: float = np.inf  # longest averaging time (s) of the recording; infinite if the values were given

    @classmethod
    def of(cls, axis: str, source: Fit | Model | Process | str, rate: float | None) -> BudgetAxis:
        """Return the noise of an axis from a fit, or from a model with all values and its sampling rate (Hz)."""
        if axis not in AXES:
            raise OptionError(argument="axis", expected=f"one of {', '.join(AXES)}", got=axis)
        if isinstance(source, Fit):
            wv = source.wavelet_variance
            si = SI_UNIT["gyro" if axis.startswith("gyro") else "accel"]
            if wv.unit != si:
                raise ModelError(
                    f"{axis} is in {wv.unit or 'an unknown unit'} instead of {si}",
                    advice="Read the recording again with {--units}.",
                )
            try:
                curve = FitCurve.of(source)
            except GmwmError:
                curve = None
            terms = dict(zip(source.model.terms, source.model.processes, strict=True))
            return cls(
                axis, _present(axis, terms, wv.rate), wv.rate, curve, wavelet_variance=wv, longest=float(wv.tau[-1]) / 2
            )
        model = as_model(source)
        missing = [name for name, value in model.parameters.items() if value is None]
        if missing:
            raise ModelError(
                f"the error budget of {model} needs a value for {', '.join(missing)}",
                advice="Write the values into the model, or calibrate a recording.",
            )
        if rate is None:
            raise OptionError(argument="rate", expected="the sampling rate (Hz), because a model has none", got=rate)
        rate = as_rate(rate)
        return cls(axis, _present(axis, dict(zip(model.terms, model.processes, strict=True)), rate), rate)

    def remarks(self, duration: float) -> tuple[Remark, ...]:
        """Return remarks if the duration (s) exceeds the recording, or if the state space of a term is approximate."""
        model = Model(tuple(self.terms.values())) if self.terms else None
        remarks = () if model is None else approximation_remarks(model, self.rate, self.axis)
        if duration <= self.longest:
            return remarks
        facts = {"duration": Quantity(duration, "s"), "longest": Quantity(self.longest, "s")}
        return (Remark.of("budget-extrapolated", self.axis, **facts), *remarks)

    def mean_squares(self, motion: Response, times: Sequence[float], rest: float) -> dict[str, Matrix]:
        """Return the mean square (T, q) of the errors that each term causes at T times (s) after a rest (s)."""
        return {label: self._of(process, motion, times, rest) for label, process in self.terms.items()}

    def errors(self, motion: Response, times: Sequence[float], rest: float, terms: Mapping[str, Matrix]) -> Matrix:
        """Return the standard errors (T, q) of the sum of the mean squares `terms`; zero if the values were given."""
        if self.curve is None or not self.curve.moving:
            return np.zeros((len(times), motion.drive.size))
        squares = {id(process): terms[label] for label, process in self.terms.items()}

        def slope(process: Process, name: str | None) -> Matrix:
            """Return the derivative (T, q) of the mean squares by the logarithm of a parameter, or by a zero scale."""
            if name is None:
                return self._of(process, motion, times, rest)
            parameter = next(p for p in process.parameters if p.name == name)
            if parameter.scale_power is not None:
                return parameter.scale_power * squares[id(process)]
            value = process.value(name)
            # Relative error of the derivatives: about 1e-6.
            moved = [process.with_values(**{name: value * (1 + side * 1e-3)}) for side in (1, -1)]
            upper, lower = (self._of(variant, motion, times, rest) for variant in moved)
            return (upper - lower) / (2 * 1e-3)

        slopes = np.array([slope(process, name) for process, name in self.curve.moving])
        variance = np.einsum("iab,ij,jab->ab", slopes, self.curve.scatter, slopes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def limits(self, motion: Response, times: Sequence[float], rest: float) -> Matrix:
        """Return the largest mean squares (T, q) that the measured wavelet variance allows; infinite without one."""
        if self.wavelet_variance is None:
            return np.full((len(times), motion.drive.size), np.inf)
        processes = [p for p in self.terms.values() if p.oscillation() is None]
        return variance_limit(self.wavelet_variance, processes, lambda p: self._of(p, motion, times, rest))

    def _of(self, process: Process, motion: Response, times: Sequence[float], rest: float) -> Matrix:
        steps = [max(1, round(time * self.rate)) for time in times]
        return mean_squares(process, self.rate, motion, steps, rest=round(rest * self.rate), gain=self.gain)

    @cached_property
    def gain(self) -> float:
        """Gain per sample of a filter with N and K of the axis; 0, for the mean of all samples, without K."""
        try:
            return filter_numbers(self.terms.values(), self.rate).gain.g if self.terms else 0.0
        except MissingTheoryError:
            return 0.0


def _present(axis: str, terms: Mapping[str, Process], rate: float) -> dict[str, Process]:
    """Return the terms that are not zero. Raises a MissingTheoryError if one of them has no state-space form."""
    present = {label: process for label, process in terms.items() if process.scale > 0}
    try:
        for process in present.values():
            process.state_space(rate)
    except MissingTheoryError as error:
        raise error.at(axis) from error
    return present
