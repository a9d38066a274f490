"""Read ArduPilot's logs (.bin, or text .log). Each instance (sensor) of IMU, ACC and GYR is a recording.

FMT messages define types. Incomplete messages are skipped, and show as gaps. Sources: ArduPilot,
libraries/AP_Logger/LogStructure.h and AP_InertialSensor/LogStructure.h."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.files.contract import CHUNK_ROWS, Channel, Layout, Reader, Rows, register

_MARK = b"\xa3\x95"
_FMT = 128
_FMT_BODY = struct.Struct("<BB4s16s64s")
_FMT_LENGTH = 3 + _FMT_BODY.size
_BLOCK = 8 << 20  # bytes

_TYPES: Mapping[str, str] = {
    "b": "i1", "B": "u1", "h": "i2", "H": "u2", "i": "i4", "I": "u4", "f": "f4", "d": "f8", "n": "S4",
    "N": "S16", "Z": "S64", "c": "i2", "C": "u2", "e": "i4", "E": "u4", "L": "i4", "M": "u1", "q": "i8", "Q": "u8",
}  # fmt: skip
"""NumPy type for each character of a format string. The scaled types (c, C, e, E) do not occur in inertial messages."""

ROLES: Mapping[str, tuple[str, str]] = {
    **{f"Gyr{axis}": (f"gyro_{axis.lower()}", "rad/s") for axis in "XYZ"},
    **{f"Acc{axis}": (f"accel_{axis.lower()}", "m/s²") for axis in "XYZ"},
    "T": ("temperature", "°C"),
}
STAMPS = {"SampleUS": "us", "TimeUS": "us", "TimeMS": "ms"}  # names of the time stamps, and their units
ADVICE = "Log them: set bit 7 (IMU) of the parameter LOG_BITMASK, or INS_RAW_LOG_OPT for raw samples."


@dataclass(frozen=True)
class _DataflashMessage:
    """A type of message: its number, its length in the file (bytes), its name, and the type of its fields."""

    number: int
    length: int
    name: str
    fields: np.dtype[Any]


@dataclass
class _LogRecording:
    """A recording in a log: message, instance (-1: none), names, binary number, count, times, any temperature but 0."""

    name: str
    instance: int
    names: tuple[str, ...]
    number: int = 0
    count: int = 0
    first: int = 0
    last: int = 0
    warm: bool = False

    @property
    def stamp(self) -> str:
        """Name of the time stamps."""
        return next(name for name in STAMPS if name in self.names)

    def add(self, count: int, first: int, last: int, warm: bool) -> None:
        """Add messages with their first and last time."""
        self.first = self.first if self.count else first
        self.last, self.count = last, self.count + count
        self.warm |= warm

    def layout(self, remarks: tuple[Remark, ...]) -> Layout:
        """Return the time, the axes, and the temperature unless it is always zero."""
        roles = {name: ROLES[name] for name in self.names if name in ROLES and (name != "T" or self.warm)}
        return Layout(
            (
                Channel(self.stamp, STAMPS[self.stamp], "time"),
                *(Channel(name, unit, axis) for name, (axis, unit) in roles.items()),
            ),
            topic=self.name if self.instance < 0 else f"{self.name}_{self.instance}", state=self,
            extent=(self.count, (self.last - self.first) / (1e3 if self.stamp == "TimeMS" else 1e6)), remarks=remarks,
            preferred=self.name == "IMU" and self.instance <= 0,
        )  # fmt: skip


@dataclass
class _LogSummary:
    """Types and recordings of the inertial messages of a log, and the number of damaged places."""

    types: dict[int, _DataflashMessage] = field(default_factory=dict)
    recordings: dict[tuple[int, int], _LogRecording] = field(default_factory=dict)
    damaged: int = 0


def _layouts(recordings: Mapping[Any, _LogRecording], damaged: int, path: Path) -> tuple[Layout, ...]:
    """Return the layout of each recording of a log, in the order of the keys."""
    if not recordings:
        raise ReadError(f"{path} holds none of the messages IMU, ACC and GYR", code="no-inertial-data", advice=ADVICE)
    remarks = (Remark.of("log-dropouts", case="dropouts", count=damaged),) if damaged else ()
    return tuple(recordings[key].layout(remarks) for key in sorted(recordings))


@register
class DataflashReader(Reader):
    """Reader of ArduPilot's DataFlash logs."""

    name: ClassVar[str] = "ardupilot"
    extensions: ClassVar[tuple[str, ...]] = (".bin",)
    signatures: ClassVar[tuple[bytes, ...]] = (_MARK + bytes([_FMT]),)

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each sensor: IMU_0 (preferred), IMU_1 …; GYR_0, ACC_0 … for raw samples."""
        summary = _LogSummary()
        for message, table in _messages(path, summary):
            names = message.fields.names or ()
            for instance in np.unique(table["I"]).tolist() if "I" in names else [-1]:
                rows = table if instance < 0 else table[table["I"] == instance]
                key = (message.number, int(instance))
                recording = summary.recordings.setdefault(
                    key, _LogRecording(message.name, int(instance), names, message.number)
                )
                times = rows[recording.stamp]
                recording.add(rows.size, int(times[0]), int(times[-1]), "T" in names and bool(np.any(rows["T"])))
        return _layouts(summary.recordings, summary.damaged, path)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers, one chunk for each block of the file."""
        recording: _LogRecording = layout.state
        for message, table in _messages(path, _LogSummary(), only=recording.name):
            rows = table if recording.instance < 0 else table[table["I"] == recording.instance]
            if message.number == recording.number and rows.size:
                yield {k: _numbers(rows[layout.channels[k].name]) for k in wanted}


def _numbers(column: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(column, dtype=np.int64 if column.dtype.kind in "iu" else np.float64)


def _messages(path: Path, found: _LogSummary, only: str = "") -> Iterator[tuple[_DataflashMessage, NDArray[Any]]]:
    """Yield the inertial messages as tables, one for each type and block; add types and damaged places to `found`."""
    lengths = [0] * 256
    lengths[_FMT] = _FMT_LENGTH
    tail = b""
    with path.open("rb") as file:
        while data := file.read(_BLOCK):
            block = tail + data
            places, used = _walk(block, lengths, found, only)
            tail = block[used:]
            for number, starts in places.items():
                message = found.types[number]
                body = np.frombuffer(block, dtype=np.uint8)
                rows = np.array(starts)[:, None] + np.arange(3, message.length)
                yield message, np.ascontiguousarray(body[rows]).view(message.fields)[:, 0]


def _walk(block: bytes, lengths: list[int], found: _LogSummary, only: str) -> tuple[dict[int, list[int]], int]:
    """Return the positions of the inertial messages in a block, by type, and the number of bytes that were used."""
    places: dict[int, list[int]] = {number: [] for number in found.types}
    position, end = 0, len(block)
    while position + 3 <= end:
        kind = block[position + 2]
        length = lengths[kind]
        if block[position] != 0xA3 or block[position + 1] != 0x95 or not length:
            following = block.find(_MARK, position + 1)
            found.damaged += 1
            position = following if following >= 0 else max(position + 1, end - 1)
            continue
        if position + length > end:
            break
        if kind in places:
            places[kind].append(position)
        elif kind == _FMT:
            number, size, name, fields, labels = _FMT_BODY.unpack_from(block, position + 3)
            lengths[number] = size if size > 3 else 0
            message = _inertial(number, size, name, fields=fields, labels=labels)
            if message is not None and only in ("", message.name):
                found.types[number] = message
                places.setdefault(number, [])
        position += length
    return {number: starts for number, starts in places.items() if starts}, position


def is_inertial(name: str, names: Sequence[str]) -> bool:
    """Return whether a message comes from an inertial sensor, by its name and the names of its values."""
    if name.rstrip("0123456789") not in ("IMU", "ACC", "GYR") or not set(STAMPS) & set(names):
        return False
    axes = {ROLES[label][0] for label in names if label in ROLES} - {"temperature"}
    return len(set(names)) == len(names) and len(axes) in (3, 6)


def _inertial(number: int, size: int, name: bytes, *, fields: bytes, labels: bytes) -> _DataflashMessage | None:
    """Return the message type that an FMT message defines if it belongs to an inertial sensor; otherwise None."""
    title = name.rstrip(b"\0").decode("latin-1")
    names = labels.rstrip(b"\0").decode("latin-1").split(",")
    kinds = [_TYPES.get(character) for character in fields.rstrip(b"\0").decode("latin-1")]
    if not is_inertial(title, names) or len(names) != len(kinds) or not all(kinds):
        return None
    dtype = np.dtype([(label, f"<{kind}") for label, kind in zip(names, kinds, strict=True)])
    return _DataflashMessage(number, size, title, dtype) if dtype.itemsize == size - 3 else None


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
            time = int(values[names.index(recording.stamp)])
            recording.add(1, time, time, "T" in names and values[names.index("T")] != 0)
        return _layouts(recordings, log.damaged, path)

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
                yield _text_numbers(rows, layout, wanted)
                rows = []
        if rows:
            yield _text_numbers(rows, layout, wanted)


def _values(line: str) -> list[float]:
    """Return the values of a message; an empty list if one of them is not a number."""
    try:
        return [float(value) for value in line.split(",")[1:]]
    except ValueError:
        return []


def _text_numbers(rows: Sequence[Sequence[float]], layout: Layout, wanted: Sequence[int]) -> Rows:
    """Convert rows to columns: time stamps as integers, all others as float64."""
    columns = zip(wanted, zip(*rows, strict=True), strict=True)
    return {k: np.array(column, dtype=np.int64 if k == 0 else np.float64) for k, column in columns}
