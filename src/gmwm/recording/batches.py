"""Divide a recording, in memory or in a file, into batches of `BATCH_SAMPLES` samples from its first one on. Results
are then the same to the last bit in memory and in chunks."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gmwm.base.arrays import Vector, freeze, joined
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.base.text import with_article
from gmwm.base.threads import check_stop, return_memory
from gmwm.base.time_base import TimeBase
from gmwm.base.units import si_unit
from gmwm.recording.chunks import Samples
from gmwm.recording.signals import Imu, Signal, changed

BATCH_SAMPLES = 1 << 21
"""Samples of a batch: 5.8 h at 100 Hz, 100 MB for six axes; a choice, as 21 is their default of `exact_levels`."""


@runtime_checkable
class Streamed(Protocol):
    """A recording whose samples are read from a file when they are needed: `gmwm.readers.Stream`."""

    @property
    def source(self) -> str:
        """Name of the file or other source, for messages."""

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on how the file was interpreted."""

    @property
    def time_base(self) -> TimeBase:
        """Properties of the time stamps. After an iteration, they describe all time stamps."""

    @property
    def has_temperature(self) -> bool:
        """Whether the recording has a temperature."""

    @property
    def rows(self) -> int:
        """Number of rows that the clock counts. Without time stamps, it is the number of rows that were read first."""

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Consecutive samples of all axes of a recording, with the gaps between them."""

    signals: Mapping[str, Signal]  # samples of each axis
    first: int = 0  # number of the first sample in the recording, from 0
    continues: bool = False  # whether no sample is missing between this batch and the previous one
    temperature: Vector | None = None  # (n,) temperature (°C), if the recording has one
    # Axes that do not continue although the batch does: a gap before the batch was filled on the other axes only
    parted: frozenset[str] = frozenset()

    def continues_on(self, axis: str) -> bool:
        """Return whether the first sample of an axis continues the previous batch."""
        return self.continues and axis not in self.parted

    def __len__(self) -> int:
        return len(next(iter(self.signals.values())))

    @property
    def stop(self) -> int:
        """Number of the sample after the last one."""
        return self.first + len(self)

    def between(self, first: int, last: int) -> Batch:
        """Return the samples `first` … `last` − 1 of the batch."""
        if first == 0 and last >= len(self):
            return self
        begins = {begin for begin, _ in next(iter(self.signals.values())).segments}
        signals = {axis: part_of(x, first, last) for axis, x in self.signals.items()}
        heat = None if self.temperature is None else self.temperature[first:last]
        return Batch(signals, self.first + first, first not in begins if first else self.continues, heat)


class Segments:
    """Segments from batches in order: ranges, first times (s), and whether the lengths of gaps are known."""

    def __init__(self) -> None:
        self.ranges: list[tuple[int, int]] = []
        self.starts: list[float] = []
        self.gaps_known = True

    def update(self, batch: Batch) -> None:
        """Add the next batch."""
        first = next(iter(batch.signals.values()))
        ranges = [(batch.first + a, batch.first + b) for a, b in first.segments]
        if batch.continues:
            self.ranges[-1] = (self.ranges[-1][0], ranges.pop(0)[1])
        self.ranges += ranges
        self.starts += first.starts[batch.continues :]
        self.gaps_known &= first.gaps_known or len(first.segments) == 1


class Accumulator(Protocol):
    """A computation on consecutive samples, such as `WaveletAccumulator`."""

    def update(self, values: Vector, /) -> None:
        """Add the next samples."""

    def gap(self) -> None:
        """Mark that samples are missing."""


def feed(one: Accumulator, signal: Signal, continues: bool = False) -> None:
    """Add the samples of a signal to an accumulator, segment by segment."""
    for k, values in enumerate(signal.segment_values()):
        if k or not continues:
            one.gap()
        one.update(values)


def require_following(part: Any, following: Any, *alike: str) -> None:
    """Raise OptionError unless an accumulator begins where `part` ends, and the attributes `alike` are equal."""
    if not isinstance(following, type(part)):
        raise OptionError(argument="following", expected=with_article(type(part).__name__), got=following)
    for name in alike:
        value, other = getattr(part, name), getattr(following, name)
        if value != other:
            raise OptionError(
                f"both parts must have the same {name}; got {value!r} and {other!r}", argument=name, got=other
            )
    if following.start != part.stop:
        raise OptionError(
            f"the following part must begin with sample {part.stop}, where this part ends; it begins with sample "
            f"{following.start}", argument="start", got=following.start, advice="Pass {--start} when the part is made.",
        )  # fmt: skip


class Batches:
    """Batches in memory or in chunks, for several passes (one read if there is one batch), without samples added later.
    `done` is called with the number of samples so far."""

    def __init__(self, recording: Imu | Streamed, done: Callable[[int], None] | None = None) -> None:
        self.recording, self._done = recording, done
        self._only: Batch | None = None
        self._samples: int | None = None

    @property
    def samples(self) -> int:
        """Number of samples, after the first iteration."""
        return self._samples or 0

    def __iter__(self) -> Iterator[Batch]:
        if self._only is not None:
            if self._done is not None:
                self._done(self._only.stop)
            yield self._only
            return
        stop = 0
        for batch in batches(self.recording, self._done):
            check_stop()
            if self._samples is not None and batch.stop >= self._samples:
                yield batch.between(0, self._samples - batch.first)
                return
            stop = batch.stop
            if stop < BATCH_SAMPLES:
                self._only = batch
            yield batch
            del batch  # before the next one is gathered
            return_memory()
        self._samples = stop

    def each(self, *work: Callable[[Batch], None]) -> None:
        """Call functions with each batch, which is released before the next one is gathered."""
        for batch in self:
            for piece in work:
                piece(batch)
            del batch

    def values(self, axis: str, first: int, last: int) -> Vector:
        """Return samples number `first` … `last` − 1 of an axis."""
        parts = []
        for batch in self:
            if batch.first >= last:
                break
            if batch.stop > first:
                parts.append(batch.signals[axis].values[max(first - batch.first, 0) : last - batch.first])
        return np.concatenate(parts)


def batches(recording: Imu | Streamed, done: Callable[[int], None] | None = None) -> Iterator[Batch]:
    """Iterate over the batches of a recording; see `Batches`."""
    if not isinstance(recording, Imu):
        yield from gather(recording.samples(), recording.axes, recording.rate, done)
        return
    heat = recording.temperature
    if len(recording) <= BATCH_SAMPLES:
        yield Batch(recording.signals, temperature=heat)
    else:
        complete = Batch(recording.signals, temperature=heat)
        for first in range(0, len(recording), BATCH_SAMPLES):
            yield complete.between(first, first + BATCH_SAMPLES)
    if done is not None:
        done(len(recording))


def gather(
    samples: Iterable[Samples], axes: Sequence[str], rate: float, done: Callable[[int], None] | None = None
) -> Iterator[Batch]:
    """Gather samples in portions of any size into batches."""
    batch = _Gathered(axes, rate)
    for chunk in samples:
        if done is not None:
            done(chunk.first + len(chunk))
        yield from batch.add(chunk)
    yield from batch.end()


class _Gathered:
    """The samples of a batch that is not complete yet."""

    def __init__(self, axes: Sequence[str], rate: float) -> None:
        self._axes, self._rate = tuple(axes), rate
        self._values: dict[str, Vector] = {}
        self._begins: list[tuple[int, float]] = []  # place in the batch and time of the first sample of each segment
        self._first = self._size = 0
        self._continues = False

    def add(self, samples: Samples) -> Iterator[Batch]:
        """Add samples, and return the batches that are complete."""
        runs = {max(sample - samples.first, 0): (sample, time) for sample, time in samples.runs}
        begins, taken = sorted(runs), 0
        while taken < len(samples):
            part = slice(taken, min(len(samples), taken + BATCH_SAMPLES - self._size))
            at = bisect_right(begins, taken) - 1
            sample, time = runs[begins[at]]
            number = samples.first + taken
            if not self._size:
                self._first, self._continues = number, sample < number
                roles = (*self._axes, *(["temperature"] if samples.temperature is not None else []))
                self._values = {role: np.empty(BATCH_SAMPLES) for role in roles}
            if not self._size or sample == number:
                self._begins.append((self._size, time + (number - sample) / self._rate))
            for begin in begins[at + 1 : bisect_left(begins, part.stop)]:
                self._begins.append((self._size + begin - taken, runs[begin][1]))
            arrays = dict(samples.values)
            if samples.temperature is not None:
                arrays["temperature"] = samples.temperature
            for role, values in self._values.items():
                values[self._size : self._size + part.stop - taken] = arrays[role][part]
            self._size, taken = self._size + part.stop - taken, part.stop
            if self._size == BATCH_SAMPLES:
                yield from self.end()

    def end(self) -> Iterator[Batch]:
        """Return the samples so far."""
        if not self._size:
            return
        ends = [*(place for place, _ in self._begins), self._size]
        segments, starts = list(pairwise(ends)), [start for _, start in self._begins]
        values = {role: freeze(self._values.pop(role)[: self._size]) for role in list(self._values)}
        temperature = values.pop("temperature", None)
        signals = {
            axis: Signal(array, self._rate, unit=si_unit(axis), axis=axis, segments=segments, starts=starts)
            for axis, array in values.items()
        }
        self._begins, self._size = [], 0
        yield Batch(signals, self._first, self._continues, temperature)


def join_batches(parts: Sequence[Batch]) -> Batch:
    """Join consecutive batches to one batch."""
    if len(parts) == 1:
        return parts[0]
    signals = {
        axis: end_to_end([part.signals[axis] for part in parts], [part.continues_on(axis) for part in parts])
        for axis in parts[0].signals
    }
    return Batch(signals, parts[0].first, parts[0].continues)


def end_to_end(signals: Sequence[Signal], continues: Sequence[bool]) -> Signal:
    """Join consecutive parts of a signal. `continues` states for each part whether it continues the previous part."""
    segments, starts, size = list[tuple[int, int]](), list[float](), 0
    for signal, follows in zip(signals, [False, *continues[1:]], strict=True):
        moved = [(first + size, last + size) for first, last in signal.segments]
        if follows:
            segments[-1] = segments[-1][0], moved.pop(0)[1]
        segments += moved
        starts += signal.starts[follows:]
        size += len(signal)
    return changed(
        signals[0], values=joined([signal.values for signal in signals]), segments=tuple(segments),
        starts=tuple(starts), filled=sum(signal.filled for signal in signals),
    )  # fmt: skip


def part_of(signal: Signal, first: int, last: int) -> Signal:
    """Return the samples number `first` … `last` − 1 of a signal."""
    last = min(last, len(signal))
    place = bisect_right(signal.segments, first, key=lambda segment: segment[1])
    stop = bisect_left(signal.segments, last, key=lambda segment: segment[0])
    segments = [(begin - first, end - first) for begin, end in signal.segments[place:stop]]
    starts = list(signal.starts[place:stop])
    starts[0] += max(-segments[0][0], 0) / signal.rate
    segments[0] = max(segments[0][0], 0), segments[0][1]
    segments[-1] = segments[-1][0], min(segments[-1][1], last - first)
    return changed(
        signal, values=signal.values[first:last], segments=tuple(segments), start=starts[0], starts=tuple(starts),
        filled=0,
    )  # fmt: skip
