"""Clock of a recording, from all time stamps: sampling rate, segments and irregularities.

Blocks of 2²⁰ rows, with 2¹⁶ rows before and after, give the same result for files in memory and larger ones."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.time_base import TimeBase, gap_duration
from gmwm.base.units import LONG_TIME_UNITS, TIME_UNITS
from gmwm.files.clock.loss_levels import Rows
from gmwm.files.clock.rate_check import require_one_rate, require_order
from gmwm.files.clock.sampling_interval import RATE_TOLERANCE, SampleLosses, find_losses, resolution_of
from gmwm.files.clock.time_stamps import (
    STAMPS_BEHIND,
    ClockSteps,
    SegmentStarts,
    Timing,
    about_stamps,
    as_stamps,
    calendar_unit,
    in_order,
    nominal_interval,
    require_countable,
    require_span,
    without_steps_back,
)

BLOCK, MARGIN = 1 << 20, 1 << 16
"""Rows of a block, and rows on each side that are analysed with it. A change of the rate lasts for 3/64 of them."""
_RATE_REMARK, _RATE_TROUBLE = 1e-4, 1e-3
"""Relative differences between declared and measured rate for a remark or warning; crystals are within 1e-4."""
_REGULAR, _REGULAR_SHARE, _EVEN = 5, 0.01, 0.1
"""SampleLosses are regular from 5 gaps and 1 % of the samples on, if the gaps are even to 10 % (standard deviation)."""


@dataclass(frozen=True)
class _StampBlock:
    """Time stamps of one block, in ticks from the first; they increase where the clock was set back."""

    rows: int  # number of rows
    found: SampleLosses  # sampling interval, and gaps by the number of the row in the recording
    walls: tuple[tuple[int, float], ...]  # each row before which the clock was set back, and its time stamp
    index: float  # mean index of the samples, in which lost samples are counted, and mean of the time stamps
    tick: float
    spread: float  # sum of the squared differences of the sample indices from their mean
    # number and sum of the intervals within segments, and the sum of their squared differences from `reference`
    inside: int
    span: float
    squares: float
    reference: float  # sampling interval of the first block, and its median interval within segments (ticks)
    median: float
    exact: bool  # whether all intervals are multiples of the median within the resolution of float64
    whole: float  # sum of all intervals
    spacing: float  # spacing of float64 numbers at the magnitude of the time stamps
    # number of time stamps that equal the previous one, and number that are smaller than the previous one
    duplicates: int
    backward: int
    steps: ClockSteps  # wraps of a counter and changes of summer time
    spaced: bool  # whether the intervals are multiples of a tenth of a sampling interval or more, as if rounded
    of_float32: bool  # whether float32 sets the resolution of the time stamps
    course: Matrix  # index of the sample and time stamp of some rows (M, 2), between which the rate is compared
    end: float  # tick of the first row of the next block


def clock_of(chunks: Iterable[NDArray[Any]], unit: str, rate: float | None) -> tuple[Timing, Remark | None]:
    """Return rate, segments and irregularities, and a remark if the unit of time is inferred or unusually long.

    A declared rate within 1 % of the time stamps is used; they then only determine gaps. The difference is a warning if
    it exceeds 0.1 %, and over the longest segment one interval and three times the jitter. Start times of segments
    differ by whole intervals, except where the clock was set back."""
    blocks: list[_StampBlock] = []
    first, remark, row = None, None, 0
    for window, begin, end in _windows(chunks):
        if first is None:
            unit = unit or calendar_unit(window)
            stamps, remark = as_stamps(window, unit, rate)
            unit, first = unit or stamps.unit, window[0].item()
        blocks.append(
            _block(_StampWindow.of(window, first, unit), begin=begin, end=end, row=row, before=blocks, rate=rate)
        )
        row += end - begin
    if first is None:
        raise ReadError("the time column is empty", code="time-empty")
    seconds, per_second = LONG_TIME_UNITS.get(unit, 1), TIME_UNITS.get(unit, 1)
    return _joint_timing(
        blocks, float(first) * seconds, per_second, unit if unit in TIME_UNITS else "s", rate=rate
    ), remark


def rows_between(
    values: NDArray[Any], unit: str, rate: float | None, *, begin: float, end: float
) -> tuple[slice, float]:
    """Return the rows between two times (s) from the first time stamp, and the first row's stamp: no clock yet."""
    unit = unit or calendar_unit(values) or as_stamps(values, unit, rate)[0].unit
    window = _StampWindow.of(values, values[0].item(), unit)
    ticks = np.fmax.accumulate(in_order(window.ticks, window.integer, window.per_second).ticks)
    first, last = np.searchsorted(ticks, [begin * window.per_second, end * window.per_second]).tolist()
    return slice(first, last), float(ticks[min(first, ticks.size - 1)]) / window.per_second


def copied_rows(chunks: Iterable[NDArray[Any]]) -> tuple[tuple[int, int], ...]:
    """Return the ranges of rows that were written again; `chunks` have the fields "time" and "values" (bits).

    Rows with few changes of a value are no copies, because they can be equal by chance where the clock was set back."""
    copies, row = [(0, 0)], 0
    for window, begin, end in _windows(chunks):
        stamps, values = window["time"], window["values"]
        order = np.argsort(stamps, kind="stable")
        back = np.flatnonzero(np.diff(stamps) < 0) + 1
        edges = (np.searchsorted(stamps, stamps[back], side, sorter=order).tolist() for side in ("left", "right"))
        for first, low, high in zip(back.tolist(), *edges, strict=True):
            if not begin <= first < end or first + row - begin < copies[-1][1]:
                continue
            for source in order[low:high][order[low:high] < first].tolist():
                count = min(first - source, window.size - first)
                for size in (min(STAMPS_BEHIND, count), count):  # rows that are no copies differ soon
                    differ = np.flatnonzero(window[first : first + size] != window[source : source + size])
                    if differ.size:
                        break
                stop = first + (int(differ[0]) if differ.size else count)
                if np.count_nonzero(np.diff(values[first:stop], axis=0)) >= STAMPS_BEHIND:
                    copies.append((first + row - begin, stop + row - begin))
                    break
        row += end - begin
    return tuple(copies[1:])


def _windows(chunks: Iterable[NDArray[Any]]) -> Iterator[tuple[NDArray[Any], int, int]]:
    """Yield blocks of rows with their margins, and the positions in these rows at which the block begins and ends."""
    waiting: list[NDArray[Any]] = []
    count = begin = 0
    for chunk in chunks:
        for k in range(0, chunk.size, BLOCK):
            waiting.append(chunk[k : k + BLOCK])
            count += waiting[-1].size
            if count >= begin + BLOCK + MARGIN:
                rows = np.concatenate(waiting)
                while rows.size >= begin + BLOCK + MARGIN:
                    yield rows[: begin + BLOCK + MARGIN], begin, begin + BLOCK
                    rows = rows[begin + BLOCK - MARGIN :]
                    begin = MARGIN
                waiting, count = [rows], rows.size
    if count > begin:
        yield np.concatenate(waiting), begin, count


@dataclass(frozen=True)
class _StampWindow:
    """Time stamps in ticks from the first time stamp of the recording, and their resolution."""

    ticks: Vector
    origin: float
    spacing: float
    per_second: int
    integer: bool
    of_float32: float  # resolution if the time stamps were stored as float32; otherwise 0

    @classmethod
    def of(cls, values: NDArray[Any], first: int | float, unit: str) -> _StampWindow:
        require_countable(values)
        integer, seconds = values.dtype.kind in "iu", LONG_TIME_UNITS.get(unit, 1)
        values = values.astype(np.int64, copy=False) if integer else values
        ticks = (values - first).astype(np.float64, copy=False)
        exact = integer and seconds == 1
        return cls(
            ticks=ticks * seconds if seconds != 1 else ticks, origin=float(first) * seconds,
            spacing=0.0
            if exact
            else float(np.spacing(np.max(np.abs(values.astype(np.float64, copy=False))))) * seconds,
            per_second=TIME_UNITS.get(unit, 1), integer=exact, of_float32=_spacing_of_float32(values) * seconds,
        )  # fmt: skip


def _spacing_of_float32(values: NDArray[Any]) -> float:
    """Return the resolution of time stamps that were stored as float32; 0 if they have more digits or are integers."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    stored = values.dtype.kind == "f" and np.array_equal(single, values)
    return float(np.spacing(np.max(np.abs(single)))) if stored else 0.0


def _block(
    window: _StampWindow, *, begin: int, end: int, row: int, before: Sequence[_StampBlock], rate: float | None
) -> _StampBlock:
    """Analyse the rows `begin` to `end` of a window; row `begin` is row number `row` of the recording."""
    per_second, offset = window.per_second, row - begin
    order = in_order(window.ticks, window.integer, per_second)
    nominal = nominal_interval(order.ticks)
    require_order(order.ticks, nominal, window.origin, per_second, row=offset)
    require_span(order.ticks, nominal, per_second)
    ticks, walls = without_steps_back(order.ticks, nominal)
    require_span(ticks, nominal, per_second)
    ticks = ticks + ((before[-1].end if before else 0.0) - ticks[begin])
    require_one_rate(ticks, per_second, offset)
    declared = before[0].found.interval if before else None
    declared = per_second / rate if rate is not None else declared
    resolution = max(resolution_of(ticks, window.spacing), window.of_float32)
    losses = find_losses(ticks, resolution, declared)

    lost = np.zeros(ticks.size, dtype=np.int64)
    lost[losses.rows] = losses.lost
    lost[walls] = 0
    block = slice(begin, end)
    low = max(begin, 1)  # the first row with an interval before it
    cut = lost > 0
    cut[walls] = True
    steps = np.diff(ticks)[low - 1 : end - 1]
    intervals = steps[~cut[low:end]]
    reference = before[0].reference if before else losses.interval
    median = before[0].median if before else float(np.median(intervals)) if intervals.size else losses.interval
    exact, multiples = 2 * window.spacing + 1e-9 * median, steps / median if median > 0 else steps
    repeated = losses.repeated[(losses.repeated >= begin) & (losses.repeated < end)] + offset
    repeats = np.bincount(repeated - row, minlength=end - begin)
    missing = sum(int(np.sum(b.found.lost)) - b.found.repeated.size for b in before)
    index = (row + missing + np.arange(end - begin) + np.cumsum(lost[block] - repeats)).astype(np.float64)
    rows = np.flatnonzero(lost[block])
    raw = np.diff(window.ticks)[low - 1 : end - 1]
    return _StampBlock(
        rows=end - begin, found=replace(losses, rows=rows + row, lost=lost[block][rows], repeated=repeated),
        walls=tuple((int(w) + offset, float(window.ticks[w])) for w in walls if begin <= w < end),
        index=float(np.mean(index)), tick=float(np.mean(ticks[block])),
        spread=float(np.sum((index - np.mean(index)) ** 2)), inside=intervals.size, span=float(np.sum(intervals)),
        squares=float(np.sum((intervals - reference) ** 2)), reference=reference, median=median,
        exact=median > 0 and bool(np.all(np.abs(multiples - np.round(multiples)) * median <= exact)),
        whole=float(np.sum(steps)), spacing=window.spacing, duplicates=int(np.count_nonzero(raw == 0)),
        backward=int(np.count_nonzero(np.diff(order.ticks)[low - 1 : end - 1] < 0)),
        steps=order.steps.between(begin, end), end=float(ticks[min(end, ticks.size - 1)]),
        spaced=resolution > 0.1 * losses.interval, of_float32=resolution == window.of_float32,
        course=_course(index, ticks[block]),
    )  # fmt: skip


def _joint_timing(
    blocks: Sequence[_StampBlock], origin: float, per_second: int, unit: str, *, rate: float | None
) -> Timing:
    """Combine all blocks into the clock of the recording."""
    rows, lost = (np.concatenate([getattr(b.found, name) for b in blocks]) for name in ("rows", "lost"))
    count = sum(b.rows for b in blocks)
    interval, remark = _interval(blocks, rows, lost, count=count, per_second=per_second)
    measured = per_second / interval
    steps = ClockSteps.join([b.steps for b in blocks])
    remarks = [*steps.remarks(per_second), *([remark] if remark else ())]
    if rate is not None:
        _require_agreement(rate, measured, unit)
    used = measured if rate is None else rate
    walls = dict(wall for b in blocks for wall in b.walls)
    cuts = np.union1d(rows, np.array(list(walls), dtype=np.int64))
    segments = tuple(pairwise([0, *cuts.tolist(), count]))
    inside, span, reference = sum(b.inside for b in blocks), sum(b.span for b in blocks), blocks[0].reference
    shift = reference - interval
    squares = sum(b.squares for b in blocks) + 2 * shift * (span - inside * reference) + inside * shift**2
    jitter = float(np.sqrt(max(squares, 0.0) / inside)) if inside else 0.0
    if drift := _about_drift(blocks, jitter / interval, per_second):
        remarks = [drift, *steps.remarks(per_second)]
    if rate is not None:
        away = max(last - first for first, last in segments) * abs(per_second / rate - interval)
        grave = abs(measured / rate - 1) > _RATE_TROUBLE and away > max(interval, 3 * jitter)
        remarks += _about_declared(rate, measured, grave)
    elif any(b.found.unclear for b in blocks):
        remarks = [Remark.of("rate-ambiguous", case="unclear", rate=Quantity(measured, "Hz")), *remarks]
    elif remark := _about_regular(rows, lost, count, measured) or _about_rounded(blocks, count, measured, per_second):
        remarks = [*(entry for entry in remarks if entry.facts.get("case") != "mean"), remark]
    gaps = dict(zip(rows.tolist(), lost.tolist(), strict=True))
    times = {row: (origin + tick) / per_second for row, tick in walls.items()}
    clock = SegmentStarts(origin / per_second, used)
    starts = tuple(clock.at(row, gaps.get(row, 0), times.get(row)) for row, _ in segments)
    base = TimeBase(
        rate=used, stamped=True, start=starts[0], jitter=jitter / per_second,
        gaps=tuple((row, gap_duration(count, used)) for row, count in gaps.items()),
        duplicates=sum(b.duplicates for b in blocks), backward=sum(b.backward for b in blocks),
    )  # fmt: skip
    remarks += about_stamps(base)
    return Timing(
        base, segments, starts=starts, remarks=tuple(remarks), width=blocks[0].found.width, set_back=bool(walls)
    )


def _interval(
    blocks: Sequence[_StampBlock], rows: Rows, lost: Rows, count: int, per_second: int
) -> tuple[float, Remark | None]:
    """Return the sampling interval (ticks) in the digits that the time stamps resolve, and a remark if it is a mean."""
    interval, median, spacing = _slope(blocks), blocks[0].median, max(b.spacing for b in blocks)
    span, repeated = sum(b.whole for b in blocks), sum(b.found.repeated.size for b in blocks)
    mean = span / max(1, count - 1 + int(np.sum(lost)) - repeated)
    exact = 2 * spacing + 1e-9 * median
    if all(b.exact for b in blocks) and abs(mean - median) <= exact and abs(interval - median) <= exact + 1e-7 * median:
        # All intervals are multiples of one interval within the resolution of float64.
        return _shortest_decimal(mean, 4 * spacing / span, per_second), None
    longest = int(np.max(np.diff(rows, prepend=0, append=count)))
    if abs(interval - median) * longest <= 0.5 * median:
        return interval, None
    # Rounded time stamps have few different intervals, and jitter has many.
    spaced = all(b.spaced for b in blocks)
    remark = Remark.of(
        "rate-stated", case="mean", rate=Quantity(per_second / interval, "Hz"),
        median=Quantity(median / per_second, "s"), cause="spaced" if spaced else "free",
    )  # fmt: skip
    return interval, remark


def _slope(blocks: Sequence[_StampBlock]) -> float:
    """Return the slope of the line through the time stamps of all blocks, from the slope and mean of each block."""
    if len(blocks) == 1:
        return blocks[0].found.interval
    sizes = np.array([b.rows for b in blocks], dtype=np.float64)
    k, t = (np.array([getattr(b, name) for b in blocks]) for name in ("index", "tick"))
    k, t = k - np.average(k, weights=sizes), t - np.average(t, weights=sizes)
    spread, slopes = np.array([b.spread for b in blocks]), np.array([b.found.interval for b in blocks])
    return float((np.dot(slopes, spread) + np.sum(sizes * k * t)) / (np.sum(spread) + np.sum(sizes * k * k)))


def _course(index: Vector, ticks: Vector) -> Matrix:
    """Return the index of the sample and the time stamp at nine rows, from means of 64 rows around them."""
    width = min(64, max(1, index.size // 16))
    rows = np.linspace(0, index.size - width, 9).astype(np.int64)
    return np.array([[np.mean(v[row : row + width]) for v in (index, ticks)] for row in rows])


def _about_drift(blocks: Sequence[_StampBlock], jitter: float, per_second: int) -> Remark | None:
    """Return a remark if the rate changes slowly by more than 1 %, beyond the jitter (sampling intervals)."""
    course = np.concatenate([block.course for block in blocks])
    course = course[np.linspace(0, len(course) - 1, 9).astype(np.int64)]
    samples, ticks = np.diff(course, axis=0).T
    if np.any(samples <= 0) or np.any(ticks <= 0):
        return None
    rates = samples / ticks * per_second
    # Six standard errors of the difference of two means of time stamps. A delay in a buffer lasts for many rows.
    if np.ptp(rates) < np.max(rates) * max(RATE_TOLERANCE, 6 * np.sqrt(2) * jitter / float(np.min(samples))):
        return None
    first, last, low, high = (Quantity(float(rate), "Hz") for rate in (rates[0], rates[-1], min(rates), max(rates)))
    percent = float(100 * np.ptp(rates) / np.mean(rates))
    return Remark.of("stamps-irregular", case="drift", first=first, last=last, low=low, high=high, percent=percent)


def _about_regular(rows: Rows, lost: Rows, count: int, rate: float) -> Remark | None:
    """Return a remark if samples are missing at regular intervals, which a lower sampling rate would also explain."""
    share = float(np.sum(lost)) / count
    if rows.size < _REGULAR or share < _REGULAR_SHARE or np.median(lost) > 2:
        return None
    apart = np.diff(rows)
    if np.std(apart) > _EVEN * np.mean(apart):
        return None
    return Remark.of(
        "rate-ambiguous", case="losses", every=round(float(np.mean(apart))) + 1, rate=Quantity(rate, "Hz"),
        other=Quantity(rate / (1 + share), "Hz"),
    )  # fmt: skip


def _about_rounded(blocks: Sequence[_StampBlock], count: int, rate: float, per_second: int) -> Remark | None:
    """Return a remark if the time stamps have two explanations, rounding at this rate or regular losses at a higher
    rate: all intervals are multiples of the most common one, and no time stamp repeats. Float32 explains this alone."""
    if not all(b.exact and not b.found.rows.size and not b.duplicates and not b.of_float32 for b in blocks):
        return None
    other = per_second / blocks[0].median
    lost = sum(b.whole for b in blocks) / blocks[0].median - (count - 1)
    if lost < max(_REGULAR, _REGULAR_SHARE * count):
        return None
    return Remark.of(
        "rate-ambiguous", case="complete", every=round(count / lost) + 1, rate=Quantity(rate, "Hz"),
        other=Quantity(other, "Hz"),
    )  # fmt: skip


def _shortest_decimal(interval: float, tolerance: float, per_second: int) -> float:
    """Round an interval within the tolerance so that it, or its rate, has the fewest decimal digits."""
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
    """Require that the declared rate and the rate of the time stamps (Hz) differ by 1 % at most."""
    if abs(measured / rate - 1) <= RATE_TOLERANCE:
        return
    units = TIME_UNITS | {u: 1 / seconds for u, seconds in LONG_TIME_UNITS.items()}
    agreeing = (u for u, n in units.items() if abs(measured * n / TIME_UNITS[unit] / rate - 1) <= RATE_TOLERANCE)
    likely = next(agreeing, "")
    advice = "To use the time stamps, leave {--rate} out; to leave them out, pass {--columns=time:none}."
    if likely:
        advice = "The rates agree if the time stamps are in {likely}: pass {--units=@units}. " + advice
    raise ReadError(
        f"the rate of {rate:g} Hz contradicts the time stamps, which show {measured:.6g} Hz in {unit}",
        code="rate-contradiction", argument="rate", got=rate, advice=advice, likely=likely, units=f"time:{likely}",
    )  # fmt: skip


def _about_declared(rate: float, measured: float, grave: bool) -> Iterator[Remark]:
    """Report a declared rate that differs from the rate of the time stamps (Hz), with a warning if `grave`."""
    apart = abs(measured / rate - 1)
    if apart <= _RATE_REMARK:
        return
    declared, stamps = Quantity(rate, "Hz"), Quantity(measured, "Hz")
    if grave:
        yield Remark.of("rate-contradicted", source="declared", rate=declared, stamps=stamps, percent=100 * apart)
    else:
        yield Remark.of("rate-stated", case="declared", rate=declared, stamps=stamps, percent=100 * apart)
