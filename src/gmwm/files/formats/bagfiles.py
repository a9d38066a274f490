"""Read the files of ROS recordings: list the topics in a file, and yield the bytes of the messages of one topic.

rosbags takes 1.3 (SQLite), 4 (ROS 1) and 4.7 (MCAP) times as long for 100 000 messages, decompresses without limit,
skips logs of unclosed databases, refuses MCAP profiles, and has foreign errors for 2 %, 10 % and 47 % of damage."""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Set
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from struct import error as StructError
from typing import Any, BinaryIO

from gmwm.base.errors import ReadError
from gmwm.base.extras import library
from gmwm.files.contract import damage_error
from gmwm.files.formats.byte_sources import ZSTD, zstd_library

Batch = tuple[list[int], list[bytes]]
"""A list of the times of recording (ns) of messages, in ascending order, and a list of the bytes of each message."""

BATCH_BYTES = 2 << 20  # approximate size of the messages in a batch (bytes)

CHUNK_LIMIT = 256 << 20  # largest size of a decompressed chunk (bytes); recorders write 0.8 to 16 MB


TEXT_LIMIT = 1 << 20  # largest length of a message definition (characters), and of a record that contains one (bytes)

TOPIC_LIMIT = 10_000


@dataclass(frozen=True)
class Topic:
    """A stream of messages of one type."""

    name: str  # name of the topic, for example "/imu/data"
    type: str  # type of the messages, for example "sensor_msgs/msg/Imu", also for ROS 1
    encoding: str  # serialisation of the messages: "cdr", "ros1", or another one, which cannot be read
    text: str = ""  # definition of the type and its language: "ros1msg", "ros2msg", "ros2idl", or "" for none
    language: str = ""
    ids: tuple[int, ...] = ()  # identifiers of the topic in the file; there is one for each publisher
    count: int | None = None  # number of messages; None if the file does not state it


class Storage(ABC):
    """One file of a ROS recording."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @abstractmethod
    def topics(self) -> tuple[Topic, ...]:
        """Return the recorded topics."""

    @abstractmethod
    def batches(self, topic: Topic) -> Iterator[Batch]:
        """Yield the messages of a topic, in batches."""


class ChunkedStorage(Storage):
    """One file whose messages are in chunks of records."""

    @abstractmethod
    def gather(self, file: BinaryIO, ids: Set[int], times: list[int], messages: list[bytes]) -> Iterator[int]:
        """Append messages of the topic `ids` to `times` and `messages`, and yield their approximate size (bytes)."""

    def batches(self, topic: Topic) -> Iterator[Batch]:
        """Yield the messages of a topic, chunk by chunk; within a batch they are sorted by the time of recording."""
        times, messages, size = list[int](), list[bytes](), 0
        with self.open_records() as file:
            for weight in self.gather(file, frozenset(topic.ids), times, messages):
                size += weight
                if size > BATCH_BYTES and messages:
                    yield _in_order(times[:], messages[:])
                    times.clear()
                    messages.clear()
                    size = 0
        if messages:
            yield _in_order(times, messages)

    @contextmanager
    def open_records(self) -> Iterator[BinaryIO]:
        """Open the file, and convert the errors of damaged records to a ReadError."""
        with self.path.open("rb") as file:
            try:
                yield file
            except (StructError, UnicodeDecodeError, KeyError, OSError) as error:
                raise damage_error(f"{self.path} is damaged or truncated ({error})") from error


def _in_order(times: list[int], messages: list[bytes]) -> Batch:
    """Sort a batch by the time of recording, because writers with several threads may swap neighbouring messages."""
    if sorted(times) == times:
        return times, messages
    order = sorted(range(len(times)), key=times.__getitem__)
    return [times[k] for k in order], [messages[k] for k in order]


def decompress(data: bytes, compression: str, size: int, path: Path) -> bytes:
    """Decompress a chunk ("", "none", "lz4", "bz2" or "zstd"), and check that it has the size that the file states."""
    if size > CHUNK_LIMIT:
        raise ReadError(
            f"{path}: a chunk of {size} bytes; more than {CHUNK_LIMIT >> 20} MB are not decompress at once",
            code="too-large",
            advice="Record with smaller chunks, or export the topic as CSV.",
        )
    if compression in ("", "none"):
        content = data
    elif compression in ("lz4", "bz2", "zstd"):
        decompressor = _decompressor(compression)
        try:
            # One byte more than expected is enough to detect that the chunk is too large.
            content = decompressor.decompress(data, max_length=size + 1)
        except Exception as error:  # three libraries can raise any error on invalid data
            raise damage_error(f"{path}: a chunk is damaged ({error})", "chunk-damaged") from error
    else:
        raise ReadError(
            f"{path}: its chunks have the compression {compression!r}, but gmwm reads only lz4, bz2, zstd and none",
            code="unsupported",
            advice="Compress the recording in one of these formats.",
        )
    if len(content) != size:
        raise damage_error(
            f"{path}: a chunk is damaged: {len(content)} bytes or more, expected {size}", "chunk-damaged"
        )
    return bytes(content)


def decompress_messages(messages: list[bytes], path: Path) -> list[bytes]:
    """Decompress messages that were compressed one by one. A CDR message cannot begin with the bytes of Zstandard."""
    if not messages[0].startswith(ZSTD):
        return messages
    try:
        # Largest size of a decompressed message (bytes); messages of inertial sensors have a few hundred bytes
        contents = [_decompressor("zstd").decompress(message, max_length=(1 << 20)) for message in messages]
    except Exception as error:  # a library can raise any error on invalid data
        raise damage_error(f"{path}: a compressed message is damaged ({error})", "chunk-damaged") from error
    if sum(map(len, contents)) > CHUNK_LIMIT:
        raise ReadError(
            f"{path}: compressed messages of more than {CHUNK_LIMIT >> 20} MB; no recorder writes them",
            code="too-large",
            advice="Copy the file again, or export the topic as CSV.",
        )
    return contents


def require_checksum(content: bytes, checksum: int, path: Path) -> None:
    """Raise an error if a chunk does not match its checksum."""
    if checksum and zlib.crc32(content) != checksum:
        raise damage_error(f"{path}: a chunk is damaged: its checksum is wrong", "checksum-wrong")


def merge_topics(topics: Iterator[Topic]) -> tuple[Topic, ...]:
    """Merge topics of the same name, because the messages of several publishers of a topic form one recording."""
    by_key: dict[tuple[str, str, str], Topic] = {}
    for topic in topics:
        key = (topic.name, topic.type, topic.encoding)
        other = by_key.get(key, Topic(*key))
        count = None if topic.count is None else topic.count + (other.count or 0)
        text, language = (topic.text, topic.language) if topic.text else (other.text, other.language)
        by_key[key] = replace(topic, text=text, language=language, ids=other.ids + topic.ids, count=count)
        if len(by_key) > TOPIC_LIMIT:
            raise ReadError(
                f"more than {TOPIC_LIMIT} topics",
                code="too-many",
                advice="Copy the topics of the sensor to another recording.",
            )
    return tuple(by_key.values())


def _decompressor(compression: str) -> Any:
    if compression == "lz4":
        return library("lz4.frame").LZ4FrameDecompressor()
    if compression == "bz2":
        from bz2 import BZ2Decompressor

        return BZ2Decompressor()
    return zstd_library().ZstdDecompressor()
