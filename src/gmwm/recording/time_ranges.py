"""Shorten a recording to a range of time, and leave out ranges within it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np

from gmwm.base.arrays import Vector, as_number
from gmwm.base.errors import DataError, GmwmWarning, OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.reporting import warn
from gmwm.base.template import join_names
from gmwm.base.text import moment
from gmwm.base.time_base import TimeBase
from gmwm.recording.chunks import MINIMUM_SAMPLES, Samples

TIME_ROUNDING = 1e-6
"""Difference (samples) up to which a time is that of a sample: above float64 rounding (1e-7 at 1 kHz after a year),
below what users type (tests/test_cuts.py)."""


def cut(
    samples: Samples, base: TimeBase, intervals: Sequence[tuple[float, float]]
) -> tuple[Samples, TimeBase, Remark] | None:
    """Return the part of a recording in ranges of time, with its time base and a remark; None if it is all of it."""
    trimmer = Trimmer(intervals, samples.rate)
    part = trimmer.take(samples)
    base = trimmer.time_base(base)
    if part is None or len(part) == len(samples):
        return None
    durations = {"kept": Quantity(len(part) / part.rate, "s"), "whole": Quantity(len(samples) / part.rate, "s")}
    return part, base, Remark.of("cut", case="cut", known="yes", ranges=range_texts(intervals), **durations)


class Trimmer:
    """Keeps the samples of a recording that lie in ranges of time (s) from the first sample, in order."""

    def __init__(self, kept: Sequence[tuple[float, float]], rate: float) -> None:
        self._kept, self._rate, self._clock = kept, rate, _Elapsed(rate)
        self._starts, self._sizes = list[float](), list[int]()
        self._count, self._left = 0, math.nan
        self._following = (-1, -1)  # segment and number of the sample that would follow without a gap

    @property
    def done(self) -> bool:
        """Whether no later sample is kept."""
        return not self._kept or self._clock.end >= self._kept[-1][1]

    def take(self, samples: Samples) -> Samples | None:
        """Return the kept samples, numbered from the first kept one of the recording; None if there are none."""
        parts, runs, first, segment = list[slice](), list[tuple[int, float]](), self._count, len(self._sizes) - 1
        for k, ((begin, end, _), (sample, time)) in enumerate(zip(samples.ranges(), samples.runs, strict=True)):
            elapsed = self._clock.begin(sample, time, samples.first + end)
            for limits in self._kept:
                a, b = (
                    int(
                        np.clip(
                            np.ceil((edge - elapsed) * self._rate - TIME_ROUNDING) + sample - samples.first, begin, end
                        )
                    )
                    for edge in limits
                )
                if a < b:
                    parts.append(slice(a, b))
                    passed = (samples.first + a - sample) / self._rate
                    if self._following != (samples.segment + k, samples.first + a):
                        self._left = elapsed + passed if not self._sizes else self._left
                        self._starts.append(time + passed)
                        self._sizes.append(0)
                        runs.append((self._count, time + passed))
                    elif not runs:
                        runs.append((first - self._sizes[-1], self._starts[-1]))
                    self._following = (samples.segment + k, samples.first + b)
                    self._sizes[-1] += b - a
                    self._count += b - a
        if not parts:
            return None

        def of(values: Vector) -> Vector:
            return values[parts[0]] if len(parts) == 1 else np.concatenate([values[part] for part in parts])

        return Samples(
            {axis: of(values) for axis, values in samples.values.items()}, samples.rate, first=first,
            segment=max(segment + (runs[0][0] == first), 0), runs=tuple(runs),
            temperature=None if samples.temperature is None else of(samples.temperature),
        )  # fmt: skip

    def time_base(self, base: TimeBase) -> TimeBase:
        """Return the kept samples' time base, after the last batch, from that of the whole recording."""
        require_some(max(self._sizes, default=0), self._kept, self._clock.end)
        require_inside(self._kept, self._clock.end, self._rate)
        return cut_base(base, self._starts, self._sizes, base.left + self._left)


class _Elapsed:
    """Time since the first sample, including gaps. If the clock was set back, the time continues without a step."""

    def __init__(self, rate: float) -> None:
        self._rate, self._run, self._origin = rate, -1, 0.0
        self._ahead = self._begin = self.end = 0.0

    def begin(self, sample: int, time: float, stop: int) -> float:
        """Return the time (s) since the first sample at which a segment begins; `stop` follows its last sample."""
        if self._run < 0:
            self._origin = time
        if sample != self._run:
            begin = time - self._origin + self._ahead
            if begin < self.end:
                self._ahead, begin = self._ahead + self.end - begin, self.end
            self._run, self._begin = sample, begin
        self.end = self._begin + (stop - sample) / self._rate
        return self._begin


def kept_ranges(
    start: float | None, stop: float | None, skip: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Return the ranges of time that are kept (s), in order."""
    begin, end = _seconds(0.0 if start is None else start, "start"), math.inf
    if stop is not None:
        end = _seconds(stop, "stop")
        if not begin < end:
            raise OptionError(argument="stop", expected=f"a time after the start at {moment(begin)}", got=stop)
    ranges = []
    if not isinstance(skip, Sequence):
        raise OptionError(argument="skip", expected="a list of pairs (from, to) in seconds", got=skip)
    for pair in sorted(_check(pair) for pair in skip):
        if begin < min(pair[0], end):
            ranges.append((begin, min(pair[0], end)))
        begin = max(begin, pair[1])
    if begin < end:
        ranges.append((begin, end))
    return ranges


def require_some(longest: int, kept: Sequence[tuple[float, float]], end: float) -> None:
    """Require `MINIMUM_SAMPLES` in the longest kept segment of a recording up to `end` (s)."""
    if longest < MINIMUM_SAMPLES:
        requested = join_names(range_texts(kept)) or "nothing"
        raise DataError(
            f"no segment of {MINIMUM_SAMPLES} samples or more is left of the recording, which lasts {moment(end)}; "
            f"wanted is {requested}",
            advice="Times are measured from the first sample; check {--start}, {--stop} and {--skip}.",
        )


def require_inside(kept: Sequence[tuple[float, float]], end: float, rate: float) -> None:
    """Require that skipped ranges begin before the end of the recording (s), and warn if only `stop` is after it."""
    for (_, begin), (last, _) in pairwise(kept):
        if begin >= end:
            raise DataError(
                f"the recording lasts {moment(end)}, so {moment(begin)} to {moment(last)} cannot be left out",
                advice="Times are measured from the first sample; check {--skip}.",
            )
    if kept and end + 1 / rate < kept[-1][1] < math.inf:
        remark = Remark.of("cut", case="stop", stop=Quantity(kept[-1][1], "s"), end=Quantity(end, "s"))
        warn(GmwmWarning(remark), stacklevel=3)


def _check(pair: tuple[float, float]) -> tuple[float, float]:
    """Check a range to skip, and return it."""
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise OptionError(argument="skip", expected="a list of pairs (from, to) in seconds", got=pair)
    begin, end = (_seconds(time, "skip") for time in pair)
    if not begin < end:
        raise OptionError(argument="skip", expected="a list of pairs with the earlier time first", got=pair)
    return begin, end


def _seconds(time: float, name: str) -> float:
    """Check a time (s), and return it."""
    return as_number(time, name, lambda time: 0 <= time < 1e300, "a time in seconds from the first sample, 0 or more")


def range_texts(kept: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    """Format ranges of time, such as "10 s to 50 s" and "60 s to the end"."""
    return tuple(f"{moment(a)} to {moment(b) if b < math.inf else 'the end'}" for a, b in kept)


def cut_base(base: TimeBase, starts: Sequence[float], sizes: Sequence[int], left: float) -> TimeBase:
    """Return the kept part's time base from first times (s) and sizes of segments, `left` (s) after the start."""
    ends = [time + (size - 1) / base.rate for time, size in zip(starts, sizes, strict=True)]
    places = list(accumulate(sizes))
    steps = [after - before for before, after in zip(ends, starts[1:], strict=False)]
    gaps = tuple((place, step) for place, step in zip(places, steps, strict=False) if step > 0)
    return replace(base, start=starts[0], gaps=gaps, backward=sum(step < 0 for step in steps), left=left)
