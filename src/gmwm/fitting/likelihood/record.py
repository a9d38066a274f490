"""Recordings in the form that the Kalman filter needs: equally spaced samples with NaN for missing ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector, as_rate, as_vector, freeze
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.text import counted
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Imu, Signal


@dataclass(frozen=True, eq=False)
class Record:
    """Equally spaced samples of one axis, NaN where one is missing, from the time `start` (s). `centre` is near the
    values and is subtracted before squares. Regression `columns` (p, N) have the standard deviation 1, `scales` (p,)
    before."""

    values: Vector
    rate: float
    unit: str = ""
    axis: str = ""
    start: float = 0.0
    centre: float = 0.0
    columns: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    scales: Vector = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self.values)

    def without(self, coefficients: Sequence[float]) -> Record:
        """Return the recording minus the effect of its columns with the given (unscaled) coefficients."""
        effect = (np.array(coefficients) * self.scales) @ self.columns
        return Record(self.values - effect, self.rate, self.unit, self.axis, start=self.start, centre=self.centre)

    @property
    def observed(self) -> int:
        """Number of observed samples."""
        return int(np.count_nonzero(np.isfinite(self.values)))

    @property
    def times(self) -> Vector:
        """Time of each sample (s)."""
        return np.asarray(self.start + np.arange(self.values.size) / self.rate)

    def signal(self) -> Signal:
        """Return the signal with short gaps filled, or all missing samples interpolated if most segments are too
        short."""
        signal = Signal.from_missing(self.values, self.rate, self.unit, self.axis).fill_gaps()
        usable = sum(b - a for a, b in signal.segments if b - a >= MINIMUM_SAMPLES)
        if 2 * usable >= len(signal):
            return signal
        index = np.flatnonzero(np.isfinite(self.values))
        values = np.interp(np.arange(index[0], index[-1] + 1), index, self.values[index])
        return Signal(values, self.rate, self.unit, self.axis)


def as_record(data: Signal | ArrayLike, rate: float | None) -> Record:
    """Make a recording for the Kalman filter. Gaps of a signal become missing samples, whose number follows from the
    time stamps (1 if the clock was set back); in an array, NaN or a masked value is missing. `rate` is needed for an
    array only. Raises DataError if fewer than 8 samples are observed, a value is
    infinite, or gaps are much longer than the recording; ModelError if all samples are equal; OptionError if the rate
    is missing or differs from the signal's."""
    if isinstance(data, Signal):
        if rate is not None and as_rate(rate) != data.rate:
            raise OptionError(
                argument="rate", expected=f"{data.rate:g}, the sampling rate of the signal (Hz)", got=rate,
                advice="Leave {--rate} out.",
            )  # fmt: skip
        values, step, unit, axis, start = _with_gaps(data), data.rate, data.unit, data.axis, data.start
    elif isinstance(data, Imu):
        raise DataError(
            f"data must be one axis; got a recording of {', '.join(data)}", argument="data",
            advice="Pass one axis, for example `imu['{axis}']`.", axis=data.axes[0],
        )  # fmt: skip
    else:
        samples = np.ma.filled(data.astype(np.float64), np.nan) if isinstance(data, np.ma.MaskedArray) else data
        values, unit, axis, start = as_vector(samples, "data", finite=False).copy(), "", "", 0.0
        step = as_rate(rate)
    observed = np.isfinite(values)
    seen = values if bool(np.all(observed)) else values[observed]
    endless = int(np.count_nonzero(np.isinf(values))) if seen.size < values.size else 0
    if endless:
        at = int(np.argmax(np.isinf(values)))
        raise DataError(
            f"{axis or 'data'} must be finite; got {counted(endless, 'infinite value')}, the first at index {at}",
            argument="data",
            advice="Mark missing samples as NaN.",
        )
    if seen.size < MINIMUM_SAMPLES:
        raise DataError(
            f"{axis or 'data'} must have at least {MINIMUM_SAMPLES} samples that are not missing; got {seen.size} of "
            f"{values.size}",
            argument="data",
            got=seen.size,
        )
    centre = float(np.mean(seen))
    if np.min(seen) == np.max(seen):
        raise ModelError(
            "the signal is constant: all its samples are equal",
            advice="Check that the sensor was recording, and that the right column was read.",
        )
    return Record(values=values, rate=step, unit=unit, axis=axis, start=start, centre=centre)


def _with_gaps(signal: Signal) -> Vector:
    """Return the samples of a signal, with NaN for the samples that are missing between its segments."""
    if len(signal.segments) == 1:
        return signal.values.copy()
    places: list[int] = []
    at, end = 0, 0.0
    for (first, last), time in zip(signal.segments, signal.starts, strict=True):
        # A gap has at least one missing sample.
        at = max(round(at + (time - end) * signal.rate), at + 1) if places else 0
        places.append(at)
        at += last - first
        end = time + (last - first) / signal.rate
    # Number of missing samples (80 MB) that gaps may add to a recording of any length. Longer recordings may have more;
    # see `_with_gaps`. Pinned by test_gaps_that_need_too_much_memory_are_refused in
    # tests/likelihood/test_loglikelihood.py.
    if at > 10 * len(signal) + 10_000_000:
        raise DataError(
            f"{signal.axis or 'the signal'} has {at - len(signal)} samples missing in gaps, and only {len(signal)} "
            "observed samples",
            advice="Use the longest part without a gap (`signal.longest()`), or each part alone.",
        )
    values = np.full(at, np.nan)
    for place, segment in zip(places, signal.segment_values(), strict=True):
        values[place : place + segment.size] = segment
    return values
