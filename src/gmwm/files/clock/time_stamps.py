"""Analyse time stamps: their unit, the rate, the gaps between segments, and their irregularities.

Time stamps are counted in their own unit from the first one, so that integers stay exact. In float64, nanoseconds since
1970 would be rounded to 256 ns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError, UnitError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.time_base import TimeBase
from gmwm.base.units import LONG_TIME_UNITS, TIME_UNITS
from gmwm.files.clock.sampling_interval import RATE_TOLERANCE
from gmwm.files.clock.stamp_order import nominal_interval

# Unless a paper is named, these thresholds separate the simulated clocks of tests/readers/test_timebase.py and
# test_steady.py: uniform, rounded, jittered, in bursts, with lost samples. The tests pin them.

_EPOCH = (1e9, 2.2e9)
"""Range of seconds since 1970 in the years 2001 to 2039, which the time stamps of computers usually have."""
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
    """Time base, segments, their start times (s), remarks on the time stamps, and the width of
    `sampling_interval.SampleLosses`."""

    base: TimeBase
    segments: tuple[tuple[int, int], ...]
    starts: tuple[float, ...]
    remarks: tuple[Remark, ...]
    width: int = 1


class SegmentStarts:
    """Start times of segments: whole sampling intervals from the last place at which the clock was set."""

    def __init__(self, time: float, rate: float) -> None:
        self._row, self._time, self._rate, self._lost = 0, time, rate, 0

    def at(self, row: int, lost: int, clock: float | None) -> float:
        """Return the start time (s) of a segment that begins with `row` after a gap with `lost` samples. `clock` is the
        time stamp (s) of the row if the clock was set back there."""
        if clock is not None:
            self._row, self._time, self._lost = row, clock, 0
        self._lost += lost
        return self._time + (row - self._row + self._lost) / self._rate


def timing_without_stamps(rate: float, samples: int) -> Timing:
    """Return the time base of a recording without time stamps: one segment at the given rate (Hz)."""
    return Timing(TimeBase(rate), ((0, samples),), starts=(0.0,), remarks=())


def as_stamps(values: NDArray[Any], unit: str, rate: float | None) -> tuple[Stamps, Remark | None]:
    """Count time stamps in their unit from the first one. Return also a remark if the unit is inferred ("") or longer
    than a second. A declared rate (Hz) decides if several units are possible."""
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
    low, high = (0.9, 1e5)  # range of rates (Hz) that are plausible for a unit of time that is not stated
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
