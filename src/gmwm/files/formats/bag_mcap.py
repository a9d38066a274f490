"""Read MCAP files of ROS 2: records of kind (one byte), length (eight bytes) and content.

Messages are records in the file or in chunks, possibly compressed. Source: MCAP format specification, version 0
(mcap.dev/spec)."""

from __future__ import annotations

from collections.abc import Iterator, Set
from io import BytesIO
from struct import Struct
from struct import error as StructError
from typing import BinaryIO

from gmwm.base.errors import ReadError
from gmwm.files.contract import damage_error
from gmwm.files.formats.bagfiles import (
    CHUNK_LIMIT,
    TEXT_LIMIT,
    ChunkedStorage,
    Topic,
    decompress,
    merge_topics,
    require_checksum,
)

MAGIC = b"\x89MCAP0\r\n"

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _DATA_END = 2, 3, 4, 5, 6, 11, 15
_HEAD = Struct("<BQ")
# Head and fixed part of a message record, 31 bytes, with signed times, as all here; unsigned only after 2262.
_WHOLE = Struct("<BQHIqQ")
_FIXED = Struct("<HIqQ")
_CHUNK_HEAD = Struct("<QQQI")
_SHORT, _WORD, _LONG = Struct("<H"), Struct("<I"), Struct("<Q")
_LIMITS = {
    _SCHEMA: 2 * TEXT_LIMIT, _CHANNEL: TEXT_LIMIT, _STATISTICS: TEXT_LIMIT, _MESSAGE: CHUNK_LIMIT,
    _CHUNK: 2 * CHUNK_LIMIT,
}  # fmt: skip


class McapStorage(ChunkedStorage):
    """One MCAP file."""

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics from the summary at the end of the file. If there is no summary, read the whole file."""
        with self.open_records() as file:
            start, contents = self._summary(file), _Contents()
            file.seek(start or len(MAGIC))
            for kind, content in self._records(file, frozenset({_SCHEMA, _CHANNEL, _STATISTICS, _CHUNK})):
                if kind != _CHUNK:
                    contents.take(kind, content)
                elif not start:
                    for inner, part in self._inside(content):
                        if inner in (_SCHEMA, _CHANNEL):
                            contents.take(inner, part)
            return merge_topics(contents.topics())

    def gather(self, file: BinaryIO, ids: Set[int], times: list[int], messages: list[bytes]) -> Iterator[int]:
        """Append the messages of each chunk, and those outside a chunk."""
        self._summary(file)
        file.seek(len(MAGIC))
        for kind, content in self._records(file, frozenset({_MESSAGE, _CHUNK})):
            if kind == _CHUNK:
                _collect(self._chunk(content), ids, times, messages)
                yield len(content)
                continue
            channel, _, time, _ = _FIXED.unpack_from(content)
            if channel in ids:
                times.append(time)
                messages.append(content[_FIXED.size :])
                yield len(content)

    def _summary(self, file: BinaryIO) -> int:
        """Return the position of the summary, or 0 if there is none. Raise an error if the end is invalid."""
        file.seek(0, 2)
        end = file.tell()
        tail = _HEAD.size + 20 + len(MAGIC)
        file.seek(max(0, end - tail))
        footer = file.read(tail)
        kind, length = _HEAD.unpack_from(footer) if len(footer) == tail else (0, 0)
        if kind != _FOOTER or length != 20 or not footer.endswith(MAGIC):
            raise ReadError(
                f"{self.path} is truncated: the copy is incomplete, or the recorder was killed",
                code="cut-off",
                advice="Copy it again, or repair it with `mcap recover`.",
            )
        start = int(_LONG.unpack_from(footer, _HEAD.size)[0])
        if start > end:
            raise damage_error(f"{self.path} is damaged: the position of its summary is after its end", "index-damaged")
        return start

    def _records(self, file: BinaryIO, wanted: Set[int]) -> Iterator[tuple[int, bytes]]:
        """Yield the kind and the content of each record of the wanted kinds, from the current position to the end."""
        while True:
            head = file.read(_HEAD.size)
            kind, length = _HEAD.unpack(head)
            if kind in (_FOOTER, _DATA_END) and _MESSAGE in wanted:
                return
            if kind == _FOOTER:
                return
            limit = _LIMITS.get(kind, 1 << 40)  # an attachment may be large
            if length > limit:
                raise damage_error(f"{self.path} is damaged: a record of {length} bytes", "record-damaged")
            if kind not in wanted:
                file.seek(length, 1)
                continue
            content = file.read(length)
            if len(content) != length:
                raise damage_error(
                    f"{self.path} is damaged: a record of {length} bytes where {len(content)} are left",
                    "record-damaged",
                )
            yield kind, content

    def _chunk(self, content: bytes) -> bytes:
        """Return the decompressed records in a chunk."""
        _, _, size, checksum = _CHUNK_HEAD.unpack_from(content)
        compression, position = _text(content, _CHUNK_HEAD.size)
        (length,) = _LONG.unpack_from(content, position)
        packed = content[position + 8 : position + 8 + length]
        records = decompress(packed, compression, size, self.path)
        require_checksum(records, checksum, self.path)
        return records

    def _inside(self, content: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield the kind and the content of each record in a chunk."""
        records = BytesIO(self._chunk(content))
        while head := records.read(_HEAD.size):
            kind, length = _HEAD.unpack(head)
            yield kind, records.read(length)


def _collect(records: bytes, ids: Set[int], times: list[int], messages: list[bytes]) -> None:
    """Append the messages. Most of the reading time is spent in this loop, so it is optimised."""
    position, end = 0, len(records)
    unpack, fixed = _WHOLE.unpack_from, _WHOLE.size
    while position < end:
        if end - position < fixed:
            _, length = _HEAD.unpack_from(records, position)
            position += _HEAD.size + length
            continue
        kind, length, channel, _, time, _ = unpack(records, position)
        following = position + 9 + length
        if kind == _MESSAGE and channel in ids:
            if length < 22 or following > end:
                raise StructError(f"a message of {length} bytes in a chunk of {end}")
            times.append(time)
            messages.append(records[position + fixed : following])
        position = following
    if position != end:
        raise StructError(f"the last record leaves its chunk by {position - end} bytes")


class _Contents:
    """Schemas, channels and message counts found so far."""

    def __init__(self) -> None:
        self.schemas: dict[int, tuple[str, str, str]] = {}
        self.channels: dict[int, tuple[int, str, str]] = {}
        self.counts: dict[int, int] | None = None

    def take(self, kind: int, content: bytes) -> None:
        if kind == _STATISTICS:
            (length,) = _WORD.unpack_from(content, 42)
            pairs = range(46, min(46 + length, len(content) - 9), 10)
            self.counts = {_SHORT.unpack_from(content, k)[0]: _LONG.unpack_from(content, k + 2)[0] for k in pairs}
            return
        (number,) = _SHORT.unpack_from(content)
        if kind == _SCHEMA:
            name, position = _text(content, 2)
            encoding, position = _text(content, position)
            text, _ = _text(content, position, strict=False)
            self.schemas[number] = (name, encoding, text)
        else:
            topic, position = _text(content, 4)
            encoding, _ = _text(content, position)
            self.channels[number] = (_SHORT.unpack_from(content, 2)[0], topic, encoding)

    def topics(self) -> Iterator[Topic]:
        for number, (schema, topic, encoding) in self.channels.items():
            name, language, text = self.schemas.get(schema, ("", "", ""))
            count = None if self.counts is None else self.counts.get(number, 0)
            yield Topic(
                name=topic, type=name, encoding=encoding, text=text, language=language, ids=(number,), count=count
            )


def _text(content: bytes, position: int, strict: bool = True) -> tuple[str, int]:
    """Read a string after its length, and its end; unless `strict`, invalid bytes (schemas) are replaced."""
    (length,) = _WORD.unpack_from(content, position)
    end = position + 4 + length
    if end > len(content):
        raise StructError(f"a text of {length} bytes in a record of {len(content)}")
    return content[position + 4 : end].decode("utf-8", "strict" if strict else "replace"), end
