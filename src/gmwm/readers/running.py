"""The clock of a recording that comes in blocks: where its segments begin, and whether it keeps its rate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.errors import ReadError
from gmwm.readers.headers import LONG_TIME_UNITS, TIME_UNITS
from gmwm.readers.steady import require_one_rate, require_order
from gmwm.readers.timebase import FARTHEST, Timing, burst_of, nominal_interval, reach_of, segments_of, troubles_of
from gmwm.signals import TimeBase

_KEPT = 4 * FARTHEST  # stamps before a block that are looked at again with it
_SOME, _LAST = 1024, 1 << 14  # the last rows, that say whether the rate has changed: at least, and at the most
_CHANGED, _CHANGED_BURSTS = 1.05, 1.2
_APART = 1e-3  # relative: between the rate of the first rows and that of all


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
    head : (n,) array of int64 or float64
        The stamps of the first rows, as they stand in the file; not yet taken.
    unit : str
        Their unit, "s" … "ns" or one of the long ones.
    timing : Timing
        What the first rows say.
    """

    def __init__(self, head: NDArray[Any], unit: str, timing: Timing) -> None:
        self._first, self._rate, self._head_rows = head[0], timing.base.rate, head.size
        self._seconds = LONG_TIME_UNITS.get(unit, 1)
        self._per_second = TIME_UNITS.get(unit, 1)
        self._origin = float(head[0]) * self._seconds
        self._interval = self._per_second / self._rate
        ticks = self._ticks(head)
        self._nominal = nominal_interval(ticks, self._interval)
        self._burst = burst_of(np.diff(ticks), self._nominal)
        self._window = np.empty(0)  # stamps from row `_base` on
        self._base = self._stop = 0
        self._span = self._squares = 0.0
        self._inside = self._duplicates = self._backward = 0
        self._gaps: list[tuple[int, float]] = []

    @property
    def rows(self) -> int:
        """Rows that came."""
        return self._base + self._window.size

    def take(self, values: NDArray[Any]) -> Settled:
        """The stamps of the rows that follow; what is settled with them.

        Raises
        ------
        ReadError
            If the stamps are not in order, or the rate changes.
        """
        before = self.rows
        self._window = np.concatenate([self._window, self._ticks(values)])
        self._require_steady(self._window[max(0, before - self._base - 1) :], max(0, before - 1))
        return self._settle(max(self._stop, self.rows - reach_of(self._burst, self.rows)))

    def end(self) -> Settled:
        """What is settled by there being no more rows."""
        return self._settle(self.rows)

    def base(self) -> TimeBase:
        """What the stamps so far say."""
        jitter = np.sqrt(self._squares / self._inside) / self._per_second if self._inside else 0.0
        start = self._origin / self._per_second
        return TimeBase(self._rate, True, start, float(jitter), tuple(self._gaps), self._duplicates, self._backward)

    def troubles(self) -> Iterator[str]:
        """What is wrong with the stamps, in plain words."""
        yield from troubles_of(self.base(), self.rows)
        if self.rows > self._head_rows and self._span > 0:
            found = self._per_second * self._inside / self._span
            if abs(found / self._rate - 1) > _APART:
                yield (
                    f"the rate of {self._rate:.6g} Hz is that of the first {self._head_rows} rows, the stamps of all "
                    f"say {found:.6g} Hz; pass rate= with the one that is right"
                )

    def _ticks(self, values: NDArray[Any]) -> Vector:
        ticks: Vector = (values - self._first).astype(np.float64)
        return ticks * self._seconds if self._seconds != 1 else ticks

    def _require_steady(self, ticks: Vector, row: int) -> None:
        """An error where new stamps, from `row` on, are in no order or at another rate."""
        if ticks.size < 2:
            return
        origin, per_second = self._origin + float(ticks[0]), self._per_second
        try:
            require_order(ticks - ticks[0], self._nominal, origin, per_second)
            require_one_rate(ticks - ticks[0], origin, per_second)
        except ReadError as error:
            raise ReadError(f"{error} (rows counted from row {row + 1} of the file)" if row else str(error)) from None
        last = self._window[-_LAST:]
        change = nominal_interval(last, self._interval) / self._nominal if last.size >= _SOME else 1.0
        allowed = _CHANGED if self._burst == 1 else _CHANGED_BURSTS
        if not 1 / allowed <= change <= allowed:
            raise ReadError(
                f"the sampling rate changes from {self._rate:.4g} Hz to {self._rate / change:.4g} Hz before row "
                f"{self.rows}, by the time stamps, and one recording has one rate: cut the file there and read the "
                "parts one at a time"
            )

    def _settle(self, stop: int) -> Settled:
        ticks, base = self._window, self._base
        steps = np.diff(ticks)
        edges = segments_of(ticks, steps, self._nominal, self._burst) if ticks.size else ()
        firsts = [base + a for a, _ in edges if self._stop <= base + a < stop and base + a > 0]
        self._count(steps[max(0, self._stop - base - 1) : max(0, stop - base - 1)], firsts)
        if self._stop == 0 < stop:
            firsts = [0, *firsts]
        starts = tuple((self._origin + float(ticks[row - base])) / self._per_second for row in firsts)
        self._stop = stop
        dropped = max(0, stop - _KEPT - base)
        self._window, self._base = ticks[dropped:], base + dropped
        return Settled(stop, tuple(firsts), starts)

    def _count(self, steps: Vector, firsts: list[int]) -> None:
        """Add the intervals before the rows that are settled now, the first of them row `_stop` (or row 1)."""
        inside = np.ones(steps.size, dtype=bool)
        for row in firsts:
            k = row - max(self._stop, 1)
            inside[k] = False
            if steps[k] > 0:
                self._gaps.append((row, float(steps[k]) / self._per_second))
        self._duplicates += int(np.count_nonzero(steps == 0))
        self._backward += int(np.count_nonzero(steps < 0))
        kept = steps[inside]
        span = float(kept.sum())
        self._span += span
        self._squares += float(np.sum((kept - self._interval) ** 2))
        self._inside += kept.size
