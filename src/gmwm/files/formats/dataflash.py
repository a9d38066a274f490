"""Read ArduPilot's logs (.bin). Each instance (sensor) of the messages IMU, ACC and GYR is a recording.

A message begins with two bytes and its type; FMT messages define the length and the fields of each type. A log has no
end mark, so an incomplete message at the end is ignored. Bytes that are not part of a message are skipped, and the
samples that are missing there show as gaps in the time stamps.

Sources: ArduPilot, libraries/AP_Logger/LogStructure.h and AP_InertialSensor/LogStructure.h.
"""

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
from gmwm.files.contract import Channel, Layout, Reader, Rows, register

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
STAMPS = {"SampleUS": "us", "TimeUS": "us", "TimeMS": "ms"}
"""Names of the time stamps, and their units."""
ADVICE = "Log them: set bit 7 (IMU) of the parameter LOG_BITMASK, or INS_RAW_LOG_OPT for raw samples."


@dataclass(frozen=True)
class _DataflashMessage:
    """A type of message: its number, its length in the file (bytes), its name, and the type of its fields."""

    number: int
    length: int
    name: str
    fields: np.dtype[Any]


@dataclass(frozen=True)
class _LogFields:
    """The messages of a recording: their type, the number of the sensor (-1 for none), and the fields to read."""

    message: _DataflashMessage
    instance: int
    names: tuple[str, ...]


@dataclass
class _LogSummary:
    """Types, counts and times of the inertial messages of a log, and the number of damaged places."""

    types: dict[int, _DataflashMessage] = field(default_factory=dict)
    counts: dict[tuple[int, int], int] = field(default_factory=dict)
    edges: dict[tuple[int, int], tuple[int, int]] = field(default_factory=dict)
    warm: set[tuple[int, int]] = field(default_factory=set)
    damaged: int = 0


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
            _count(summary, message, table)
        remarks = (Remark.of("log-dropouts", case="dropouts", count=summary.damaged),) if summary.damaged else ()
        layouts = [_layout(summary, key, remarks) for key in sorted(summary.counts)]
        if not layouts:
            raise ReadError(
                f"{path} holds none of the messages IMU, ACC and GYR", code="no-inertial-data", advice=ADVICE
            )
        return tuple(layouts)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers, one chunk for each block of the file."""
        selection: _LogFields = layout.state
        for message, table in _messages(path, _LogSummary(), only=selection.message.name):
            rows = table if selection.instance < 0 else table[table["I"] == selection.instance]
            if message.number == selection.message.number and rows.size:
                yield {k: _numbers(rows[selection.names[k]]) for k in wanted}


def _layout(found: _LogSummary, key: tuple[int, int], remarks: tuple[Remark, ...]) -> Layout:
    message, instance = found.types[key[0]], key[1]
    names = message.fields.names or ()
    stamp = next(name for name in STAMPS if name in names)
    channels = [Channel(stamp, STAMPS[stamp], "time")]
    for name in names:
        axis, unit = ROLES.get(name, ("", ""))
        if axis and (axis != "temperature" or key in found.warm):
            channels.append(Channel(name, unit, axis))
    first, last = found.edges[key]
    seconds = (last - first) / (1e3 if stamp == "TimeMS" else 1e6)
    return Layout(
        tuple(channels), topic=message.name if instance < 0 else f"{message.name}_{instance}",
        state=_LogFields(message, instance, tuple(channel.name for channel in channels)),
        extent=(found.counts[key], seconds), remarks=remarks, preferred=message.name == "IMU" and instance <= 0,
    )  # fmt: skip


def _numbers(column: NDArray[Any]) -> NDArray[Any]:
    return np.ascontiguousarray(column, dtype=np.int64 if column.dtype.kind in "iu" else np.float64)


def _count(found: _LogSummary, message: _DataflashMessage, table: NDArray[Any]) -> None:
    """Add the messages of a block to the summary."""
    stamp = next(name for name in STAMPS if name in (message.fields.names or ()))
    instances = np.unique(table["I"]).tolist() if "I" in (message.fields.names or ()) else [-1]
    for instance in instances:
        rows = table if instance < 0 else table[table["I"] == instance]
        key = (message.number, int(instance))
        times = rows[stamp]
        first, _ = found.edges.get(key, (int(times[0]), 0))
        found.edges[key] = first, int(times[-1])
        found.counts[key] = found.counts.get(key, 0) + rows.size
        if "T" in (message.fields.names or ()) and np.any(rows["T"]):
            found.warm.add(key)


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
