"""Read the messages in PX4's flight logs (.ulg), block by block.

Source: PX4 guide, "ULog file format". The tests compare the result with pyulog.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadCode, ReadError

SIGNATURE = b"ULog\x01\x12\x35"
_HEADER = 16
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
        tail, begin = b"", _HEADER
        with self.path.open("rb") as file:
            if len(file.read(_HEADER)) < _HEADER:
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
