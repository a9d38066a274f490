"""Monitor several units at rest side by side, and report which of them has changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gmwm.applications.monitor.api import Monitor
from gmwm.applications.monitor.axis import NAMING_S, Event
from gmwm.applications.monitor.baseline import Baseline, as_every, check_rate, chunks_of, common_rate, models_of
from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError, OptionError
from gmwm.files.readers.streams import Stream
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.recording.signals import Imu
from gmwm.theory.processes.model import Model

UNITS_TO_COMPARE = 3  # smallest number of units with which the changed unit can be identified
LONGEST_MOTION_S = 60.0  # longest time (s) for which all units may move together


class UnitEvent(NamedTuple):
    """An event of one of several units. The name is an empty string if the event concerns all units."""

    name: str
    event: Event

    def to_dict(self) -> dict[str, Any]:
        """Return the event with the name of its unit as numbers and strings for JSON."""
        return {"source": self.name, **self.event.to_dict()}

    def __str__(self) -> str:
        return f"{self.name or 'all units'}: {self.event}"


def redundant(
    calibration: Mapping[str, Any], recordings: Mapping[str, Imu | Stream], every: str | float = "30d", *,
    axes: Sequence[str] | None = None,
) -> Iterator[UnitEvent]:  # fmt: skip
    """Compare at least three units of the same type at rest with each other, and report which unit has changed.

    For each of the n units, the monitored signal is the difference between this unit and the mean of the other units,
    r_i = x_i − Σ_{j≠i} x_j/(n − 1). Its model is the model of one unit with all variances multiplied by 1 + 1/(n − 1).
    Effects that all units share, such as temperature and motion of the table, largely cancel in the difference. A fault
    of one unit also changes the differences of the other units, but less. The unit of the first and largest event on an
    axis is therefore reported.

    Parameters
    ----------
    calibration : Calibration, or mapping of axis to Fit or Model
        The noise models of one unit, which are used for all units.
    recordings : mapping of name to Imu or Stream
        Recordings without gaps that were made at the same time. Their first tenth is the reference for the baseline.
    every : str or float
        Average time between false alarms of all units and axes together: a number of seconds, or text such as "30d".
    axes : sequence of str, optional
        The axes to monitor; by default, all axes of the calibration that every recording has.

    Returns
    -------
    iterator of UnitEvent
        Each event with the name of its unit.

    Raises
    ------
    OptionError
        If there are fewer than three recordings, or their sampling rate differs from the rate of the calibration.
    DataError
        If a recording has gaps or is too short, or if the units move for more than a minute.

    Examples
    --------
    >>> from gmwm import simulate
    >>> model = {"gyro_x": "WN(sigma2=1e-6) + RW(gamma2=1e-14)"}
    >>> units = {name: simulate(model, rate=100.0, samples=60_000, rng=k) for k, name in enumerate("abc")}
    >>> list(redundant(model, units, every="10d"))
    []
    """
    if len(recordings) < UNITS_TO_COMPARE:
        raise OptionError(
            f"at least {UNITS_TO_COMPARE} units are needed to name the one that has changed; got {len(recordings)}",
            argument="recordings", got=len(recordings),
            advice="Monitor each unit alone, with the baseline of its own calibration.",
        )  # fmt: skip
    shared = [axis for axis in calibration if all(axis in recording_of.axes for recording_of in recordings.values())]
    models = models_of(calibration, shared if axes is None else axes)
    rate = common_rate(calibration, next(iter(recordings.values())).rate)
    for recording in recordings.values():
        check_rate(recording.rate, rate)
    return _events(models, recordings, as_every(every), rate)


def _events(
    models: Mapping[str, Model], recordings: Mapping[str, Imu | Stream], every: float, rate: float
) -> Iterator[UnitEvent]:
    n = len(recordings)
    apart = {axis: _times(model, 1.0 + 1.0 / (n - 1), rate) for axis, model in models.items()}
    mean_of = {axis: _times(model, 1.0 / n, rate) for axis, model in models.items()}
    common = Monitor(mean_of, every, rate=rate, baseline=None)
    references = _baselines(apart, recordings, rate)
    monitors = {name: Monitor(apart, every * n, rate=rate, baseline=references[name]) for name in recordings}
    culprits = _Culprits(n)
    for block in _blocks(recordings, list(models), 1 << 11):
        mean = {axis: np.asarray(sum(unit[axis] for unit in block.values()) / n) for axis in models}
        motion = [event for event in common.update(mean) if event.kind in ("moved", "still")]
        yield from (UnitEvent("", event) for event in motion)
        if motion or common.resting:
            if common.resting and common.moving_for > LONGEST_MOTION_S:
                raise DataError(
                    f"the units have moved for more than {LONGEST_MOTION_S:g} s: they can be compared only at rest, "
                    "because a difference of 0.1 % in scale is 180 deg/h at 50 deg/s",
                    argument="recordings", advice="Leave the motion out with {--skip}, or record at rest.",
                )  # fmt: skip
            for monitor in monitors.values():
                monitor.skip(next(iter(mean.values())).size)
            continue
        events = [
            UnitEvent(name, event)
            for name, monitor in monitors.items()
            for event in monitor.update({a: n / (n - 1) * (x - mean[a]) for a, x in block[name].items()})
        ]
        yield from culprits.of(events)
    yield from culprits.of([UnitEvent(name, event) for name, monitor in monitors.items() for event in monitor.finish()])


class _Culprits:
    """Selects the first and largest event of each axis, and drops later events of other units as its consequences."""

    def __init__(self, units: int) -> None:
        self._units = units
        self._until: dict[str, tuple[str, float]] = {}

    def of(self, batch: list[UnitEvent]) -> Iterator[UnitEvent]:
        """Yield the events that are not consequences of an event of another unit."""
        by_axis: dict[str, list[UnitEvent]] = {}
        for item in batch:
            by_axis.setdefault(item.event.axis, []).append(item)
        for axis, events in by_axis.items():
            begin = min(item.event.time for item in events)
            first = [item for item in events if item.event.time <= begin + NAMING_S]
            size = {item: max(abs(item.event.size or 0.0), item.event.ratio or 0.0) for item in events}
            for item in sorted(events, key=lambda item: (item not in first, -size[item], item.event.time)):
                name, until = self._until.get(axis, ("", -np.inf))
                if item.name != name and item.event.time <= until:
                    continue
                # Other differences contain 1/(n − 1) of the fault, so detecting it there takes (n − 1)² times as long.
                slow = (self._units - 1) ** 2 * (item.event.time - item.event.began)
                # Consequences last at least 600 s.
                self._until[axis] = (item.name, item.event.time + max(600.0, 4.0 * slow))
                yield item


def _times(model: Model, factor: float, rate: float) -> Model:
    """Return a model with all variances times a factor, without drifts: their slopes differ between units."""
    noises = [process for process in model.processes if process.scale > 0 and not is_ramp(process, rate)]
    return Model(tuple(process.with_scale(process.scale * factor) for process in noises))


def _baselines(
    models: Mapping[str, Model], recordings: Mapping[str, Imu | Stream], rate: float
) -> dict[str, dict[str, Baseline]]:
    """Return the baselines of the differences for each unit and axis, from the first tenth of the recordings."""
    n = len(recordings)
    lengths = [recording.rows if isinstance(recording, Stream) else len(recording) for recording in recordings.values()]
    count = max(int(0.1 * min(lengths)), 1)  # the first tenth of the recordings
    block = next(_blocks(recordings, list(models), count))
    mean = {axis: sum(unit[axis] for unit in block.values()) / n for axis in models}
    return {
        name: {
            axis: Baseline.of(model, [n / (n - 1) * (unit[axis] - mean[axis])], rate) for axis, model in models.items()
        }
        for name, unit in block.items()
    }


def _blocks(
    recordings: Mapping[str, Imu | Stream], axes: Sequence[str], size: int
) -> Iterator[dict[str, dict[str, Vector]]]:
    """Yield blocks of `size` samples of all recordings, up to the end of the shortest recording."""
    sources = {name: chunks_of(recording) for name, recording in recordings.items()}
    held = {name: {axis: np.zeros(0) for axis in axes} for name in recordings}
    while True:
        for name, source in sources.items():
            while held[name][axes[0]].size < size and (chunk := next(source, None)) is not None:
                if chunk.segment:
                    raise DataError(
                        f"{name} has missing samples at {chunk.start:.1f} s, and units are compared sample by sample",
                        argument="recordings",
                        advice="Monitor each unit alone, or shorten the recordings with {--start} and {--stop}.",
                    )
                held[name] = {axis: np.concatenate([x, chunk.values[axis]]) for axis, x in held[name].items()}
        n = min([size, *(values[axes[0]].size for values in held.values())])
        if not n:
            return
        yield {name: {axis: x[:n] for axis, x in values.items()} for name, values in held.items()}
        held = {name: {axis: x[n:] for axis, x in values.items()} for name, values in held.items()}
