"""Compute the error budget of unaided inertial navigation from noise models."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from gmwm.applications.navigation.response import EARTH_RATE, MEAN, BudgetAxis, Response, navigation
from gmwm.applications.navigation.result import Budget, Growth
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.durations import parse_length
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.base.units import STANDARD_GRAVITY
from gmwm.choosing.datasheets.limits import WIDEST_INTERVAL
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

GRAVITY = STANDARD_GRAVITY
"""Default gravity (m/s²)."""
LATITUDE = 45.0
"""Default latitude (deg)."""
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
    """Return where the ends of the interval of a root mean square differ by more than a factor of `WIDEST_INTERVAL`,
    from the mean squares and half the widths of their intervals."""
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
