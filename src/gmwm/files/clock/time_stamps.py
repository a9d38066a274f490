"""Put time stamps in order, and find their unit, the rate, gaps and irregularities.

Wraps of counters, summer time, single stamps out of order and clocks set back are corrected. Ticks from the first stamp
keep integers exact: float64 would round nanoseconds since 1970 to 256 ns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Integers, Vector
from gmwm.base.errors import ReadError, UnitError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.time_base import TimeBase
from gmwm.base.units import LONG_TIME_UNITS, TIME_UNITS
from gmwm.files.clock.sampling_interval import RATE_TOLERANCE

# The thresholds are pinned by the study of clocks, docs/validation/clocks.md, and by tests/readers/test_steady.py.

_NOMINAL_WINDOW = 64
"""Number of intervals over which the nominal interval is averaged, so that the rounding of time stamps averages out."""
_HOUR = 3600  # step of a clock at a change to or from summer time (s)
_HOUR_WITHIN = 0.25
"""Largest difference (s) of such a step; two sampling intervals if shorter, and at least half of one."""
STAMPS_BEHIND = 8  # time stamps after a backward step that show whether the clock was set back or one is late


@dataclass(frozen=True)
class ClockSteps:
    """Rows before which a counter wraps, with its length (ticks), and rows of summer time (1 forward, −1 back)."""

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
    """Undo wraps of a counter and summer time. A step back is a wrap if 2¹⁶, 2²⁴ or 2³² ticks (unless `integer`, also
    ns, µs or ms), a day or a week make it 1 to 64 intervals. It is summer time if an hour makes it one interval."""
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


def _wraps(steps: Vector, nominal: float, near: float, lengths: Sequence[float]) -> Iterator[tuple[float, Integers]]:
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


def without_steps_back(ticks: Vector, nominal: float) -> tuple[Vector, Integers]:
    """Return stamps that never decrease, and rows before which the clock was set back. There the stamps go on by one
    interval; a single one out of order gets its neighbour's time."""
    back = np.flatnonzero(np.diff(ticks) < 0)
    if not back.size:
        return ticks, np.empty(0, dtype=np.int64)
    last = np.minimum(back + 1 + STAMPS_BEHIND, ticks.size - 1)
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


# Thresholds without a paper separate simulated clocks (tests/readers/test_timebase.py, test_steady.py pin them).

_EPOCH = (1e9, 2.2e9)
"""Range of seconds since 1970 in the years 2001 to 2039, which the time stamps of computers usually have."""
_RATES = (0.9, 1e5)  # range of rates (Hz) that are plausible for a unit of time that is not stated
_CALENDARS = (
    ("d", 36_892.0, 51_136.0),
    ("d", 730_852.0, 745_096.0),
    (".NET ticks", 6.31e17, 6.44e17),
    (".NET ticks", 1.26e17, 1.39e17),
)
"""Unit and range of time stamps in the same years: days of Excel and MATLAB (datenum), ticks of .NET and Windows."""


@dataclass(frozen=True)
class Stamps:
    """Time stamps counted from the first one."""

    ticks: Vector  # time stamps minus the first, in `unit`; exact if the file holds integers
    origin: float  # the first time stamp, in `unit`
    spacing: float  # spacing of float64 numbers at the magnitude of the time stamps, in `unit`; 0 for integers
    unit: str  # "s", "ms", "us" or "ns"
    integer: bool = False  # whether the file holds integers in this unit

    @property
    def per_second(self) -> int:
        """Number of ticks in a second."""
        return TIME_UNITS[self.unit]


@dataclass(frozen=True)
class Timing:
    """Time base, segments, start times (s), remarks, the width of `SampleLosses`, and whether a clock was set back."""

    base: TimeBase
    segments: tuple[tuple[int, int], ...]
    starts: tuple[float, ...]
    remarks: tuple[Remark, ...]
    width: int = 1
    set_back: bool = False


class SegmentStarts:
    """Start times of segments: whole sampling intervals from the last place at which the clock was set."""

    def __init__(self, time: float, rate: float) -> None:
        self._row, self._time, self._rate, self._lost = 0, time, rate, 0

    def at(self, row: int, lost: int, clock: float | None) -> float:
        """Return the start (s) of a segment after `lost` samples; `clock` is its stamp (s) if the clock was set."""
        if clock is not None:
            self._row, self._time, self._lost = row, clock, 0
        self._lost += lost
        return self._time + (row - self._row + self._lost) / self._rate


def timing_without_stamps(rate: float, samples: int) -> Timing:
    """Return the time base of a recording without time stamps: one segment at the given rate (Hz)."""
    return Timing(TimeBase(rate), ((0, samples),), starts=(0.0,), remarks=())


def as_stamps(values: NDArray[Any], unit: str, rate: float | None) -> tuple[Stamps, Remark | None]:
    """Count time stamps in their unit, chosen with a declared rate; remark if it is inferred ("") or over a second."""
    require_countable(values)
    integer = values.dtype.kind in "iu"
    values = values.astype(np.int64) if integer else values
    ticks = (values - values[0]).astype(np.float64)
    spacing = 0.0 if integer else float(np.spacing(np.max(np.abs(values))))
    if unit in LONG_TIME_UNITS:
        seconds = LONG_TIME_UNITS[unit]
        spacing = float(np.spacing(np.max(np.abs(values.astype(np.float64))))) * seconds
        stamps = Stamps(ticks * seconds, float(values[0]) * seconds, spacing, "s")
        return stamps, Remark.of("time-read", case="read", form="long-unit", unit=unit, seconds=seconds)
    remark = None
    if not unit:
        unit = _inferred_unit(ticks, float(values[0]), rate)
        remark = Remark.of("time-read", case="unit", unit=unit)
    return Stamps(ticks, float(values[0]), spacing, unit, integer=integer), remark


_COUNTABLE = 1e25
"""Absolute value of a time stamp that no clock reaches in any unit; it is 300 million years in nanoseconds."""


def require_countable(values: NDArray[Any]) -> None:
    """Raise an error if a time stamp is larger than any clock can count."""
    if values.dtype.kind != "f" or not values.size or float(np.max(np.abs(values))) <= _COUNTABLE:
        return
    row = int(np.argmax(~(np.abs(values) <= _COUNTABLE)))
    raise ReadError(
        f"the time stamps hold {values[row]:.3g}, which no clock counts",
        code="time-implausible",
        advice="Repair the rows, or leave the time out with {--columns=time:none} and pass {--rate}.",
    )


def are_intervals(values: NDArray[Any]) -> bool:
    """Return whether numbers can be the times between rows: nearly equal, positive, and no clock, which increases.

    >>> are_intervals(np.array([0, 5, 5, 6, 5])), are_intervals(np.array([1700.0, 1700.1, 1700.2]))
    (True, False)
    """
    later = values[1:].astype(np.float64)  # the first row may have no row before it
    if later.size < 2 or not np.all(later > 0) or np.mean(np.abs(later / np.median(later) - 1) <= 0.5) < 0.9:
        return False
    return bool(np.ptp(later) == 0 or np.any(np.diff(later) < 0))


def calendar_unit(values: NDArray[Any]) -> str:
    """Return the unit of time stamps that count from the first day of a calendar; "" if they do not.

    >>> calendar_unit(np.array([45413.5, 45413.500000116])), calendar_unit(np.array([45413.5, 45413.51]))
    ('d', '')
    """
    unit = next((unit for unit, low, high in _CALENDARS if low <= values[0] <= high), "")
    slow = 2 / LONG_TIME_UNITS.get(unit, 1)  # an interval of 2 s
    return unit if unit and nominal_interval((values - values[0]).astype(np.float64)) < slow else ""


def _inferred_unit(ticks: Vector, origin: float, rate: float | None) -> str:
    """Return the only unit in which the time stamps are plausible."""
    interval = nominal_interval(ticks)
    rates = {unit: per_second / interval for unit, per_second in TIME_UNITS.items()}
    if rate is not None:
        # Relative agreement of a declared rate with time stamps in a unit; units differ by a factor of 1000
        agreeing = [unit for unit, value in rates.items() if abs(value / rate - 1) <= 0.05]
        if agreeing:
            return agreeing[0]
    low, high = _RATES
    possible = [unit for unit, value in rates.items() if low <= value <= high]
    epoch = [unit for unit in possible if _EPOCH[0] <= origin / TIME_UNITS[unit] <= _EPOCH[1]]
    # Rate (Hz) above which a unit is not inferred if another unit gives a lower rate, because such recordings are rare
    usual = [unit for unit in possible if rates[unit] < 1e4] if len(possible) > 1 else possible
    for choice in (epoch, possible, usual):
        if len(choice) == 1:
            return choice[0]
    meaning = ", ".join(f"{value:.6g} Hz in {unit}" for unit, value in rates.items())
    raise UnitError(
        f"the unit of the time column is neither stated nor clear: its median interval of {interval:.6g} is a rate of "
        f"{meaning}",
        code="unit-unknown",
        advice="State the unit, for example with {--units=time:s} or {--units=time:ms}, or pass {--rate}.",
    )


def require_plausible(rate: float, unit: str) -> None:
    """Raise an error if time stamps in a unit that the file states show a rate (Hz) that no sensor has."""
    if rate > _RATES[1] and unit in TIME_UNITS:
        rates = {other: rate * count / TIME_UNITS[unit] for other, count in TIME_UNITS.items()}
        likely = next((other for other, value in rates.items() if _RATES[0] <= value <= _RATES[1]), "s")
        raise UnitError(
            f"the time stamps show {rate:.3g} Hz in {unit}, the unit that the file states, but {rates[likely]:.6g} Hz "
            f"in {likely}", code="unit-contradiction", advice="State the unit with {--units=@units}.",
            units=f"time:{likely}",
        )  # fmt: skip


def beside_stated(found: Timing, stated: float) -> Timing:
    """Add a remark to the timing if the file states another rate (Hz) than the time stamps show."""
    if abs(found.base.rate / stated - 1) <= RATE_TOLERANCE:
        return found
    remark = Remark.of(
        "rate-contradicted", source="file", rate=Quantity(stated, "Hz"), stamps=Quantity(found.base.rate, "Hz")
    )
    return replace(found, remarks=(*found.remarks, remark))


def about_stamps(base: TimeBase) -> Iterator[Remark]:
    """Yield remarks on time stamps that step backward, repeat or jitter."""
    if base.backward:
        yield Remark.of("stamps-irregular", case="backward", count=base.backward)
    if base.duplicates:
        yield Remark.of("stamps-irregular", case="repeated", count=base.duplicates)
    # Jitter, as a share of the sampling interval, above which the order of neighbouring samples is uncertain
    if base.jitter * base.rate > 0.5:
        yield Remark.of("stamps-irregular", case="jitter", share=base.jitter * base.rate)
