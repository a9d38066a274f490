"""Options of a monitor, and the baseline of an axis, also as an addition to a calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.monitor import charts
from gmwm.applications.monitor.whitening import Finite, Gain, Whitener
from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Vector, as_rate, runs_of
from gmwm.base.documents import plain_fields
from gmwm.base.errors import DataError, ModelError, OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.time_base import parse_length
from gmwm.calibration.additions import AxisAddition
from gmwm.files.readers.streams import Stream
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model, as_model

LEAST_BLOCKS = 80  # least blocks for the mean square of a level: standard error below 7 %, less than the dead band
LARGEST_RATIO = 1e15
"""Largest number in a baseline; ratios, shapes and scatter are at least its inverse. Other numbers are damage."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline(FrozenArrays):
    """Statistics of the standardised innovations of an axis in a reference recording.

    Attributes
    ----------
    samples : int
        Number of samples of the reference recording.
    ratios : (J,) array
        Mean squares of the standardised Haar coefficients of the innovations at levels 1 … J; 1 if the model is right.
    shapes : (J,) array
        Shape k of the Gamma distribution of the mean squares in blocks, for each of these levels.
    scatter : tuple of float
        Standard deviations of the standardised block means at levels 0 … L − 1; at least 1.
    largest : float
        Largest absolute innovation.
    equal : int
        Largest number of equal samples in a row.
    lowest, highest : float
        Smallest and largest sample, in the unit of the signal.
    """

    samples: int
    ratios: Vector
    shapes: Vector
    scatter: tuple[float, ...]
    largest: float
    equal: int
    lowest: float
    highest: float

    @classmethod
    def of(cls, model: Model, segments: Sequence[Vector], rate: float) -> Baseline:
        """Measure the baseline of an axis from a recording of a healthy sensor.

        Parameters
        ----------
        model : Model
            Model of the axis with all values, per sample at `rate`.
        segments : sequence of (n,) arrays
            Parts of the recording without gaps, in rad/s or m/s².
        rate : float
            Sampling rate (Hz).

        Raises
        ------
        DataError
            If the recording is too short for the finest level.
        ModelError
            If a parameter of the model has no value.
        """
        whitener = Whitener(Gain.of(Finite.of(model, rate)))
        errors = []
        for values in segments:
            whitener.restart()
            errors.append(whitener.update(values))
        largest = max((float(max(e.max(initial=0.0), -e.min(initial=0.0))) for e in errors), default=0.0)
        sums = _BlockSums(errors)
        ratios, shapes = _mean_squares(sums)
        scatter = _block_means(sums)
        total = sum(e.size for e in errors)
        if not ratios.size or not scatter:
            raise DataError(
                f"the reference has {total} samples, and a baseline needs {LEAST_BLOCKS * 2 * charts.BLOCKS_OF_LEVEL} "
                "without a gap",
                argument="reference", got=total, advice="Record for at least some minutes with a sensor that is good.",
            )  # fmt: skip
        return cls(
            samples=total, ratios=ratios, shapes=shapes, scatter=scatter, largest=largest, equal=longest_run(segments),
            lowest=min(float(part.min(initial=math.inf)) for part in segments),
            highest=max(float(part.max(initial=-math.inf)) for part in segments),
        )  # fmt: skip

    def settings(self) -> charts.ChartSettings:
        """Return the settings of the charts for this baseline."""
        return charts.ChartSettings(
            # Dead band: parts of a recording in docs/validation/monitor.md differ by less.
            self.ratios, self.shapes, scatter=np.array(self.scatter), band=1.1,
            # Shorter runs never count as frozen.
            tail=max(1.0, self.largest / charts.spike_limit(self.samples)), equal=max(2 * self.equal, 8),
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return the baseline as numbers and lists for JSON."""
        return plain_fields(self, "samples ratios shapes scatter largest equal lowest highest")

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Baseline:
        """Create a baseline from the `content` that `to_dict` returned. Other content raises a ReadError."""
        arrays = {}
        try:
            for name in ("ratios", "shapes", "scatter"):
                arrays[name] = np.array(content[name], dtype=np.float64)
            numbers = {name: float(content[name]) for name in ("largest", "lowest", "highest")}
            counts = {name: int(content[name]) for name in ("samples", "equal")}
        except (KeyError, TypeError, ValueError) as error:
            raise ReadError(f"not a baseline: {error}", advice="Measure the baseline again.") from error
        good = all(
            a.ndim == 1 and a.size and bool(np.all((a > 1 / LARGEST_RATIO) & (a < LARGEST_RATIO)))
            for a in arrays.values()
        )
        good = good and all(abs(value) < LARGEST_RATIO for value in numbers.values())
        if not good or arrays["ratios"].size != arrays["shapes"].size or counts["samples"] < 1:
            reason = (
                f"ratios, shapes and scatter must be lists of numbers from {1 / LARGEST_RATIO:g} to {LARGEST_RATIO:g}"
            )
            raise ReadError(f"not a baseline: {reason}", advice="Measure the baseline again.")
        scatter = tuple(arrays.pop("scatter").tolist())
        return cls(**arrays, scatter=scatter, **numbers, **counts)  # type: ignore[arg-type]


def longest_run(segments: Sequence[Vector]) -> int:
    """Return the length of the longest run of equal values within a segment."""
    sizes = [part.size for part in segments if part.size]
    values = np.concatenate([np.zeros(0), *segments])
    equal = values[1:] == values[:-1]
    equal[np.cumsum(sizes[:-1], dtype=np.int64) - 1] = False  # the last sample of a segment, and the first of the next
    return int(np.max(np.diff(runs_of(equal)), initial=0)) + 1 if sizes else 0


class _BlockSums:
    """Sums of innovations over blocks of 2^level samples of each segment. Each level follows from the one before."""

    def __init__(self, errors: Sequence[Vector]) -> None:
        self._levels = [list(errors)]

    def __getitem__(self, level: int) -> list[Vector]:
        while len(self._levels) <= level:
            fine = self._levels[-1]
            self._levels.append([sums[0 : sums.size & ~1 : 2] + sums[1::2] for sums in fine if sums.size > 1])
        return self._levels[level]


def _mean_squares(sums: _BlockSums) -> tuple[Vector, Vector]:
    """Return the mean of the mean squares of blocks at each level, and the shapes of their Gamma distributions."""
    ratios: list[float] = []
    shapes: list[float] = []
    while True:
        level = len(ratios) + 1
        base, m = charts.window(level)
        blocks = _blocks(sums[base], m, level)
        if blocks.size < LEAST_BLOCKS:
            return np.array(ratios), np.array(shapes)
        mean = float(np.mean(blocks))
        ratios.append(mean)
        shapes.append(min(charts.white_shape(level), *_shapes(blocks / mean)))


def _shapes(blocks: Vector) -> Iterator[float]:
    """Yield Gamma shapes 1/Var of mean squares of 1, 2, 4, … blocks, per block; bursts make later ones smaller."""
    together = 1
    while together <= 256 and blocks.size >= LEAST_BLOCKS:  # charts raise an alarm within this number of blocks
        yield 1.0 / max(together * float(np.var(blocks, ddof=1)), 1e-300)
        even = blocks.size & ~1
        blocks, together = 0.5 * (blocks[0:even:2] + blocks[1:even:2]), 2 * together


def _blocks(segments: Sequence[Vector], m: int, level: int) -> Vector:
    """Return mean squares of standardised Haar coefficients of m block sums each, in blocks within segments."""
    length = charts.BLOCKS_OF_LEVEL * m
    blocks = [_core.block_mean_squares(part, m, length) for part in segments if part.size >= length]
    return np.concatenate([np.zeros(0), *blocks]) / 2.0**level


def _block_means(sums: _BlockSums) -> tuple[float, ...]:
    scatter: list[float] = []
    while True:
        level = len(scatter)
        count = sum(part.size for part in sums[level])
        if count < 30:  # the standard error of the scatter is then 13 %
            # A chart adds up to 2^REACH blocks before an alarm, so it uses the largest scatter of its and five coarser
            # levels.
            return tuple(max(scatter[k : k + 6]) for k in range(len(scatter)))
        scatter.append(max(1.0, math.sqrt(sum(float(part @ part) for part in sums[level]) / count / 2.0**level)))


def models_of(calibration: Mapping[str, Any], axes: Sequence[str] | None) -> dict[str, Model]:
    """Return the model of each axis to monitor."""
    if not isinstance(calibration, Mapping) or not calibration:
        raise OptionError(
            "calibration must be a Calibration or a mapping of axis to Fit or Model; got "
            f"{'an empty mapping' if isinstance(calibration, Mapping) else type(calibration).__name__}",
            argument="calibration", advice='Load one: `gmwm.Calibration.load("results/calibration.json")`.',
        )  # fmt: skip
    names = list(calibration) if axes is None else list(axes)
    unknown = [axis for axis in names if axis not in calibration]
    if unknown or not names:
        raise OptionError(argument="axes", expected=f"some of {', '.join(calibration)}", got=(unknown or [""])[0])
    return {axis: item.model if isinstance(item := calibration[axis], Fit) else as_model(item) for axis in names}


def common_rate(calibration: Mapping[str, Any], rate: float | None) -> float:
    """Return the sampling rate (Hz): the given one, or by default the rate of the fits."""
    rates = {item.wavelet_variance.rate for item in calibration.values() if isinstance(item, Fit)}
    if rate is None and not rates:
        raise OptionError(argument="rate", expected="a number (Hz), because models have no sampling rate", got=None)
    common = as_rate(rate if rate is not None else max(rates))
    for fit_rate in rates:
        check_rate(common, fit_rate)
    return common


def check_rate(rate: float, expected: float) -> None:
    """Raise an error if a recording does not have the sampling rate of the calibration."""
    if abs(rate / expected - 1.0) > 0.01:  # changes variances by less than the dead band of the charts
        raise OptionError(
            argument="rate",
            expected=f"{expected:g}, the rate of the calibration (Hz), because its values are per sample", got=rate,
            advice="Calibrate a recording with this rate.",
        )  # fmt: skip


LONGEST_RUN_S = 1e12
"""Longest time (s) between false alarms. The thresholds of the charts need a run length that is finite."""


def as_every(every: str | float) -> float:
    """Return the time between false alarms in seconds."""
    seconds = parse_length(every, "every") if isinstance(every, str) else every
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0 < seconds <= LONGEST_RUN_S:
        expected = f"a time above 0 s and at most {LONGEST_RUN_S:g} s, such as 30d"
        raise OptionError(argument="every", expected=expected, got=every)
    return float(seconds)


def baselines_of(
    calibration: Mapping[str, Any], chosen: Mapping[str, Baseline] | Literal["auto"] | None, axes: Sequence[str]
) -> dict[str, Baseline]:
    """Return the baseline of each axis that has one."""
    if chosen is None:
        return {}
    if chosen == "auto":
        measured = getattr(calibration, "baselines", {})
        return {axis: measured[axis] for axis in axes if axis in measured}
    if not isinstance(chosen, Mapping) or not all(isinstance(item, Baseline) for item in chosen.values()):
        raise OptionError(
            argument="baseline", expected="a mapping of axis to Baseline, 'auto', or None", got=type(chosen).__name__
        )
    return {axis: chosen[axis] for axis in axes if axis in chosen}


def remarks_of(gains: Mapping[str, Gain], baselines: Mapping[str, Baseline], *, wanted: bool) -> Iterator[Remark]:
    """Yield the remarks on approximated models and on axes without a baseline."""
    for axis, gain in gains.items():
        yield from (remark.about(axis) for remark in gain.finite.remarks)
        if wanted and axis not in baselines:
            yield Remark.of("monitor-no-baseline", axis)


def chunks_of(recording: Imu | Stream) -> Iterator[Chunk]:
    """Yield the chunks of a recording in memory or in a file."""
    if not isinstance(recording, Imu):
        yield from recording
        return
    reference = next(iter(recording.signals.values()))
    for k, ((first, last), start) in enumerate(zip(reference.segments, reference.starts, strict=True)):
        values = {axis: signal.values[first:last] for axis, signal in recording.signals.items()}
        yield Chunk(values, first=first, segment=k, start=start)


def checked_samples(axes: Sequence[str], values: Mapping[str, ArrayLike]) -> dict[str, Vector]:
    """Return the samples of the axes as vectors of equal length."""
    arrays: dict[str, Vector] = {}
    for axis in axes:
        if axis not in values:
            raise DataError(
                f"the samples of {axis} are missing; got {', '.join(values) or 'no axis'}", argument="values",
                advice="Pass all axes of the monitor, or make it with `axes=`.",
            )  # fmt: skip
        x = np.atleast_1d(np.ascontiguousarray(values[axis], dtype=np.float64))
        if x.ndim != 1:
            raise DataError(argument=axis, expected="one value for each sample", got=f"shape {x.shape}")
        if not np.all(np.isfinite(x)):
            raise DataError(
                f"{axis} has a value that is not finite", argument=axis,
                advice="Leave missing samples out, and call `gap()` there.",
            )  # fmt: skip
        arrays[axis] = x
    if len({x.size for x in arrays.values()}) > 1:
        sizes = ", ".join(f"{axis} {x.size}" for axis, x in arrays.items())
        raise DataError(f"the axes have different numbers of samples: {sizes}", argument="values")
    return arrays


def baselines(
    calibration: Mapping[str, Any], recording: Imu | Stream, axes: Sequence[str] | None = None
) -> dict[str, Baseline]:
    """Measure the baseline of each axis for `Monitor`, from a recording of a healthy sensor at rest.

    `calibrate` calls this function with the calibrated recording.

    Parameters
    ----------
    calibration : Calibration, or mapping of axis to Fit or Model
        The noise models.
    recording : Imu or Stream
        The reference recording. Its first 2.1 million samples are used.
    axes : sequence of str, optional
        The axes; all axes of the calibration by default.

    Raises
    ------
    DataError
        If the recording does not have an axis, or is too short.
    OptionError
        If the sampling rate differs from the rate of the calibration.

    Examples
    --------
    >>> from gmwm import Model, simulate
    >>> model = "WN(sigma2=1e-6) + RW(gamma2=1e-14)"
    >>> quiet = simulate({"gyro_x": model}, rate=100.0, samples=60_000, rng=1)
    >>> found = baselines({"gyro_x": model}, quiet)["gyro_x"]
    >>> found.ratios[:3].round(1).tolist(), found.equal
    ([1.0, 1.0, 1.0], 1)
    """
    models = models_of(calibration, axes)
    missing = [axis for axis in models if axis not in recording.axes]
    if missing:
        raise DataError(
            f"the reference has no {missing[0]}; it has {', '.join(recording.axes)}", argument="reference",
            advice="Choose the axes to monitor with {--axis}.",
        )  # fmt: skip
    rate = common_rate(calibration, recording.rate)
    check_rate(recording.rate, rate)
    parts: dict[str, list[list[Vector]]] = {axis: [] for axis in models}
    segment, total = -1, 0
    for chunk in chunks_of(recording):
        for axis, segments in parts.items():
            if chunk.segment != segment:
                segments.append([])
            segments[-1].append(chunk.values[axis])
        segment, total = chunk.segment, total + len(chunk)
        if total >= 1 << 21:  # later samples of a reference are not used
            break
    return {
        axis: Baseline.of(models[axis], [np.concatenate(part) for part in segments], rate)
        for axis, segments in parts.items()
    }


class BaselineAddition(AxisAddition):
    """The baseline of each axis: statistics of the innovations of its model in the recording."""

    name = "baseline"
    # 1.5 h at 100 Hz. With these samples, the standard deviation of every chart statistic is known to a few per cent.
    beginning = 1 << 19

    def of_axis(self, fit: Fit, beginnings: Sequence[Signal]) -> Baseline | None:
        """Measure the baseline; None if the samples are too few, or if the model has no Kalman filter."""
        segments = [values for signal in beginnings for values in signal.segment_values()]
        try:
            return Baseline.of(fit.model, segments, beginnings[0].rate)
        except (DataError, ModelError):
            return None  # the monitor reports it

    def to_dict(self, value: Baseline) -> dict[str, Any]:
        """Return a baseline as numbers and lists for JSON."""
        return value.to_dict()

    def from_dict(self, content: Mapping[str, Any]) -> Baseline:
        """Restore a baseline from the result of `to_dict`."""
        return Baseline.from_dict(content)
