"""Change the samples of a recording in memory, or of one in a file while it is read."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase
from gmwm.recording.batches import Streamed


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
