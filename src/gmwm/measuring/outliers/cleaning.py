"""Screen samples in one pass for bursts, wrong samples and heavy tails, and replace wrong samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmwm.base.arrays import Vector, row_medians
from gmwm.base.documents import Documented
from gmwm.base.time_base import times_of
from gmwm.measuring.covariance.tails import TailSums
from gmwm.measuring.outliers.bursts import BurstFinder, Bursts, Ranges, burst_ranges, coefficients, pulse_ranges
from gmwm.measuring.outliers.spikes import find_spikes, repaired, spikes_beside
from gmwm.measuring.variance.open_segments import panel_length
from gmwm.recording.batches import feed
from gmwm.recording.gaps import drawn
from gmwm.recording.resolution import lsb
from gmwm.recording.signals import Signal


@dataclass(frozen=True, kw_only=True)
class Replaced(Documented):
    """Samples of one axis that were replaced before the measurement. `spikes` and `in_knocks` are the numbers of
    isolated wrong samples and of samples in knocks, `largest` the largest deviation of the former in local standard
    deviations. `left` is the sum of the squares of wrong samples that are too small to be found.
    `knocks` has the begin and end (s) of each knock, counted like the option `skip` of `read`."""

    spikes: int = 0
    largest: float = 0.0
    knocks: tuple[tuple[float, float], ...] = ()
    in_knocks: int = 0
    left: float = 0.0

    def __add__(self, other: Replaced) -> Replaced:
        return Replaced(
            spikes=self.spikes + other.spikes, largest=max(self.largest, other.largest),
            knocks=self.knocks + other.knocks, in_knocks=self.in_knocks + other.in_knocks,
            left=self.left + other.left,
        )  # fmt: skip


NOTHING_REPLACED = Replaced()


@dataclass(frozen=True, kw_only=True, eq=False)
class Screen:
    """Screening of one axis: bursts, wrong samples in the data (as in `Replaced`), and sums for heavy tails."""

    bursts: Bursts
    spikes: int
    largest: float
    replaced: Replaced
    tails: TailSums


class Screening:
    """Screen samples that arrive in chunks; the result does not depend on the chunks."""

    def __init__(self, rate: float) -> None:
        self._bursts, self._tails = BurstFinder(rate), TailSums()

    def update(self, values: Vector) -> None:
        """Add the next samples of the segment."""
        self._bursts.update(values)
        self._tails.update(values)

    def gap(self) -> None:
        """End the segment, because samples are missing before the next ones."""
        self._bursts.gap()
        self._tails.gap()

    def result(self, *, spikes: int = 0, largest: float = 0.0, replaced: Replaced = NOTHING_REPLACED) -> Screen:
        """Return the results for all samples, with the isolated wrong samples that were found separately."""
        self.gap()
        bursts = self._bursts.result()
        return Screen(bursts=bursts, spikes=spikes, largest=largest, replaced=replaced, tails=self._tails)


def screened(x: Signal) -> Screen:
    """Screen a signal without replacing samples."""
    screening, spikes = Screening(x.rate), find_spikes(x)
    feed(screening, x)
    return screening.result(spikes=len(spikes), largest=spikes.largest)


MARGIN, LEAST = 1.0, 8
"""Margin that is replaced before and after a knock, where the knock is too weak to be detected: as a multiple of the
length of the knock, and its smallest number of samples (tests/outliers/test_cleaning.py, as the next two constants)."""
LONGEST = 30.0  # longest time (s) that is replaced, including the margins of the knock
MOST = 0.15  # largest share of the samples that is replaced, as `bursts.RARE`
KINDS = ("large", "small", "pulses")  # disturbances in the order of the search
_BESIDE = 32  # smallest number of samples on each side of a knock from which its samples are replaced during the search


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleaned:
    """A signal whose wrong samples and knocks are drawn from their distribution given the others; `knocks` (k, 2) are
    index ranges, and `replaced` counts samples."""

    signal: Signal
    knocks: Ranges
    replaced: Replaced


def cleaned(x: Signal) -> Cleaned:
    """Replace isolated wrong samples (`find_spikes`) and knocks (`find_bursts`), with fixed seeds. Knocks over 30 s, or
    together over 15 % of the samples, are kept: they are a state of the sensor."""
    step = lsb(x.values) or 0.0  # replaced samples are not at its multiples
    spikes = spikes_beside(x, step)
    signal = repaired(x, spikes)
    knocks, hidden = _knocks(signal.values, x.rate, step), False
    if len(spikes) and not knocks.size:
        # The largest samples of short pulses can look like spikes.
        hidden = True
        knocks = _knocks(x.values, x.rate, step, ("pulses",))
    if knocks.size:
        # Knocks hide the tails of the noise from the search for spikes, and spikes within knocks hide the knocks.
        before, spikes = spikes, find_spikes(replace(x, values=_Mirror(x.values).without(knocks)))
        if not hidden and not np.all(np.isin(before.indices, spikes.indices)):
            knocks = _knocks(repaired(x, spikes).values, x.rate, step)
            spikes = find_spikes(replace(x, values=_Mirror(x.values).without(knocks)))
        present = np.ones(len(x), dtype=np.bool_)
        for first, last in knocks.tolist():
            present[first:last] = False
        present[spikes.indices] = False
        signal = replace(x, values=drawn(x.values, present))
    times = times_of(knocks.ravel(), x.rate, x.segments, x.starts).reshape(-1, 2)
    return Cleaned(
        signal=signal,
        knocks=knocks,
        replaced=Replaced(
            spikes=len(spikes), largest=spikes.largest, left=spikes.left,
            knocks=tuple((start, stop) for start, stop in times.tolist()),
            in_knocks=_size(knocks),
        ),
    )  # fmt: skip


def _knocks(values: Vector, rate: float, step: float, kinds: tuple[str, ...] = KINDS) -> Ranges:
    """Return the index ranges of the knocks."""
    length = panel_length(rate)
    begins = range(0, values.size, length)
    panels = [_of_panel(values[begin : begin + length], rate, step, kinds) + begin for begin in begins]
    ranges = _union(np.concatenate(panels))
    ranges = ranges[ranges[:, 1] - ranges[:, 0] <= LONGEST * rate]
    return ranges if _size(ranges) <= MOST * values.size else ranges[:0]


def _of_panel(values: Vector, rate: float, step: float, kinds: tuple[str, ...]) -> Ranges:
    """Return the index ranges of the knocks in consecutive samples that form one panel."""
    ranges = _ranges_of(kinds, values, rate, step, most=MOST * values.size)
    if _size(ranges) > MOST * values.size:
        # At coarse levels, pulses every few seconds look like one burst. Longer knocks need their margins.
        pulses = _ranges_of(sorted(kinds, key="pulses".__ne__), values, rate, step)
        if pulses.size and np.max(pulses[:, 1] - pulses[:, 0]) < 150:
            return pulses
        return _ranges_of(kinds, values, rate, step, margin=MARGIN / 4)
    return ranges


def _ranges_of(
    kinds: Sequence[str], values: Vector, rate: float, step: float, *, margin: float = MARGIN, most: float = math.inf
) -> Ranges:
    """Return the index ranges of disturbances, searched in this order until they have more than `most` samples, with
    margins as a multiple of their length."""
    levels, ranges = list(coefficients(values, rate, step)), np.empty((0, 2), dtype=np.int64)
    mirror = _Mirror(values)
    for kind in kinds:
        # Each search follows the replacement of the knocks found so far, because weak ends are found last.
        for _ in range(6):
            if kind == "pulses":
                # Four pulses or knocks are not a chance; then, fewer ones are left. Their ends are sharp.
                pulses = pulse_ranges(levels, mirror.without(ranges), 1 if len(ranges) >= 4 else 4)
                wider = _widen(pulses, values.size, 0.0)
            else:
                wider = _widen(burst_ranges(levels, small=kind == "small"), values.size, margin)
            wider = _union(np.concatenate([ranges, wider]))
            if np.array_equal(wider, ranges):
                break
            if _size(wider) > most:
                return wider
            ranges, levels = wider, list(coefficients(mirror.without(wider), rate, step))
    return ranges


class _Mirror:
    """Samples that stand for ranges of values, to search for weak parts of knocks: those next to a range, mirrored on a
    straight line. Each range is computed once."""

    def __init__(self, values: Vector) -> None:
        self._values, self._known = values, dict[tuple[int, int], Vector]()

    def without(self, ranges: Ranges) -> Vector:
        """Return the values with these ranges replaced."""
        out = self._values.copy()
        for first, last in ranges.tolist():
            if (first, last) not in self._known:
                self._known[first, last] = self._of(first, last)
            out[first:last] = self._known[first, last]
        return out

    def _of(self, first: int, last: int) -> Vector:
        size, half = last - first, (last - first) // 2
        before = self._values[max(first - max(half, _BESIDE), 0) : first]
        after = self._values[last : last + max(half, _BESIDE)]
        if not before.size + after.size:
            return self._values[first:last]
        before, after = (side if side.size else other for side, other in ((before, after), (after, before)))
        start, end = (row_medians(side[None])[0] for side in (before, after))
        echoes = np.resize((before - start)[::-1], half), np.resize(after - end, size - half)[::-1]
        return np.asarray(np.linspace(start, end, size) + np.concatenate(echoes))


def _size(ranges: Ranges) -> int:
    return int(np.sum(ranges[:, 1] - ranges[:, 0]))


def _widen(ranges: Ranges, size: int, share: float = MARGIN) -> Ranges:
    """Extend each range by the margins in which the knock is weak, a share of its length."""
    margin = np.maximum(LEAST, np.ceil(share * (ranges[:, 1] - ranges[:, 0]))).astype(np.int64)
    first, last = ranges[:, 0] - margin, ranges[:, 1] + margin
    return np.stack([np.maximum(first, 0), np.minimum(last, size)], axis=1)


def _union(ranges: Ranges) -> Ranges:
    """Return the union of the ranges, in order."""
    if not ranges.size:
        return ranges
    ranges = ranges[np.argsort(ranges[:, 0])]
    ends = np.maximum.accumulate(ranges[:, 1])
    begins = np.flatnonzero(np.concatenate([[True], ranges[1:, 0] > ends[:-1]]))
    return np.stack([ranges[begins, 0], ends[np.append(begins[1:], ranges.shape[0]) - 1]], axis=1)
