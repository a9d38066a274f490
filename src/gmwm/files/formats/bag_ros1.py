"""Read bags of ROS 1, format 2.0.

A file is a sequence of records. A record has a header with fields `name=value` and data, each preceded by its length.
Messages are inside chunks, which may be compressed. The index at the end lists topics and chunks. Source: ROS wiki,
"Bags/Format/2.0".
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from struct import Struct
from struct import error as StructError
from typing import BinaryIO

from gmwm.base.errors import ReadError
from gmwm.files.formats.bag_mcap import in_order
from gmwm.files.formats.bagfiles import (
    BATCH_BYTES,
    CHUNK_LIMIT,
    TEXT_LIMIT,
    TOPIC_LIMIT,
    Batch,
    Storage,
    Topic,
    merged,
    unpacked,
)

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _BAG, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_WORD, _LONG = Struct("<I"), Struct("<Q")
_PAIR = Struct("<II")
_CHUNKS = 10_000_000


class Ros1Storage(Storage):
    """One bag of ROS 1."""

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics, from the index at the end of the file."""
        with self.path.open("rb") as file:
            try:
                return self._index(file)[0]
            except (StructError, UnicodeDecodeError, KeyError, OSError) as error:
                raise self._damaged(error) from error

    def batches(self, topic: Topic) -> Iterator[Batch]:
        """Yield the messages of a topic, chunk by chunk; within a chunk they are sorted by the time of recording."""
        ids = frozenset(topic.ids)
        times: list[int] = []
        messages: list[bytes] = []
        size = 0
        with self.path.open("rb") as file:
            try:
                for position, counts in self._index(file)[1]:
                    if ids.isdisjoint(counts):
                        continue
                    self._seek(file, position)
                    records = self._chunk(file)
                    _collect(records, ids, times, messages)
                    size += len(records)
                    if size > BATCH_BYTES and messages:
                        yield in_order(times, messages)
                        times, messages, size = [], [], 0
            except (StructError, UnicodeDecodeError, KeyError, OSError) as error:
                raise self._damaged(error) from error
        if messages:
            yield in_order(times, messages)

    def _index(self, file: BinaryIO) -> tuple[tuple[Topic, ...], list[tuple[int, dict[int, int]]]]:
        """Read from the index the topics, and for each chunk its position and the number of messages of each
        connection."""
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
        if connections > TOPIC_LIMIT or chunks > _CHUNKS:
            raise ReadError(
                f"{self.path} is damaged: {connections} connections in {chunks} chunks",
                code="index-damaged",
                advice="Copy the file again.",
            )
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
        return merged(_topic(info, data, counts) for info, data in records), sorted(places, key=lambda place: place[0])

    def _seek(self, file: BinaryIO, position: int) -> None:
        """Go to a position from the index, after a check that it is inside the file."""
        if position > self.path.stat().st_size:
            raise ReadError(
                f"{self.path} is damaged or truncated: its index points behind its end",
                code="index-damaged",
                advice="Copy the file again.",
            )
        file.seek(position)

    def _chunk(self, file: BinaryIO) -> bytes:
        """Read a chunk and return its decompressed records."""
        head, data = self._record(file, _CHUNK)
        return unpacked(data, head["compression"].decode(), _WORD.unpack(head["size"])[0], self.path)

    def _record(self, file: BinaryIO, kind: int) -> tuple[dict[str, bytes], bytes]:
        """Read a record of one kind; return its header and its data."""
        parts = []
        for limit in (TEXT_LIMIT, CHUNK_LIMIT if kind == _CHUNK else 4 * TEXT_LIMIT):
            (length,) = _WORD.unpack(file.read(4))
            if length > limit:
                raise ReadError(
                    f"{self.path} is damaged: a record of {length} bytes",
                    code="record-damaged",
                    advice="Copy the file again.",
                )
            part = file.read(length)
            if len(part) != length:
                raise ReadError(
                    f"{self.path} is truncated: a record of {length} bytes where {len(part)} are left",
                    code="cut-off",
                    advice="Copy the file again.",
                )
            parts.append(part)
        header = dict(_fields(parts[0]))
        if header.get("op") != bytes([kind]):
            raise ReadError(
                f"{self.path} is damaged: its index does not lead to a record of kind {kind}",
                code="index-damaged",
                advice="Copy the file again.",
            )
        return header, parts[1]

    def _damaged(self, error: Exception) -> ReadError:
        return ReadError(
            f"{self.path} is damaged or truncated ({error})", code="damaged", advice="Copy the file again."
        )


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
        name=info["topic"].decode(),
        type=kind,
        encoding="ros1",
        text=text,
        language="ros1msg",
        ids=(number,),
        count=counts.get(number, 0),
    )


def _collect(records: bytes, ids: Set[int], times: list[int], messages: list[bytes]) -> None:
    """Append the messages of the connections `ids` in a chunk to `times` and `messages`. The layout found in one header
    is reused for the next headers until it no longer fits."""
    position, end = 0, len(records)
    shape = _Shape(b"")
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
            shape = _Shape(header)
        connection, seconds, rest = shape.values(header)
        if connection in ids:
            times.append(seconds * 1_000_000_000 + rest)
            messages.append(records[position - size : position])


class _Shape:
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
        seconds, rest = _PAIR.unpack_from(header, self.time)
        return connection, seconds, rest
