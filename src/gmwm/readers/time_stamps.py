"""What time stamps say: their unit, the rate, the gaps between segments, and how irregular they are.

Stamps are counted in their own unit from the first one on, so that integers stay exact: nanoseconds since
1970 held as float64 would be known to 256 ns only.
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
from gmwm.time_base import TimeBase
from gmwm.units import LONG_TIME_UNITS, TIME_UNITS

GAP = 1.5
"""An interval longer than this many sampling intervals is a gap, if the stamps behind it stay behind."""

FARTHEST = 512
"""Stamps on either side of a long interval that say whether it is a gap, at the most."""

_WINDOW = 64  # intervals over which the nominal one is averaged: rounding of single stamps fades
_SHORT, _LONG = 64, 1024  # stamps over which lost samples and rounding are told apart
_BY_CHANCE = 0.7  # standard deviation over mean of distances that are those of chance (1), not regular (0)
_WHOLE = 0.05  # of an interval: how near to whole multiples intervals between lost samples are
_PLAUSIBLE = (0.1, 1e5)  # Hz, for a unit that nobody named
_USUAL = 1e4  # Hz, the highest rate that is believed where a lower one is possible
_EPOCH = (1e9, 2.2e9)  # seconds since 1970 of the years 2001 to 2039
_RATE_TOLERANCE = 1e-2  # between rate= and the stamps
_RATE_REMARK, _RATE_TROUBLE = 1e-4, 1e-3


@dataclass(frozen=True)
class Stamps:
    """Time stamps counted from the first one.

    Parameters
    ----------
    ticks : (N,) array
        Stamps minus the first, in `unit`; exact where the file holds integers.
    origin : float
        The first stamp, in `unit`.
    spacing : float
        Distance between numbers of the size of the stamps, in `unit`; 0 for integers.
    unit : str
        "s", "ms", "us" or "ns".
    """

    ticks: Vector
    origin: float
    spacing: float
    unit: str

    @property
    def per_second(self) -> int:
        """How many of the unit a second holds."""
        return TIME_UNITS[self.unit]


@dataclass(frozen=True)
class Timing:
    """The time base of a recording and what follows from it: segments, their start times (s), remarks."""

    base: TimeBase
    segments: tuple[tuple[int, int], ...]
    starts: tuple[float, ...]
    notes: tuple[str, ...]
    troubles: tuple[str, ...]


def unstamped(rate: float, samples: int) -> Timing:
    """The time base of a recording without stamps: one segment at the declared rate."""
    return Timing(TimeBase(rate), ((0, samples),), starts=(0.0,), notes=(), troubles=())


def as_stamps(values: NDArray[Any], unit: str, rate: float | None) -> tuple[Stamps, str]:
    """Stamps in their unit, and a remark where the unit was inferred.

    Parameters
    ----------
    values : (N,) array of int64 or float64
        The column as it stands in the file.
    unit : str
        One of `TIME_UNITS` or `LONG_TIME_UNITS` where declared or named; "" to infer it.
    rate : float or None
        Declared rate (Hz); it settles the unit where several are possible.
    """
    integer = values.dtype.kind in "iu"
    ticks = (values - values[0]).astype(np.float64)
    spacing = 0.0 if integer else float(np.spacing(np.max(np.abs(values))))
    remark = ""
    if unit in LONG_TIME_UNITS:
        seconds = LONG_TIME_UNITS[unit]  # from here on they are counted in seconds
        spacing = float(np.spacing(np.max(np.abs(values.astype(np.float64))))) * seconds
        return Stamps(
            ticks * seconds, float(values[0]) * seconds, spacing, "s"
        ), f"time: stamps in {unit}, taken times {seconds} s"
    if not unit:
        unit = _inferred_unit(ticks, float(values[0]), rate)
        remark = f"time: unit {unit} inferred from the size and the interval of the stamps"
    return Stamps(ticks, float(values[0]), spacing, unit), remark


def _inferred_unit(ticks: Vector, origin: float, rate: float | None) -> str:
    """The one unit that makes sense of the stamps, or an error that shows what each would mean."""
    interval = nominal_interval(ticks)
    rates = {unit: per_second / interval for unit, per_second in TIME_UNITS.items()}
    if rate is not None:
        agreeing = [unit for unit, value in rates.items() if abs(value / rate - 1) <= 0.05]
        if agreeing:
            return agreeing[0]
    low, high = _PLAUSIBLE
    possible = [unit for unit, value in rates.items() if low <= value <= high]
    epoch = [unit for unit in possible if _EPOCH[0] <= origin / TIME_UNITS[unit] <= _EPOCH[1]]
    usual = [unit for unit in possible if rates[unit] < _USUAL] if len(possible) > 1 else possible
    for choice in (epoch, possible, usual):
        if len(choice) == 1:
            return choice[0]
    meaning = ", ".join(f"{unit}: {value:.6g} Hz" for unit, value in rates.items())
    raise UnitError(
        f"the unit of the time column is neither named nor clear: the median interval {interval:.6g} would be "
        f"a rate of ({meaning}); say which with {_one_of_units()}, or pass rate="
    )


def _one_of_units() -> str:
    """What to type for each unit of time."""
    *first, last = (f'units={{"time": "{unit}"}}' for unit in TIME_UNITS)
    return f"{', '.join(first)} or {last}"


def timing(stamps: Stamps, rate: float | None) -> Timing:
    """Rate, segments and irregularities of a recording from its stamps.

    The rate is 1 / median interval within segments. Where a clock of the median interval would leave the
    stamps by more than half a sample within the longest segment (stamps rounded to 10 ms at 128 Hz), it is
    1 / mean interval between gaps. A declared rate wins within 1 %; beyond 0.1 % it is a trouble, where its clock
    leaves the stamps of the longest segment by more than a sample and three times their jitter.

    Raises
    ------
    ReadError
        If the stamps do not move forward, are not in order, change their rate, or contradict the declared one.
    """
    ticks, per_second = stamps.ticks, stamps.per_second
    nominal = nominal_interval(ticks, None if rate is None else per_second / rate)
    require_order(ticks, nominal, stamps.origin, per_second)
    require_one_rate(ticks, stamps.origin, per_second)
    steps = np.diff(ticks)
    segments = segments_of(ticks, steps, nominal, burst_of(steps, nominal))
    interval, remark = _interval(stamps, steps, segments)
    found = per_second / interval
    notes = [remark] if remark else []
    troubles: list[str] = []
    by_stamps = interval
    if rate is not None:
        said = list(_declared(rate, found, stamps.unit))
        interval, found = per_second / rate, rate
    starts = tuple((stamps.origin + float(ticks[first])) / per_second for first, _ in segments)
    inside = np.ones(steps.size, dtype=bool)
    breaks = np.array([first - 1 for first, _ in segments[1:]], dtype=np.int64)
    inside[breaks] = False
    jitter = float(np.sqrt(np.mean((steps[inside] - interval) ** 2))) if inside.any() else 0.0
    if rate is not None:
        scatter = float(np.sqrt(np.mean((steps[inside] - by_stamps) ** 2))) if inside.any() else 0.0
        away = max(last - first for first, last in segments) * abs(interval - by_stamps)
        grave = abs(by_stamps / interval - 1) > _RATE_TROUBLE and away > max(by_stamps, 3 * scatter)
        (troubles if grave else notes).extend(said)
    gaps = tuple((int(b) + 1, float(steps[b]) / per_second) for b in breaks if steps[b] > 0)
    duplicates, backward = int(np.count_nonzero(steps == 0)), int(np.count_nonzero(steps < 0))
    base = TimeBase(
        rate=found,
        stamped=True,
        start=starts[0],
        jitter=jitter / per_second,
        gaps=gaps,
        duplicates=duplicates,
        backward=backward,
    )
    return Timing(
        base, segments, starts=starts, notes=tuple(notes), troubles=(*troubles, *troubles_of(base, ticks.size))
    )


def beside_stated(found: Timing, stated: float) -> Timing:
    """The time base by the stamps, with a trouble where the rate (Hz) that the file states is another one."""
    if abs(found.base.rate / stated - 1) <= _RATE_TOLERANCE:
        return found
    trouble = (
        f"the file states a rate of {stated:g} Hz, but its time stamps say {found.base.rate:.6g} Hz, which counts; if "
        "the stamps are wrong, leave them out with columns={'time': None} and pass rate="
    )
    return replace(found, troubles=(*found.troubles, trouble))


def nominal_interval(ticks: Vector, declared: float | None = None) -> float:
    """The sampling interval before gaps are known, in ticks: robust to gaps, to rounding and to bursts.

    The median of averages over many intervals; the median interval itself where long gaps come so often
    that the averages hold one each. A declared interval decides if it agrees with either.
    """
    forward = np.diff(ticks)
    forward = forward[forward >= 0]
    single = float(np.median(forward)) if forward.size else 0.0
    average = _average(ticks, _WINDOW)
    if average <= 0 and single <= 0:
        raise ReadError(
            "the time column does not move forward; name another column with columns={'time': ...}, "
            "or leave it out with columns={'time': None} and pass rate="
        )
    if declared is not None and min(abs(single / declared - 1), abs(average / declared - 1)) <= 0.05:
        return declared
    long = forward[forward > GAP * (single or average)]
    if average <= 0 or (single > 0 and long.size <= 0.05 * forward.size):
        # Long intervals are rare: they are gaps. Rounding makes the average better than one interval.
        regular = average <= 0 or not 0.5 < average / single < GAP or abs(average / single - 1) <= 1e-9
        return single if regular else average
    if _samples_are_missing(ticks, single, average):
        return single
    # Long intervals are common: samples come in bursts. Averages over many bursts fade their steps.
    burst = float(np.median(long)) / average if long.size else 1.0
    return _average(ticks, max(_WINDOW, int(8 * burst**2)))


def _samples_are_missing(ticks: Vector, single: float, average: float) -> bool:
    """Whether long intervals are samples lost at random from a clock of the interval `single`.

    Then all intervals are whole multiples of it, the long ones come as irregularly as chance has it, and the stamps
    leave any uniform clock as a random walk does. Those that are rounded or come in bursts have long intervals at
    regular distances, and stay near a uniform clock however long they are looked at.
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
    """How far stamps stray from the line through the ends of a window, at most; the median over all windows."""
    count = turns.size // window
    pieces = turns[: count * window].reshape(count, window)
    ramp = np.linspace(0.0, 1.0, window)
    away = pieces - pieces[:, :1] - ramp * (pieces[:, -1:] - pieces[:, :1])
    return float(np.median(np.ptp(away, axis=1)))


def _average(ticks: Vector, window: int) -> float:
    """The middle half's mean of the interval averaged over `window` intervals; 0 if nothing moves forward."""
    window = max(1, min(window, ticks.size // 8))
    averages = (ticks[window:] - ticks[:-window]) / window
    averages = np.sort(averages[averages > 0])
    quarter = averages.size // 4
    return float(np.mean(averages[quarter : averages.size - quarter])) if averages.size else 0.0


def burst_of(steps: Vector, nominal: float) -> float:
    """How many samples are stamped together, roughly; 1 where none are.

    Samples stamped in bursts follow one another at once, then a long interval: a gap is longer than that.
    """
    ahead = steps > GAP * nominal
    bursts = bool(ahead.any()) and float(np.median(steps[steps >= 0])) < 0.5 * nominal
    return float(np.median(steps[ahead])) / nominal if bursts else 1.0


def reach_of(burst: float, stamps: int) -> int:
    """How many of so many stamps on either side say whether a long interval is a gap."""
    return int(min(max(8, 2 * np.round(burst)), FARTHEST, max(1, stamps // 4)))


def segments_of(ticks: Vector, steps: Vector, nominal: float, burst: float) -> tuple[tuple[int, int], ...]:
    """Ranges without a gap: cut where stamps step back, and where they jump ahead and stay there."""
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
    """For each long interval, whether the stamps after it lag the uniform clock by a lost sample or more.

    A stamp that is merely late (a busy host) is followed by short intervals, samples stamped in bursts
    likewise: medians on both sides, over twice the length of a burst, do not move. A lost sample moves them,
    or a lost burst where there are bursts.
    """
    width = reach_of(burst, ticks.size)
    wall = np.searchsorted(walls, ahead)
    low, high = walls[wall - 1] + 1, walls[np.minimum(wall, walls.size - 1)]
    result = np.empty(ahead.size, dtype=bool)
    for begin in range(0, ahead.size, 4096):  # bounded memory where every burst is a candidate
        part = slice(begin, begin + 4096)
        offsets = np.arange(width)
        before = np.maximum(ahead[part, None] - offsets, low[part, None])
        after = np.minimum(ahead[part, None] + 1 + offsets, high[part, None])
        lag_before = np.median(ticks[before] - before * nominal, axis=1)
        lag_after = np.median(ticks[after] - after * nominal, axis=1)
        result[part] = lag_after - lag_before > 0.5 * burst * nominal
    return result


def _interval(stamps: Stamps, steps: Vector, segments: tuple[tuple[int, int], ...]) -> tuple[float, str]:
    """The sampling interval in ticks, and a remark where it is not the median."""
    inside = np.ones(steps.size, dtype=bool)
    inside[[first - 1 for first, _ in segments[1:]]] = False
    count = int(np.count_nonzero(inside))
    if count == 0:
        raise ReadError("no two consecutive time stamps belong together; is this column really the time?")
    span = sum(float(stamps.ticks[b - 1] - stamps.ticks[a]) for a, b in segments)
    repeated = int(np.count_nonzero(steps[inside] == 0))
    if repeated <= max(2, 0.005 * count):
        count -= repeated  # rows written twice; where they are many, stamps were rounded and all samples count
    median, mean = float(np.median(steps[inside])), span / count
    longest = max(b - a for a, b in segments) - 1
    if abs(mean - median) <= 2 * stamps.spacing:
        # One number, read from single intervals or from all of them: all of them know it better.
        return _shortest_decimal(mean, 4 * stamps.spacing / span, stamps.per_second), ""
    if abs(mean - median) * longest <= 0.5 * median:
        return median, ""
    by_median = f"would be {stamps.per_second / median:.6g} Hz" if median > 0 else "is 0"
    return mean, (
        f"rate from the mean interval: the stamps' median interval {by_median}, but they keep pace with "
        f"{stamps.per_second / mean:.6g} Hz (rounded, stamped in bursts, or do samples miss at regular distances?)"
    )


def _shortest_decimal(interval: float, tolerance: float, per_second: int) -> float:
    """The interval of the rate, or the interval, with the fewest digits within the tolerance of float64."""
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


def _declared(rate: float, found: float, unit: str) -> Iterator[str]:
    """Remarks on a declared rate beside the stamps'; an error if they contradict one another."""
    apart = abs(found / rate - 1)
    if apart > _RATE_TOLERANCE:
        known = TIME_UNITS | {u: 1 / seconds for u, seconds in LONG_TIME_UNITS.items()}
        meant = (u for u, n in known.items() if abs(found * n / TIME_UNITS[unit] / rate - 1) <= _RATE_TOLERANCE)
        hint = "".join(f' The stamps are not in {unit}, it seems: pass units={{"time": "{u}"}}.' for u in meant)
        raise ReadError(
            f"rate={rate:g} Hz contradicts the time stamps, which say {found:.6g} Hz; drop rate= to use the stamps, "
            f"or leave them out with columns={{'time': None}}.{hint}"
        )
    if apart > _RATE_REMARK:
        yield (
            f"the declared rate of {rate:g} Hz counts, though the time stamps say {found:.6g} Hz, {100 * apart:.2g} % "
            "from it; drop rate= to use the stamps"
        )


def troubles_of(base: TimeBase, samples: int) -> Iterator[str]:
    """What is wrong with the stamps, in plain words."""
    if base.backward:
        yield f"time stamps that step backward: {base.backward}; the recording is split there"
    if base.duplicates:
        yield f"time stamps that repeat the one before: {base.duplicates} of {samples}: rows repeated, or rounded?"
    if base.jitter * base.rate > 0.5:
        yield f"the stamps jitter by {base.jitter:.3g} s rms, more than half the interval of {1 / base.rate:.3g} s"
