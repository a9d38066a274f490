"""The course of a monitor over time, for a picture: the signal, and how high its charts are."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm._text import counted, duration_text
from gmwm.chunks import Chunk
from gmwm.monitor.api import Monitor
from gmwm.monitor.events import Event
from gmwm.monitor.setup import chunks_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure as MatplotlibFigure

    from gmwm.readers.streams import Stream
    from gmwm.signals import Imu

MOST = 2048
"""Largest number of intervals that are kept. If there are more, neighbours are joined."""
SHORTEST = 16
"""Number of samples in an interval at the beginning."""
STEP, LOOKS = 512, 256
"""The charts are looked at after STEP samples, later after a share 1/LOOKS of the samples so far."""
FAMILIES = ("noise up", "noise down", "level")
"""Families of charts whose heights are kept."""


class Trace:
    """Events of a monitor, and for pictures the extremes of each signal and the heights of its charts over time.

    Parameters
    ----------
    monitor : Monitor
        It gets the samples.
    pictures : bool
        Whether signals and heights are kept, in up to 2048 intervals each.
    source : str
        What is monitored, for the report: a file, or the name of a unit.

    Attributes
    ----------
    events : list of Event
    """

    def __init__(self, monitor: Monitor, *, pictures: bool = True, source: str = "") -> None:
        self.monitor = monitor
        self.source = source
        self.events: list[Event] = []
        self._pictures = pictures
        self._signals = {axis: _Course(SHORTEST) for axis in monitor.axes}
        self._heights = {axis: _Course(1) for axis in monitor.axes}

    def watch(self, recording: Imu | Stream) -> Iterator[Event]:
        """Monitor a whole recording, as `Monitor.watch` does.

        Parameters
        ----------
        recording : Imu or Stream

        Returns
        -------
        iterator of Event
        """
        for chunk in chunks_of(recording):
            yield from self.update(chunk)
        yield from self.finish()

    def update(self, chunk: Chunk) -> list[Event]:
        """Add the next samples, and return the events that were named with them.

        Parameters
        ----------
        chunk : Chunk
            Samples of `gmwm.stream`, without a gap.

        Returns
        -------
        list of Event
        """
        found: list[Event] = []
        at = 0
        while at < len(chunk):
            step = max(STEP, self.monitor.samples // LOOKS) if self._pictures else len(chunk)
            values = {axis: chunk.values[axis][at : at + step] for axis in self.monitor.axes}
            time = chunk.start + at / self.monitor.rate
            found += self.monitor.update(Chunk(values, first=chunk.first + at, segment=chunk.segment, start=time))
            if self._pictures:
                self._note(time, values)
            at += step
        self.events += found
        return found

    def finish(self) -> list[Event]:
        """Name the faults that are still open at the end."""
        found = self.monitor.finish()
        self.events += found
        return found

    def signal(self, axis: str) -> tuple[Vector, Matrix]:
        """Times (n,) of intervals (s), and the least and the greatest sample (n, 2) in each (SI).

        Parameters
        ----------
        axis : str
        """
        times, rows = self._signals[axis].found()
        return times, rows * np.array([-1.0, 1.0])

    def heights(self, axis: str) -> tuple[Vector, dict[str, Vector]]:
        """Times (n,) (s), and the height of the highest chart of each family, as a share of its threshold.

        Parameters
        ----------
        axis : str
        """
        times, rows = self._heights[axis].found()
        return times, {family: rows[:, k] for k, family in enumerate(FAMILIES)}

    def to_dict(self) -> dict[str, Any]:
        """Axes, length and events as numbers and strings."""
        return {
            "axes": list(self.monitor.axes),
            "rate": self.monitor.rate,
            "samples": self.monitor.samples,
            "every": self.monitor.every,
            "resting": self.monitor.resting,
            "events": [event.to_dict() for event in self.events],
        }

    def summary(self) -> str:
        """Describe what was monitored, and count the events, in one line."""
        one = self.monitor
        length = duration_text(one.samples / one.rate)
        found = counted(len(self.events), "event") if self.events else "no event"
        rest = "; the unit was moved and is not yet still" if one.resting else ""
        return f"{found} in {length} ({counted(one.samples, 'sample')}) of {', '.join(one.axes)}{rest}"

    def plot(self, *, path: str | os.PathLike[str] | None = None) -> MatplotlibFigure:
        """Draw the signals with the events, and the heights of the charts.

        Parameters
        ----------
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure

        Raises
        ------
        DataError
            If there are no samples.
        OptionError
            If the ending of `path` is unknown.
        """
        from gmwm.plots.monitor import plot_trace

        return plot_trace(self, path=path)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write a summary as one HTML page: verdict, events, picture.

        Parameters
        ----------
        path : path
            A file name that ends in .html; the file is written whole or not at all.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        OptionError
            If `path` does not end in .html.
        """
        from gmwm.reports.monitor import monitor_report

        return monitor_report(self, path)

    def _note(self, time: float, values: Mapping[str, Vector]) -> None:
        heights = self.monitor.heights()
        for axis, x in values.items():
            self._signals[axis].update(time, 1.0 / self.monitor.rate, np.stack([-x, x], axis=1))
            self._heights[axis].update(time, 0.0, np.array([[heights[axis][family] for family in FAMILIES]]))


class _Course:
    """Maxima of columns over intervals, whose length doubles when there are too many."""

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
            if not self._filled and len(self._times) >= MOST:
                self._times, self._width = self._times[::2], 2 * self._width
                self._rows = [np.maximum(a, b) for a, b in zip(self._rows[::2], self._rows[1::2], strict=True)]

    def found(self) -> tuple[Vector, Matrix]:
        """Times (n,), and maxima (n, m)."""
        return np.array(self._times), np.array(self._rows) if self._rows else np.zeros((0, 1))
