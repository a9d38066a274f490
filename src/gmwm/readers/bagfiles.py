"""Files of ROS recordings: what topics are in them, and the bytes of the messages of one, in batches.

Three containers: the bag of ROS 1, the SQLite database and the MCAP file of ROS 2. Each is a `Storage`.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gmwm.errors import ReadError
from gmwm.readers.byte_sources import ZSTD, zstd_library

Batch = tuple[list[int], list[bytes]]
"""Messages in the order of recording: when each was recorded (ns), and its bytes."""

BATCH_BYTES = 2 << 20
"""Bytes of messages in a batch, roughly."""

CHUNK_LIMIT = 256 << 20
"""Bytes of a chunk when unpacked; recorders write 0.8 to 16 MB."""

MESSAGE_LIMIT = 1 << 20
"""Bytes of a message when unpacked: those of inertial sensors have some hundred."""

TEXT_LIMIT = 1 << 20
"""Characters of a message definition, and bytes of a record that holds one."""

TOPIC_LIMIT = 10_000


@dataclass(frozen=True)
class Topic:
    """A stream of messages of one type.

    Parameters
    ----------
    name : str
        As "/imu/data".
    type : str
        As "sensor_msgs/msg/Imu", also for ROS 1.
    encoding : str
        How messages are serialised: "cdr", "ros1", or another that is not read here.
    text, language : str
        Definition of the type, and in what it is written: "ros1msg", "ros2msg", "ros2idl", or "" for none.
    ids : tuple of int
        By what the container knows it.
    count : int or None
        Messages, where the container says so.
    """

    name: str
    type: str
    encoding: str
    text: str = ""
    language: str = ""
    ids: tuple[int, ...] = ()
    count: int | None = None


class Storage(ABC):
    """One file of a recording."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @abstractmethod
    def topics(self) -> tuple[Topic, ...]:
        """What was recorded."""

    @abstractmethod
    def batches(self, topic: Topic) -> Iterator[Batch]:
        """The messages of a topic."""


def unpacked(data: bytes, compression: str, size: int, path: Path) -> bytes:
    """The content of a chunk, which must have the size that the file says.

    Parameters
    ----------
    data : bytes
        As it stands in the file.
    compression : str
        "", "none", "lz4", "bz2" or "zstd".
    size : int
        Bytes when unpacked.

    Raises
    ------
    ReadError
        If it is damaged, of another size, larger than any recorder writes, or packed in another way.
    """
    if size > CHUNK_LIMIT:
        raise ReadError(f"{path}: a chunk of {size} bytes; more than {CHUNK_LIMIT >> 20} MB are not unpacked at once")
    if compression in ("", "none"):
        content = data
    elif compression in ("lz4", "bz2", "zstd"):
        try:
            # One byte more than there should be is enough to see that there are too many.
            content = _decompressor(compression).decompress(data, max_length=size + 1)
        except Exception as error:  # of three libraries, on bytes of a stranger: any kind
            raise ReadError(f"{path}: a chunk is damaged ({error})", advice="Copy the file again.") from error
    else:
        raise ReadError(f"{path}: its chunks are packed with {compression!r}; none, lz4, bz2 and zstd are read")
    if len(content) != size:
        raise ReadError(f"{path}: a chunk is damaged: {len(content)} bytes or more, expected {size}")
    return bytes(content)


def unpacked_messages(messages: list[bytes], path: Path) -> list[bytes]:
    """Messages that a recorder compressed one by one; no CDR begins as Zstandard does."""
    if not messages[0].startswith(ZSTD):
        return messages
    try:
        found = [_decompressor("zstd").decompress(message, max_length=MESSAGE_LIMIT) for message in messages]
    except Exception as error:  # of a library, on bytes of a stranger: any kind
        raise ReadError(f"{path}: a compressed message is damaged ({error})", advice="Copy the file again.") from error
    if sum(map(len, found)) > CHUNK_LIMIT:
        raise ReadError(f"{path}: compressed messages of more than {CHUNK_LIMIT >> 20} MB; no recorder writes them")
    return found


def require_checksum(content: bytes, checksum: int, path: Path) -> None:
    """An error where a chunk is not what was written."""
    if checksum and zlib.crc32(content) != checksum:
        raise ReadError(f"{path}: a chunk is damaged: its checksum is wrong", advice="Copy the file again.")


def merged(topics: Iterator[Topic]) -> tuple[Topic, ...]:
    """Topics with the ids of all who wrote on them: two publishers on one topic are one stream."""
    found: dict[tuple[str, str, str], Topic] = {}
    for topic in topics:
        key = (topic.name, topic.type, topic.encoding)
        other = found.get(key, Topic(*key))
        count = None if topic.count is None else topic.count + (other.count or 0)
        text, language = (topic.text, topic.language) if topic.text else (other.text, other.language)
        found[key] = replace(topic, text=text, language=language, ids=other.ids + topic.ids, count=count)
        if len(found) > TOPIC_LIMIT:
            raise ReadError(f"more than {TOPIC_LIMIT} topics")
    return tuple(found.values())


def _decompressor(compression: str) -> Any:
    if compression == "lz4":
        from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]

        return LZ4FrameDecompressor()
    if compression == "bz2":
        from bz2 import BZ2Decompressor

        return BZ2Decompressor()
    return zstd_library().ZstdDecompressor()
