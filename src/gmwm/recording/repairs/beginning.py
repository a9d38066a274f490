"""Leave the beginning of a recording out, such as a warm-up."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase
from gmwm.recording.batches import Streamed
from gmwm.recording.chunks import Samples
from gmwm.recording.signals import Imu
from gmwm.recording.time_ranges import Trimmer


def without_beginning(recording: Imu | Streamed, start: float) -> Imu | Streamed:
    """Return a recording without its first `start` seconds, with the same remarks."""
    if isinstance(recording, Imu):
        return replace(recording.between(start), remarks=recording.remarks)
    return _LaterStream(recording, start)


class _LaterStream:
    """A recording in a file whose beginning is left out while it is read."""

    def __init__(self, stream: Streamed, start: float) -> None:
        self._stream, self._start = stream, start
        self.source, self.axes, self.rate = stream.source, stream.axes, stream.rate
        self.has_temperature, self.rows = stream.has_temperature, stream.rows
        self._base: TimeBase | None = None

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks of the stream."""
        return self._stream.remarks

    @property
    def time_base(self) -> TimeBase:
        """Properties of the time stamps, of the later part after an iteration."""
        return self._base or self._stream.time_base

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples."""
        trimmer = Trimmer([(self._start, math.inf)], self.rate)
        for samples in self._stream.samples():
            part = trimmer.take(samples)
            if part is not None:
                yield part
        self._base = trimmer.time_base(self._stream.time_base)
