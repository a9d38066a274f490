"""Analyse time stamps: their unit, the rate, the gaps between segments, and their irregularities.

Time stamps are counted in their own unit from the first one, so that integers stay exact: float64 holds nanoseconds
since 1970 only to 256 ns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.errors import ReadError, UnitError
from gmwm.readers.rate_check import require_one_rate, require_order
from gmwm.remarks import Quantity, Remark
from gmwm.time_base import TimeBase
from gmwm.units import LONG_TIME_UNITS, TIME_UNITS

# Unless a paper is named, these thresholds separate the made-up clocks of tests/readers/test_timebase.py and
# test_steady.py: uniform, rounded, jittered, in bursts, with lost samples. The tests pin them.

GAP = 1.5
"""An interval longer than this many sampling intervals is a gap, if the time stamps after it stay late. One lost sample
makes an interval of 2, and 1.5 is halfway."""

FARTHEST = 512
"""Number of time stamps on either side of a long interval by which a gap is recognised, at most. It bounds the
memory of a stream."""

_WINDOW = 64
"""Intervals over which the nominal interval is averaged, so that the rounding of single time stamps averages out."""
_SHORT, _LONG = 64, 1024
"""Time stamps over which lost samples are distinguished from rounding: a random walk departs from a line 4 times
further over 16 times the length, while rounding departs by the same amount."""
_BY_CHANCE = 0.7
"""Coefficient of variation of the distances between long intervals above which they are random. It is 1 for an
exponential distribution and 0 for regular distances."""
_WHOLE = 0.05
"""Largest difference of an interval from a multiple of the sampling interval if samples are lost, in intervals."""
_PLAUSIBLE = (0.1, 1e5)
"""Range of rates (Hz) that are plausible for a unit of time that is not stated."""
_USUAL = 1e4
"""Rate (Hz) above which a unit is not inferred if another unit gives a lower rate: such recordings are rare."""
_EPOCH = (1e9, 2.2e9)
"""Seconds since 1970 of the years 2001 to 2039, as time stamps of computers are."""
_AGREES = 0.05
"""Relative difference within which a declared rate agrees with time stamps in one unit; units differ by 1000."""
_RATE_TOLERANCE = 1e-2
"""Relative difference between a stated or declared rate and the time stamps beyond which they contradict each other.
The clock of a MEMS gyroscope is specified to 1 % (for example in the InvenSense product specification PS-MPU-6000A)."""
_RATE_REMARK, _RATE_TROUBLE = 1e-4, 1e-3
"""Relative differences from a declared rate that are remarked and warned of: a crystal has 1e-4 or less."""
_JITTER = 0.5
"""Jitter, as a share of the sampling interval, beyond which neighbouring samples may be exchanged."""


@dataclass(frozen=True)
class Stamps:
    """Time stamps counted from the first one.

    Parameters
    ----------
    ticks : (N,) array
        Time stamps minus the first, in `unit`; exact if the file holds integers.
    origin : float
        The first time stamp, in `unit`.
    spacing : float
        Distance of float64 numbers of the size of the time stamps, in `unit`; 0 for integers.
    unit : str
        "s", "ms", "us" or "ns".
    """

    ticks: Vector
    origin: float
    spacing: float
    unit: str

    @property
    def per_second(self) -> int:
        """Ticks in a second."""
        return TIME_UNITS[self.unit]


@dataclass(frozen=True)
class Timing:
    """The time base of a recording, its segments, their start times (s), and remarks on the time stamps."""

    base: TimeBase
    segments: tuple[tuple[int, int], ...]
    starts: tuple[float, ...]
    remarks: tuple[Remark, ...]


def unstamped(rate: float, samples: int) -> Timing:
    """The time base of a recording without time stamps: one segment at the given rate (Hz)."""
    return Timing(TimeBase(rate), ((0, samples),), starts=(0.0,), remarks=())


def as_stamps(values: NDArray[Any], unit: str, rate: float | None) -> tuple[Stamps, Remark | None]:
    """Count time stamps in their unit from the first one; with a remark if the unit is inferred or long.

    Parameters
    ----------
    values : (N,) array of int64 or float64
        The column as it stands in the file.
    unit : str
        One of `TIME_UNITS` or `LONG_TIME_UNITS` if declared or stated; "" to infer it.
    rate : float or None
        Declared rate (Hz), which decides if several units are possible.

    Raises
    ------
    UnitError
        If the unit cannot be inferred.
    """
    integer = values.dtype.kind in "iu"
    ticks = (values - values[0]).astype(np.float64)
    spacing = 0.0 if integer else float(np.spacing(np.max(np.abs(values))))
    if unit in LONG_TIME_UNITS:
        seconds = LONG_TIME_UNITS[unit]
        spacing = float(np.spacing(np.max(np.abs(values.astype(np.float64))))) * seconds
        stamps = Stamps(ticks * seconds, float(values[0]) * seconds, spacing, "s")
        return stamps, Remark.of("time-read", form="long-unit", unit=unit, seconds=seconds)
    remark = None
    if not unit:
        unit = _inferred_unit(ticks, float(values[0]), rate)
        remark = Remark.of("time-unit-inferred", unit=unit)
    return Stamps(ticks, float(values[0]), spacing, unit), remark


def _inferred_unit(ticks: Vector, origin: float, rate: float | None) -> str:
    """The only unit in which the time stamps are plausible.

    Raises
    ------
    UnitError
        If several units are plausible, or none; the message has the rate in each unit.
    """
    interval = nominal_interval(ticks)
    rates = {unit: per_second / interval for unit, per_second in TIME_UNITS.items()}
    if rate is not None:
        agreeing = [unit for unit, value in rates.items() if abs(value / rate - 1) <= _AGREES]
        if agreeing:
            return agreeing[0]
    low, high = _PLAUSIBLE
    possible = [unit for unit, value in rates.items() if low <= value <= high]
    epoch = [unit for unit in possible if _EPOCH[0] <= origin / TIME_UNITS[unit] <= _EPOCH[1]]
    usual = [unit for unit in possible if rates[unit] < _USUAL] if len(possible) > 1 else possible
    for choice in (epoch, possible, usual):
        if len(choice) == 1:
            return choice[0]
    meaning = ", ".join(f"{value:.6g} Hz in {unit}" for unit, value in rates.items())
    raise UnitError(
        f"the unit of the time column is neither stated nor clear: its median interval of {interval:.6g} is a rate of "
        f"{meaning}",
        advice="State the unit, for example with {--units=time:s} or {--units=time:ms}, or pass {--rate}.",
    )


def timing(stamps: Stamps, rate: float | None) -> Timing:
    """Rate, segments and irregularities of a recording, from its time stamps.

    The rate is 1 / median interval within segments. If a clock of the median interval departs from the time stamps by
    more than half a sample within the longest segment (for example time stamps at 128 Hz, rounded to 10 ms), the rate
    is 1 / mean interval between gaps. A declared rate is used if it agrees within 1 %. If the difference is more than
    0.1 %, and a clock of the declared rate departs from the time stamps of the longest segment by more than a sample
    and three times their jitter, the remark on it is also a warning.

    Raises
    ------
    ReadError
        If the time stamps do not increase, are not in order, change their rate, or contradict the declared rate.
    """
    ticks, per_second = stamps.ticks, stamps.per_second
    nominal = nominal_interval(ticks, None if rate is None else per_second / rate)
    require_order(ticks, nominal, stamps.origin, per_second)
    require_one_rate(ticks, stamps.origin, per_second)
    steps = np.diff(ticks)
    segments = segments_of(ticks, steps, nominal, burst_of(steps, nominal))
    interval, remark = _interval(stamps, steps, segments)
    measured = per_second / interval
    remarks = [remark] if remark else []
    by_stamps = interval
    if rate is not None:
        _require_agreement(rate, measured, stamps.unit)
        interval = per_second / rate
    starts = tuple((stamps.origin + float(ticks[first])) / per_second for first, _ in segments)
    inside = np.ones(steps.size, dtype=bool)
    breaks = np.array([first - 1 for first, _ in segments[1:]], dtype=np.int64)
    inside[breaks] = False
    jitter = float(np.sqrt(np.mean((steps[inside] - interval) ** 2))) if inside.any() else 0.0
    if rate is not None:
        scatter = float(np.sqrt(np.mean((steps[inside] - by_stamps) ** 2))) if inside.any() else 0.0
        away = max(last - first for first, last in segments) * abs(interval - by_stamps)
        grave = abs(by_stamps / interval - 1) > _RATE_TROUBLE and away > max(by_stamps, 3 * scatter)
        remarks += _about_declared(rate, measured, grave)
    gaps = tuple((int(b) + 1, float(steps[b]) / per_second) for b in breaks if steps[b] > 0)
    duplicates, backward = int(np.count_nonzero(steps == 0)), int(np.count_nonzero(steps < 0))
    base = TimeBase(
        rate=measured if rate is None else rate,
        stamped=True,
        start=starts[0],
        jitter=jitter / per_second,
        gaps=gaps,
        duplicates=duplicates,
        backward=backward,
    )
    return Timing(base, segments, starts=starts, remarks=(*remarks, *about_stamps(base)))


def beside_stated(found: Timing, stated: float) -> Timing:
    """The timing with a remark if the file states another rate (Hz) than the time stamps show."""
    if abs(found.base.rate / stated - 1) <= _RATE_TOLERANCE:
        return found
    remark = Remark.of(
        "rate-contradicted", source="file", rate=Quantity(stated, "Hz"), stamps=Quantity(found.base.rate, "Hz")
    )
    return replace(found, remarks=(*found.remarks, remark))


def nominal_interval(ticks: Vector, declared: float | None = None) -> float:
    """Sampling interval in ticks before gaps are known, robust to gaps, rounding and bursts.

    It is the mean of the middle half of averages over many intervals. If gaps are so frequent that most averages hold
    one, it is the median interval. A declared interval is used if it agrees with either within 5 %.

    Raises
    ------
    ReadError
        If the time stamps do not increase.
    """
    forward = np.diff(ticks)
    forward = forward[forward >= 0]
    single = float(np.median(forward)) if forward.size else 0.0
    average = _average(ticks, _WINDOW)
    if average <= 0 and single <= 0:
        raise ReadError(
            "the time column does not increase",
            advice="Name another time column with {--columns}, or leave it out with {--columns=time:none} and pass "
            "{--rate}.",
        )
    if declared is not None and min(abs(single / declared - 1), abs(average / declared - 1)) <= _AGREES:
        return declared
    long = forward[forward > GAP * (single or average)]
    if average <= 0 or (single > 0 and long.size <= 0.05 * forward.size):
        # Less than one interval in 20 is long, so the long ones are gaps: rounding and bursts make more. The average is
        # better than the median if time stamps are rounded.
        regular = average <= 0 or not 0.5 < average / single < GAP or abs(average / single - 1) <= 1e-9
        return single if regular else average
    if _samples_are_missing(ticks, single, average):
        return single
    # Long intervals are common, so samples come in bursts. Averages over many bursts smooth their steps.
    burst = float(np.median(long)) / average if long.size else 1.0
    return _average(ticks, max(_WINDOW, int(8 * burst**2)))


def _samples_are_missing(ticks: Vector, single: float, average: float) -> bool:
    """Whether long intervals are caused by samples lost at random from a clock of the interval `single`.

    If so, all intervals are multiples of it, the distances between long intervals are random, and the time stamps
    depart from any uniform clock like a random walk. Rounded time stamps and bursts have long intervals at regular
    distances, and stay near a uniform clock over any length.
    """
    steps = np.diff(ticks)
    if steps.size < 4 * _LONG or not single > 0 or not 1 < average / single < GAP:
        return False
    turns = np.round(steps / single)
    if np.any(turns < 1) or np.any(np.abs(steps - turns * single) > _WHOLE * single):
        return False
    apart = np.diff(np.flatnonzero(turns > 1))
    short, long = (_strays(ticks / single, window) for window in (_SHORT, _LONG))
    return bool(np.std(apart) > _BY_CHANCE * np.mean(apart)) and long > 2 * short and long > 2


def _strays(turns: Vector, window: int) -> float:
    """Largest distance of time stamps from the line through the ends of a window; the median over all windows."""
    count = turns.size // window
    parts = turns[: count * window].reshape(count, window)
    ramp = np.linspace(0.0, 1.0, window)
    away = parts - parts[:, :1] - ramp * (parts[:, -1:] - parts[:, :1])
    return float(np.median(np.ptp(away, axis=1)))


def _average(ticks: Vector, window: int) -> float:
    """Mean of the middle half of averages over `window` intervals; 0 if no time stamp increases."""
    window = max(1, min(window, ticks.size // 8))
    averages = (ticks[window:] - ticks[:-window]) / window
    averages = np.sort(averages[averages > 0])
    quarter = averages.size // 4
    return float(np.mean(averages[quarter : averages.size - quarter])) if averages.size else 0.0


def burst_of(steps: Vector, nominal: float) -> float:
    """Approximate number of samples in a burst; 1 if samples do not come in bursts.

    The samples of a burst follow each other at once, and a long interval follows. A gap is longer than that interval.
    """
    ahead = steps > GAP * nominal
    bursts = bool(ahead.any()) and float(np.median(steps[steps >= 0])) < 0.5 * nominal
    return float(np.median(steps[ahead])) / nominal if bursts else 1.0


def reach_of(burst: float, stamps: int) -> int:
    """Number of time stamps on either side of a long interval by which a gap is recognised.

    At least 8 give a median that one late time stamp does not move, two bursts average over their steps, and a quarter
    of all time stamps leaves others to compare with.
    """
    return int(min(max(8, 2 * np.round(burst)), FARTHEST, max(1, stamps // 4)))


def segments_of(ticks: Vector, steps: Vector, nominal: float, burst: float) -> tuple[tuple[int, int], ...]:
    """Ranges without a gap, cut where time stamps step backward, or jump ahead and stay ahead."""
    backward = np.flatnonzero(steps < 0)
    ahead = np.flatnonzero(steps > GAP * nominal)
    if ahead.size:
        ahead = ahead[steps[ahead] > GAP * burst * nominal]
        walls = np.concatenate(([-1], backward, [steps.size]))
        ahead = ahead[_stays_ahead(ticks, ahead, nominal=nominal, walls=walls, burst=burst)]
    cuts = np.union1d(backward, ahead) + 1
    edges = [0, *(int(c) for c in cuts), ticks.size]
    return tuple(pairwise(edges))


def _stays_ahead(
    ticks: Vector, ahead: NDArray[np.int64], nominal: float, walls: NDArray[np.int64], burst: float
) -> NDArray[np.bool_]:
    """For each long interval, whether the time stamps after it stay late by a sample or more.

    If a time stamp is late because the host was busy, or if samples come in bursts, short intervals follow. The medians
    on both sides, over twice the length of a burst, are then the same. They differ after a lost sample, or after a lost
    burst if samples come in bursts.
    """
    width = reach_of(burst, ticks.size)
    wall = np.searchsorted(walls, ahead)
    low, high = walls[wall - 1] + 1, walls[np.minimum(wall, walls.size - 1)]
    result = np.empty(ahead.size, dtype=bool)
    for begin in range(0, ahead.size, 4096):  # bounds the memory if every burst is a candidate
        part = slice(begin, begin + 4096)
        offsets = np.arange(width)
        before = np.maximum(ahead[part, None] - offsets, low[part, None])
        after = np.minimum(ahead[part, None] + 1 + offsets, high[part, None])
        lag_before = np.median(ticks[before] - before * nominal, axis=1)
        lag_after = np.median(ticks[after] - after * nominal, axis=1)
        result[part] = lag_after - lag_before > 0.5 * burst * nominal
    return result


def _interval(stamps: Stamps, steps: Vector, segments: tuple[tuple[int, int], ...]) -> tuple[float, Remark | None]:
    """Sampling interval in ticks, and a remark if it is not the median interval.

    Raises
    ------
    ReadError
        If every interval is a gap.
    """
    inside = np.ones(steps.size, dtype=bool)
    inside[[first - 1 for first, _ in segments[1:]]] = False
    count = int(np.count_nonzero(inside))
    if count == 0:
        raise ReadError(
            "there is a gap between any two time stamps", advice="Check that {--columns} names the time column."
        )
    span = sum(float(stamps.ticks[b - 1] - stamps.ticks[a]) for a, b in segments)
    repeated = int(np.count_nonzero(steps[inside] == 0))
    if repeated <= max(2, 0.005 * count):
        # At most 0.5 % repeated: rows were written twice. Rounding repeats more, and then each row is a sample.
        count -= repeated
    median, mean = float(np.median(steps[inside])), span / count
    longest = max(b - a for a, b in segments) - 1
    if abs(mean - median) <= 2 * stamps.spacing:
        # Median and mean agree within the resolution of float64, and the mean is more precise.
        return _shortest_decimal(mean, 4 * stamps.spacing / span, stamps.per_second), None
    if abs(mean - median) * longest <= 0.5 * median:
        return median, None
    remark = Remark.of(
        "rate-from-mean",
        rate=Quantity(stamps.per_second / mean, "Hz"),
        median=Quantity(median / stamps.per_second, "s"),
    )
    return mean, remark


def _shortest_decimal(interval: float, tolerance: float, per_second: int) -> float:
    """The interval rounded to the fewest digits, of itself or of its rate, that lie within the tolerance of float64."""
    tolerance = max(tolerance, 4 * float(np.finfo(np.float64).eps))
    if tolerance > 1e-6:
        return interval
    for digits in range(1, 16):
        by_rate = per_second / float(f"{per_second / interval:.{digits}g}")
        by_interval = float(f"{interval:.{digits}g}")
        for candidate in (by_rate, by_interval):
            if abs(candidate / interval - 1) <= tolerance:
                return candidate
    return interval


def _require_agreement(rate: float, measured: float, unit: str) -> None:
    """Require that a declared rate and that of the time stamps (Hz) differ by 1 % at most.

    Raises
    ------
    ReadError
        If they differ by more; the advice names the unit in which they would agree.
    """
    if abs(measured / rate - 1) <= _RATE_TOLERANCE:
        return
    known = TIME_UNITS | {u: 1 / seconds for u, seconds in LONG_TIME_UNITS.items()}
    agreeing = (u for u, n in known.items() if abs(measured * n / TIME_UNITS[unit] / rate - 1) <= _RATE_TOLERANCE)
    likely = next(agreeing, "")
    advice = "To use the time stamps, leave {--rate} out; to leave them out, pass {--columns=time:none}."
    if likely:
        advice = "The rates agree if the time stamps are in {likely}: pass {--units=@units}. " + advice
    raise ReadError(
        f"the rate of {rate:g} Hz contradicts the time stamps, which show {measured:.6g} Hz in {unit}",
        argument="rate",
        got=rate,
        advice=advice,
        likely=likely,
        units=f"time:{likely}",
    )


def _about_declared(rate: float, measured: float, grave: bool) -> Iterator[Remark]:
    """A remark if a declared rate and that of the time stamps (Hz) differ; `grave` if it is also a warning."""
    apart = abs(measured / rate - 1)
    if apart <= _RATE_REMARK:
        return
    declared, stamps = Quantity(rate, "Hz"), Quantity(measured, "Hz")
    if grave:
        yield Remark.of("rate-contradicted", source="declared", rate=declared, stamps=stamps, percent=100 * apart)
    else:
        yield Remark.of("rate-declared", rate=declared, stamps=stamps, percent=100 * apart)


def about_stamps(base: TimeBase) -> Iterator[Remark]:
    """Remarks on time stamps that step backward, repeat or jitter."""
    if base.backward:
        yield Remark.of("stamps-backward", count=base.backward)
    if base.duplicates:
        yield Remark.of("stamps-repeated", count=base.duplicates)
    if base.jitter * base.rate > _JITTER:
        yield Remark.of("stamps-jitter", share=base.jitter * base.rate)
