"""Read PX4's flight logs (.ulg) in blocks; each gyroscope and accelerometer is a recording (tested against pyulog).

Sources: PX4 guide, "ULog file format"; PX4-Autopilot, msg/SensorCombined.msg, SensorGyro.msg, SensorAccel.msg."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadCode, ReadError
from gmwm.base.remarks import Remark
from gmwm.files.contract import Channel, Layout, Reader, Rows, register

SIGNATURE = b"ULog\x01\x12\x35"
_BLOCK = 4 << 20
_FORMAT, _FLAGS, _ADD, _DATA, _DROPOUT = b"FBADO"
_OTHER = frozenset(b"IMPQLCSR")
_MOST_FIELDS = 2000
"""Largest number of fields of a message: sensors have about ten; deeply nested types could exhaust the memory."""
_DEEPEST = 50  # largest depth of nested types
_TYPES = {
    "int8_t": "i1", "uint8_t": "u1", "int16_t": "i2", "uint16_t": "u2", "int32_t": "i4", "uint32_t": "u4",
    "int64_t": "i8", "uint64_t": "u8", "float": "f4", "double": "f8", "bool": "i1", "char": "u1",
}  # fmt: skip

Table = NDArray[Any]


@dataclass(frozen=True)
class UlogMessage:
    """One instance of a logged message."""

    name: str  # name of the message, such as "sensor_gyro"
    instance: int  # number of the sensor, from 0
    fields: np.dtype[Any]  # fields without the padding at the end
    largest: int  # size (bytes) with the padding

    @property
    def topic(self) -> str:
        """Name and instance of the message, such as "sensor_gyro_0"."""
        return f"{self.name}_{self.instance}"


@dataclass
class Log:
    """The messages of a log, as far as they are read."""

    path: Path  # the file
    # logged messages by their identifiers; None for messages that are not wanted
    messages: dict[int, UlogMessage | None] = field(default_factory=dict)
    dropouts: int = 0  # number of places where the logger lost data
    _formats: dict[str, list[tuple[str, int, str]]] = field(default_factory=dict)
    _bounds: list[int] = field(default_factory=list)

    def tables(self, names: tuple[str, ...]) -> Iterator[tuple[UlogMessage, Table]]:
        """Read the file, and yield the messages with the wanted names as tables, one for each message and block."""
        tail, begin = b"", 16  # bytes of the header
        with self.path.open("rb") as file:
            if len(file.read(begin)) < begin:
                raise self._damage("it is too short for a log")
            while data := file.read(_BLOCK):
                block = tail + data
                places, used = self._walk(block, begin, names)
                for number, starts in places.items():
                    message = self.messages[number]
                    assert message is not None
                    yield message, self._table(block, message, np.array(starts))
                tail, begin = block[used:], begin + used
        if tail:
            raise ReadError(
                f"{self.path} ends within a message", code="cut-off",
                advice="Copy it again. If the autopilot lost its power, install pyulog and save the complete messages "
                "with `pyulog.ULog('{name}').write_ulog('complete.ulg')`.", name=str(self.path),
            )  # fmt: skip

    def _walk(self, block: bytes, begin: int, names: tuple[str, ...]) -> tuple[dict[int, list[int]], int]:
        """Return the positions of the wanted messages in a block at byte `begin`, and the number of bytes used."""
        places: dict[int, list[int]] = {}
        at, end = 0, len(block)
        while at + 3 <= end:
            size, kind = block[at] | block[at + 1] << 8, block[at + 2]
            last = at + 3 + size
            if self._bounds and begin + last > self._bounds[0]:
                # After a crash, data are appended at this place, and the message before it is not complete.
                if begin + end < self._bounds[0]:
                    break
                bound = self._bounds.pop(0) - begin
                if bound < at:  # the same messages would be read again and again
                    raise self._damage("appended data begin before the messages in front of them")
                at = bound
                continue
            if last > end:
                break
            if kind == _DATA:
                number = block[at + 3] | block[at + 4] << 8 if size >= 2 else -1
                if number not in self.messages:
                    raise self._damage(f"there is no subscription for message {number}")
                if self.messages[number] is not None:
                    places.setdefault(number, []).append(at)
            elif kind == _DROPOUT:
                self.dropouts += 1
            elif kind not in _OTHER:
                self._define(kind, block[at + 3 : last], names)
            at = last
        return places, at

    def _define(self, kind: int, body: bytes, names: tuple[str, ...]) -> None:
        """Read a message that defines other messages, or that holds the flags of the log."""
        try:
            if kind == _FORMAT:
                name, _, fields = body.decode().partition(":")
                self._formats[name] = [_field(entry) for entry in fields.split(";") if entry]
            elif kind == _FLAGS:
                if any(body[8:16][1:]) or body[8] & ~1:
                    raise self._damage("an incompatible flag is set, so that it cannot be read")
                self._bounds = [offset for offset in struct.unpack_from("<3Q", body, 16) if offset]
            elif kind == _ADD:
                instance, number, name = body[0], body[1] | body[2] << 8, body[3:].decode()
                self.messages[number] = self._message(name, instance) if name in names else None
            # Largest size (bytes) of a message of an unknown kind; a larger one is taken for damage, as in pyulog
            elif not kind or not 0 < len(body) <= 10_000:
                raise self._damage("a message is invalid")
        except ReadError:
            raise
        except (ValueError, IndexError, KeyError, struct.error) as error:
            raise self._damage(f"a message of the kind {chr(kind)!r} is invalid: {error}") from error

    def _message(self, name: str, instance: int) -> UlogMessage:
        fields = list(self._flat(name, "", (), [_MOST_FIELDS]))
        sizes = np.dtype([(label, f"<{kind}") for label, kind in fields]).itemsize
        while fields and fields[-1][0].startswith("_padding"):
            fields.pop()
        return UlogMessage(name, instance, np.dtype([(label, f"<{kind}") for label, kind in fields]), sizes)

    def _flat(self, name: str, prefix: str, above: tuple[str, ...], budget: list[int]) -> Iterator[tuple[str, str]]:
        """Yield name and type of each field of a message, also of nested types, for at most `budget[0]` fields."""
        if name in above:
            raise self._damage(f"the type {name!r} contains itself", code="type-recursive")
        if len(above) > _DEEPEST:
            raise self._damage(f"its types are nested more than {_DEEPEST} times")
        for kind, count, label in self._formats[name]:
            for k in range(max(count, 1)):
                path = f"{prefix}{label}[{k}]" if count else f"{prefix}{label}"
                budget[0] -= 1
                if budget[0] < 0:
                    raise self._damage(f"a message has more than {_MOST_FIELDS} fields", code="too-many")
                if kind in _TYPES:
                    yield path, _TYPES[kind]
                else:
                    yield from self._flat(kind, f"{path}.", (*above, name), budget)

    def _table(self, block: bytes, message: UlogMessage, starts: NDArray[np.int64]) -> Table:
        """Return the messages that begin at the positions `starts` of a block, as a table."""
        raw = np.frombuffer(block, dtype=np.uint8)
        sizes = raw[starts].astype(np.int64) + (raw[starts + 1].astype(np.int64) << 8) - 2
        if np.any((sizes < message.fields.itemsize) | (sizes > message.largest)):
            raise self._damage(f"a message {message.topic} has the wrong size")
        rows = starts[:, None] + np.arange(5, 5 + message.fields.itemsize)
        return np.ascontiguousarray(raw[rows]).view(message.fields)[:, 0]

    def _damage(self, reason: str, code: ReadCode = "damaged") -> ReadError:
        return ReadError(f"{self.path} is damaged: {reason}", code=code, advice="Copy the file again.")


def _field(text: str) -> tuple[str, int, str]:
    """Return type, length (0 if it is not an array) and name of a field, such as `float[3] gyro_rad`."""
    kind, label = text.split(" ")
    kind, _, count = kind.partition("[")
    return kind, int(count.rstrip("]")) if count else 0, label


def column(table: Table, name: str) -> NDArray[Any]:
    """Return a field of a table: integers of 64 bits, or floating point numbers."""
    values = table[name]
    return np.ascontiguousarray(values, dtype=np.int64 if values.dtype.kind in "iu" else np.float64)


_AXES = ("x", "y", "z")
_GYRO = {"x": "gyro_x", "y": "gyro_y", "z": "gyro_z", "temperature": "temperature"}
_ACCEL = {"x": "accel_x", "y": "accel_y", "z": "accel_z", "temperature": "temperature"}
_COMBINED = {f"gyro_rad[{k}]": f"gyro_{axis}" for k, axis in enumerate(_AXES)} | {
    f"accelerometer_m_s2[{k}]": f"accel_{axis}" for k, axis in enumerate(_AXES)
}
_MESSAGES = {"sensor_combined": _COMBINED, "sensor_gyro": _GYRO, "sensor_accel": _ACCEL}
_SELECTION = "sensor_selection"
_STAMPS = ("timestamp_sample", "timestamp")  # µs; the time of the sample is preferred to the time of its publication
_UNITS = {"gyro": "rad/s", "accel": "m/s²", "temperature": "°C"}
_MOST_TEMPERATURES = 1 << 18
"""Largest number of temperatures of a sensor that are kept. If there are more, every second one is dropped."""


@dataclass
class _SensorSummary:
    """Result of the first pass over the messages of one sensor."""

    count: int = 0  # number of messages
    edges: dict[str, tuple[int, int]] = field(default_factory=dict)  # first and last time (µs) of each kind of stamp
    stamped: set[str] = field(default_factory=set)  # the kinds of stamps that are not always 0
    # Whether the sensor has a temperature. Simulated sensors have a temperature of 0, which does not count
    warm: bool = False
    device: int = 1  # identity of the sensor
    _stamps: list[Vector] = field(default_factory=list)
    _values: list[Vector] = field(default_factory=list)

    def add(self, table: Table) -> None:
        """Add the messages of a block."""
        names = table.dtype.names or ()
        if not self.count and "device_id" in names:
            self.device = int(table["device_id"][0])
        self.count += table.size
        for name in set(_STAMPS) & set(names):
            temperatures = column(table, name)
            self.edges[name] = self.edges.get(name, (int(temperatures[0]), 0))[0], int(temperatures[-1])
            if np.any(temperatures):
                self.stamped.add(name)
        if "temperature" in names and "timestamp" in names:
            values = column(table, "temperature")
            finite = np.isfinite(values)
            self.warm |= bool(np.any(values[finite]))
            self._stamps.append(table["timestamp"][finite].astype(np.float64))
            self._values.append(values[finite])
            while sum(batch.size for batch in self._values) > _MOST_TEMPERATURES:
                self._stamps = [np.concatenate(self._stamps)[::2]]
                self._values = [np.concatenate(self._values)[::2]]

    def temperatures(self) -> tuple[Vector, Vector]:
        """Return times (µs) and temperatures (°C)."""
        return np.concatenate(self._stamps), np.concatenate(self._values)


@dataclass(frozen=True, eq=False)
class _UlogFields:
    """The message and the fields from which the columns of a recording are read."""

    message: UlogMessage  # the message to read
    names: tuple[str, ...]  # Field of each column. A temperature column from another message has no field
    # temperatures of another message, which are interpolated linearly
    temperatures: tuple[Vector, Vector] | None = None


@register
class UlogReader(Reader):
    """Reader of PX4 ULog files."""

    name: ClassVar[str] = "ulog"
    extensions: ClassVar[tuple[str, ...]] = (".ulg", ".ulog")
    signatures: ClassVar[tuple[bytes, ...]] = (SIGNATURE,)

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each instance of sensor_combined (preferred), sensor_gyro and sensor_accel. The
        temperature of sensor_combined comes from the slower message sensor_gyro."""
        log, summaries, selected = Log(path), dict[UlogMessage, _SensorSummary](), 0
        for message, table in log.tables((*_MESSAGES, _SELECTION)):
            if message.name != _SELECTION:
                summaries.setdefault(message, _SensorSummary()).add(table)
            elif "gyro_device_id" in (table.dtype.names or ()):
                selected = int(table["gyro_device_id"][-1])
        dropouts = (Remark.of("log-dropouts", case="dropouts", count=log.dropouts),) if log.dropouts else ()
        ordered = sorted(summaries, key=lambda message: (message.name, message.instance))
        layouts = [layout for message in ordered if (layout := _layout(message, summaries[message])) is not None]
        if not layouts:
            raise ReadError(
                f"{path} holds none of the messages {', '.join(_MESSAGES)}",
                code="no-inertial-data",
                advice="Log them with the parameter SDLOG_PROFILE.",
            )
        out = []
        for layout in layouts:
            combined = layout.topic == "sensor_combined_0"
            complete = _with_temperature(layout, summaries, selected) if combined else layout
            out.append(replace(complete, preferred=combined, remarks=(*complete.remarks, *dropouts)))
        return tuple(out)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers, one chunk for each block of the file."""
        selection: _UlogFields = layout.state
        for message, table in Log(path).tables((selection.message.name,)):
            if message == selection.message:
                yield {k: _column(table, selection, k) for k in wanted}


def _column(table: Table, selection: _UlogFields, k: int) -> Vector:
    if k < len(selection.names):
        return column(table, selection.names[k])
    assert selection.temperatures is not None
    return np.interp(column(table, selection.names[0]).astype(np.float64), *selection.temperatures)


def _layout(message: UlogMessage, found: _SensorSummary) -> Layout | None:
    """Return the columns of one message, with its temperature if there is one; None if an axis is missing."""
    axes, fields = _MESSAGES[message.name], message.fields.names or ()
    stamp = next((name for name in _STAMPS if name in found.stamped), None)
    names = [name for name in axes if name in fields and (axes[name] != "temperature" or found.warm)]
    if stamp is None or not {name for name in axes if axes[name] != "temperature"} <= set(names):
        return None
    channels = [Channel(stamp, "us", "time")]
    channels += [Channel(name, _UNITS[axes[name].split("_")[0]], axes[name]) for name in names]
    first, last = found.edges[stamp]
    return Layout(
        tuple(channels), topic=message.topic, state=_UlogFields(message, (stamp, *names)),
        extent=(found.count, (last - first) / 1e6),
    )  # fmt: skip


def _with_temperature(layout: Layout, found: Mapping[UlogMessage, _SensorSummary], selected: int) -> Layout:
    """Add the temperature of the selected gyroscope, or of another sensor, to the layout of sensor_combined."""
    sensors = [message for message, summary in found.items() if summary.warm]
    sensors.sort(key=lambda one: (found[one].device != selected, one.name != "sensor_gyro", one.name, one.instance))
    if not sensors:
        return layout
    return replace(
        layout,
        channels=(*layout.channels, Channel("temperature", "°C", "temperature")),
        state=replace(layout.state, temperatures=found[sensors[0]].temperatures()),
        remarks=(*layout.remarks, Remark.of("file-content", case="temperature", topic=sensors[0].topic)),
    )
