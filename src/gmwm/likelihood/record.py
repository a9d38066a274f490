"""A record for the Kalman filter: samples at equal steps, NaN where one is missing."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector, as_rate, as_vector, freeze
from gmwm.errors import DataError, ModelError, OptionError
from gmwm.signals import MINIMUM_SAMPLES, Imu, Signal

_ROOM = 10_000_000
"""Missing samples that gaps may add whatever the length of the record."""


@dataclass(frozen=True, eq=False)
class Record:
    """One axis at equal steps.

    Attributes
    ----------
    values : (N,) array, in `unit`
        NaN where a sample is missing.
    rate : float
        Samples per second (Hz).
    start : float
        Time of the first sample (s).
    centre : float
        A number near the values, taken off before anything is squared.
    """

    values: Vector
    rate: float
    unit: str = ""
    axis: str = ""
    start: float = 0.0
    centre: float = 0.0

    def __post_init__(self) -> None:
        freeze(self.values)

    @property
    def observed(self) -> int:
        """Number of samples that are there."""
        return int(np.count_nonzero(np.isfinite(self.values)))

    @property
    def times(self) -> Vector:
        """Time of each sample (s)."""
        return np.asarray(self.start + np.arange(self.values.size) / self.rate)

    def signal(self) -> Signal:
        """The same as a signal with segments, whose wavelet variance can be had; short segments are left out.

        Where most of it lies in segments that are too short, the missing samples are drawn in straight lines.
        """
        there = np.isfinite(self.values)
        edges = np.flatnonzero(np.diff(np.concatenate(([False], there, [False])).astype(np.int8)))
        runs = [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a >= MINIMUM_SAMPLES]
        kept = sum(b - a for a, b in runs)
        if 2 * kept < np.count_nonzero(there):
            index = np.flatnonzero(there)
            whole = np.interp(np.arange(index[0], index[-1] + 1), index, self.values[index])
            return Signal(whole, self.rate, self.unit, self.axis)
        ends = np.cumsum([0, *(b - a for a, b in runs)]).tolist()
        return Signal(
            values=np.concatenate([self.values[a:b] for a, b in runs]),
            rate=self.rate,
            unit=self.unit,
            axis=self.axis,
            start=0.0,
            segments=list(pairwise(ends)),
            starts=[a / self.rate for a, _ in runs],
        )


def as_record(data: Signal | ArrayLike, rate: float | None, *, name: str = "data") -> Record:
    """The record that `data` stands for.

    Parameters
    ----------
    data : Signal or (N,) array
        Gaps between the segments of a signal are missing samples, as many as their time stamps say, to the nearest
        step, and one where the clock was set back. In an array NaN, or a masked value, is a missing sample.
    rate : float, optional
        Samples per second (Hz); needed with an array only.

    Raises
    ------
    DataError
        If fewer than 8 samples are there, a value is infinite, or gaps are so long that they outweigh the record.
    ModelError
        If the samples are all alike.
    OptionError
        If the rate is missing, or contradicts that of a signal.
    """
    if isinstance(data, Signal):
        if rate is not None and as_rate(rate) != data.rate:
            raise OptionError(f"rate={rate:g} contradicts the signal's {data.rate:g} Hz; leave rate out")
        values, step, unit, axis, start = _with_gaps(data), data.rate, data.unit, data.axis, data.start
    elif isinstance(data, Imu):
        raise DataError(f"{name} must be one axis, got a recording of {', '.join(data)}; pass imu[{data.axes[0]!r}]")
    else:
        given = np.ma.filled(data.astype(np.float64), np.nan) if isinstance(data, np.ma.MaskedArray) else data
        values, unit, axis, start = as_vector(given, name, finite=False).copy(), "", "", 0.0
        step = as_rate(rate)
    there = np.isfinite(values)
    seen = values if bool(np.all(there)) else values[there]
    endless = int(np.count_nonzero(np.isinf(values))) if seen.size < values.size else 0
    if endless:
        at = int(np.argmax(np.isinf(values)))
        raise DataError(
            f"{axis or name} must be finite, NaN where a sample is missing; got {endless} infinite (first at {at})"
        )
    if seen.size < MINIMUM_SAMPLES:
        raise DataError(
            f"{axis or name} must have at least {MINIMUM_SAMPLES} samples that are not missing, got {seen.size} of "
            f"{values.size}"
        )
    centre = float(np.mean(seen))
    if np.min(seen) == np.max(seen):
        raise ModelError("a constant signal has no noise to model: all its samples are alike")
    return Record(values=values, rate=step, unit=unit, axis=axis, start=start, centre=centre)


def _with_gaps(signal: Signal) -> Vector:
    """The samples of a signal with NaN for those that are missing between its segments."""
    if len(signal.segments) == 1:
        return signal.values.copy()
    places: list[int] = []
    at, end = 0, 0.0
    for (first, last), time in zip(signal.segments, signal.starts, strict=True):
        # From the sample before to this one is at least two steps, or there would be no gap.
        at = max(round(at + (time - end) * signal.rate), at + 1) if places else 0
        places.append(at)
        at += last - first
        end = time + (last - first) / signal.rate
    if at > 10 * len(signal) + _ROOM:
        raise DataError(
            f"{signal.axis or 'the signal'} has {at - len(signal)} samples missing in gaps and {len(signal)} that are "
            "there; use signal.longest(), or each part by itself"
        )
    values = np.full(at, np.nan)
    for place, segment in zip(places, signal.segment_values(), strict=True):
        values[place : place + segment.size] = segment
    return values
