"""Read bags of ROS 1, format 2.0: records of a header with fields `name=value` and of data, each after its length.

Messages are in chunks, maybe compressed; an index lists topics and chunks. Source: ROS wiki, "Bags/Format/2.0"."""

from __future__ import annotations

from collections.abc import Iterator, Set
from struct import Struct
from struct import error as StructError
from typing import BinaryIO

from gmwm.base.errors import ReadError
from gmwm.files.contract import damage_error
from gmwm.files.formats.bagfiles import (
    CHUNK_LIMIT,
    TEXT_LIMIT,
    TOPIC_LIMIT,
    ChunkedStorage,
    Topic,
    decompress,
    merge_topics,
)

MAGIC = b"#ROSBAG V2.0\n"

_BAG, _CHUNK, _CHUNK_INFO, _CONNECTION = 3, 5, 6, 7
_WORD, _LONG = Struct("<I"), Struct("<Q")
_PAIR = Struct("<II")


class Ros1Storage(ChunkedStorage):
    """One bag of ROS 1."""

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics, from the index at the end of the file."""
        with self.open_records() as file:
            return self._index(file)[0]

    def gather(self, file: BinaryIO, ids: Set[int], times: list[int], messages: list[bytes]) -> Iterator[int]:
        """Append the messages of each chunk that has some of the topic, according to the index."""
        for position, counts in self._index(file)[1]:
            if not ids.isdisjoint(counts):
                self._seek(file, position)
                head, data = self._record(file, _CHUNK)
                size = _WORD.unpack(head["size"])[0]
                _collect(decompress(data, head["compression"].decode(), size, self.path), ids, times, messages)
                yield size

    def _index(self, file: BinaryIO) -> tuple[tuple[Topic, ...], list[tuple[int, dict[int, int]]]]:
        """Read the topics from the index, and the position and the messages per connection of each chunk."""
        file.seek(len(MAGIC))
        head, _ = self._record(file, _BAG)
        position = _LONG.unpack(head["index_pos"])[0]
        if not position:
            raise ReadError(
                f"{self.path} has no index: the recorder was killed or is still running",
                code="no-index",
                advice="Repair it with `rosbag reindex`.",
            )
        if head.get("encryptor"):
            raise ReadError(
                f"{self.path} is encrypted; decrypt it first",
                code="encrypted",
                advice="Decrypt it with `rosbag decrypt`.",
            )
        connections, chunks = (_WORD.unpack(head[name])[0] for name in ("conn_count", "chunk_count"))
        if connections > TOPIC_LIMIT or chunks > 10_000_000:
            raise damage_error(f"{self.path} is damaged: {connections} connections in {chunks} chunks", "index-damaged")
        self._seek(file, position)
        records = [self._record(file, _CONNECTION) for _ in range(connections)]
        places = []
        counts: dict[int, int] = {}
        for _ in range(chunks):
            info, data = self._record(file, _CHUNK_INFO)
            held = dict(_PAIR.iter_unpack(data))
            places.append((_LONG.unpack(info["chunk_pos"])[0], held))
            for number, count in held.items():
                counts[number] = counts.get(number, 0) + count
        return merge_topics(_topic(info, data, counts) for info, data in records), sorted(
            places, key=lambda place: place[0]
        )

    def _seek(self, file: BinaryIO, position: int) -> None:
        """Go to a position from the index, after a check that it is inside the file."""
        if position > self.path.stat().st_size:
            raise damage_error(f"{self.path} is damaged or truncated: its index points behind its end", "index-damaged")
        file.seek(position)

    def _record(self, file: BinaryIO, kind: int) -> tuple[dict[str, bytes], bytes]:
        """Read a record of one kind; return its header and its data."""
        parts = []
        for limit in (TEXT_LIMIT, CHUNK_LIMIT if kind == _CHUNK else 4 * TEXT_LIMIT):
            (length,) = _WORD.unpack(file.read(4))
            if length > limit:
                raise damage_error(f"{self.path} is damaged: a record of {length} bytes", "record-damaged")
            part = file.read(length)
            if len(part) != length:
                raise damage_error(
                    f"{self.path} is truncated: a record of {length} bytes where {len(part)} are left", "cut-off"
                )
            parts.append(part)
        header = dict(_fields(parts[0]))
        if header.get("op") != bytes([kind]):
            raise damage_error(
                f"{self.path} is damaged: its index does not lead to a record of kind {kind}", "index-damaged"
            )
        return header, parts[1]


def _fields(header: bytes) -> Iterator[tuple[str, bytes]]:
    """Yield the name and the value of each field of a record header."""
    position = 0
    while position < len(header):
        (length,) = _WORD.unpack_from(header, position)
        position += 4
        name, sign, value = header[position : position + length].partition(b"=")
        if not sign or position + length > len(header):
            raise StructError("a header is not a row of fields")
        yield name.decode(), value
        position += length


def _topic(info: dict[str, bytes], data: bytes, counts: dict[int, int]) -> Topic:
    """Make a topic from its connection record, with the ROS 2 name of its type."""
    (number,) = _WORD.unpack(info["conn"])
    fields = dict(_fields(data))
    package, _, name = fields["type"].decode().partition("/")
    kind = f"{package}/{name}" if name.startswith("msg/") else f"{package}/msg/{name}"
    text = fields["message_definition"].decode("utf-8", "replace")
    return Topic(
        name=info["topic"].decode(), type=kind, encoding="ros1", text=text, language="ros1msg", ids=(number,),
        count=counts.get(number, 0),
    )  # fmt: skip


def _collect(records: bytes, ids: Set[int], times: list[int], messages: list[bytes]) -> None:
    """Append the messages. The layout of one header is reused for the next headers until it no longer fits."""
    position, end = 0, len(records)
    shape = _HeaderShape(b"")
    while position < end:
        (length,) = _WORD.unpack_from(records, position)
        header = records[position + 4 : position + 4 + length]
        position += 4 + length
        (size,) = _WORD.unpack_from(records, position)
        position += 4 + size
        if position > end:
            raise StructError(f"the last record leaves its chunk by {position - end} bytes")
        if not shape.fits(header):
            if header.find(b"op=\x02") < 0:
                continue
            shape = _HeaderShape(header)
        connection, seconds, nanoseconds = shape.values(header)
        if connection in ids:
            times.append(seconds * 1_000_000_000 + nanoseconds)
            messages.append(records[position - size : position])


class _HeaderShape:
    """Layout of a message header: the positions of its values, and the constant bytes around them."""

    def __init__(self, header: bytes) -> None:
        self.length = len(header)
        self.conn = header.find(b"conn=") + 5
        self.time = header.find(b"time=") + 5
        if header and (dict(_fields(header)).keys() != {"op", "conn", "time"} or self.length != 4 * 3 + 4 + 9 + 13):
            raise StructError("the header of a message has other fields than op, conn and time")
        self.cuts = sorted((self.conn, self.time))
        self.frame = self._frame(header)

    def _frame(self, header: bytes) -> tuple[bytes, bytes, bytes]:
        first, second = self.cuts
        width, other = (4, 8) if first == self.conn else (8, 4)
        return header[:first], header[first + width : second], header[second + other :]

    def fits(self, header: bytes) -> bool:
        return len(header) == self.length > 0 and self._frame(header) == self.frame

    def values(self, header: bytes) -> tuple[int, int, int]:
        (connection,) = _WORD.unpack_from(header, self.conn)
        seconds, nanoseconds = _PAIR.unpack_from(header, self.time)
        return connection, seconds, nanoseconds
