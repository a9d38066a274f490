"""Read ArduPilot's logs in text form (.log), which Mission Planner writes. The recordings are as in the binary logs.

A line is a message: its name and its values, separated by commas. FMT lines define the names of the values. Lines with
the wrong number of values or with values that are not numbers, such as an incomplete last line, are skipped. The
samples that are missing there show as gaps in the time stamps. The messages are the same as in
`gmwm.files.formats.dataflash`: each instance (sensor) of IMU, ACC and GYR is a recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.files.contract import CHUNK_ROWS, Channel, Layout, Reader, Rows, register
from gmwm.files.formats.dataflash import ADVICE, ROLES, STAMPS, is_inertial


@dataclass
class _LogRecording:
    """A recording in the log: message, instance (-1 for none), names of values, count, times, any temperature but
    zero."""

    name: str
    instance: int
    names: tuple[str, ...]
    count: int = 0
    first: int = 0
    last: int = 0
    warm: bool = False


@dataclass
class _TextLog:
    """The names of the values of each inertial message in a log, and the number of damaged lines."""

    names: dict[str, tuple[str, ...]] = field(default_factory=dict)
    damaged: int = 0

    def messages(self, path: Path, only: str = "") -> Iterator[tuple[str, list[float]]]:
        """Yield the name and the values of each inertial message."""
        with path.open(encoding="utf-8", errors="replace") as file:
            for line in file:
                name = line.partition(",")[0].strip()
                if name == "FMT":
                    self._define(line)
                elif name in self.names and only in ("", name):
                    values = _values(line)
                    if len(values) == len(self.names[name]):
                        yield name, values
                    else:
                        self.damaged += 1

    def _define(self, line: str) -> None:
        parts = [part.strip() for part in line.split(",")]
        if len(parts) > 5 and is_inertial(parts[3], parts[5:]):
            self.names[parts[3]] = tuple(parts[5:])


@register
class DataflashTextReader(Reader):
    """Reader of ArduPilot's DataFlash logs in text form."""

    name: ClassVar[str] = "ardupilot text"
    extensions: ClassVar[tuple[str, ...]] = (".log",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 1 if the file begins with the line that defines FMT lines."""
        first = head.lstrip(b"\xef\xbb\xbf").split(b"\n", 1)[0]
        return 1.0 if [part.strip() for part in first.split(b",")[:4:3]] == [b"FMT", b"FMT"] else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each sensor, as for binary logs. IMU_0 is preferred."""
        log, recordings = _TextLog(), dict[tuple[str, int], _LogRecording]()
        for name, values in log.messages(path):
            names = log.names[name]
            instance = int(values[names.index("I")]) if "I" in names else -1
            recording = recordings.setdefault((name, instance), _LogRecording(name, instance, names))
            time = int(values[names.index(_stamp(names))])
            recording.first = recording.first if recording.count else time
            recording.last, recording.count = time, recording.count + 1
            recording.warm |= "T" in names and values[names.index("T")] != 0
        if not recordings:
            raise ReadError(
                f"{path} holds none of the messages IMU, ACC and GYR", code="no-inertial-data", advice=ADVICE
            )
        remarks = (Remark.of("log-dropouts", case="dropouts", count=log.damaged),) if log.damaged else ()
        return tuple(_layout(recordings[key], remarks) for key in sorted(recordings))

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers of the messages."""
        recording: _LogRecording = layout.state
        places = {k: recording.names.index(layout.channels[k].name) for k in wanted}
        instance = recording.names.index("I") if recording.instance >= 0 else -1
        rows: list[list[float]] = []
        for _, values in _TextLog().messages(path, recording.name):
            if instance >= 0 and values[instance] != recording.instance:
                continue
            rows.append([values[place] for place in places.values()])
            if len(rows) == CHUNK_ROWS:
                yield _numbers(rows, layout, wanted)
                rows = []
        if rows:
            yield _numbers(rows, layout, wanted)


def _values(line: str) -> list[float]:
    """Return the values of a message; an empty list if one of them is not a number."""
    try:
        return [float(value) for value in line.split(",")[1:]]
    except ValueError:
        return []


def _stamp(names: Sequence[str]) -> str:
    return next(name for name in STAMPS if name in names)


def _layout(found: _LogRecording, remarks: tuple[Remark, ...]) -> Layout:
    stamp = _stamp(found.names)
    channels = [Channel(stamp, STAMPS[stamp], "time")]
    for name in found.names:
        axis, unit = ROLES.get(name, ("", ""))
        if axis and (axis != "temperature" or found.warm):
            channels.append(Channel(name, unit, axis))
    return Layout(
        tuple(channels), topic=found.name if found.instance < 0 else f"{found.name}_{found.instance}", state=found,
        extent=(found.count, (found.last - found.first) / (1e3 if stamp == "TimeMS" else 1e6)), remarks=remarks,
        preferred=found.name == "IMU" and found.instance <= 0,
    )  # fmt: skip


def _numbers(rows: Sequence[Sequence[float]], layout: Layout, wanted: Sequence[int]) -> Rows:
    """Convert rows to columns: time stamps as integers, all others as float64."""
    columns = zip(wanted, zip(*rows, strict=True), strict=True)
    return {k: np.array(column, dtype=np.int64 if k == 0 else np.float64) for k, column in columns}
