"""Analyse time stamps block by block: where segments begin, and whether the rate stays the same."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.errors import ReadError
from gmwm.readers.rate_check import require_one_rate, require_order
from gmwm.readers.time_stamps import FARTHEST, Timing, about_stamps, burst_of, nominal_interval, reach_of, segments_of
from gmwm.remarks import Quantity, Remark
from gmwm.time_base import TimeBase
from gmwm.units import LONG_TIME_UNITS, TIME_UNITS

# Pinned by tests/readers/test_stream.py and test_parts.py, which hold streams to the segments and errors of `read`.

KEPT = 4 * FARTHEST
"""Time stamps before a block that are analysed again with it, so that each gap is decided by both sides."""

_SOME, _LAST = 1024, 1 << 14
"""Fewest and most of the last rows by which a change of the rate is recognised."""
_CHANGED, _CHANGED_BURSTS = 1.05, 1.2
"""Factors between two rates that are a change, as in `gmwm.readers.rate_check`."""
_APART = 1e-3
"""Relative difference between the rates of the first rows and of all rows that is warned of, as for a declared rate."""


@dataclass(frozen=True)
class Pace:
    """Sampling interval, unit and origin of the time stamps, from the first rows.

    Attributes
    ----------
    first : int or float
        The first time stamp as it stands in the file, from which the others are counted.
    rows : int
        Number of the first rows.
    rate : float
        Samples per second (Hz).
    seconds, per_second : float, int
        Seconds in a tick if it is longer than a second, and ticks in a second if it is shorter; 1 otherwise.
    nominal, burst : float
        Sampling interval in ticks, and number of samples in a burst.
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
        """Analyse the time stamps (n,) of the first rows, int64 or float64, in any unit of time."""
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
        """The first time stamp in ticks."""
        return float(self.first) * self.seconds

    @property
    def before(self) -> int:
        """Number of rows before a row by which it is decided whether the row begins a segment."""
        return KEPT + self.behind

    @property
    def behind(self) -> int:
        """Number of rows from a row on by which it is decided whether the row begins a segment."""
        return reach_of(self.burst, KEPT)

    def ticks(self, values: NDArray[Any]) -> Vector:
        """Time stamps of the file, counted in ticks from the first."""
        ticks: Vector = (values - self.first).astype(np.float64)
        return ticks * self.seconds if self.seconds != 1 else ticks

    def time(self, tick: float) -> float:
        """Time of a tick (s) on the clock of the recording."""
        return (self.origin + tick) / self.per_second

    def base(self, counted: Counted) -> TimeBase:
        """The time base of rows whose intervals were counted."""
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

    def remarks(self, counted: Counted, rows: int) -> Iterator[Remark]:
        """Remarks on the time stamps of all rows, `rows` of them."""
        yield from about_stamps(self.base(counted))
        if rows > self.rows and counted.span > 0:
            measured = self.per_second * counted.inside / counted.span
            if abs(measured / self.rate - 1) > _APART:
                yield Remark.of(
                    "rate-contradicted",
                    source="first-rows",
                    rate=Quantity(self.rate, "Hz"),
                    rows=self.rows,
                    stamps=Quantity(measured, "Hz"),
                )


@dataclass(frozen=True)
class Counted:
    """Sums over intervals of time stamps.

    Attributes
    ----------
    inside : int
        Number of intervals within segments.
    span, squares : float
        Sum of these intervals (ticks), and sum of their squared differences from the sampling interval.
    duplicates, backward : int
        Number of time stamps that repeat the one before, and that step backward.
    gaps : tuple of (row, seconds)
        For each gap, the first row after it and its length.
    """

    inside: int = 0
    span: float = 0.0
    squares: float = 0.0
    duplicates: int = 0
    backward: int = 0
    gaps: tuple[tuple[int, float], ...] = ()

    def followed_by(self, later: Counted) -> Counted:
        """The sums with those of the rows that follow."""
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
    """Rows up to `stop` whose segments are known: the rows that begin a segment, and their times (s)."""

    stop: int
    firsts: tuple[int, ...]
    starts: tuple[float, ...]


class RunningClock:
    """Find gaps in time stamps block by block, with the sampling interval of the first rows.

    A long interval is a gap if the time stamps after it stay late. This needs some rows more, so the segments of the
    last rows of a block are decided with the next block.

    Parameters
    ----------
    pace : Pace
        The time stamps of the first rows.
    row : int
        Number of the first row that will be given.
    before : (n,) array, optional
        Time stamps of the last rows before it, `pace.before` of them or all.
    """

    def __init__(self, pace: Pace, row: int = 0, before: NDArray[Any] | None = None) -> None:
        self.pace = pace
        self._interval = pace.per_second / pace.rate
        self._window = np.empty(0) if before is None else pace.ticks(before)  # ticks from row `_base` on
        self._base, self._stop = row - self._window.size, row
        self._counted, self._gaps = Counted(), list[tuple[int, float]]()

    @property
    def rows(self) -> int:
        """Number of the next row."""
        return self._base + self._window.size

    @property
    def counted(self) -> Counted:
        """Sums over the intervals up to the last row whose segment is known."""
        return self._counted.followed_by(Counted(gaps=tuple(self._gaps)))

    def take(self, values: NDArray[Any]) -> Settled:
        """Add the time stamps of the next rows, and return the rows whose segments are now known.

        Raises
        ------
        ReadError
            If the time stamps are not in order, or the rate changes.
        """
        before = self.rows
        self._window = np.concatenate([self._window, self.pace.ticks(values)])
        self._require_steady(self._window[max(0, before - self._base - 1) :], max(0, before - 1))
        return self._settle(max(self._stop, self.rows - reach_of(self.pace.burst, self.rows)))

    def end(self, behind: NDArray[Any] | None = None) -> Settled:
        """Decide the last rows, with the time stamps of `pace.behind` rows after them if there are any."""
        stop = self.rows
        if behind is not None:
            self._window = np.concatenate([self._window, self.pace.ticks(behind)])
        return self._settle(stop)

    def _require_steady(self, ticks: Vector, row: int) -> None:
        """Require that the new time stamps, from `row` on, are in order and at the same rate.

        Raises
        ------
        ReadError
            If they are not.
        """
        if ticks.size < 2:
            return
        pace = self.pace
        origin, per_second = pace.origin + float(ticks[0]), pace.per_second
        try:
            require_order(ticks - ticks[0], pace.nominal, origin, per_second)
            require_one_rate(ticks - ticks[0], origin, per_second)
        except ReadError as error:
            if row:
                error.message += f" (rows counted from row {row + 1} of the file)"
            raise
        last = self._window[-_LAST:]
        change = nominal_interval(last, self._interval) / pace.nominal if last.size >= _SOME else 1.0
        allowed = _CHANGED if pace.burst == 1 else _CHANGED_BURSTS
        if not 1 / allowed <= change <= allowed:
            raise ReadError(
                f"the sampling rate changes from {pace.rate:.4g} Hz to {pace.rate / change:.4g} Hz before row "
                f"{self.rows}, by the time stamps",
                advice="Split the file there and read the parts one at a time.",
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
        """Add the intervals before the rows that were decided last, the first of them row `_stop` (or row 1)."""
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
