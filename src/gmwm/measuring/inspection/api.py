"""Inspect a recording before it is used: its time base, its units, and whether the sensor was at rest."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from threading import Lock
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.base.threads import in_threads
from gmwm.base.time_base import TimeBase
from gmwm.base.units import SI_UNIT, STANDARD_GRAVITY, find_unit
from gmwm.measuring.axis_results import as_recording
from gmwm.measuring.inspection import findings
from gmwm.measuring.inspection.axis_statistics import AxisStatistics, level_change, motion_of, still_parts
from gmwm.measuring.inspection.jumps import jumps_of, with_recurring, with_shared_settling
from gmwm.measuring.inspection.knocks import Step, knocks_of, steps_of
from gmwm.measuring.inspection.result import AxisInspection, Inspection, combined
from gmwm.measuring.inspection.time_grid import Ends, Extent, Saturation, dead_band_of, folding_of, saturation_of
from gmwm.measuring.inspection.trends import Swing, Trend, swing_of, trend_of
from gmwm.measuring.regression.against import AUTO, Against, Asked
from gmwm.measuring.regression.conditions import NOTHING, Conditions
from gmwm.recording.batches import Batch, Batches, Segments, Streamed
from gmwm.recording.options import one_of
from gmwm.recording.repairs import axes_with_two_levels, repaired
from gmwm.recording.resolution import Sample, before_rounding, is_counter, step_of
from gmwm.recording.signals import Imu, Signal

_SLOWEST = 10.0  # smallest bandwidth (Hz) of a sensor for its noise density. Slower logs keep some of the samples

Values = Callable[[str, int, int], Vector]
"""Function of axis, first and last index that returns the samples of a half-open range."""


def inspect(
    recording: Imu | Streamed, *, against: Against = AUTO, repeated: Literal["auto", "keep"] = "auto"
) -> Inspection:
    """Check a recording of a sensor at rest: time base, units, quantization, motion, knocks, jumps and warm-up.

    Parameters
    ----------
    recording : Imu, Stream or data frame
        A recording in memory, or a stream. A stream is read twice in bounded memory, or once if it has at most 2.1
        million samples. It is read once more if the axes are regressed on conditions.
    against : "auto", "none", str or mapping
        Conditions that the axes are regressed on, as in `gmwm.calibrate`; "auto" is the temperature of the recording.
        The effect of the conditions is removed before the test for trends.
    repeated : "auto" or "keep"
        With "auto", faults of the logger are undone before the inspection, and remarks name them: every value that is
        repeated k times is used once, at the rate of the sensor; samples that repeat the last one, frozen and
        interpolated samples are gaps; a constant beginning is left out; values that wrapped around are moved back. The
        first 2.1 million samples decide what is undone. With "keep", all values are used as they are.

    Returns
    -------
    Inspection
        Statistics of every axis, and remarks on what affects a calibration. The result is deterministic.

    Raises
    ------
    OptionError
        If `recording` is neither an Imu nor a Stream.
    ReadError, DataError
        If the stream cannot be read.

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
    recording = as_recording(recording)
    if not isinstance(recording, Imu | Streamed):
        raise _not_a_recording(recording)
    one_of(repeated, "repeated", ("auto", "keep"))
    parts = repaired(recording) if repeated == "auto" else (recording,)
    asked = Asked.of(against)
    return combined(with_gravity([inspect_with(part, Conditions.of_recording(part, asked)) for part in parts]))


def with_gravity(inspections: list[Inspection]) -> list[Inspection]:
    """Return the inspections of parts of a recording, with gravity in the first if several have accelerometers, and
    with the axes in remarks on gaps."""
    axes = {axis: item for part in inspections for axis, item in part.axes.items()}
    if len(inspections) < 2:
        return inspections
    inspections = [replace(part, remarks=tuple(_about_axes(part))) for part in inspections]
    if any(part.gravity is not None for part in inspections):
        return inspections
    gravity, _ = _specific_force(axes)
    positions = any(remark.facts.get("case") == "positions" for part in inspections for remark in part.remarks)
    remarks = findings.of_gravity(None if positions else gravity, axes, _turning(axes, gravity))
    first, *others = inspections
    return [replace(first, gravity=gravity, remarks=(*first.remarks, *remarks)), *others]


def _about_axes(part: Inspection) -> Iterator[Remark]:
    for remark in part.remarks:
        yield from map(remark.about, part.axes) if remark.code == "gaps" else (remark,)


def inspect_with(recording: Imu | Streamed, conditions: Conditions) -> Inspection:
    """Inspect a recording whose axes are regressed on conditions."""
    batches = Batches(recording)
    first_pass = FirstPass(batches)
    batches.each(first_pass.update)
    statistics = first_pass.second_pass()
    batches.each(statistics.update)
    return statistics.result(conditions)


def _not_a_recording(value: object) -> OptionError:
    """Return the error for an argument that is neither an Imu nor a Stream."""
    facts: dict[str, Any] = {}
    advice = "Make one from arrays: `inspect(Imu.from_arrays(arrays, rate=100.0))`."
    if isinstance(value, str | os.PathLike):
        advice, facts = "Read the file first: `inspect(read({path}))`.", {"path": repr(os.fspath(value))}
    elif isinstance(value, Signal):
        advice, facts = 'Wrap the signal: `inspect(Imu({{"{axis}": signal}}))`.', {"axis": value.axis or "gyro_x"}
    name = type(value).__name__
    return OptionError(
        f"recording must be an Imu or a Stream; got {name}", argument="recording", advice=advice, **facts
    )


class FirstPass:
    """The first of two passes over the batches: finds the segments and the quantization step of each axis."""

    def __init__(self, batches: Batches) -> None:
        self._batches = batches
        axes = batches.recording.axes
        self._samples = {axis: Sample() for axis in axes}
        self._ends = {axis: Ends() for axis in axes}
        self._segments = Segments()
        self._temperature: tuple[float, float] | None = None

    def update(self, batch: Batch) -> None:
        """Add the next batch."""
        self._segments.update(batch)
        if batch.temperature is not None:
            temperatures = float(np.min(batch.temperature)), float(np.max(batch.temperature))
            low, high = temperatures if self._temperature is None else self._temperature
            self._temperature = min(low, temperatures[0]), max(high, temperatures[1])

        def work(axis: str, sample: Sample) -> None:
            values = batch.signals[axis].values
            sample.update(values)
            self._ends[axis].update(values)

        in_threads(work, self._samples)

    def second_pass(self) -> RecordingStatistics:
        """Return empty statistics, to which the second pass adds the batches."""
        recording = self._batches.recording
        base = recording.time_base or TimeBase(recording.rate, start=self._segments.starts[0])
        return RecordingStatistics(
            source=recording.source, remarks=recording.remarks, base=base,
            extent=Extent.of(
                recording.rate, self._segments.ranges, self._segments.starts, base.left,
                gaps_known=self._segments.gaps_known,
            ),
            resolutions=in_threads(lambda _, sample: step_of(sample.values()), self._samples),
            values=self._batches.values, temperature=self._temperature,
            ends=self._ends,
        )  # fmt: skip


class _AxisFindings(NamedTuple):
    """Findings of one axis: begin (s) and share of windows in which it is stuck, and whether it `moves`, which an axis
    that is stuck or clipped does not."""

    item: AxisInspection
    stuck: tuple[float, float] | None
    saturation: Saturation | None
    moves: bool
    steps: list[Step]
    trend: Trend | None
    swing: Swing | None


class RecordingStatistics:
    """Statistics of all axes of a recording, from its batches in order; `values(axis, first, last)` returns samples."""

    def __init__(
        self, source: str, remarks: Sequence[Remark], base: TimeBase, extent: Extent,
        resolutions: Mapping[str, float | None], values: Values, temperature: tuple[float, float] | None,
        ends: Mapping[str, Ends],
    ) -> None:  # fmt: skip
        self._source, self._remarks, self._base, self._extent = source, tuple(remarks), base, extent
        self._resolutions, self._values, self._temperature = resolutions, values, temperature
        self._ends = ends
        self._turn = Lock()
        self._units: dict[str, str] = {}
        self._axes = {axis: AxisStatistics(extent, step or 0.0) for axis, step in resolutions.items()}
        self._same = 0

    def update(self, batch: Batch) -> None:
        """Add the next samples of all axes."""
        self._units = {axis: signal.unit for axis, signal in batch.signals.items()}
        in_threads(lambda axis, one: one.update(batch.signals[axis].values), self._axes)
        if self._base.duplicates:
            self._same += _repetitions(batch)

    def result(self, conditions: Conditions = NOTHING) -> Inspection:
        """Return the inspection, after the last batch, with trends tested without the effect of the conditions."""
        extent, statistics = self._extent, self._axes
        parts = still_parts({axis: sums.levels() for axis, sums in statistics.items()}, self._length, extent)
        by_axis = in_threads(lambda axis, sums: self._of_axis(axis, sums, conditions, still=not parts), statistics)
        axes = {axis: of_axis.item for axis, of_axis in by_axis.items()}
        stuck = {axis: of_axis.stuck for axis, of_axis in by_axis.items()}
        saturations = tuple(of_axis.saturation for of_axis in by_axis.values() if of_axis.saturation is not None)
        moving = {axis for axis, of_axis in by_axis.items() if of_axis.moves}
        outliers = {axis: sums.outliers() for axis, sums in statistics.items() if axis in moving}
        bursts = () if parts else knocks_of(outliers, extent)
        motion = motion_of(statistics, bursts, extent, lambda axis, *part: self._reader(axis)(*part))
        knocks = tuple(knock for knock in bursts if not motion.meets(knock.time, knock.time + knock.duration))
        gravity, tilt, tilt_noise = _gravity(statistics, axes, extent.samples, motion.still)
        trends = tuple(of_axis.trend for of_axis in by_axis.values() if of_axis.trend is not None)
        swings = tuple(of_axis.swing for of_axis in by_axis.values() if of_axis.swing is not None)
        reach = self._length / extent.rate  # The place of a jump is known to a block.
        jumps = with_shared_settling([step for of_axis in by_axis.values() for step in of_axis.steps], reach)
        steps = tuple(
            step for step in sorted(jumps, key=lambda step: (step.time, step.axis))
            if step.axis not in motion.ratios or not motion.meets(step.time - reach, step.time + reach)
        )  # fmt: skip
        # Turns of gravity above 0.1° (a bias of 1.7 mg) that noise, at five standard errors, does not explain.
        turned = tilt is not None and tilt > max(0.1, 5.0 * tilt_noise)
        moved = tilt is not None and turned and tilt > findings.MOVED
        motions = findings.of_motion(motion, tilt if turned else None, knocks, extent)
        coarse = {
            axis for axis, item in axes.items() if item.lsb and item.lsb > 2 * (item.before_rounding or item.noise)
        }
        levels = {
            axis: change
            for axis in moving - coarse - {item.axis for item in saturations}
            if (change := level_change(statistics[axis], motion, extent)) is not None
        }
        remarks = (
            *findings.of_time(extent, self._base, self._same), *findings.of_stuck(stuck), *findings.of_copies(axes),
            *findings.of_saturation(saturations, self._units),
            *(findings.of_positions(parts) if parts else motions),
            *findings.of_steps(steps, self._remarks), *(() if parts else findings.of_levels(levels)),
            *findings.of_swings(swings, self._units),
            *findings.of_trends(trends, self._units, extent, self._base.left > 0),
            *findings.of_gravity(None if parts else gravity, axes, _turning(axes, gravity)),
            *findings.of_rounding({axis: item for axis, item in axes.items() if axis in moving}, extent.rate),
            *findings.of_units(self._densities()),
            *findings.of_conditions(conditions.found, conditions.unknown),
            # `of_time` makes the other remarks of a reader on the time stamps again.
            *(r for r in self._remarks if r.code != "stamps-irregular" or r.facts["case"] in ("drift", "again")),
        )  # fmt: skip
        return Inspection(
            source=self._source, rate=extent.rate, duration=extent.samples / extent.rate, samples=extent.samples,
            segments=len(extent.segments), time_base=self._base, axes=axes, gravity=gravity, tilt=tilt,
            static=not (moved or motion.spans or parts), knocks=knocks, steps=steps, trends=trends, swings=swings,
            temperature=self._temperature, regressions=dict(conditions.found), remarks=remarks,
        )  # fmt: skip

    @property
    def _length(self) -> int:
        """Number of samples of a block."""
        return next(iter(self._axes.values())).length

    def _reader(self, axis: str) -> Callable[[int, int], Vector]:
        """Return the function that reads samples of an axis, for one thread at a time, as a stream needs."""

        def values(first: int, last: int) -> Vector:
            with self._turn:
                return self._values(axis, first, last)

        return values

    def _of_axis(self, axis: str, sums: AxisStatistics, conditions: Conditions, *, still: bool) -> _AxisFindings:
        """Inspect an axis; only one that is `still`, at one position of the unit, can have jumps."""
        item, stuck = self._axis(axis, sums), self._stuck(axis, sums)
        saturation = None if stuck is not None else self._saturation(axis, item)
        # Most samples of a clipped or stuck axis can be the same, so that all others are far from them.
        moves = stuck is None and not (saturation is not None and saturation.matters)
        means = _noise(axis, sums, conditions)
        # A clipped axis minus a jump would not look clipped.
        steps = self._steps(axis, means) if still and moves else []
        calm = _without_steps(means, steps, sums.length)
        trend = trend_of(axis, calm, self._extent)
        swing = None if trend is not None else swing_of(axis, calm, self._extent, self._reader(axis))
        return _AxisFindings(item, stuck, saturation, moves=moves, steps=steps, trend=trend, swing=swing)

    def _steps(self, axis: str, means: list[tuple[int, Vector]]) -> list[Step]:
        """Return the jumps of an axis: between neighbouring blocks, and out of the noise at any time scale."""
        if axis in axes_with_two_levels(self._remarks):
            return []
        sums, values = self._axes[axis], self._reader(axis)
        clear = jumps_of(axis, means, self._extent, values)
        resolution = self._resolutions[axis] or 0.0
        sharp = steps_of(axis, sums.levels(), extent=self._extent, resolution=resolution, values=values)
        further = [step for step in sharp if all(abs(step.index - item.index) > 3 * sums.length for item in clear)]
        return with_recurring(clear + further, sums.length)

    def _axis(self, axis: str, sums: AxisStatistics) -> AxisInspection:
        noise = float(np.sqrt(sums.differences.means[0] / 2))
        wander = float(np.ptp(sums.windows.means))
        mean, sd = float(sums.all.means[0]), float(np.sqrt(sums.all.variances()[0]))
        step, runs = self._resolutions[axis], sums.runs()
        counter = step is not None and is_counter(runs, step)
        counts = sums.calm.counts
        mean_at_rest = float(counts @ sums.calm.means / np.sum(counts)) if np.any(counts) else mean
        return AxisInspection(
            unit=self._units[axis], mean=mean, sd=sd, rest=mean_at_rest, noise=noise, lsb=step,
            before_rounding=None if step is None or counter else before_rounding(runs, step), wander=wander,
            counter=counter,
        )  # fmt: skip

    def _saturation(self, axis: str, item: AxisInspection) -> Saturation | None:
        samples, step, runs = self._extent.samples, item.lsb or 0.0, self._axes[axis].runs(outliers=True)
        if folded := folding_of(axis, runs, step):
            return folded
        clipped = saturation_of(axis, self._ends[axis], samples=samples, step=step, noise=item.before_rounding or 0.0)
        if clipped is not None or item.counter:
            return clipped
        return dead_band_of(axis, runs, samples=samples, step=step)

    def _stuck(self, axis: str, sums: AxisStatistics) -> tuple[float, float] | None:
        """Return the first time (s) and the share of windows in which an axis is constant; None if due to rounding."""
        measured = sums.steps.counts > 0
        still, step = measured & (sums.steps.means == 0), self._resolutions[axis] or 0.0
        moving = measured & ~still
        # The mean square of the differences is step² times the share of samples at which the output changes, or more.
        # Share of samples with a changed output, above which rounding does not explain a window without any change.
        if not np.any(still) or not np.any(moving) or np.median(sums.steps.means[moving]) < 0.1 * step**2:
            return None
        first, _ = self._extent.windows()[int(np.argmax(still))]
        return float(self._extent.times([first])[0]), float(np.mean(still[measured]))

    def _densities(self) -> dict[str, float]:
        """Return each gyroscope's white noise density (rad/s/√Hz): the smaller of medians, which ignore knocks, of
        first differences (raised by lines) and block means (raised by drifts)."""
        densities, rate = {}, max(self._extent.rate, _SLOWEST)
        for axis, sums in self._axes.items():
            measured, unit = sums.steps.counts > 0, find_unit(self._units[axis])
            if unit is not None and unit.quantity == "gyro" and np.any(measured):
                squares = [np.median(sums.steps.means[measured]) / rate]
                changes = np.concatenate([np.empty(0), *(np.diff(means) for _, means in sums.means())])
                if changes.size:
                    # 0.4549 is the median of the square of a standard normal variable.
                    squares.append(np.median(changes**2) / 0.4549 * sums.length / rate)
                densities[axis] = math.sqrt(min(squares) / 2) * unit.factor
        return densities


def _repetitions(batch: Batch) -> int:
    """Return the number of samples that equal the sample before on all axes."""
    return int(np.sum(np.logical_and.reduce([x.values[1:] == x.values[:-1] for x in batch.signals.values()])))


def _noise(axis: str, sums: AxisStatistics, conditions: Conditions) -> list[tuple[int, Vector]]:
    """Return block means of an axis without the effect of the conditions."""
    if conditions.applied_regression(axis) is None:
        return sums.means()
    length = sums.length
    return [
        (first, means - conditions.effect(axis, range(first + length // 2, first + length * means.size, length)))
        for first, means in sums.means()
    ]


def _without_steps(means: list[tuple[int, Vector]], steps: Sequence[Step], length: int) -> list[tuple[int, Vector]]:
    """Return block means of an axis without its jumps."""
    return [
        (first, block_means - sum(
            step.size * np.clip((first + length * np.arange(1, block_means.size + 1) - step.index) / length, 0.0, 1.0)
            for step in steps if not step.possible
        ))
        for first, block_means in means
    ]  # fmt: skip


def _specific_force(axes: Mapping[str, AxisInspection]) -> tuple[float | None, Vector]:
    """Return the norm of the mean specific force (m/s²), and the mean; None without three accelerometers."""
    names = ("accel_x", "accel_y", "accel_z")
    if any(axis not in axes or axes[axis].unit != SI_UNIT["accel"] for axis in names):
        return None, np.zeros(3)
    mean = np.array([axes[axis].mean for axis in names])
    return float(np.linalg.norm(mean)), mean


_WEIGHTLESS = 0.5  # specific force (m/s²) whose direction is that of offsets, as of sensors without gravity


def _turning(axes: Mapping[str, AxisInspection], gravity: float | None) -> str | None:
    """Return the gyroscope axis that has gravity as its mean (rad/s) while the accelerometers lack it, if any."""
    turning = (
        axis for axis, item in axes.items()
        if gravity is not None and item.unit == SI_UNIT["gyro"] and abs(item.mean) > 1.0
        and abs(math.hypot(item.mean, gravity) / STANDARD_GRAVITY - 1) < 0.05
    )  # fmt: skip
    return next(turning, None)


def _gravity(
    statistics: Mapping[str, AxisStatistics], axes: Mapping[str, AxisInspection], samples: int, still: NDArray[np.bool_]
) -> tuple[float | None, float | None, float]:
    """Return the norm of the mean specific force (m/s²), its largest turn (°) in `still` windows, and that of noise."""
    norm, mean = _specific_force(axes)
    if not norm or norm < _WEIGHTLESS:
        return norm, None, 0.0
    names = ("accel_x", "accel_y", "accel_z")
    windows = np.column_stack([statistics[axis].windows.means for axis in names])
    across = np.linalg.norm(np.cross(windows, mean / norm), axis=1)
    tilt = float(np.degrees(np.max(np.arctan2(across, windows @ mean / norm)[still], initial=0.0)))
    length = max(samples / len(windows), 1.0)
    noise = float(np.linalg.norm([axes[axis].noise for axis in names])) / np.sqrt(length)
    return norm, tilt, float(np.degrees(np.arctan2(noise, norm)))
