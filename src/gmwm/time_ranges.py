"""A part of a recording: between two times, and without what was handled on the way."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate, pairwise
from numbers import Real

import numpy as np

from gmwm._arrays import Vector
from gmwm._text import moment
from gmwm.errors import DataError, GmwmWarning, OptionError
from gmwm.signals import MINIMUM_SAMPLES, Imu, Signal
from gmwm.time_base import TimeBase, begins_of

ROUNDING = 1e-6
"""Samples: a time that is that of a sample but for rounding."""
CUT = "cut: "
"""How the note of a recording that was cut begins."""


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
    note = f"{CUT}{sum(sizes) / imu.rate:.6g} s of {imu.duration:.6g} s kept, " + range_words(kept)
    return replace(
        imu,
        signals=signals,
        notes=(*imu.notes, note),
        time_base=cut_base(base, starts, sizes, base.left + ranges[0][3]),
        temperature=None if imu.temperature is None else of(imu.temperature),
    )


def kept_ranges(
    start: float | None, stop: float | None, skip: Sequence[tuple[float, float]]
) -> list[tuple[float, float]]:
    """Ranges of time that are kept, in order."""
    begin, end = _seconds(0.0 if start is None else start, "start"), math.inf
    if stop is not None:
        end = _seconds(stop, "stop")
        if not begin < end:
            raise OptionError(f"stop must come after start={begin:g} s, got {stop!r}")
    kept = []
    for pair in sorted(_checked(pair) for pair in skip):
        if begin < min(pair[0], end):
            kept.append((begin, min(pair[0], end)))
        begin = max(begin, pair[1])
    if begin < end:
        kept.append((begin, end))
    return kept


def require_some(longest: int, kept: Sequence[tuple[float, float]], end: float) -> None:
    """An error if the longest segment of what is kept of a recording, that lasts until `end` (s), is too short."""
    if longest < MINIMUM_SAMPLES:
        asked = " and ".join(
            f"{moment(a)} to {moment(b)}" if b < math.inf else f"{moment(a)} on" for a, b in kept
        ) or "nothing"  # fmt: skip
        raise DataError(
            f"nothing is left between start=, stop= and skip= that has {MINIMUM_SAMPLES} samples or more without a "
            f"gap: the recording lasts {moment(end)}, counted from its first sample, wanted is {asked}"
        )


def require_inside(kept: Sequence[tuple[float, float]], end: float, rate: float) -> None:
    """An error if what was to be skipped lies behind the end (s) of a recording, a warning if only `stop` does."""
    for (_, begin), (last, _) in pairwise(kept):
        if begin >= end:
            raise DataError(
                f"skip= from {moment(begin)} to {moment(last)} lies outside the recording, which lasts {moment(end)}: "
                "times count from its first sample"
            )
    if kept and end + 1 / rate < kept[-1][1] < math.inf:
        warnings.warn(
            f"stop= at {moment(kept[-1][1])} lies outside the recording, which lasts {moment(end)}, and cuts nothing "
            "off: times count from its first sample",
            GmwmWarning,
            stacklevel=3,
        )


def _checked(pair: tuple[float, float]) -> tuple[float, float]:
    if not isinstance(pair, Sequence) or isinstance(pair, str) or len(pair) != 2:
        raise OptionError(f"skip must hold pairs (from, to) in seconds, got {pair!r}")
    begin, end = (_seconds(time, "skip") for time in pair)
    if not begin < end:
        raise OptionError(f"skip must hold pairs with the earlier time first, got {pair!r}")
    return begin, end


def _seconds(time: object, name: str) -> float:
    if isinstance(time, bool) or not isinstance(time, Real) or not 0 <= float(time) < math.inf:
        raise OptionError(f"{name} must be a time in seconds from the first sample, not negative, got {time!r}")
    return float(time)


def range_words(kept: Sequence[tuple[float, float]]) -> str:
    """Such ranges in words."""
    return " and ".join(f"from {moment(a)}" + (f" to {moment(b)}" if b < math.inf else "") for a, b in kept[:5]) + (
        " …" if len(kept) > 5 else ""
    )


def _sample_ranges(signal: Signal, kept: Sequence[tuple[float, float]]) -> list[tuple[int, int, float, float]]:
    """Ranges of samples without a gap in the kept ranges of time; clock and time from the first sample there."""
    ranges: list[tuple[int, int, float, float]] = []
    begins = begins_of(signal.rate, signal.segments, signal.starts)
    for (first, last), begin, time in zip(signal.segments, begins, signal.starts, strict=True):
        seam = True
        for limits in kept:
            a, b = (
                first + int(np.ceil(np.clip((edge - begin) * signal.rate - ROUNDING, 0, last - first)))
                for edge in limits
            )
            if a < b and not seam and ranges[-1][1] == a:
                ranges[-1] = (ranges[-1][0], b, *ranges[-1][2:])  # no sample lay in what was skipped
            elif a < b:
                passed = (a - first) / signal.rate
                ranges.append((a, b, time + passed, begin + passed))
                seam = False
    return ranges


def cut_base(base: TimeBase, starts: Sequence[float], sizes: Sequence[int], left: float) -> TimeBase:
    """The time base with the gaps that there are now, `left` seconds after the first sample of all."""
    ends = [time + (size - 1) / base.rate for time, size in zip(starts, sizes, strict=True)]
    places = list(accumulate(sizes))
    steps = [after - before for before, after in zip(ends, starts[1:], strict=False)]
    gaps = tuple((place, step) for place, step in zip(places, steps, strict=False) if step > 0)
    return replace(base, start=starts[0], gaps=gaps, backward=sum(step < 0 for step in steps), left=left)
