"""Sums over the wavelet coefficients of samples that arrive in chunks, with gaps between segments."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Integers, Vector, as_vector, as_whole_number, joined
from gmwm.base.threads import OneAtATime, one_at_a_time
from gmwm.measuring.variance.rise import RiseSums
from gmwm.measuring.variance.segment_state import SegmentState, Statistics, StatisticsCollector
from gmwm.recording.batches import feed
from gmwm.recording.signals import Signal

if TYPE_CHECKING:
    from typing_extensions import Self


class HeldSamples:
    """Samples in order of arrival, divided into segments by gaps; `inbox` is the buffer of small chunks and its fill.

    >>> held = HeldSamples()
    >>> held.add(np.array([1.0, 2.0]))
    >>> held.gap()
    >>> held.add(np.array([3.0]))
    >>> held.segments(), held.lengths, held.ends_with_gap
    ([array([1., 2.]), array([3.])], (2, 1), False)
    """

    def __init__(self, buffer: Vector | None = None) -> None:
        # Default size of the buffer of small chunks, so that single samples do not each need an array.
        size = 4096
        self._segments: list[list[Vector]] = [[]]
        self._lengths, self._size = [0], 0
        self._small = size if buffer is None else buffer.size
        self._place(np.empty(size) if buffer is None else buffer)

    def __getstate__(self) -> dict[str, Any]:
        self._flush()
        return {name: value for name, value in self.__dict__.items() if name not in ("_buffer", "inbox")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._place(np.empty(0))

    def __len__(self) -> int:
        """Return the number of samples."""
        return self._size + self.inbox.used

    @property
    def lengths(self) -> tuple[int, ...]:
        """Number of samples of each segment. Directly after a gap, the last number is 0."""
        return (*self._lengths[:-1], self._lengths[-1] + self.inbox.used)

    @property
    def ends_with_gap(self) -> bool:
        """Whether the last sample is followed by a gap."""
        return len(self._lengths) > 1 and not self.lengths[-1]

    def add(self, x: Vector) -> None:
        """Add samples to the current segment. A writable array is copied, because its owner can change it."""
        if self.inbox.append(x, self._small):
            return
        self._flush()
        if x.size < self._small:
            self._place(np.empty(self._small))
            self.inbox.append(x, self._small)
        else:
            self._store(x.copy() if x.flags.writeable else x)

    def gap(self) -> None:
        """End the current segment."""
        self._flush()
        if self._lengths[-1]:
            self._segments.append([])
            self._lengths.append(0)

    def segments(self) -> list[Vector]:
        """Return the samples of each segment as one array."""
        self._flush()
        self._segments = [segment if len(segment) < 2 else [joined(segment)] for segment in self._segments]
        return [segment[0] for segment in self._segments if segment]

    def _flush(self) -> None:
        """Move the used part of the buffer to the segment, without a copy."""
        used = self.inbox.used
        if used:
            self._store(self._buffer[:used])
            self._place(self._buffer[used:])

    def _place(self, buffer: Vector) -> None:
        """Use another buffer for small chunks."""
        self._buffer, self.inbox = buffer, _core.Inbox(buffer)

    def _store(self, x: Vector) -> None:
        self._segments[-1].append(x)
        self._lengths[-1] += x.size
        self._size += x.size


EXACT_LEVELS = 14  # default number of levels at which an accumulator uses every coefficient
LEAST_EXACT = 6
"""Smallest number of exact levels. Up to τ = 64 samples, every τ/64-th coefficient means every coefficient."""
MOST_EXACT = 24  # largest number of exact levels
MOST_LEVELS = 44  # largest number of levels: 2^44 samples are 500 years at 1 kHz
MEMORY_BYTES = 1 << 29
"""Default memory (bytes) of a recording's accumulators: 8.4 million samples (six axes), then 21 exact levels."""
PANEL_SAMPLES = 1 << 20  # largest number of samples that are processed together
UNCOPIED_SAMPLES = 1 << 18  # number of samples from which a chunk is processed without a copy


class SegmentedAccumulator(OneAtATime):
    """Sums over the wavelet coefficients of a recording in chunks, one thread at a time.

    Up to `held` samples (2^exact − 1 by default) are stored, with all levels exact; more are processed in panels to
    sums. `start` is the index of the first sample; `collector` adds statistics. See also `WaveletAccumulator`."""

    def __init__(
        self, levels: int, exact: int, start: int, collector: StatisticsCollector | None, held: int | None = None
    ) -> None:
        self.exact = as_whole_number(exact, "exact", LEAST_EXACT, MOST_EXACT)
        self.levels = as_whole_number(levels, "levels", 1, MOST_LEVELS)
        self.start = as_whole_number(start, "start", 0, 1 << 62)
        self.held = (1 << self.exact) - 1 if held is None else as_whole_number(held, "held", 0, 1 << 62)
        # `_first` is closed by a gap, `_last` is open, and the others are sums over the segments between them.
        self._first: SegmentState | None = None
        self._squares, self._counts = np.zeros(self.levels), np.zeros(self.levels, dtype=np.int64)
        self._collector = collector
        self._statistics: Statistics | None = None if collector is None else collector.empty()
        self._lengths: list[int] = []
        self._rises = 0.0
        self.filled, self._line = 0, RiseSums()
        self._last: SegmentState | None = None
        self._held, self._panel = HeldSamples(), np.empty(0)
        self._usual = False  # whether a small chunk needs no other checks and fits into the panel
        self._count = 0  # samples in the sums

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_panel": np.empty(0), "_usual": False}  # no segment uses the panel

    @one_at_a_time
    def __len__(self) -> int:
        """Return the number of samples so far."""
        return self._count + len(self._held)

    @property
    def stop(self) -> int:
        """Index of the next sample in the recording; missing samples in gaps are not counted."""
        return self.start + len(self)

    @property
    @one_at_a_time
    def lengths(self) -> tuple[int, ...]:
        """Lengths of the segments between gaps so far."""
        first = () if self._first is None else (self._first.count,)
        open_part = 0 if self._last is None else self._last.count
        held = self._held.lengths
        going = (open_part + held[0], *held[1:])
        return (*first, *self._lengths, *(length for length in going if length))

    @property
    def holds_all(self) -> bool:
        """Whether all samples so far are stored. The result is then computed as in `wavelet_variance`."""
        return self._first is None and self._last is None and not self._lengths

    def update(self, chunk: ArrayLike) -> None:
        """Add the next samples (n,), one or more. Raises DataError if a value is NaN or infinite, or if, in a robust
        accumulator, it is so large that double precision loses the other values. The chunk is rejected, and the earlier
        samples are kept."""
        with self._lock:
            # The checks of a small chunk in Python take three times as long as its sums.
            if not (self._usual and self._held.inbox.append(chunk, UNCOPIED_SAMPLES - 1)):
                self._add(chunk)

    @one_at_a_time
    def feed(self, signal: Signal, continues: bool = False) -> None:
        """Add a signal, which may have filled samples. If `continues`, its first segment extends the open segment."""
        feed(self, signal, continues)
        self.filled += signal.filled
        self._line = self._line.followed_by(RiseSums.of(signal))

    @property
    @one_at_a_time
    def rise(self) -> float | None:
        """Mean rise per sample over all segments; None if there is one segment or a gap has an unknown length."""
        return self._line.slope() if len(self.lengths) > 1 and self._line.number == len(self) else None

    @one_at_a_time
    def gap(self) -> None:
        """Mark a gap where samples are missing, so that the next sample begins a new segment."""
        if len(self._held):
            self._held.gap()
        else:
            self._end_segment()

    def _take_state(self, other: Self) -> None:
        """Copy the state of another accumulator; segments are immutable, so both can share them."""
        other._fold()
        self._first, self._last, self._rises = other._first, other._last, other._rises
        self.filled, self._line = other.filled, other._line
        self._count = other._count
        self._squares, self._counts = other._squares.copy(), other._counts.copy()
        self._lengths, self._statistics = list(other._lengths), other._statistics

    def _append(self, following: Self) -> None:
        """Append a part of the recording that directly follows this part."""
        self.filled += following.filled
        self._line = self._line.followed_by(following._line)
        following._fold()
        self._count += following._count
        for part, ended in ((following._first, True), (following._last, False)):
            if part is not None:
                self._last = part if self._last is None else self._last.followed_by(part, self._collector)
            if ended and following._first is not None:
                self._end_segment()
                self._squares += following._squares
                self._counts += following._counts
                if self._statistics is not None:
                    self._statistics = self._statistics.merge(following._statistics)
                self._lengths += following._lengths
                self._rises += following._rises

    def _open(self) -> list[SegmentState]:
        """Return the first and the last segment, to which another part can still be joined."""
        return [part for part in (self._first, self._last) if part is not None]

    def _sums(self) -> tuple[Vector, Integers]:
        """Return Σ W² and the number of coefficients of all levels (J,)."""
        squares, counts = self._squares.copy(), self._counts.copy()
        for part in self._open():
            sums = part.sums(self.levels)
            squares, counts = squares + sums[0], counts + sums[1]
        return squares, counts

    def _all_statistics(self) -> Any:
        """Return the collected statistics of all segments."""
        statistics = self._statistics
        for part in self._open():
            assert statistics is not None
            assert self._collector is not None
            statistics = statistics.merge(part.all_statistics(self._collector))
        return statistics

    def _require_usable(self, x: Vector) -> None:
        """Raise an error if these samples cannot be used. By default, all finite samples can be used."""

    def _add(self, chunk: ArrayLike) -> None:
        """Add samples after all checks."""
        x = as_vector(chunk, "chunk", at_least=0)
        self._require_usable(x)
        room = self.held if self.holds_all else PANEL_SAMPLES
        if len(self._held) + x.size > room:
            self._fold()
        if x.size > room or (x.size >= UNCOPIED_SAMPLES and not self.holds_all):
            self._grow(x)
        elif x.size:
            self._held.add(x)

    def _fold(self) -> None:
        """Process the samples that are stored, and store them no longer."""
        parts = self._held.segments()
        for values in parts:
            self._require_usable(values)
        if not self._panel.size:
            self._panel = np.empty(PANEL_SAMPLES)
        self._usual = self._collector is None
        held, self._held = self._held, HeldSamples(self._panel)  # a segment keeps no sample of the panel
        for k, values in enumerate(parts):
            if k:
                self._end_segment()
            self._grow(values)
        if held.ends_with_gap:
            self._end_segment()

    def _end_segment(self) -> None:
        """Close the open segment."""
        if self._last is None:
            return
        if self._first is None and not self._lengths:
            self._first = self._last
        else:
            segment = self._last
            squares, counts = segment.sums(self.levels)
            self._squares += squares
            self._counts += counts
            if self._statistics is not None and self._collector is not None:
                self._statistics = self._statistics.merge(segment.all_statistics(self._collector))
            self._lengths.append(segment.count)
            self._rises += float(segment.count) ** 2 * segment.rise
        self._last = None

    def _grow(self, x: Vector) -> None:
        """Add samples to the open segment."""
        for k in range(0, x.size, PANEL_SAMPLES):
            part = x[k : k + PANEL_SAMPLES]
            if self._last is None:
                self._last = SegmentState.of(
                    part, self.stop, exact=self.exact, levels=self.levels, collector=self._collector
                )
            else:
                self._last = self._last.grown(part, self._collector)
            self._count += part.size


def exact_levels(axes: int, memory: int = MEMORY_BYTES, sample_bytes: int = 40) -> int:
    """Return the largest number of exact levels for which the accumulators of all axes need at most `memory` bytes.

    >>> exact_levels(6), exact_levels(1)
    (21, 23)
    """
    return min(max((memory // (sample_bytes * axes)).bit_length() - 1, LEAST_EXACT), MOST_EXACT)


def held_samples(axes: int) -> int:
    """Return the default number of samples of each axis that are stored in a recording of `axes` axes.

    >>> held_samples(6)
    8388608
    """
    return 1 << ((MEMORY_BYTES // (8 * axes)).bit_length() - 1)


LEAST_PANEL_SAMPLES = 1 << 17  # smallest number of samples of a panel


def panel_length(rate: float) -> int:
    """Return the number of samples of a panel, a power of two.

    >>> panel_length(100.0), panel_length(4000.0)
    (131072, 524288)
    """
    return max(LEAST_PANEL_SAMPLES, 1 << max(int(np.ceil(np.log2(128.0 * rate))), 0))


class Panels:
    """Divide one segment after the other into panels of `length` samples. The last panel of a segment can be shorter.

    >>> panels = Panels(4)
    >>> [part.tolist() for part in panels.divide(np.arange(6.0))], [part.tolist() for part in panels.end()]
    ([[0.0, 1.0, 2.0, 3.0]], [[4.0, 5.0]])
    """

    def __init__(self, length: int) -> None:
        self.length = length
        self._rest: list[Vector] = []
        self._held = 0

    def divide(self, values: Vector) -> Iterator[Vector]:
        """Add samples of the current segment, and yield the panels that are complete."""
        first = 0
        while self._held + values.size - first >= self.length:
            last = first + self.length - self._held
            yield self._join(values[first:last])
            first = last
        if first < values.size:
            # A copy, because the chunk may be reused by the reader.
            self._rest.append(values[first:].copy())
            self._held += values.size - first

    def end(self) -> Iterator[Vector]:
        """End the segment, and yield its last panel if it has samples."""
        if self._held:
            yield self._join(np.empty(0))

    def _join(self, values: Vector) -> Vector:
        joined = np.concatenate([*self._rest, values]) if self._rest else values
        self._rest, self._held = [], 0
        return np.ascontiguousarray(joined, dtype=np.float64)
