"""The clock of a recording that comes in blocks: where its segments begin, and whether it keeps its rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.errors import ReadError
from gmwm.readers.rate_check import require_one_rate, require_order
from gmwm.readers.time_stamps import FARTHEST, Timing, burst_of, nominal_interval, reach_of, segments_of, troubles_of
from gmwm.time_base import TimeBase
from gmwm.units import LONG_TIME_UNITS, TIME_UNITS

KEPT = 4 * FARTHEST
"""Stamps before a block that are looked at again with it."""

_SOME, _LAST = 1024, 1 << 14  # the last rows, that say whether the rate has changed: at least, and at the most
_CHANGED, _CHANGED_BURSTS = 1.05, 1.2
_APART = 1e-3  # relative: between the rate of the first rows and that of all


@dataclass(frozen=True)
class Pace:
    """What the first rows say of the time stamps of all.

    Attributes
    ----------
    first : int or float
        The first stamp, as it stands in the file; others are counted from it.
    rows : int
        How many rows said it.
    rate : float
        Samples per second (Hz).
    seconds, per_second : float, int
        Seconds in a tick where it is longer than one, ticks in a second where it is not; 1 otherwise.
    nominal, burst : float
        Sampling interval in ticks, and how many samples are stamped together.
    """

    first: int | float
    rows: int
    rate: float
    seconds: float
    per_second: int
    nominal: float
    burst: float

    @classmethod
    def of(cls, head: NDArray[Any], unit: str, timing: Timing) -> Self:
        """That of the stamps (n,) of the first rows, int64 or float64, "s" … "ns" or one of the long units."""
        rate, seconds, per_second = timing.base.rate, LONG_TIME_UNITS.get(unit, 1), TIME_UNITS.get(unit, 1)
        ticks: Vector = (head - head[0]).astype(np.float64) * seconds
        nominal = nominal_interval(ticks, per_second / rate)
        burst = burst_of(np.diff(ticks), nominal)
        return cls(
            first=head[0].item(),
            rows=head.size,
            rate=rate,
            seconds=seconds,
            per_second=per_second,
            nominal=nominal,
            burst=burst,
        )

    @property
    def origin(self) -> float:
        """The first stamp in ticks."""
        return float(self.first) * self.seconds

    @property
    def before(self) -> int:
        """So many rows before one, if there are as many, say whether it begins a segment."""
        return KEPT + self.behind

    @property
    def behind(self) -> int:
        """So many rows from one on, if there are as many, say whether it begins a segment."""
        return reach_of(self.burst, KEPT)

    def ticks(self, values: NDArray[Any]) -> Vector:
        """Stamps as they stand in the file, counted from the first."""
        ticks: Vector = (values - self.first).astype(np.float64)
        return ticks * self.seconds if self.seconds != 1 else ticks

    def time(self, tick: float) -> float:
        """A tick in seconds on the recording's own clock."""
        return (self.origin + tick) / self.per_second

    def base(self, counted: Counted) -> TimeBase:
        """What stamps say that were counted."""
        jitter = np.sqrt(counted.squares / counted.inside) / self.per_second if counted.inside else 0.0
        start = self.origin / self.per_second
        return TimeBase(
            rate=self.rate,
            stamped=True,
            start=start,
            jitter=float(jitter),
            gaps=counted.gaps,
            duplicates=counted.duplicates,
            backward=counted.backward,
        )

    def troubles(self, counted: Counted, rows: int) -> Iterator[str]:
        """What is wrong with the stamps of so many rows, in plain words."""
        yield from troubles_of(self.base(counted), rows)
        if rows > self.rows and counted.span > 0:
            found = self.per_second * counted.inside / counted.span
            if abs(found / self.rate - 1) > _APART:
                yield (
                    f"the rate of {self.rate:.6g} Hz is that of the first {self.rows} rows, the stamps of all "
                    f"say {found:.6g} Hz; pass rate= with the one that is right"
                )


@dataclass(frozen=True)
class Counted:
    """Intervals of time stamps: how many lie inside segments, their sum and squared errors (ticks), and what is odd.

    Attributes
    ----------
    inside : int
        Intervals inside segments.
    span, squares : float
        Their sum, and the sum of their squared differences from the sampling interval.
    duplicates, backward : int
        Stamps that repeat the one before, or step back.
    gaps : tuple of (row, seconds)
        Each gap's first row behind it, and how long it is.
    """

    inside: int = 0
    span: float = 0.0
    squares: float = 0.0
    duplicates: int = 0
    backward: int = 0
    gaps: tuple[tuple[int, float], ...] = ()

    def followed_by(self, later: Counted) -> Counted:
        """These and those that follow."""
        return Counted(
            inside=self.inside + later.inside,
            span=self.span + later.span,
            squares=self.squares + later.squares,
            duplicates=self.duplicates + later.duplicates,
            backward=self.backward + later.backward,
            gaps=self.gaps + later.gaps,
        )


@dataclass(frozen=True)
class Settled:
    """Rows up to `stop` whose segments are known: which rows among them begin one, and at what time (s)."""

    stop: int
    firsts: tuple[int, ...]
    starts: tuple[float, ...]


class RunningClock:
    """Time stamps block by block, with the sampling interval that the first rows have.

    A long interval is a gap if the stamps behind it stay behind: that takes a few rows more, so that the last rows of a
    block are settled with the next one.

    Parameters
    ----------
    pace : Pace
        What the first rows say.
    row : int
        Number of the first row that will come: all before it are settled.
    before : (n,) array
        The stamps of the last rows before it, `pace.before` of them or all; none from the first row on.
    """

    def __init__(self, pace: Pace, row: int = 0, before: NDArray[Any] | None = None) -> None:
        self.pace = pace
        self._interval = pace.per_second / pace.rate
        self._window = np.empty(0) if before is None else pace.ticks(before)  # stamps from row `_base` on
        self._base, self._stop = row - self._window.size, row
        self._counted, self._gaps = Counted(), list[tuple[int, float]]()

    @property
    def rows(self) -> int:
        """Number of the row to come."""
        return self._base + self._window.size

    @property
    def counted(self) -> Counted:
        """The intervals before the rows that are settled."""
        return self._counted.followed_by(Counted(gaps=tuple(self._gaps)))

    def take(self, values: NDArray[Any]) -> Settled:
        """The stamps of the rows that follow; what is settled with them.

        Raises
        ------
        ReadError
            If the stamps are not in order, or the rate changes.
        """
        before = self.rows
        self._window = np.concatenate([self._window, self.pace.ticks(values)])
        self._require_steady(self._window[max(0, before - self._base - 1) :], max(0, before - 1))
        return self._settle(max(self._stop, self.rows - reach_of(self.pace.burst, self.rows)))

    def end(self, behind: NDArray[Any] | None = None) -> Settled:
        """What is settled by there being no more rows, or by the stamps of those that follow: `pace.behind` of them."""
        stop = self.rows
        if behind is not None:
            self._window = np.concatenate([self._window, self.pace.ticks(behind)])
        return self._settle(stop)

    def _require_steady(self, ticks: Vector, row: int) -> None:
        """An error where new stamps, from `row` on, are in no order or at another rate."""
        if ticks.size < 2:
            return
        pace = self.pace
        origin, per_second = pace.origin + float(ticks[0]), pace.per_second
        try:
            require_order(ticks - ticks[0], pace.nominal, origin, per_second)
            require_one_rate(ticks - ticks[0], origin, per_second)
        except ReadError as error:
            raise ReadError(f"{error} (rows counted from row {row + 1} of the file)" if row else str(error)) from None
        last = self._window[-_LAST:]
        change = nominal_interval(last, self._interval) / pace.nominal if last.size >= _SOME else 1.0
        allowed = _CHANGED if pace.burst == 1 else _CHANGED_BURSTS
        if not 1 / allowed <= change <= allowed:
            raise ReadError(
                f"the sampling rate changes from {pace.rate:.4g} Hz to {pace.rate / change:.4g} Hz before row "
                f"{self.rows}, by the time stamps, and one recording has one rate: cut the file there and read the "
                "parts one at a time"
            )

    def _settle(self, stop: int) -> Settled:
        ticks, base = self._window, self._base
        steps = np.diff(ticks)
        edges = segments_of(ticks, steps, self.pace.nominal, self.pace.burst) if ticks.size else ()
        firsts = [base + a for a, _ in edges if self._stop <= base + a < stop and a > 0]
        self._count(steps[max(0, self._stop - base - 1) : max(0, stop - base - 1)], firsts)
        if self._stop == 0 < stop:
            firsts = [0, *firsts]
        starts = tuple(self.pace.time(float(ticks[row - base])) for row in firsts)
        self._stop = stop
        dropped = max(0, stop - KEPT - base)
        self._window, self._base = ticks[dropped:], base + dropped
        return Settled(stop, tuple(firsts), starts)

    def _count(self, steps: Vector, firsts: list[int]) -> None:
        """Add the intervals before the rows that are settled now, the first of them row `_stop` (or row 1)."""
        inside = np.ones(steps.size, dtype=bool)
        for row in firsts:
            k = row - max(self._stop, 1)
            inside[k] = False
            if steps[k] > 0:
                self._gaps.append((row, float(steps[k]) / self.pace.per_second))
        kept = steps[inside]
        squares = float(np.sum((kept - self._interval) ** 2))
        duplicates, backward = int(np.count_nonzero(steps == 0)), int(np.count_nonzero(steps < 0))
        found = Counted(kept.size, float(kept.sum()), squares=squares, duplicates=duplicates, backward=backward)
        self._counted = self._counted.followed_by(found)
