"""Correct time stamps for counters that wrap around, summer time, single stamps out of order, and clocks set back."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Quantity, Remark

# The thresholds are pinned by the study of clocks, docs/validation/clocks.md, and by tests/readers/test_steady.py.

_NOMINAL_WINDOW = 64
"""Number of intervals over which the nominal interval is averaged, so that the rounding of time stamps averages out."""
_HOUR = 3600  # step of a clock at a change to or from summer time (s)
_HOUR_WITHIN = 0.25
"""Largest difference (s) of such a step; two sampling intervals if shorter, and at least half of one."""
_STAMPS_BEHIND = (
    8  # time stamps after a backward step that show whether the clock was set back or one stamp is out of order
)


@dataclass(frozen=True)
class ClockSteps:
    """Rows before which a counter wraps, each with the length of the counter (ticks), and rows before which the clock
    changes by an hour for summer time (1 for forward, −1 for back)."""

    wraps: tuple[tuple[int, float], ...] = ()
    hours: tuple[tuple[int, int], ...] = ()

    def between(self, begin: int, end: int) -> ClockSteps:
        """Return the steps before the rows `begin` to `end`."""
        wraps = tuple(wrap for wrap in self.wraps if begin <= wrap[0] < end)
        return ClockSteps(wraps, tuple(hour for hour in self.hours if begin <= hour[0] < end))

    @classmethod
    def join(cls, several: Iterable[ClockSteps]) -> ClockSteps:
        """Join the steps of consecutive parts. The row numbers still refer to the beginning of each part."""
        several = tuple(several)
        wraps = tuple(wrap for steps in several for wrap in steps.wraps)
        return cls(wraps, tuple(hour for steps in several for hour in steps.hours))

    def remarks(self, per_second: int) -> Iterator[Remark]:
        """Yield remarks on these steps."""
        if self.wraps:
            length = Quantity(self.wraps[0][1] / per_second, "s")
            yield Remark.of("time-read", case="wrapped", count=len(self.wraps), length=length)
        for sign, direction in ((1, "forward"), (-1, "back")):
            if count := sum(sign == sense for _, sense in self.hours):
                yield Remark.of("time-read", case="hour", count=count, direction=direction)


@dataclass(frozen=True)
class OrderedStamps:
    """Time stamps (ticks) that are corrected for counter wraps and summer time, and the rows of these corrections."""

    ticks: Vector
    steps: ClockSteps


def nominal_interval(ticks: Vector) -> float:
    """Return the approximate sampling interval in ticks: the median interval, or the mean of time stamps in bursts."""
    forward = np.diff(ticks)
    forward = forward[forward >= 0]
    single = float(np.median(forward)) if forward.size else 0.0
    window = max(1, min(_NOMINAL_WINDOW, ticks.size // 8))
    averages = (ticks[window:] - ticks[:-window]) / window
    averages = averages[averages > 0]
    average = float(np.median(averages)) if averages.size else 0.0
    if average <= 0 and single <= 0:
        raise ReadError(
            "the time column does not increase",
            code="time-order",
            advice="Name another time column with {--columns}, or leave it out with {--columns=time:none} and pass "
            "{--rate}.",
        )
    in_place = forward.size > 0.99 * (ticks.size - 1)
    return single if single > 0.5 * average and (in_place or average <= 0) else average


def in_order(ticks: Vector, integer: bool, per_second: int, nominal: float | None = None) -> OrderedStamps:
    """Undo wraps of a counter and changes to and from summer time. A backward step is a wrap if it becomes one sampling
    interval, or at most 64, when 2¹⁶, 2²⁴ or 2³² ticks, a day or a week are added to it. For time stamps that are not
    integers, the ticks of the counter can also be ns, µs or ms. A step is a change of summer time if it becomes one
    sampling interval when an hour is added or subtracted."""
    steps = np.diff(ticks)
    if not np.any(steps < 0) and not np.any(steps > _HOUR_WITHIN * per_second):
        return OrderedStamps(ticks, ClockSteps())
    nominal = nominal_interval(ticks) if nominal is None else nominal
    near = 0.5 * nominal
    added = np.zeros(ticks.size)
    wraps: list[tuple[int, float]] = []
    units = {1.0} if integer else {1.0, *(per_second / parts for parts in (10**3, 10**6, 10**9))}  # ns, µs, ms, tick
    for length, places in _wraps(steps, nominal, near, _counters(units, per_second)):
        added[places + 1] += length
        wraps = [(row + 1, length) for row in places.tolist()]
    steps = np.diff(ticks + np.cumsum(added))
    within = max(near, min(_HOUR_WITHIN * per_second, 2 * nominal))
    hours: list[tuple[int, int]] = []
    for sign in (1, -1):
        away = np.abs(steps - sign * _HOUR * per_second - nominal)
        leaps = np.flatnonzero(away <= within) if nominal < _HOUR * per_second / 100 else np.empty(0, dtype=np.int64)
        added[leaps + 1] -= sign * _HOUR * per_second
        hours += [(row + 1, sign) for row in leaps.tolist()]
    if not wraps and not hours:
        return OrderedStamps(ticks, ClockSteps())
    return OrderedStamps(ticks + np.cumsum(added), ClockSteps(tuple(wraps), tuple(sorted(hours))))


def _counters(units: set[float], per_second: int) -> list[float]:
    """Return the lengths (ticks) of counters that wrap around: 16, 24 and 32 bits, a day and a week."""
    bits = (unit * 2.0**count for unit in units for count in (16, 24, 32))
    return sorted({*bits, 86_400.0 * per_second, 604_800.0 * per_second})


def _wraps(
    steps: Vector, nominal: float, near: float, lengths: Sequence[float]
) -> Iterator[tuple[float, NDArray[np.int64]]]:
    """Yield the length of the counter and the intervals where it wraps, if most backward steps are its wraps."""
    back = np.flatnonzero(steps < 0)
    for length in lengths:
        remainder = steps[back] + length
        intervals = np.round(remainder / nominal)  # number of sampling intervals that remain
        near_whole = np.abs(remainder / nominal - intervals) <= 0.25
        # Largest number of samples that may be lost where a counter wraps around
        missing = (intervals >= 1) & (intervals <= min(64, length / nominal / 8)) & near_whole
        wraps = back[(np.abs(remainder - nominal) <= near) | missing]
        if wraps.size and wraps.size >= 0.5 * back.size and length > 8 * nominal:
            yield length, wraps
            return


def without_steps_back(ticks: Vector, nominal: float) -> tuple[Vector, NDArray[np.int64]]:
    """Return time stamps that never decrease, and the rows before which the clock was set back. A single time stamp out
    of order gets the time of its neighbour. If the clock was set back, the time stamps continue one sampling interval
    after the last one."""
    back = np.flatnonzero(np.diff(ticks) < 0)
    if not back.size:
        return ticks, np.empty(0, dtype=np.int64)
    last = np.minimum(back + 1 + _STAMPS_BEHIND, ticks.size - 1)
    base = np.minimum(ticks[back], ticks[np.maximum(back - 1, 0)] + nominal)
    missing = base + (last - back) * nominal - ticks[last]
    walls = back[missing > 0.75 * nominal + 1e-9 * np.abs(base)] + 1
    alone = np.setdiff1d(back + 1, walls)
    late = alone[(alone < 2) | (ticks[alone] >= ticks[np.maximum(alone - 2, 0)])]
    ticks = ticks.copy()
    ticks[late - 1] = ticks[late]
    shift = np.zeros(ticks.size)
    shift[walls] = ticks[walls - 1] + nominal - ticks[walls]
    return np.maximum.accumulate(ticks + np.cumsum(shift)), walls


def require_span(ticks: Vector, nominal: float, per_second: float) -> None:
    """Raise an error if the time stamps span a longer time than a recording can last."""
    span = float(np.max(ticks) - np.min(ticks))
    # Longest time between two time stamps of a recording (s). It is 300 years, the range of nanoseconds since 1970.
    if span > 1e10 * per_second or not span < 2.0**52 * nominal:
        raise ReadError(
            f"the time stamps reach over {span / per_second:.3g} s at a typical interval of {nominal / per_second:.3g} "
            "s, which is no recording",
            code="time-span",
            advice="Check that {--columns} names the time column and {--units=time:ms} its unit, or leave it out with "
            "{--columns=time:none} and pass {--rate}.",
        )
