"""A look at a recording before it is used: its time base, its resolution, and whether it was static."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.knocks import Knock, find_knocks
from gmwm.signals import Imu, Signal, TimeBase
from gmwm.units import STANDARD_GRAVITY

_BLOCKS = 64  # pieces of a recording whose means and spreads are compared
_RESTLESS = 4.0  # spread of a piece over the median spread that means motion
_TILT = 1.0  # degrees of the direction of gravity that mean motion: a bias of 17 mg would do the same
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
        Largest difference between the means of pieces of the recording.
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
    temperature: tuple[float, float] | None
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain dicts, lists and numbers, ready for JSON."""
        return dict(_plain(asdict(self)))

    def summary(self) -> str:
        """The inspection as a text."""
        lines = [
            f"{self.source or 'recording'}: {self.samples} samples at {self.rate:.10g} Hz, {_span(self.duration)}"
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
            lines.append(f"time stamps: jitter {self.time_base.jitter:.3g} s rms, {len(self.time_base.gaps)} gaps")
        for knock in self.knocks[:5]:
            what = f"{', '.join(knock.axes)}, {knock.peak:.0f} sd"
            lines.append(f"knock at {knock.time:.6g} s for {knock.duration:.3g} s ({what})")
        if len(self.knocks) > 5:
            lines.append(f"and {len(self.knocks) - 5} more knocks")
        lines += [f"note: {note}" for note in self.notes]
        lines += [f"warning: {warning}" for warning in self.warnings]
        return "\n".join(lines)

    def __repr__(self) -> str:
        state = "static" if self.static else "not static"
        return (
            f"Inspection({len(self.axes)} axes, {self.samples} samples at {self.rate:g} Hz, {state}, "
            f"{len(self.knocks)} knocks, {len(self.warnings)} warnings)"
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
    time_base = imu.time_base or TimeBase(imu.rate)
    pieces = _pieces(imu.segments)
    means = {axis: _piece_means(imu[axis].values, pieces) for axis in imu}
    axes = {axis: _axis(imu[axis], means[axis]) for axis in imu}
    gravity, tilt, tilt_noise = _gravity(imu, means, axes)
    knocks, outliers = find_knocks(imu, {name: axis.lsb for name, axis in axes.items()})
    restless = _restless(imu, pieces, outliers)
    turned = tilt is not None and tilt > max(_TURN, 5 * tilt_noise)
    moved = tilt is not None and turned and tilt > _TILT
    warnings = [
        *_time_warnings(imu, time_base),
        *_motion_warnings(imu, restless, tilt if turned else None, knocks),
        *_value_warnings(axes, gravity),
    ]
    return Inspection(
        imu.source, imu.rate, imu.duration, len(imu), len(imu.segments), time_base, axes, gravity, tilt,
        not (moved or restless), knocks, _range(imu.temperature), imu.notes, tuple(warnings),
    )  # fmt: skip


def _pieces(segments: tuple[tuple[int, int], ...]) -> list[tuple[int, int]]:
    """About `_BLOCKS` index ranges of like length that cross no gap; a short segment is one piece."""
    length = max(segments[-1][1] // _BLOCKS, 1)
    pieces = []
    for first, last in segments:
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


def _time_warnings(imu: Imu, base: TimeBase) -> list[str]:
    """What the time base means for the answer."""
    said = []
    if len(imu.segments) > 1:
        lost = sum(duration - 1 / imu.rate for _, duration in base.gaps)
        said.append(
            f"{len(imu.segments)} segments with {_span(lost)} missing between them: use imu.longest(), "
            "or one segment at a time"
        )
    if base.duplicates:
        said.append(f"time stamps that repeat the one before: {base.duplicates}")
    if base.backward:
        said.append(f"time stamps that step backward: {base.backward}")
    if base.jitter * base.rate > 0.1:
        said.append(
            f"the time stamps jitter by {100 * base.jitter * base.rate:.0f} % of the interval: if the samples do, "
            "short scales are blurred; if only the stamps do, nothing is lost"
        )
    return said


def _motion_warnings(
    imu: Imu, restless: dict[str, tuple[float, float]], tilt: float | None, knocks: tuple[Knock, ...]
) -> list[str]:
    """What motion means for the answer."""
    said = []
    if restless:
        axis = max(restless, key=lambda name: restless[name][1])
        when, times = restless[axis]
        said.append(
            f"not static: around {when:.6g} s the spread of {axis} is {times:.1f} times its usual one; cut it out"
        )
    if tilt is not None and tilt > _TILT:
        said.append(f"not static: the specific force turns by {tilt:.3g}°")
    elif tilt is not None:
        said.append(
            f"the specific force turns by {tilt:.2g}°, more than its noise explains: the mount settles, or the "
            "accelerometers' biases wander (with temperature?)"
        )
    if knocks:
        said.append(f"{len(knocks)} knocks (the first at {knocks[0].time:.6g} s): cut them out, they raise the curve")
    return said


def _value_warnings(axes: dict[str, AxisInspection], gravity: float | None) -> list[str]:
    """What the numbers themselves say."""
    said = []
    if gravity is not None and abs(gravity / STANDARD_GRAVITY - 1) > 0.05:
        said.append(
            f"the specific force is {gravity:.4g} m/s², not {STANDARD_GRAVITY:.4g}: is the unit right, "
            "was gravity removed?"
        )
    coarse = [name for name, axis in axes.items() if axis.lsb is not None and axis.noise < 0.5 * axis.lsb]
    if coarse:
        said.append(
            f"{', '.join(coarse)}: the noise is below half a quantisation step, so short scales show the step, "
            "not the sensor"
        )
    return said


def _range(temperature: Vector | None) -> tuple[float, float] | None:
    return None if temperature is None else (float(np.min(temperature)), float(np.max(temperature)))


def _span(seconds: float) -> str:
    """A length of time for people."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"


def _plain(value: Any) -> Any:
    """Tuples as lists, all the way down."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return value
