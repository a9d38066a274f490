"""A look at a recording before it is used: its time base, its resolution, and whether it was static."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm._words import counted
from gmwm.cautions import MOVED, about_declared, about_motion, about_steps, about_time, about_units, about_values, span
from gmwm.errors import OptionError
from gmwm.knocks import Knock, Step, find_knocks, find_steps
from gmwm.signals import Imu, Signal, TimeBase

_BLOCKS = 64  # pieces of a recording whose means and spreads are compared
_RESTLESS = 4.0  # spread of a piece over the median spread that means motion
_TURN = 0.1  # degrees that deserve a word: the sensor settles, or its biases wander
_LSB_SAMPLES = 20_000  # enough to see every step of a coarse sensor many times


@dataclass(frozen=True)
class AxisInspection:
    """One axis of a recording, in `unit`.

    Parameters
    ----------
    unit : str
        Unit of the numbers here.
    mean, sd : float
        Mean and standard deviation.
    noise : float
        Standard deviation from first differences, blind to offset and slow drift.
    lsb : float or None
        Quantisation step; None where none shows.
    wander : float
        Largest difference between the means of equal pieces of the recording, a 64th each.
    """

    unit: str
    mean: float
    sd: float
    noise: float
    lsb: float | None
    wander: float


@dataclass(frozen=True)
class Inspection:
    """What a recording looks like; `warnings` says in plain words what should be known before it is used.

    Parameters
    ----------
    source : str
        Where the recording came from.
    rate : float
        Samples per second (Hz).
    duration : float
        Length without gaps (s).
    samples, segments : int
        Number of samples, and of stretches without a gap.
    time_base : TimeBase
        Jitter, gaps, duplicates of the time stamps.
    axes : mapping of axis to AxisInspection
        The axes.
    gravity : float or None
        Norm of the mean specific force (m/s²); None without three accelerometers.
    tilt : float or None
        Largest turn of the specific force from its mean direction (degrees).
    static : bool
        Whether nothing was found that says the sensor moved.
    knocks : tuple of Knock
        Bursts of outliers in the order of time.
    steps : tuple of Step
        Lasting changes of level in the order of time.
    temperature : (lowest, highest) or None
        Range of the temperature (°C).
    notes : tuple of str
        What was understood on reading.
    warnings : tuple of str
        What should be known before the recording is used.
    """

    source: str
    rate: float
    duration: float
    samples: int
    segments: int
    time_base: TimeBase
    axes: dict[str, AxisInspection]
    gravity: float | None
    tilt: float | None
    static: bool
    knocks: tuple[Knock, ...]
    steps: tuple[Step, ...]
    temperature: tuple[float, float] | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain dicts, lists and numbers, ready for JSON."""
        return dict(_plain(asdict(self)))

    def summary(self) -> str:
        """The inspection as a text."""
        lines = [
            f"{self.source or 'recording'}: {self.samples} samples at {self.rate:.10g} Hz, {span(self.duration)}"
            + (f" in {self.segments} segments" if self.segments > 1 else ""),
            f"{'axis':<8} {'mean':>11} {'sd':>11} {'noise':>11} {'LSB':>11} {'wander':>11}  unit",
        ]
        for name, axis in self.axes.items():
            lsb = "-" if axis.lsb is None else f"{axis.lsb:.4g}"
            numbers = f"{axis.mean:>11.4g} {axis.sd:>11.4g} {axis.noise:>11.4g} {lsb:>11} {axis.wander:>11.4g}"
            lines.append(f"{name:<8} {numbers}  {axis.unit}")
        if self.gravity is not None:
            lines.append(f"specific force: {self.gravity:.5g} m/s², turned by at most {self.tilt:.3g}°")
        if self.temperature is not None:
            lines.append(f"temperature: {self.temperature[0]:.4g} to {self.temperature[1]:.4g} °C")
        if self.time_base.stamped:
            gaps = counted(len(self.time_base.gaps), "gap")
            lines.append(f"time stamps: jitter {self.time_base.jitter:.3g} s rms, {gaps}")
        for knock in self.knocks[:5]:
            what = f"{', '.join(knock.axes)}, {knock.peak:.0f} sd"
            long = f"for {knock.duration:.3g} s" if knock.duration > 0 else "of one sample"
            lines.append(f"knock at {knock.time:.6g} s {long} ({what})")
        if len(self.knocks) > 5:
            lines.append(f"and {counted(len(self.knocks) - 5, 'more knock')}")
        for step in self.steps[:5]:
            change = f"{step.size:+.3g} {self.axes[step.axis].unit}, {step.times:.0f} times the usual"
            lines.append(f"step of {step.axis} at {step.time:.6g} s ({change})")
        if len(self.steps) > 5:
            lines.append(f"and {counted(len(self.steps) - 5, 'more step')}")
        lines += [f"note: {note}" for note in self.notes]
        lines += [f"warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)

    def __repr__(self) -> str:
        state = "static" if self.static else "not static"
        return (
            f"Inspection({'1 axis' if len(self.axes) == 1 else f'{len(self.axes)} axes'}, {self.samples} samples at "
            f"{self.rate:g} Hz, {state}, {counted(len(self.knocks), 'knock')}, "
            f"{counted(len(self.warnings), 'warning')})"
        )


def inspect(imu: Imu) -> Inspection:
    """What a recording looks like, and whether it was really static.

    Parameters
    ----------
    imu : Imu
        The recording; all segments are looked at.

    Returns
    -------
    Inspection
        The same for the same recording: nothing in it is random.

    Raises
    ------
    OptionError
        If it is not an Imu.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> noise = np.round(rng.normal(0, 0.01, 5000), 3)
    >>> noise[3000] = 1.0
    >>> found = inspect(Imu.from_arrays({"gyro_x": noise}, rate=100))
    >>> found.axes["gyro_x"].lsb, found.knocks[0].time
    (0.001, 30.0)
    """
    if not isinstance(imu, Imu):
        raise OptionError(f"imu must be an Imu, got {type(imu).__name__}; {_way_to_an_imu(imu)}")
    time_base = imu.time_base or TimeBase(imu.rate)
    pieces = _pieces(imu.segments)
    means = {axis: _piece_means(imu[axis].values, pieces) for axis in imu}
    axes = {axis: _axis(imu[axis], means[axis]) for axis in imu}
    gravity, tilt, tilt_noise = _gravity(imu, means, axes)
    resolutions = {name: axis.lsb for name, axis in axes.items()}
    knocks, outliers = find_knocks(imu, resolutions)
    steps = find_steps(imu, resolutions)
    restless = _restless(imu, pieces, outliers)
    turned = tilt is not None and tilt > max(_TURN, 5 * tilt_noise)
    moved = tilt is not None and turned and tilt > MOVED
    warnings = [
        *about_time(imu, time_base),
        *about_motion(restless, tilt if turned else None, knocks),
        *about_steps(steps),
        *about_values(axes, gravity),
        *about_units(imu, pieces),
        *about_declared(imu.notes),
    ]
    return Inspection(
        imu.source, imu.rate, imu.duration, len(imu), len(imu.segments), time_base, axes, gravity, tilt,
        not (moved or restless), knocks, steps, _range(imu.temperature), imu.notes, tuple(warnings),
    )  # fmt: skip


def _way_to_an_imu(given: object) -> str:
    """What to pass in place of something that is no Imu."""
    if isinstance(given, str | os.PathLike):
        return f"read it first: inspect(read({os.fspath(given)!r}))"
    if isinstance(given, Signal):
        return f'wrap it: inspect(Imu({{"{given.axis or "gyro_x"}": signal}}))'
    return "make one of arrays: inspect(Imu.from_arrays(arrays, rate=...))"


def _pieces(segments: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
    """About `_BLOCKS` index ranges of like length, whose means and spreads are therefore comparable.

    They cross no gap, but where segments are shorter than half a piece: those are taken together with the
    short ones beside them, and left out if that is not enough.
    """
    length = max(segments[-1][1] // _BLOCKS, 1)
    stretches: list[tuple[int, int]] = []
    joined = False  # whether the last stretch is of short segments and may still grow
    for first, last in segments:
        short = 2 * (last - first) < length
        if short and joined and stretches[-1][1] - stretches[-1][0] < length:
            stretches[-1] = (stretches[-1][0], last)
        else:
            stretches.append((first, last))
        joined = short
    long = [(a, b) for a, b in stretches if 2 * (b - a) >= length]
    pieces = []
    for first, last in long:
        count = max((last - first) // length, 1)
        edges = np.linspace(first, last, min(count, _BLOCKS) + 1).astype(int)
        pieces += [(int(a), int(b)) for a, b in pairwise(edges)]
    return pieces


def _piece_means(values: Vector, pieces: list[tuple[int, int]]) -> Vector:
    return np.array([np.mean(values[a:b]) for a, b in pieces])


def _axis(signal: Signal, means: Vector) -> AxisInspection:
    values = signal.values
    seams = [first - 1 for first, _ in signal.segments[1:]]
    difference = np.delete(np.diff(values), seams) if seams else np.diff(values)
    noise = float(np.sqrt(np.mean(difference**2) / 2)) if difference.size else 0.0
    wander = float(np.ptp(means))
    return AxisInspection(signal.unit, float(np.mean(values)), float(np.std(values)), noise, lsb(values), wander)


def lsb(values: Vector) -> float | None:
    """The quantisation step of an axis: the step of a lattice on which all values lie, or None.

    Looked for only where values repeat; numbers with many digits lie on no visible lattice.

    >>> lsb(np.round(np.random.default_rng(0).normal(0, 1, 1000) / 0.05) * 0.05)
    0.05
    """
    sample = values[:: max(1, values.size // _LSB_SAMPLES)]
    levels = np.unique(sample)
    if levels.size < 2 or levels.size > 0.9 * sample.size:
        return None
    steps = np.diff(levels)
    # Values that differ only by the rounding of float64 are one level.
    steps = steps[steps > 1e-12 * np.max(np.abs(levels))]
    if steps.size == 0:
        return None
    step = float(np.min(steps))
    multiples = steps / step
    if np.max(np.abs(multiples - np.round(multiples))) > 0.05:
        return None
    # One step read from the whole range is exact where a single difference carries rounding.
    exact = float(np.sum(steps) / np.sum(np.round(multiples)))
    return float(f"{exact:.9g}")


def _gravity(
    imu: Imu, means: dict[str, Vector], axes: dict[str, AxisInspection]
) -> tuple[float | None, float | None, float]:
    """Norm of the mean specific force, its largest turn between pieces, and the turn that noise explains (°)."""
    names = ("accel_x", "accel_y", "accel_z")
    if any(axis not in means for axis in names):
        return None, None, 0.0
    mean = np.array([axes[axis].mean for axis in names])
    norm = float(np.linalg.norm(mean))
    if norm == 0:
        return 0.0, None, 0.0
    pieces = np.column_stack([means[axis] for axis in names])
    across = np.linalg.norm(np.cross(pieces, mean / norm), axis=1)
    tilt = float(np.degrees(np.max(np.arctan2(across, pieces @ mean / norm))))
    length = max(len(imu) / len(pieces), 1.0)
    noise = float(np.linalg.norm([axes[axis].noise for axis in names])) / np.sqrt(length)
    return norm, tilt, float(np.degrees(np.arctan2(noise, norm)))


def _restless(
    imu: Imu, pieces: list[tuple[int, int]], outliers: dict[str, NDArray[np.int64]]
) -> dict[str, tuple[float, float]]:
    """For each axis with a piece far more restless than the others: when it was, and by how much."""
    found = {}
    for axis in imu:
        values = imu[axis].values
        if outliers[axis].size:
            values = values.copy()
            values[outliers[axis]] = np.nan  # a knock is told as such
        spreads = np.array([np.sqrt(_variance(values[a:b])) for a, b in pieces])
        usual = float(np.median(spreads))
        worst = int(np.argmax(spreads))
        if usual > 0 and spreads[worst] > _RESTLESS * usual:
            found[axis] = (float(imu[axis].times([pieces[worst][0]])[0]), float(spreads[worst] / usual))
    return found


def _variance(values: Vector) -> float:
    there = values[~np.isnan(values)]
    return float(np.var(there)) if there.size else 0.0


def _range(temperature: Vector | None) -> tuple[float, float] | None:
    return None if temperature is None else (float(np.min(temperature)), float(np.max(temperature)))


def _plain(value: Any) -> Any:
    """Tuples as lists, all the way down."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
