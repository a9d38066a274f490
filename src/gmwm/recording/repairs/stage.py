"""Change the samples of a recording in memory, or of one in a file while it is read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase
from gmwm.recording.batches import Streamed
from gmwm.recording.chunks import Samples
from gmwm.recording.signals import Imu, Signal


class Stage:
    """A recording in a file whose samples are changed while they are read, with one of `every` samples left."""

    def __init__(self, stream: Streamed, axes: Sequence[str] = (), every: float = 1.0) -> None:
        self._stream, self.source, self.axes = stream, stream.source, tuple(axes) or stream.axes
        self.rate, self.rows, self.has_temperature = (
            stream.rate / every,
            round(stream.rows / every),
            stream.has_temperature,
        )
        self._remarks: tuple[Remark, ...] = ()
        self._base: TimeBase | None = None

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks of the stream, and on what is changed; complete after an iteration."""
        return (*self._stream.remarks, *self._remarks)

    @property
    def time_base(self) -> TimeBase:
        """Properties of the time stamps; after an iteration those of the samples that were kept."""
        return self._base or self._stream.time_base


def samples_of(imu: Imu, axes: Sequence[str]) -> Samples:
    """Return the samples of some axes of a recording in memory."""
    first = imu.signals[axes[0]]
    runs = tuple((begin, time) for (begin, _), time in zip(first.segments, first.starts, strict=True))
    values = {axis: imu.signals[axis].values for axis in axes}
    return Samples(values, imu.rate, first=0, segment=0, runs=runs, temperature=imu.temperature)


def with_samples(imu: Imu, part: Samples, base: TimeBase, remarks: Sequence[Remark]) -> Imu:
    """Return a recording with other samples and additional remarks."""
    first, ranges = imu.signals[next(iter(part.values))], list(part.ranges())
    signals = {
        axis: Signal(
            values=values, rate=part.rate, unit=imu.signals[axis].unit, axis=axis,
            segments=[(begin, end) for begin, end, _ in ranges], starts=[time for _, _, time in ranges],
            gaps_known=first.gaps_known or len(first.segments) == 1,
        )
        for axis, values in part.values.items()
    }  # fmt: skip
    return replace(imu, signals=signals, remarks=(*imu.remarks, *remarks), time_base=base, temperature=part.temperature)


def time_base_of(imu: Imu) -> TimeBase:
    """Return the time base of a recording in memory."""
    return imu.time_base or TimeBase(imu.rate, start=imu.signals[imu.axes[0]].start)
