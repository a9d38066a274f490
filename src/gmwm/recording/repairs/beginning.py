"""Leave times of a recording out, such as a warm-up or a motion, and subtract jumps of the mean."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from gmwm.base.arrays import Vector, freeze
from gmwm.base.remarks import Remark
from gmwm.recording.batches import Streamed
from gmwm.recording.chunks import Samples
from gmwm.recording.repairs.stage import Stage
from gmwm.recording.signals import Imu
from gmwm.recording.time_ranges import Trimmer, kept_ranges


def without_times(
    recording: Imu | Streamed, start: float, skip: Sequence[tuple[float, float]] = ()
) -> Imu | Streamed:  # fmt: skip
    """Return a recording without its first `start` seconds and without ranges (s), with the same remarks."""
    if isinstance(recording, Imu):
        return replace(recording.between(start, skip=skip), remarks=recording.remarks)
    return _PartialStream(recording, kept_ranges(start, None, skip))


class _PartialStream(Stage):
    """A recording in a file of which only some ranges (s) are kept while it is read."""

    def __init__(self, stream: Streamed, kept: Sequence[tuple[float, float]]) -> None:
        super().__init__(stream)
        self._kept = kept

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples."""
        trimmer = Trimmer(self._kept, self.rate)
        for samples in self._stream.samples():
            part = trimmer.take(samples)
            if part is not None:
                yield part
        self._base = trimmer.time_base(self._stream.time_base)


Jumps = Mapping[str, Sequence[tuple[int, float]]]
"""For each axis, the number of the first sample after each jump, and the size of the jump."""


def without_jumps(recording: Imu | Streamed, jumps: Jumps, remarks: Sequence[Remark]) -> Imu | Streamed:
    """Return a recording minus the jumps of its axes, with additional remarks."""
    if not isinstance(recording, Imu):
        return _LevelStream(recording, jumps, remarks)
    signals = {
        axis: replace(signal, values=_level(signal.values, 0, jumps.get(axis, ())))
        for axis, signal in recording.signals.items()
    }
    return replace(recording, signals=signals, remarks=(*recording.remarks, *remarks))


def _level(values: Vector, first: int, jumps: Sequence[tuple[int, float]]) -> Vector:
    """Return values minus the jumps; `first` is the number of the first value."""
    jumps = [(index, size) for index, size in jumps if index < first + values.size]
    if not jumps:
        return values
    level = values.copy()
    for index, size in jumps:
        level[max(index - first, 0) :] -= size
    return freeze(level)


class _LevelStream(Stage):
    """A recording in a file, from which jumps are subtracted while it is read."""

    def __init__(self, stream: Streamed, jumps: Jumps, remarks: Sequence[Remark]) -> None:
        super().__init__(stream)
        self._jumps, self._remarks = jumps, tuple(remarks)

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples."""
        for samples in self._stream.samples():
            values = {axis: _level(x, samples.first, self._jumps.get(axis, ())) for axis, x in samples.values.items()}
            yield replace(samples, values=values)
