"""Record the signals and the chart statistics of a monitor over time, to plot them."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmwm.applications.monitor.api import Monitor
from gmwm.applications.monitor.axis import Event
from gmwm.applications.monitor.baseline import chunks_of
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.results import Plotted, register
from gmwm.base.text import counted, duration_text
from gmwm.files.readers.streams import Stream
from gmwm.recording.chunks import Chunk
from gmwm.recording.signals import Imu

STEP, LOOKS = 512, 256
"""The chart statistics are recorded after each STEP samples or, later, after 1/LOOKS of the samples so far."""
FAMILIES = ("noise up", "noise down", "level")  # families of charts whose statistics are recorded


class Trace(Plotted):
    """Run a monitor, and record its events, the extremes of its signals and its chart statistics over time.

    Parameters
    ----------
    monitor : Monitor
        Monitor that processes the samples.
    pictures : bool
        Whether to record signals and chart statistics for plots, in up to 2048 intervals each.
    source : str
        Name of the file or unit that is monitored, for the report.

    Attributes
    ----------
    events : list of Event
        Events so far.
    """

    def __init__(self, monitor: Monitor, *, pictures: bool = True, source: str = "") -> None:
        self.monitor = monitor
        self.source = source
        self.events: list[Event] = []
        self._pictures = pictures
        self._signals = {axis: _Course(16) for axis in monitor.axes}
        self._heights = {axis: _Course(1) for axis in monitor.axes}

    def watch(self, recording: Imu | Stream) -> Iterator[Event]:
        """Monitor a `recording`, and yield each event as soon as its kind is determined, like `Monitor.watch`."""
        for chunk in chunks_of(recording):
            yield from self.update(chunk)
        yield from self.finish()

    def update(self, chunk: Chunk) -> list[Event]:
        """Add a `chunk` of `gmwm.stream`, and return the events that were detected with it, in order of time."""
        events: list[Event] = []
        at = 0
        while at < len(chunk):
            step = max(STEP, self.monitor.samples // LOOKS) if self._pictures else len(chunk)
            values = {axis: chunk.values[axis][at : at + step] for axis in self.monitor.axes}
            time = chunk.start + at / self.monitor.rate
            events += self.monitor.update(Chunk(values, first=chunk.first + at, segment=chunk.segment, start=time))
            if self._pictures:
                self._note(time, values)
            at += step
        self.events += events
        return events

    def finish(self) -> list[Event]:
        """Determine and return the faults of pending alarms at the end of the samples."""
        events = self.monitor.finish()
        self.events += events
        return events

    def signal(self, axis: str) -> tuple[Vector, Matrix]:
        """Return times (n,) of intervals (s), and smallest and largest sample (n, 2) of an `axis` in each, in SI."""
        times, rows = self._signals[axis].found()
        return times, rows * np.array([-1.0, 1.0])

    def heights(self, axis: str) -> tuple[Vector, dict[str, Vector]]:
        """Return times (n,) (s), and the largest statistic (n,) of each family of an `axis`, over its threshold."""
        times, rows = self._heights[axis].found()
        return times, {family: rows[:, k] for k, family in enumerate(FAMILIES)}

    def to_dict(self) -> dict[str, Any]:
        """Return the axes, the number of samples and the events as lists, numbers and strings for JSON."""
        return plain_fields(self.monitor, "axes rate samples every resting") | {"events": plain(self.events)}

    def summary(self) -> str:
        """Describe the monitored data and the number of events in one line."""
        monitor = self.monitor
        length = duration_text(monitor.samples / monitor.rate)
        count = counted(len(self.events), "event") if self.events else "no event"
        motion = "; the unit was moved and is not yet still" if monitor.resting else ""
        lost = f", {monitor.lost} lost" if monitor.lost else ""
        return f"{count} in {length} ({counted(monitor.samples, 'sample')}{lost}) of {', '.join(monitor.axes)}{motion}"

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a report with the result, the events and the plots as one HTML page, and return its path.

        If `path` does not end in .html, or another error occurs, no file is written."""
        from gmwm.applications.monitor.plot import monitor_report

        return monitor_report(self, path)

    def _note(self, time: float, values: Mapping[str, Vector]) -> None:
        heights = self.monitor.heights()
        for axis, x in values.items():
            self._signals[axis].update(time, 1.0 / self.monitor.rate, np.stack([-x, x], axis=1))
            self._heights[axis].update(time, 0.0, np.array([[heights[axis][family] for family in FAMILIES]]))


register(Trace, "gmwm.applications.monitor.plot:plot_trace")


class _Course:
    """Maxima of time series over intervals. The length of the intervals doubles when there are too many."""

    def __init__(self, width: int) -> None:
        self._width, self._filled = width, 0
        self._times: list[float] = []
        self._rows: list[Vector] = []

    def update(self, time: float, step: float, rows: Matrix) -> None:
        """Add rows (n, m), `step` seconds apart, the first at `time`."""
        at = 0
        while at < len(rows):
            taken = rows[at : at + self._width - self._filled]
            largest = taken.max(axis=0)
            if self._filled:
                self._rows[-1] = np.maximum(self._rows[-1], largest)
            else:
                self._times.append(time + at * step)
                self._rows.append(largest)
            self._filled, at = (self._filled + len(taken)) % self._width, at + len(taken)
            if not self._filled and len(self._times) >= 2048:
                self._times, self._width = self._times[::2], 2 * self._width
                self._rows = [np.maximum(a, b) for a, b in zip(self._rows[::2], self._rows[1::2], strict=True)]

    def found(self) -> tuple[Vector, Matrix]:
        """Return the times (n,) of the intervals, and the maxima (n, m)."""
        return np.array(self._times), np.array(self._rows) if self._rows else np.zeros((0, 1))
