"""Cut a recording to a range of time, and leave out ranges within it."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from numbers import Real

import numpy as np

from gmwm._arrays import Vector
from gmwm._template import joined
from gmwm._text import moment
from gmwm.errors import DataError, GmwmWarning, OptionError
from gmwm.remarks import Quantity, Remark
from gmwm.signals import MINIMUM_SAMPLES, Imu, Signal
from gmwm.time_base import TimeBase, begins_of

ROUNDING = 1e-6
"""Tolerance in samples within which a given time is that of a sample: above the rounding of times in float64 (1e-7 of a
sample at 1 kHz after a year), below anything that a user types. Pinned by tests/test_cuts.py."""


def cut(
    imu: Imu, start: float | None = None, stop: float | None = None, skip: Sequence[tuple[float, float]] = ()
) -> Imu:
    """Cut out the part of a recording between two times: see `Imu.between`."""
    kept = kept_ranges(start, stop, skip)
    first = next(iter(imu.signals.values()))
    ranges = _sample_ranges(first, kept)
    begins = begins_of(first.rate, first.segments, first.starts)
    end = begins[-1] + (first.segments[-1][1] - first.segments[-1][0]) / first.rate
    require_some(max((last - begin for begin, last, _, _ in ranges), default=0), kept, end)
    require_inside(kept, end, first.rate)
    if [(begin, last) for begin, last, _, _ in ranges] == list(first.segments):
        return imu
    sizes = [last - begin for begin, last, _, _ in ranges]
    segments = tuple(pairwise(accumulate(sizes, initial=0)))
    starts = tuple(time for _, _, time, _ in ranges)
    base = imu.time_base or TimeBase(imu.rate, start=first.start)

    def of(values: Vector) -> Vector:
        parts = [values[begin:last] for begin, last, _, _ in ranges]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    signals = {
        axis: Signal(
            values=of(signal.values),
            rate=signal.rate,
            unit=signal.unit,
            axis=axis,
            start=starts[0],
            segments=segments,
            starts=starts,
        )
        for axis, signal in imu.signals.items()
    }
    remark = Remark.of(
        "cut",
        known="yes",
        kept=Quantity(sum(sizes) / imu.rate, "s"),
        whole=Quantity(imu.duration, "s"),
        ranges=range_texts(kept),
    )
    return replace(
        imu,
        signals=signals,
        remarks=(*imu.remarks, remark),
        time_base=cut_base(base, starts, sizes, base.left + ranges[0][3]),
        temperature=None if imu.temperature is None else of(imu.temperature),
    )


def kept_ranges(
    start: float | None, stop: float | None, skip: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Ranges of time that are kept (s), in order.

    Raises
    ------
    OptionError
        If a time is negative or not a number, or a range ends before it begins.
    """
    begin, end = _seconds(0.0 if start is None else start, "start"), math.inf
    if stop is not None:
        end = _seconds(stop, "stop")
        if not begin < end:
            raise OptionError(argument="stop", expected=f"a time after the start at {moment(begin)}", got=stop)
    kept = []
    for pair in sorted(_checked(pair) for pair in skip):
        if begin < min(pair[0], end):
            kept.append((begin, min(pair[0], end)))
        begin = max(begin, pair[1])
    if begin < end:
        kept.append((begin, end))
    return kept


def require_some(longest: int, kept: Sequence[tuple[float, float]], end: float) -> None:
    """Require that the longest segment that is kept has enough samples; the recording lasts until `end` (s).

    Raises
    ------
    DataError
        If it has fewer than `MINIMUM_SAMPLES`.
    """
    if longest < MINIMUM_SAMPLES:
        wanted = joined(range_texts(kept)) or "nothing"
        raise DataError(
            f"no segment of {MINIMUM_SAMPLES} samples or more is left of the recording, which lasts {moment(end)}; "
            f"wanted is {wanted}",
            advice="Times count from the first sample; check {--start}, {--stop} and {--skip}.",
        )


def require_inside(kept: Sequence[tuple[float, float]], end: float, rate: float) -> None:
    """Require that skipped ranges begin before the end of the recording (s), and warn if only `stop` is after it.

    Raises
    ------
    DataError
        If a range to skip begins after the end.
    """
    for (_, begin), (last, _) in pairwise(kept):
        if begin >= end:
            raise DataError(
                f"the recording lasts {moment(end)}, so {moment(begin)} to {moment(last)} cannot be left out",
                advice="Times count from the first sample; check {--skip}.",
            )
    if kept and end + 1 / rate < kept[-1][1] < math.inf:
        remark = Remark.of("stop-outside", stop=Quantity(kept[-1][1], "s"), end=Quantity(end, "s"))
        warnings.warn(GmwmWarning(remark), stacklevel=3)


def _checked(pair: tuple[float, float]) -> tuple[float, float]:
    """A range to skip, checked."""
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise OptionError(argument="skip", expected="a list of pairs (from, to) in seconds", got=pair)
    begin, end = (_seconds(time, "skip") for time in pair)
    if not begin < end:
        raise OptionError(argument="skip", expected="a list of pairs with the earlier time first", got=pair)
    return begin, end


def _seconds(time: object, name: str) -> float:
    """A time (s), checked."""
    if isinstance(time, bool) or not isinstance(time, Real) or not 0 <= float(time) < math.inf:
        raise OptionError(argument=name, expected="a time in seconds from the first sample, 0 or more", got=time)
    return float(time)


def range_texts(kept: Sequence[tuple[float, float]]) -> tuple[str, ...]:
    """Ranges of time as texts, such as "10 s to 50 s" and "60 s to the end"."""
    return tuple(f"{moment(a)} to {moment(b) if b < math.inf else 'the end'}" for a, b in kept)


def _sample_ranges(signal: Signal, kept: Sequence[tuple[float, float]]) -> list[tuple[int, int, float, float]]:
    """Ranges of samples without a gap in the kept times, each with its time stamp and its time from the first sample.

    Returns
    -------
    list of (first, last, stamp, time)
    """
    ranges: list[tuple[int, int, float, float]] = []
    begins = begins_of(signal.rate, signal.segments, signal.starts)
    for (first, last), begin, time in zip(signal.segments, begins, signal.starts, strict=True):
        at_start = True
        for times in kept:
            a, b = (
                first + int(np.ceil(np.clip((edge - begin) * signal.rate - ROUNDING, 0, last - first)))
                for edge in times
            )
            if a < b and not at_start and ranges[-1][1] == a:
                ranges[-1] = (ranges[-1][0], b, *ranges[-1][2:])  # the skipped range holds no sample
            elif a < b:
                passed = (a - first) / signal.rate
                ranges.append((a, b, time + passed, begin + passed))
                at_start = False
    return ranges


def cut_base(base: TimeBase, starts: Sequence[float], sizes: Sequence[int], left: float) -> TimeBase:
    """The time base of the part that is kept, which begins `left` seconds after the first sample of the recording.

    Parameters
    ----------
    base : TimeBase
        That of the whole recording.
    starts, sizes : sequence of float, of int
        Time of the first sample (s) and number of samples of each segment.
    left : float
        Time left out before the first sample (s).
    """
    ends = [time + (size - 1) / base.rate for time, size in zip(starts, sizes, strict=True)]
    places = list(accumulate(sizes))
    steps = [after - before for before, after in zip(ends, starts[1:], strict=False)]
    gaps = tuple((place, step) for place, step in zip(places, steps, strict=False) if step > 0)
    return replace(base, start=starts[0], gaps=gaps, backward=sum(step < 0 for step in steps), left=left)
