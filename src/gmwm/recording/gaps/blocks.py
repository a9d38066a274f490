"""Fill the gaps of a recording block by block.

Gaps of `BLOCK_SAMPLES` known samples are filled from these and `CONTEXT` on each side, with the block's number as seed,
so the parts in which a recording arrives have no effect."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, freeze
from gmwm.base.threads import in_threads, return_memory
from gmwm.base.time_base import lost_before
from gmwm.recording.batches import Batch, end_to_end, join_batches
from gmwm.recording.gaps import gaps
from gmwm.recording.gaps.drawing import drawn
from gmwm.recording.gaps.gaps import restarts
from gmwm.recording.signals import Signal, changed


def fill_gaps(signals: Mapping[str, Signal]) -> dict[str, Signal]:
    """Fill short gaps (`Signal.fill_gaps`); where one sensor restarted, all signals are split to stay synchronous."""
    return dict(join_batches(list(filled([Batch(signals)], together=True))).signals)


def filled(
    batches: Iterable[Batch], threads: int | None = None, *, block: int = 0, context: int = 0, together: bool = False
) -> Iterator[Batch]:
    """Fill the short gaps of a recording (`Signal.fill_gaps`), its axes in threads.

    Axes are split where their sensor restarted, with `together` all of them. Samples without short gaps are yielded at
    once, others when their block and context are complete."""
    block, context = block or gaps.BLOCK_SAMPLES, context or gaps.CONTEXT
    window = _Window(block, context, together)
    passed = 0  # number of samples that were yielded
    for batch in batches:
        waited = passed < window.stop
        window.add(batch)
        if not waited and not window.ends_in_short_gaps(batch):
            yield batch
            passed = window.stop
        while (last := (passed // block + 1) * block) + context <= window.stop:
            yield window.fill(passed, last, threads)
            passed = last
            return_memory()
        del batch
        window.forget(passed // block * block - context)
    while passed < window.stop:
        last = min((passed // block + 1) * block, window.stop)
        yield window.fill(passed, last, threads)
        passed = last


class _Window:
    """The batches from which the next block is filled. Samples are counted from the first one of the first batch."""

    def __init__(self, block: int, context: int, together: bool) -> None:
        self._block, self._context, self._together = block, context, together
        self._parts: list[Batch] = []
        self._first = self.stop = 0

    def add(self, batch: Batch) -> None:
        """Add the next batch."""
        self._parts.append(batch)
        self.stop += len(batch)

    def ends_in_short_gaps(self, batch: Batch) -> bool:
        """Return whether the last batch has gaps that may be filled, or a gap before it."""
        signal = next(iter(batch.signals.values()))
        if not signal.gaps_known:
            return False
        segments, starts = list(signal.segments), list(signal.starts)
        if len(self._parts) > 1 and not batch.continues:
            before = next(iter(self._parts[-2].signals.values()))
            (first, last), start = before.segments[-1], before.starts[-1]
            segments, starts = [(first - last, 0), *segments], [start, *starts]
        return gaps.has_short_gaps(signal.rate, segments, starts)

    def fill(self, first: int, last: int, threads: int | None) -> Batch:
        """Return samples number `first` … `last` − 1 of a block with their gaps, and the gap before them, filled."""
        number = first // self._block
        begin = max(number * self._block - self._context, self._first)
        end = (number + 1) * self._block + self._context
        window = self._between(begin, end)
        axes = dict.fromkeys(self._parts[0].signals, None)
        lost = self._lost_counts(window, threads)

        def fill_axis(axis: str, _: None) -> tuple[Signal, bool]:
            plan = Filling(_joined(window, axis), lost[axis], first=first - begin, last=last - begin, seed=number)
            return plan.signal(), plan.continues

        results = in_threads(fill_axis, axes, threads=threads)
        continues = any(follows for _, follows in results.values())
        parted = frozenset(axis for axis, (_, follows) in results.items() if continues and not follows)
        return Batch({axis: signal for axis, (signal, _) in results.items()}, first, continues, parted=parted)

    def _between(self, first: int, last: int) -> list[Batch]:
        """Return samples number `first` … `last` − 1 as views of the batches."""
        pieces, begin = list[Batch](), self._first
        for part in self._parts:
            if first < begin + len(part) and begin < last:
                pieces.append(part.between(max(first - begin, 0), last - begin))
            begin += len(part)
        return pieces

    def _lost_counts(self, window: Sequence[Batch], threads: int | None) -> Mapping[str, NDArray[np.int64]]:
        """Return for each axis the number of samples to fill in before each segment but the first."""
        axes = dict.fromkeys(window[0].signals, None)
        first = _joined(window, next(iter(axes)))
        ranges = np.array(first.segments, dtype=np.int64)
        begins, lost = ranges[1:, 0], lost_before(first.rate, ranges, first.starts)
        accepted = gaps.fillable(ranges[:, 1] - ranges[:, 0], lost)

        def own(axis: str, _: None) -> NDArray[np.int64]:
            again, values = np.zeros_like(accepted), _joined(window, axis).values
            again[accepted] = restarts(values, begins[accepted], lost[accepted], begins[~accepted].tolist())
            return np.where(accepted & ~again, lost, 0)

        samples = in_threads(own, axes, threads=threads)
        if not self._together:
            return samples
        least = np.stack(list(samples.values())).min(axis=0)
        return dict.fromkeys(axes, least)

    def forget(self, first: int) -> None:
        """Drop the samples before number `first`."""
        while self._parts and self._first + len(self._parts[0]) <= first:
            self._first += len(self._parts.pop(0))
        if self._parts and self._first < first:
            size = len(self._parts[0])
            remainder = self._parts[0].between(first - self._first, size)
            signals = {axis: _without_others(x, size) for axis, x in remainder.signals.items()}
            self._parts[0], self._first = replace(remainder, signals=signals), first


def _without_others(x: Signal, size: int) -> Signal:
    """Copy what remains of a batch of `size` samples, so that the memory of the others can be freed, unless the batch
    is a part of a recording in memory."""
    owner = x.values.base
    if isinstance(owner, np.ndarray) and owner.size > size:
        return x
    return changed(x, values=freeze(x.values.copy()))


def _joined(window: Sequence[Batch], axis: str) -> Signal:
    """Return the samples of an axis, with a copy only if they are in several batches."""
    if len(window) == 1:
        return window[0].signals[axis]
    return end_to_end([batch.signals[axis] for batch in window], [batch.continues_on(axis) for batch in window])


class Filling:
    """Plan for filling an axis's gaps in a block with its context; a gap belongs to the block of the sample after it.

    `lost` (m,) samples are filled in before each segment but the first (0: kept). `first` and `last` are the range of
    the block's known samples, `seed` is its number, and `continues`: no gap is left before the first one."""

    def __init__(self, signal: Signal, lost: NDArray[np.int64], *, first: int, last: int, seed: int) -> None:
        self._signal, self._seed = signal, seed
        ranges = np.array(signal.segments, dtype=np.int64)
        lengths = ranges[:, 1] - ranges[:, 0]
        # Position of each segment on a timeline that includes the filled samples.
        places = np.concatenate([[0], np.cumsum(lengths[:-1] + lost)])
        self._ranges, self._places = ranges, places
        self._cuts = places[1:][lost == 0].tolist()
        self._size, self._first, self._last = int(places[-1] + lengths[-1]), first, last
        # The gap before the first sample of the block belongs to it.
        begin = self._place(first - 1) + 1 if first else 0
        self._own = slice(begin, self._place(last - 1) + 1)
        here = [cut - begin for cut in self._cuts if begin < cut < self._own.stop]
        edges = [0, *here, self._own.stop - begin]
        self._segments = tuple(pairwise(edges))
        self._filled = edges[-1] - (last - first)
        self.continues = first > 0 and begin not in self._cuts
        at = np.searchsorted(places, np.array(edges[:-1]) + begin, side="right") - 1
        self._starts = np.asarray(signal.starts)[at] + (np.array(edges[:-1]) + begin - places[at]) / signal.rate

    def _place(self, sample: int) -> int:
        """Return the position of a known sample on the timeline."""
        segment = int(np.searchsorted(self._ranges[:, 0], sample, side="right")) - 1
        return sample + int(self._places[segment] - self._ranges[segment, 0])

    def signal(self) -> Signal:
        """Return the block with its gaps filled, from its samples and its context."""
        return replace(
            self._signal, values=freeze(self._values()), segments=self._segments, starts=tuple(self._starts.tolist()),
            filled=self._filled,
        )  # fmt: skip

    def _values(self) -> Vector:
        values = self._signal.values
        if not self._filled:
            return values[self._first : self._last]
        present = np.zeros(self._size, dtype=np.bool_)
        for place, (begin, end) in zip(self._places.tolist(), self._ranges.tolist(), strict=True):
            present[place : place + end - begin] = True
        timeline = np.zeros(present.size)
        timeline[present] = values
        # A view would keep the context in memory.
        return drawn(timeline, present, seed=self._seed, cuts=self._cuts)[self._own].copy()
