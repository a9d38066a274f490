"""Fill the gaps of a recording block by block.

A block has `BLOCK` known samples, counted from the first one of the recording. Its gaps are filled from its own samples
and from `CONTEXT` samples on each side of it, with random numbers that follow from the number of the block. The result
therefore does not depend on the parts in which a recording arrives.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gmwm._arrays import Vector, freeze
from gmwm._threads import in_threads
from gmwm.batches import Batch, joined
from gmwm.filling import gaps
from gmwm.filling.drawing import drawn
from gmwm.signals import Signal


def fill_gaps(signal: Signal) -> Signal:
    """Fill the short gaps of a signal: see `Signal.fill_gaps`."""
    return joined(list(filled([Batch({signal.axis: signal})]))).signals[signal.axis]


def filled(
    batches: Iterable[Batch], threads: int | None = None, *, block: int = 0, context: int = 0
) -> Iterator[Batch]:
    """Fill the short gaps of a recording: see `Signal.fill_gaps`. The axes of a batch are filled in threads.

    Samples without short gaps are passed on as they come. Others wait until their block is complete, with the context
    after it. The sizes of blocks and contexts are `BLOCK` and `CONTEXT`, unless smaller ones are given.
    """
    block, context = block or gaps.BLOCK, context or gaps.CONTEXT
    window = _Window(block, context)
    passed = 0  # number of samples that were passed on
    for batch in batches:
        waited = passed < window.stop
        window.add(batch)
        if not waited and not window.ends_in_short_gaps(batch):
            yield batch
            passed = window.stop
        while (last := (passed // block + 1) * block) + context <= window.stop:
            yield window.filled(passed, last, threads)
            passed = last
        del batch
        window.forget(passed // block * block - context)
    while passed < window.stop:
        last = min((passed // block + 1) * block, window.stop)
        yield window.filled(passed, last, threads)
        passed = last


class _Window:
    """The batches that a block may need. Samples are counted from the first one of the first batch."""

    def __init__(self, block: int, context: int) -> None:
        self._block, self._context = block, context
        self._parts: list[Batch] = []
        self._first = self.stop = 0

    def add(self, batch: Batch) -> None:
        """Add the next batch."""
        self._parts.append(batch)
        self.stop += len(batch)

    def ends_in_short_gaps(self, batch: Batch) -> bool:
        """Return whether the last batch has gaps that may be filled, or a gap before it."""
        one = next(iter(batch.signals.values()))
        if not one.gaps_known:
            return False
        segments, starts = list(one.segments), list(one.starts)
        if len(self._parts) > 1 and not batch.continues:
            before = next(iter(self._parts[-2].signals.values()))
            (first, last), start = before.segments[-1], before.starts[-1]
            segments, starts = [(first - last, 0), *segments], [start, *starts]
        return gaps.has_short_gaps(one.rate, segments, starts)

    def filled(self, first: int, last: int, threads: int | None) -> Batch:
        """Return samples number `first` … `last` − 1 of a block with their gaps, and the gap before them, filled."""
        number = first // self._block
        begin = max(number * self._block - self._context, self._first)
        end = (number + 1) * self._block + self._context
        self._parts = [joined(self._parts)]
        part = self._parts[0].between(begin - self._first, end - self._first)
        one = next(iter(part.signals.values()))
        filling = Filling(one.rate, one.segments, one.starts, first=first - begin, last=last - begin, seed=number)

        def fill(_: str, signal: Signal) -> Signal:
            values = freeze(filling.of(signal.values))
            return replace(
                signal, values=values, segments=filling.segments, starts=filling.starts, filled=filling.filled
            )

        return Batch(in_threads(fill, part.signals, threads=threads), first, filling.continues)

    def forget(self, first: int) -> None:
        """Drop the samples before number `first`."""
        while self._parts and self._first + len(self._parts[0]) <= first:
            self._first += len(self._parts.pop(0))
        if self._parts and self._first < first:
            rest = self._parts[0].between(first - self._first, len(self._parts[0]))
            # A copy of a few samples, so that the memory of the others is free.
            self._parts[0] = replace(
                rest, signals={axis: replace(x, values=x.values.copy()) for axis, x in rest.signals.items()}
            )
            self._first = first


class Filling:
    """Plan for filling the gaps of a block, for all axes.

    A gap belongs to the block of the sample after it.

    Parameters
    ----------
    rate : float
        Samples per second (Hz).
    segments, starts
        Segments of the block with its context, and the times of their first samples (s).
    first, last : int
        Half-open range of the known samples of the block, or of the last part of them.
    seed : int
        Number of the block.

    Attributes
    ----------
    segments : tuple of (first, last)
        Segments of the block after it is filled.
    starts : tuple of float
        Times of their first samples (s).
    continues : bool
        Whether no gap is left before the first sample.
    filled : int
        Number of samples that stand for lost ones.
    """

    def __init__(
        self, rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float], *, first: int, last: int,
        seed: int,
    ) -> None:  # fmt: skip
        ranges = np.array(segments, dtype=np.int64)
        lost, lengths = gaps.lost_samples(rate, ranges, starts), ranges[:, 1] - ranges[:, 0]
        accepted = gaps.fillable(lengths, lost)
        lost = np.where(accepted, lost, 0)
        # Place of each segment on a timeline with the lost samples that are filled.
        places = np.concatenate([[0], np.cumsum(lengths[:-1] + lost)])
        self._known = np.arange(ranges[-1, 1]) + np.repeat(places - ranges[:, 0], lengths)
        self._cuts, self._seed = places[1:][~accepted].tolist(), seed
        self._size, self._first, self._last = int(places[-1] + lengths[-1]), first, last
        # The gap before the first sample of the block belongs to it.
        begin = int(self._known[first - 1]) + 1 if first else 0
        self._own = slice(begin, int(self._known[last - 1]) + 1)
        here = [cut - begin for cut in self._cuts if begin < cut < self._own.stop]
        edges = [0, *here, self._own.stop - begin]
        self.segments = tuple(pairwise(edges))
        self.filled = edges[-1] - (last - first)
        self.continues = first > 0 and begin not in self._cuts
        at = np.searchsorted(places, np.array(edges[:-1]) + begin, side="right") - 1
        times = np.asarray(starts)[at] + (np.array(edges[:-1]) + begin - places[at]) / rate
        self.starts = tuple(times.tolist())

    def of(self, values: Vector) -> Vector:
        """Return the samples of the block with its gaps filled, from the samples of the block and its context."""
        if not self.filled:
            return values[self._first : self._last]
        present = np.zeros(self._size, dtype=np.bool_)
        present[self._known] = True
        timeline = np.zeros(present.size)
        timeline[present] = values
        return drawn(timeline, present, seed=self._seed, cuts=self._cuts)[self._own]
