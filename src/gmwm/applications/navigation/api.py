"""Error budget of unaided inertial navigation: its error equations, and the mean squares of the errors.

For a level vehicle at rest (x north, y east, z down), errors of attitude φ, velocity v and position p obey

    dφ/dt = −ω × φ + δω − e_g,    dv/dt = f × φ − 2ω × v + δg + e_a,    dp/dt = v,

with sensor errors e_g, e_a, Earth rate ω = Ω (cos L, 0, −sin L), its error δω by v, p and radius R (Schuler, 84 min), f
= (0, 0, −g), δg = (0, 0, 2g/R) p_z, and no accelerations. Titterton and Weston (2004), Strapdown Inertial Navigation
Technology, 2nd ed., chapter 12."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from statistics import NormalDist

import numpy as np

from gmwm.applications.navigation.result import Budget, Growth
from gmwm.base.arrays import Matrix, Vector, as_rate, freeze
from gmwm.base.errors import GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.time_base import parse_length
from gmwm.base.units import AXES, SI_UNIT, STANDARD_GRAVITY
from gmwm.choosing.datasheets.bias import FitCurve
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.choosing.datasheets.limits import WIDEST_INTERVAL, variance_limit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks, start_at_zero
from gmwm.theory.processes.model import Model, as_model
from gmwm.theory.processes.validation import require_values
from gmwm.theory.statespace import StateSpace

EARTH_RADIUS_M = 6.371e6  # mean radius of the Earth (m)
EARTH_RATE = 7.292115e-5  # rotation rate of the Earth (rad/s), WGS 84


@dataclass(frozen=True, eq=False)
class Response:
    """Linear system dn/dt = a n + drive e for the navigation errors n that the error e of one sensor causes."""

    a: Matrix  # (q, q) system matrix, in 1/s
    drive: Vector  # (q,) effect of e on the derivative of each error
    at_start: Vector  # (q,) errors n at the start per unit of the bias e that the rest before gives
    removed: bool  # whether this bias is subtracted from the sensor


@lru_cache(maxsize=16)
def _step(motion: Response, dt: float) -> tuple[Matrix, Vector]:
    """Return the transition matrix over a sample of `dt` (s), and the effect of a constant e during the sample."""
    q = motion.drive.size
    joint = np.zeros((q + 1, q + 1))
    joint[:q, :q], joint[:q, q] = motion.a, motion.drive
    joint = freeze(scipy.linalg.expm(joint * dt))
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
        return _mean_squares(start_at_zero(process, rate), rate, motion, steps, start=(0, gain))
    squares = _mean_squares(process.state_space(rate), rate, motion, steps, start=(rest, gain))
    if np.any(motion.at_start):
        from_zero = _mean_squares(start_at_zero(process, rate), rate, motion, steps, start=(rest, gain))
        squares[:, :3] = from_zero[:, :3]
    return squares


def _mean_squares(
    space: StateSpace, rate: float, motion: Response, steps: Sequence[int], *, start: tuple[int, float]
) -> Matrix:
    p, q = space.states, motion.drive.size
    moment = np.zeros((p + 1 + q, p + 1 + q))
    moment[:p, :p] = space.P0 + np.outer(space.m0, space.m0)
    rest, gain = start
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
    motion_step, drive = _step(motion, dt)
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
    wavelet_variance: WaveletVariance | None = None  # the curve of the recording; None if the values were given
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
            terms = source.model.by_term
            return cls(
                axis, _present(axis, terms, wv.rate), wv.rate, curve, wavelet_variance=wv, longest=float(wv.tau[-1]) / 2
            )
        model = as_model(source)
        require_values(model, "the error budget", "Write the values into the model, or calibrate a recording.")
        if rate is None:
            raise OptionError(argument="rate", expected="the sampling rate (Hz), because a model has none", got=rate)
        rate = as_rate(rate)
        return cls(axis, _present(axis, model.by_term, rate), rate)

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


GRAVITY = STANDARD_GRAVITY  # default gravity (m/s²)
LATITUDE = 45.0  # default latitude (deg)
REST_S = 60.0
"""Default time at rest before navigation (s), after which most filters know the biases (docs/howto/budget.md)."""
_DEGREE = math.pi / 180

_ERRORS = {
    "tilt_x": ("tilt about x", "deg", {"gyro_x"}), "tilt_y": ("tilt about y", "deg", {"gyro_y"}),
    "heading": ("heading", "deg", {"gyro_z"}), "velocity_x": ("velocity along x", "m/s", {"gyro_y", "accel_x"}),
    "velocity_y": ("velocity along y", "m/s", {"gyro_x", "accel_y"}),
    "velocity_z": ("vertical velocity", "m/s", {"accel_z"}),
    "position_x": ("position along x", "m", {"gyro_y", "accel_x"}),
    "position_y": ("position along y", "m", {"gyro_x", "accel_y"}), "position_z": ("height", "m", {"accel_z"}),
}  # fmt: skip
"""Title and unit of each error, and the axes of which at least one is needed, in the order of the error equations."""


def budget(
    noise: Mapping[str, Fit | Model | Process | str], duration: float | str, *, rate: float | None = None,
    rest: float | str = REST_S, latitude: float = LATITUDE, gravity: float = GRAVITY, level: float = 0.95,
) -> Budget:  # fmt: skip
    """Compute how attitude, velocity and position errors of unaided inertial navigation grow.

    The vehicle is level and at rest, with x north, y east and z down. One rule holds for all terms: the biases at the
    start are those that a filter with N and K of the axis knows after a rest. It is the mean over the rest, or over the
    last N/K seconds of a longer one, with exponential weights. The filter subtracts the bias from the gyroscopes and
    from the vertical accelerometer, and levels the vehicle with the horizontal accelerometers. The biases of the
    horizontal accelerometers when the rest begins are constant biases, which are not part of a noise model, so that the
    budget does not include their tilt. With `rest` = 0, all biases are known exactly at the start. Slow noise of the
    same curve has the same budget, whether it is a random walk, flicker noise or a Gauss-Markov process.

    The error equations are linear. They include the effect of gravity on a tilted vehicle, the Schuler oscillation and
    the rotation of the Earth, but no accelerations of the vehicle. Strapdown integrations of simulated sensors agree
    within 5 % from 1 s to 1 h (docs/validation/budget.md). Vertical errors are only given up to 100 s, because
    second-order effects of the tilt, which are not included, exceed them after that.

    Parameters
    ----------
    noise : mapping of axis to Fit or Model
        The noise of one or more of the axes gyro_x … accel_z, in rad/s and m/s².
    duration : float or str
        Time of navigation (s), or text such as "60s" or "10min".
    rate : float, optional
        Sampling rate (Hz), which is needed if `noise` has models.
    rest : float or str
        Time at rest before navigation starts (s), or text such as "60s", from which the filter knows the biases and the
        level.
    latitude : float
        Latitude (deg).
    gravity : float
        Gravity (m/s²).
    level : float
        Confidence level of the intervals, from 0.5 to below 1.

    Returns
    -------
    Budget
        The errors over time, each with its confidence interval and the contribution of each term.

    Raises
    ------
    OptionError
        If `noise` has no axis or an unknown axis, `rate` is missing, or an option is out of range.
    ModelError
        If a parameter of a model has no value, or the unit of a fit is not the SI unit of its axis.
    MissingTheoryError
        If a term has no state-space form.

    Examples
    --------
    >>> found = budget({"gyro_y": "WN(sigma2=1e-6)", "accel_x": "WN(sigma2=1e-4)"}, "60s", rate=100.0)
    >>> f"{found['tilt_y'].error[-1]:.3f} deg, {found['position_x'].error[-1]:.1f} m"
    '0.063 deg, 7.6 m'

    White noise of density N gives a tilt of N √(t + t²/rest), and levelling with accelerometers adds an error:

    >>> np.isclose(found["tilt_y"].error[-1], np.degrees(1e-4 * 120**0.5), rtol=1e-2)
    np.True_
    """
    seconds, before = _seconds(duration, "duration"), _seconds(rest, "rest", least=0.0)
    level = as_confidence(level, "level")
    if not -89.0 <= latitude <= 89.0:
        raise OptionError(argument="latitude", expected="from -89 to 89 (deg)", got=latitude)
    if not 0 < gravity < math.inf:
        raise OptionError(argument="gravity", expected="a positive acceleration (m/s²)", got=gravity)
    if not noise:
        raise OptionError(argument="noise", expected="a mapping with at least one axis", got=noise)
    axes = {axis: BudgetAxis.of(axis, source, rate) for axis, source in noise.items()}
    slowest = min(noise_of.rate for noise_of in axes.values())
    times = _times(seconds, 1 / slowest)
    maker = _Maker(axes, times, rest=before, gravity=gravity, reach=NormalDist().inv_cdf((1 + level) / 2))
    remarks = [remark for noise_of in axes.values() for remark in noise_of.remarks(seconds + before)]
    missing = [f"{sensor}_{letter}" for sensor in ("gyro", "accel") for letter in "xyz"]
    if missing := [axis for axis in missing if axis not in axes]:
        remarks.append(Remark.of("budget-axes-missing", axes=tuple(missing)))
    return Budget(
        growths=maker.growths(latitude * _DEGREE), alignment=maker.alignment(latitude * _DEGREE), duration=seconds,
        rest=before, latitude=float(latitude), gravity=float(gravity), level=level,
        remarks=tuple(dict.fromkeys(remarks)),
    )  # fmt: skip


def _seconds(given: float | str, name: str, least: float = 1e-9) -> float:
    value = parse_length(given, name) if isinstance(given, str) else given
    if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value <= 1e7:
        raise OptionError(argument=name, expected="a time in seconds, at most 1e7, or text such as '60s'", got=given)
    return float(value)


def _times(duration: float, step: float) -> Vector:
    """Return the times (s) of the curves, from 1 s, or a tenth of a short duration, to the duration."""
    if duration < step:
        raise OptionError(argument="duration", expected=f"at least one sample, {step:g} s", got=duration)
    first = max(min(1.0, duration / 10), step)
    count = 1 + math.ceil(8 * math.log10(duration / first))  # points per decade of time
    return np.geomspace(first, duration, max(count, 1)) if count > 1 else np.array([duration])


@dataclass(frozen=True, eq=False)
class _ErrorPart:
    """The mean squares (T, q) of the terms of an axis, the standard errors of their sum, and the largest sum that the
    measured curve allows, which is infinite where the standard errors are small."""

    squares: Mapping[str, Matrix]
    errors: Matrix
    limits: Matrix

    def largest(self, reach: float) -> Matrix:
        """Return the upper limits (T, q) of the sum for an interval of `reach` standard errors."""
        total = np.asarray(sum(self.squares.values(), np.zeros_like(self.errors)))
        width = np.divide(reach * self.errors, total, out=np.zeros_like(total), where=total > 0)
        return np.asarray(np.minimum(total * np.exp(np.minimum(width, 600.0)), self.limits))


def _is_wide(total: Matrix, error: Matrix) -> Matrix:
    """Return where the RMS interval exceeds `WIDEST_INTERVAL`, from mean squares and half widths."""
    return np.asarray((total > 0) & (error > math.log(WIDEST_INTERVAL) * total))


@dataclass(frozen=True, eq=False)
class _Maker:
    """Computation of the errors of a budget from the noise of its axes."""

    axes: Mapping[str, BudgetAxis]
    times: Vector  # (T,) in s
    rest: float  # time at rest before navigation starts (s)
    gravity: float  # m/s²
    reach: float  # half the width of a confidence interval in standard errors

    def growths(self, latitude: float) -> dict[str, Growth]:
        """Return the attitude, velocity and position errors by name. The latitude is in rad."""
        motions = {axis: navigation(axis, self.gravity, latitude) for axis in self.axes}
        parts = self._parts(motions, self.rest)
        growths = {}
        for column, (name, (title, unit, needed)) in enumerate(_ERRORS.items()):
            # Later, second-order effects of the tilt exceed the vertical errors (docs/validation/budget.md).
            if needed & self.axes.keys() and (not name.endswith("_z") or self.times[-1] <= 100.0):
                size = _DEGREE if unit == "deg" else 1.0
                growths[name] = self._growth(parts, column, size, name=name, title=title, unit=unit)
        return growths

    def alignment(self, latitude: float) -> dict[str, Growth]:
        """Return the errors of levelling and gyro-compassing over averaging times, by name. The latitude is in rad."""
        growths = {}
        north = EARTH_RATE * math.cos(latitude)
        for sensor, kind, title, size in (
            ("accel", "level", "levelling with {}", self.gravity), ("gyro", "north", "north from {}", north)
        ):  # fmt: skip
            for axis in (f"{sensor}_x", f"{sensor}_y"):
                if axis in self.axes:
                    name, parts = f"{kind}_{axis[-1]}", self._parts({axis: MEAN}, 0.0)
                    size_of = _DEGREE * size * self.times
                    growths[name] = self._growth(parts, 0, size_of, name=name, title=title.format(axis), unit="deg")
        return growths

    def _parts(self, motions: Mapping[str, Response], rest: float) -> list[_ErrorPart]:
        """Return the mean squares that the noise of each axis causes."""
        parts = []
        for axis, motion in motions.items():
            noise = self.axes[axis]
            squares = noise.mean_squares(motion, self.times.tolist(), rest)
            errors = noise.errors(motion, self.times.tolist(), rest, squares)
            total = np.asarray(sum(squares.values(), np.zeros_like(errors)))
            limits = np.full_like(errors, np.inf)
            # Where the interval is wider than the measured curve allows, the curve limits the mean squares of the axis.
            if np.any(_is_wide(total, self.reach * errors)):
                limits = np.maximum(noise.limits(motion, self.times.tolist(), rest), total)
            parts.append(_ErrorPart({f"{axis} {label}": square for label, square in squares.items()}, errors, limits))
        return parts

    def _growth(
        self, parts: Sequence[_ErrorPart], column: int, size: float | Vector, *, name: str,
        title: str, unit: str,
    ) -> Growth:  # fmt: skip
        """Return the error in a column of the mean squares as a `Growth`. `size` is the unit of the error in SI."""
        squares = {label: square[:, column] for part in parts for label, square in part.squares.items()}
        total = np.asarray(sum(squares.values(), np.zeros(self.times.size)), dtype=np.float64)
        error = self.reach * np.sqrt(sum(part.errors[:, column] ** 2 for part in parts))
        with np.errstate(divide="ignore", invalid="ignore"):
            width = np.where(total > 0, np.minimum(error / (2 * total), 300.0), 0.0)
        # A wider interval is only an upper limit.
        wide = _is_wide(total, error)
        root, high = np.sqrt(total), np.sqrt(total) * np.exp(width)
        most = np.sqrt(sum(part.largest(self.reach)[:, column] for part in parts))
        low, high = np.where(wide, 0.0, root * np.exp(-width)), np.where(wide, np.minimum(high, most), high)
        root, low, high = root / size, low / size, high / size
        terms = {label: np.sqrt(square) / size for label, square in squares.items() if np.any(square > 0)}
        return Growth(
            name=name, title=title, unit=unit, times=self.times.copy(), error=root, low=low, high=high, terms=terms,
        )  # fmt: skip
