"""Check the arguments of a monitor: models, sampling rate, time between false alarms, baselines and samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.monitor.baseline import Baseline
from gmwm.applications.monitor.whitening import Gain
from gmwm.base.arrays import Vector, as_rate
from gmwm.base.durations import parse_length
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Remark
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu
from gmwm.theory.processes.model import Model, as_model

if TYPE_CHECKING:
    from gmwm.files.readers.streams import Stream


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
        The noise models. recording : Imu or Stream The reference recording. Its first 2.1 million samples are used.
    axes : sequence of str, optional
        The axes; all axes of the calibration by default.

    Returns
    -------
    mapping of axis to Baseline

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
