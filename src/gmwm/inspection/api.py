"""`inspect`: a recording looked at as a whole, in memory or in pieces."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from gmwm._arrays import Vector
from gmwm._threads import in_threads
from gmwm.errors import OptionError
from gmwm.inspection.axis_statistics import Look
from gmwm.inspection.findings import MOVED, of_motion, of_steps, of_time, of_units, of_values, of_warm_up
from gmwm.inspection.knocks import knocks_of, steps_of
from gmwm.inspection.resolution import Sample, lsb, step_of
from gmwm.inspection.result import AxisInspection, Inspection
from gmwm.inspection.time_grid import Extent
from gmwm.inspection.warm_up import warm_up_of
from gmwm.readers.streams import Piece, Stream
from gmwm.remarks import Remark
from gmwm.signals import Imu, Signal, TimeBase, axis_quantity
from gmwm.units import SI_UNIT

_RESTLESS = 4.0  # spread of a piece over the median spread that means motion
_TURN = 0.1  # degrees that deserve a word: the sensor settles, or its biases wander

Values = Callable[[str, int, int], Vector]
"""The samples of an axis from a first to before a last one."""


def inspect(recording: Imu | Stream) -> Inspection:
    """What a recording looks like, and whether it was really static.

    Parameters
    ----------
    recording : Imu or Stream
        All segments are looked at. A stream is read twice, in bounded memory; its temperature is not looked at.

    Returns
    -------
    Inspection
        The same for the same recording: nothing in it is random.

    Raises
    ------
    OptionError
        If it is neither.
    ReadError, DataError
        What reading a stream raises.

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
    if isinstance(recording, Stream):
        survey = Survey(recording)
        for piece in recording:
            survey.take(piece)
        looks = survey.looks()
        for piece in recording:
            looks.take(piece)
        return looks.found()
    if not isinstance(recording, Imu):
        raise OptionError(
            f"recording must be an Imu or a Stream, got {type(recording).__name__}; {_way_to_an_imu(recording)}"
        )
    first = recording[recording.axes[0]]
    base = recording.time_base or TimeBase(recording.rate, start=first.start)
    looks = Looks(
        source=recording.source,
        remarks=recording.remarks,
        base=base,
        extent=Extent.of(first, base.left),
        units={axis: recording[axis].unit for axis in recording},
        resolutions={axis: lsb(recording[axis].values) for axis in recording},
        values=lambda axis, first, last: recording[axis].values[first:last],
    )
    looks.take(Piece({axis: recording[axis].values for axis in recording}, 0, 0, 0.0))
    return looks.found(recording.temperature)


def _way_to_an_imu(given: object) -> str:
    """What to pass in place of something that is no Imu."""
    if isinstance(given, str | os.PathLike):
        return f"read it first: inspect(read({os.fspath(given)!r}))"
    if isinstance(given, Signal):
        return f'wrap it: inspect(Imu({{"{given.axis or "gyro_x"}": signal}}))'
    return "make one of arrays: inspect(Imu.from_arrays(arrays, rate=...))"


class Survey:
    """The first of two passes over a stream: where its samples are, and the steps of their numbers.

    Parameters
    ----------
    stream : Stream
        Its pieces then come by `take`.
    """

    def __init__(self, stream: Stream) -> None:
        self._stream = stream
        self._samples = {axis: Sample() for axis in stream.axes}
        self._firsts: list[int] = []
        self._starts: list[float] = []
        self._stop = 0

    def take(self, piece: Piece) -> None:
        """The piece that follows."""
        if piece.segment == len(self._firsts):
            self._firsts.append(piece.first)
            self._starts.append(piece.start)
        self._stop = piece.first + len(piece)
        for axis, sample in self._samples.items():
            sample.take(piece[axis])

    def looks(self) -> Looks:
        """What takes the pieces of the second pass."""
        stream, stops = self._stream, [*self._firsts[1:], self._stop]
        segments = list(zip(self._firsts, stops, strict=True))
        extent = Extent.at(stream.rate, segments, self._starts, stream.time_base.left)
        return Looks(
            source=stream.source,
            remarks=stream.remarks,
            base=stream.time_base,
            extent=extent,
            units={axis: SI_UNIT[axis_quantity(axis)] for axis in stream.axes},
            resolutions={axis: step_of(sample.values()) for axis, sample in self._samples.items()},
            values=self._values,
        )

    def _values(self, axis: str, first: int, last: int) -> Vector:
        """Some samples, read anew: only where a level has changed for good."""
        parts = []
        for piece in self._stream:
            if piece.first >= last:
                break
            if piece.first + len(piece) > first:
                parts.append(piece[axis][max(first - piece.first, 0) : last - piece.first])
        return np.concatenate(parts)


class Looks:
    """All axes of a recording, looked at piece by piece.

    Parameters
    ----------
    source, remarks, base : str, sequence of Remark, TimeBase
        What is known of the recording.
    extent : Extent
        Where its samples are.
    units : mapping of axis to str
    resolutions : mapping of axis to float or None
        Their quantisation steps.
    values : callable
        Samples once more, as `values(axis, first, last)`.
    """

    def __init__(
        self, source: str, remarks: Sequence[Remark], base: TimeBase, extent: Extent, units: Mapping[str, str],
        resolutions: Mapping[str, float | None], values: Values,
    ) -> None:  # fmt: skip
        self._source, self._remarks, self._base, self._extent = source, tuple(remarks), base, extent
        self._units, self._resolutions, self._values = units, resolutions, values
        self._looks = {axis: Look(extent, resolutions[axis] or 0.0) for axis in units}

    @property
    def samples(self) -> int:
        """How many there are."""
        return self._extent.samples

    def take(self, piece: Piece) -> None:
        """The samples that follow, of all axes; what a file has got since it was surveyed is left out."""
        room = self._extent.samples - piece.first
        if room > 0:
            in_threads(lambda axis, look: look.take(piece[axis][:room]), self._looks)

    def found(self, temperature: Vector | None = None) -> Inspection:
        """What was seen, once all samples were."""
        extent, looks = self._extent, self._looks
        axes = {axis: self._axis(axis, look) for axis, look in looks.items()}
        gravity, tilt, tilt_noise = _gravity(looks, axes, extent.samples)
        knocks = knocks_of({axis: look.outliers() for axis, look in looks.items()}, extent)
        steps = sorted(
            (
                step
                for axis, look in looks.items()
                for step in steps_of(
                    axis, look.levels(), extent=extent, resolution=self._resolutions[axis] or 0.0,
                    values=partial(self._values, axis),
                )
            ),
            key=lambda step: (step.time, step.axis),
        )  # fmt: skip
        settling = (warm_up_of(axis, look.levels(), extent, self._resolutions[axis] or 0.0)
                    for axis, look in looks.items())  # fmt: skip
        warm_ups = tuple(found for found in settling if found is not None)
        restless = {axis: found for axis, look in looks.items() if (found := _restless(look, extent)) is not None}
        turned = tilt is not None and tilt > max(_TURN, 5 * tilt_noise)
        moved = tilt is not None and turned and tilt > MOVED
        remarks = (
            *of_time(len(extent.segments), self._base),
            *of_motion(restless, tilt if turned else None, knocks),
            *of_steps(tuple(steps)),
            *of_warm_up(warm_ups, self._base.left > 0),
            *of_values(axes, gravity),
            *of_units(self._densities()),
            *self._remarks,
        )
        segments = len(extent.segments)
        return Inspection(
            source=self._source,
            rate=extent.rate,
            duration=extent.samples / extent.rate,
            samples=extent.samples,
            segments=segments,
            time_base=self._base,
            axes=axes,
            gravity=gravity,
            tilt=tilt,
            static=not (moved or restless),
            knocks=knocks,
            steps=tuple(steps),
            warm_ups=warm_ups,
            temperature=_range(temperature),
            remarks=remarks,
        )

    def _axis(self, axis: str, look: Look) -> AxisInspection:
        noise = float(np.sqrt(look.differences.means[0] / 2))
        wander = float(np.ptp(look.pieces.means))
        mean, sd = float(look.all.means[0]), float(np.sqrt(look.all.variances()[0]))
        return AxisInspection(
            unit=self._units[axis], mean=mean, sd=sd, noise=noise, lsb=self._resolutions[axis], wander=wander
        )

    def _densities(self) -> dict[str, float]:
        """Noise densities of the gyroscopes (rad/s/√Hz): of the middle one of all pieces, that no knock is among it."""
        found = {}
        for axis, look in self._looks.items():
            some = look.steps.counts > 0
            if self._units[axis] == SI_UNIT["gyro"] and np.any(some):
                found[axis] = float(np.sqrt(np.median(look.steps.means[some]) / 2 / self._extent.rate))
        return found


def _gravity(
    looks: Mapping[str, Look], axes: Mapping[str, AxisInspection], samples: int
) -> tuple[float | None, float | None, float]:
    """Norm of the mean specific force, its largest turn between pieces, and the turn that noise explains (°)."""
    names = ("accel_x", "accel_y", "accel_z")
    if any(axis not in looks for axis in names):
        return None, None, 0.0
    mean = np.array([axes[axis].mean for axis in names])
    norm = float(np.linalg.norm(mean))
    if norm == 0:
        return 0.0, None, 0.0
    pieces = np.column_stack([looks[axis].pieces.means for axis in names])
    across = np.linalg.norm(np.cross(pieces, mean / norm), axis=1)
    tilt = float(np.degrees(np.max(np.arctan2(across, pieces @ mean / norm))))
    length = max(samples / len(pieces), 1.0)
    noise = float(np.linalg.norm([axes[axis].noise for axis in names])) / np.sqrt(length)
    return norm, tilt, float(np.degrees(np.arctan2(noise, norm)))


def _restless(look: Look, extent: Extent) -> tuple[float, float] | None:
    """When the spread of an axis was far more than its usual one, and by how much; knocks are told as such."""
    spreads = np.sqrt(look.calm.variances())
    usual, worst = float(np.median(spreads)), int(np.argmax(spreads))
    if usual > 0 and spreads[worst] > _RESTLESS * usual:
        return float(extent.times([extent.pieces()[worst][0]])[0]), float(spreads[worst] / usual)
    return None


def _range(temperature: Vector | None) -> tuple[float, float] | None:
    return None if temperature is None else (float(np.min(temperature)), float(np.max(temperature)))
