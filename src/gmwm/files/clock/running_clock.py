"""Find the rows at which segments begin, block by block, for files whose clock is known and for live streams."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.time_base import TimeBase, gap_duration
from gmwm.base.units import LONG_TIME_UNITS, TIME_UNITS
from gmwm.files.clock.rate_check import COMPARISON, require_one_rate, require_order
from gmwm.files.clock.sampling_interval import find_losses, resolution_of
from gmwm.files.clock.time_stamps import SegmentStarts, Timing, about_stamps, in_order, without_steps_back

if TYPE_CHECKING:
    from typing_extensions import Self

# Pinned by tests/readers/test_growing.py.

STAMPS_AGAIN = 4096
"""Number of time stamps before a block that are analysed again with it, so that both sides of each gap are used."""
_ROWS_BEHIND = 128  # later rows that decide whether a row begins a segment. Late deliveries end within these rows.


@dataclass(frozen=True)
class KnownSegments:
    """The row up to which segments are known (`stop`), the new rows that begin a segment, and their times (s)."""

    stop: int
    firsts: tuple[int, ...]
    starts: tuple[float, ...]


class KnownClock:
    """Clock of a recording whose time stamps have all been analysed."""

    def __init__(self, timing: Timing, row: int = 0) -> None:
        self._firsts = np.array([first for first, _ in timing.segments])
        self._starts, self._row, self._gaps = timing.starts, row, timing.base.gaps
        self._rows = timing.segments[-1][1] if timing.base.stamped else None

    def take(self, rows: int) -> KnownSegments:
        """Add the next rows, and return the segments that begin in them."""
        row, stop = self._row, self._row + rows
        self._row = stop
        a, b = np.searchsorted(self._firsts, [row, stop]).tolist()
        return KnownSegments(stop, tuple(self._firsts[a:b].tolist()), self._starts[a:b])

    def remaining(self) -> int | None:
        """Return the number of rows that follow; None if it is unknown because the recording has no time stamps."""
        return None if self._rows is None else self._rows - self._row

    def gaps(self, first: int, stop: int) -> tuple[tuple[int, float], ...]:
        """Return the gaps directly before the rows `first` to `stop` − 1: the row after each, and its length (s)."""
        return tuple(gap for gap in self._gaps if first <= gap[0] < stop)

    def segment_at(self, row: int) -> tuple[int, float]:
        """Return the first row of the segment that contains a row, and its time (s)."""
        k = int(np.searchsorted(self._firsts, row, side="right")) - 1
        return int(self._firsts[k]), self._starts[k]


@dataclass(frozen=True)
class Pace:
    """Sampling interval, unit and origin of the time stamps of a live stream, from its first rows."""

    first: int | float  # the first time stamp as it is in the file, from which the others are counted
    rows: int  # number of the first rows
    rate: float  # samples per second (Hz)
    # seconds in a tick if it is longer than a second, and ticks in a second if it is shorter; 1 otherwise
    seconds: float
    per_second: int
    width: int  # number of rows in the blocks that were compared to find the gaps; 1 for single rows
    spacing: float  # spacing of float64 numbers at the magnitude of the time stamps (ticks); 0 for integers

    @classmethod
    def of(cls, head: NDArray[Any], unit: str, timing: Timing) -> Self:
        """Analyse the time stamps (n,) of the first rows, int64 or float64, in any unit of time."""
        seconds = LONG_TIME_UNITS.get(unit, 1)
        integer = head.dtype.kind in "iu"
        return cls(
            first=head[0].item(), rows=head.size, rate=timing.base.rate, seconds=seconds,
            per_second=TIME_UNITS.get(unit, 1), width=timing.width,
            spacing=0.0 if integer else float(np.spacing(np.max(np.abs(head)))) * seconds,
        )  # fmt: skip

    @property
    def interval(self) -> float:
        """Sampling interval in ticks."""
        return self.per_second / self.rate

    @property
    def behind(self) -> int:
        """Number of later rows that are needed to decide whether a row begins a segment."""
        return min(_ROWS_BEHIND + 4 * self.width, STAMPS_AGAIN)

    def ticks(self, values: NDArray[Any]) -> Vector:
        """Convert time stamps of the file to ticks from the first time stamp."""
        ticks: Vector = (values - self.first).astype(np.float64)
        return ticks * self.seconds if self.seconds != 1 else ticks

    def time(self, tick: float) -> float:
        """Convert a tick to a time (s) on the clock of the recording."""
        return (float(self.first) * self.seconds + tick) / self.per_second


@dataclass
class IntervalCounts:
    """Counts and sums over the intervals between time stamps."""

    inside: int = 0  # number of intervals within segments
    span: float = 0.0  # sum of these intervals (ticks), and sum of their squared differences from the sampling interval
    squares: float = 0.0
    # number of time stamps that equal the previous one, and number that are smaller than the previous one
    duplicates: int = 0
    backward: int = 0
    # for each gap, the first row after it and its length (s)
    gaps: list[tuple[int, float]] = field(default_factory=list)


class RunningClock:
    """Find gaps in a live stream's time stamps, with the interval of the first rows. Stamps after a gap stay late.
    Later rows show this, so a block's last segments follow with the next block."""

    def __init__(self, pace: Pace) -> None:
        self.pace = pace
        self._window = np.empty(0)  # ticks from row `_base` on
        self._base = self._stop = 0
        self._starts = SegmentStarts(pace.time(0.0), pace.rate)
        self._counted = IntervalCounts()

    @property
    def rows(self) -> int:
        """Number of the next row."""
        return self._base + self._window.size

    def take(self, values: NDArray[Any]) -> KnownSegments:
        """Add the time stamps of the next rows, and return the rows whose segments are now known."""
        before = self.rows
        self._window = np.concatenate([self._window, self.pace.ticks(values)])
        self._require_steady(self._window[max(0, before - self._base - 1) :], max(0, before - 1))
        stop = self.rows - self.pace.behind
        return self._settle(stop) if stop > self._stop else KnownSegments(self._stop, (), ())

    def end(self) -> KnownSegments:
        """Return the segments of the last rows, at the end of the stream."""
        return self._settle(self.rows)

    def base(self) -> TimeBase:
        """Return the time base of the rows up to the last one whose segment is known."""
        counted, pace = self._counted, self.pace
        jitter = np.sqrt(counted.squares / counted.inside) / pace.per_second if counted.inside else 0.0
        return TimeBase(
            rate=pace.rate, stamped=True, start=pace.time(0.0), jitter=float(jitter), gaps=tuple(counted.gaps),
            duplicates=counted.duplicates, backward=counted.backward,
        )  # fmt: skip

    def remarks(self) -> Iterator[Remark]:
        """Yield remarks on the time stamps of the rows whose segments are known."""
        counted, pace = self._counted, self.pace
        yield from about_stamps(self.base())
        if self._stop > pace.rows and counted.span > 0:
            measured = pace.per_second * counted.inside / counted.span
            # Relative difference between the rates of the first and of all rows for a warning, as for a declared rate
            if abs(measured / pace.rate - 1) > 1e-3:
                yield Remark.of(
                    "rate-contradicted", source="first-rows", rate=Quantity(pace.rate, "Hz"), rows=pace.rows,
                    stamps=Quantity(measured, "Hz"),
                )  # fmt: skip

    def _require_steady(self, new: Vector, row: int) -> None:
        """Require that the new time stamps, from `row` on, are in order and at the same rate."""
        pace = self.pace
        if new.size < 2:
            return
        ticks = in_order(new - new[0], pace.spacing == 0, pace.per_second, pace.interval).ticks
        try:
            require_order(ticks, pace.interval, pace.time(0.0) * pace.per_second + float(new[0]), pace.per_second)
            require_one_rate(without_steps_back(ticks, pace.interval)[0], pace.per_second)
        except ReadError as error:
            if row:
                error.message += f" (rows and times counted from row {row + 1} of the file)"
            raise
        # Smallest number of recent rows whose rate is compared with the rate of the first rows
        if self._window.size < 1024:
            return
        last = self._without_steps_back(self._window)[0]
        change = find_losses(last, resolution_of(last, pace.spacing)).interval / pace.interval
        allowed = COMPARISON.changed if pace.width == 1 else COMPARISON.changed_bursts
        if not 1 / allowed <= change <= allowed:
            raise ReadError(
                f"the sampling rate changes from {pace.rate:.4g} Hz to {pace.rate / change:.4g} Hz before row "
                f"{self.rows}, by the time stamps",
                code="rate-changes",
                advice="Split the file there and read the parts one at a time.",
            )

    def _without_steps_back(self, ticks: Vector) -> tuple[Vector, NDArray[np.int64]]:
        """Return time stamps of the window that never decrease, and the rows in it where the clock was set back."""
        pace = self.pace
        ordered = in_order(ticks, pace.spacing == 0, pace.per_second, pace.interval).ticks
        return without_steps_back(ordered, pace.interval)

    def _settle(self, stop: int) -> KnownSegments:
        window, base, pace = self._window, self._base, self.pace
        ticks, walls = self._without_steps_back(window)
        cuts = dict.fromkeys((base + walls).tolist(), 0)
        if window.size > 2:
            losses = find_losses(ticks, resolution_of(ticks, pace.spacing), pace.interval)
            cuts |= dict(zip((base + losses.rows).tolist(), losses.lost.tolist(), strict=True)) | cuts
        firsts = [row for row in sorted(cuts) if self._stop <= row < stop]
        steps = np.diff(ticks)[max(0, self._stop - base - 1) : max(0, stop - base - 1)]
        self._count(steps, np.diff(window)[max(0, self._stop - base - 1) : max(0, stop - base - 1)], firsts)
        starts = []
        for row in firsts:
            if cuts[row]:
                self._counted.gaps.append((row, gap_duration(cuts[row], pace.rate)))
            # No sample is lost where the clock was set back.
            starts.append(self._starts.at(row, cuts[row], None if cuts[row] else pace.time(float(window[row - base]))))
        if self._stop == 0 < stop:
            firsts, starts = [0, *firsts], [pace.time(0.0), *starts]
        self._stop = stop
        dropped = max(0, stop - STAMPS_AGAIN - base)
        self._window, self._base = window[dropped:], base + dropped
        return KnownSegments(stop, tuple(firsts), tuple(starts))

    def _count(self, steps: Vector, raw: Vector, firsts: list[int]) -> None:
        """Add the intervals before the rows, from `_stop` (or row 1) on, whose segments have just been determined."""
        inside = np.ones(steps.size, dtype=bool)
        inside[[row - max(self._stop, 1) for row in firsts]] = False
        intervals, counted = steps[inside], self._counted
        counted.inside += intervals.size
        counted.span += float(intervals.sum())
        counted.squares += float(np.sum((intervals - self.pace.interval) ** 2))
        counted.duplicates += int(np.count_nonzero(raw == 0))
        counted.backward += int(np.count_nonzero(raw < 0))
