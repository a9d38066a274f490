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

RATE_TOLERANCE = 0.01
"""Largest relative difference between the sampling rates of a recording and of the calibration. A difference of this
size changes the expected variances by less than the dead band of the charts."""


def models_of(calibration: Mapping[str, Any], axes: Sequence[str] | None) -> dict[str, Model]:
    """Return the model of each axis to monitor."""
    if not isinstance(calibration, Mapping) or not calibration:
        raise OptionError(
            "calibration must be a Calibration or a mapping of axis to Fit or Model; got "
            f"{'an empty mapping' if isinstance(calibration, Mapping) else type(calibration).__name__}",
            argument="calibration",
            advice='Load one: `gmwm.Calibration.load("results/calibration.json")`.',
        )
    names = list(calibration) if axes is None else list(axes)
    unknown = [axis for axis in names if axis not in calibration]
    if unknown or not names:
        raise OptionError(argument="axes", expected=f"some of {', '.join(calibration)}", got=(unknown or [""])[0])
    return {axis: _model(calibration[axis]) for axis in names}


def _model(item: Any) -> Model:
    return item.model if isinstance(item, Fit) else as_model(item)


def common_rate(calibration: Mapping[str, Any], rate: float | None) -> float:
    """Return the sampling rate (Hz): the given one, or by default the rate of the fits."""
    rates = {item.wavelet_variance.rate for item in calibration.values() if isinstance(item, Fit)}
    if rate is None and not rates:
        raise OptionError(argument="rate", expected="a number (Hz), because models have no sampling rate", got=None)
    found = as_rate(rate if rate is not None else max(rates))
    for known in rates:
        check_rate(found, known)
    return found


def check_rate(rate: float, known: float) -> None:
    """Raise an error if a recording does not have the sampling rate of the calibration."""
    if abs(rate / known - 1.0) > RATE_TOLERANCE:
        raise OptionError(
            argument="rate",
            expected=f"{known:g}, the rate of the calibration (Hz), because its values are per sample",
            got=rate,
            advice="Calibrate a recording with this rate.",
        )


LONGEST_EVERY = 1e12
"""Longest time (s) between false alarms. The thresholds of the charts need a run length that is finite."""


def as_every(every: str | float) -> float:
    """Return the time between false alarms in seconds."""
    seconds = parse_length(every, "every") if isinstance(every, str) else every
    if isinstance(seconds, bool) or not isinstance(seconds, (int, float)) or not 0 < seconds <= LONGEST_EVERY:
        expected = f"a time above 0 s and at most {LONGEST_EVERY:g} s, such as 30d"
        raise OptionError(argument="every", expected=expected, got=every)
    return float(seconds)


def baselines_of(
    calibration: Mapping[str, Any], given: Mapping[str, Baseline] | Literal["auto"] | None, axes: Sequence[str]
) -> dict[str, Baseline]:
    """Return the baseline of each axis that has one."""
    if given is None:
        return {}
    if given == "auto":
        own = getattr(calibration, "baselines", {})
        return {axis: own[axis] for axis in axes if axis in own}
    if not isinstance(given, Mapping) or not all(isinstance(one, Baseline) for one in given.values()):
        raise OptionError(
            argument="baseline", expected="a mapping of axis to Baseline, 'auto', or None", got=type(given).__name__
        )
    return {axis: given[axis] for axis in axes if axis in given}


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
    one = next(iter(recording.signals.values()))
    for k, ((first, last), start) in enumerate(zip(one.segments, one.starts, strict=True)):
        values = {axis: signal.values[first:last] for axis, signal in recording.signals.items()}
        yield Chunk(values, first=first, segment=k, start=start)


def as_lists(value: Any) -> Any:
    """Return a state with arrays and tuples converted to lists."""
    if isinstance(value, Mapping):
        return {key: as_lists(item) for key, item in value.items()}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [as_lists(item) for item in value] if isinstance(value, list | tuple) else value


def checked_samples(axes: Sequence[str], values: Mapping[str, ArrayLike]) -> dict[str, Vector]:
    """Return the samples of the axes as vectors of equal length."""
    arrays: dict[str, Vector] = {}
    for axis in axes:
        if axis not in values:
            raise DataError(
                f"the samples of {axis} are missing; got {', '.join(values) or 'no axis'}",
                argument="values",
                advice="Pass all axes of the monitor, or make it with `axes=`.",
            )
        x = np.atleast_1d(np.ascontiguousarray(values[axis], dtype=np.float64))
        if x.ndim != 1:
            raise DataError(argument=axis, expected="one value for each sample", got=f"shape {x.shape}")
        if not np.all(np.isfinite(x)):
            raise DataError(
                f"{axis} has a value that is not finite",
                argument=axis,
                advice="Leave missing samples out, and call `gap()` there.",
            )
        arrays[axis] = x
    if len({x.size for x in arrays.values()}) > 1:
        sizes = ", ".join(f"{axis} {x.size}" for axis, x in arrays.items())
        raise DataError(f"the axes have different numbers of samples: {sizes}", argument="values")
    return arrays
