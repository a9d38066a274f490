"""Reduce a recording of any length to the samples that a plot over time needs, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector, runs_of
from gmwm.base.time_base import TimeBase
from gmwm.base.units import SI_UNIT
from gmwm.files.readers.streams import Stream
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu, Signal

SCREEN_COLUMNS = 2048
"""Largest number of columns to which a recording is reduced, which is more than a screen shows."""


class Overview:
    """The smallest and the largest sample of each axis in each of at most `SCREEN_COLUMNS` equal parts of a recording.

    A part has `width` samples. Whenever the recording is longer than all parts together, the width is doubled, so the
    length of the recording need not be known in advance.
    """

    def __init__(self, axes: Iterable[str], rate: float) -> None:
        self.axes, self.rate = tuple(axes), rate
        self.width = 1
        shape = len(self.axes), SCREEN_COLUMNS
        self.least, self.greatest = np.full(shape, np.inf), np.full(shape, -np.inf)
        self._origin: float | None = None
        self._end = 0

    def update(self, chunk: Chunk) -> None:
        """Add the samples of the next chunk."""
        if self._origin is None:
            self._origin = chunk.start
        # If the clock was set back, these samples are placed directly after the previous ones.
        begin = max(round((chunk.start - self._origin) * self.rate), self._end)
        self._end = begin + len(chunk)
        while self._end > SCREEN_COLUMNS * self.width:
            self._halve()
        place = np.arange(begin, self._end) // self.width
        starts = np.flatnonzero(np.diff(place, prepend=-1))
        columns = place[starts]
        for k, axis in enumerate(self.axes):
            values = chunk[axis]
            self.least[k, columns] = np.minimum(self.least[k, columns], np.minimum.reduceat(values, starts))
            self.greatest[k, columns] = np.maximum(self.greatest[k, columns], np.maximum.reduceat(values, starts))

    def result(self, source: str) -> Imu:
        """Return a recording with two samples for each part, its smallest and its largest sample. Gaps are kept."""
        finite = np.isfinite(self.least[0])
        runs = runs_of(finite).tolist()
        lengths = np.cumsum([0, *(2 * (b - a) for a, b in runs)]).tolist()
        segments = tuple(pairwise(lengths))
        starts = tuple(a * self.width / self.rate for a, _ in runs)
        rate = 2 * self.rate / self.width
        signals = {}
        for k, axis in enumerate(self.axes):
            pairs: Vector = np.stack([self.least[k, finite], self.greatest[k, finite]], axis=1).ravel()
            unit = next((si for sensor, si in SI_UNIT.items() if axis.startswith(sensor)), "")
            signals[axis] = Signal(pairs, rate, unit=unit, axis=axis, segments=segments, starts=starts)
        return Imu(signals, source, time_base=TimeBase(rate))

    def _halve(self) -> None:
        self.width *= 2
        for sums, empty, combine in ((self.least, np.inf, np.minimum), (self.greatest, -np.inf, np.maximum)):
            half = combine(sums[:, ::2], sums[:, 1::2])
            sums[:, : SCREEN_COLUMNS // 2], sums[:, SCREEN_COLUMNS // 2 :] = half, empty


def overview(recording: Imu | Stream, done: Callable[[int], None]) -> Imu:
    """Return a recording that can be drawn over time. A stream is reduced to its overview; an Imu is unchanged."""
    if isinstance(recording, Imu):
        return recording
    summary, samples = Overview(recording.axes, recording.rate), 0
    for chunk in recording:
        summary.update(chunk)
        samples += len(chunk)
        done(samples)
    return summary.result(recording.source)


def shown_times(relayout: dict[str, Any] | None) -> tuple[float, float] | None:
    """Return the time range that the user marked in a figure, in the unit of its time axis; None if there is none.

    >>> shown_times({"selections": [{"x0": 20.0, "x1": 10.0}]})
    (10.0, 20.0)
    """
    marked = (relayout or {}).get("selections") or [{}]
    last = marked[-1] if isinstance(marked, list) else {}
    ends = [last.get(name) for name in ("x0", "x1")] if isinstance(last, dict) else []
    times = sorted(float(end) for end in ends if isinstance(end, int | float))
    return (times[0], times[1]) if len(times) == 2 else None
