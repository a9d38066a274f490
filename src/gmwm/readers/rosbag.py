"""Recordings of ROS, without ROS: bags of ROS 1, databases and MCAP files of ROS 2, alone or in their directory.

Every topic whose messages hold numbers is a recording; those of type sensor_msgs/Imu are taken for inertial ones,
others where names of their fields say so. Time is the stamp in the header of a message, and where that is not set,
when it was recorded.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from gmwm.errors import ReadError
from gmwm.readers import bag_mcap, bag_ros1, bag_sqlite
from gmwm.readers.bag_mcap import McapStorage
from gmwm.readers.bag_ros1 import Ros1Storage
from gmwm.readers.bag_sqlite import SqliteStorage
from gmwm.readers.bag_types import IMU, definition
from gmwm.readers.bagfiles import Batch, Storage, Topic, merged, unpacked_messages
from gmwm.readers.base import Channel, Layout, Reader, Rows, register
from gmwm.readers.byte_sources import ZSTD, CompressedSource
from gmwm.readers.cdr import Decoder, Definition
from gmwm.readers.column_names import recognise
from gmwm.signals import AXES

LOG_TIME = "log_time"
"""Name of the channel that holds when a message was recorded."""

STAMP = "header.stamp"

_ELEMENT = re.compile(r"(.*)\[([012])\]")
_SENSORS = {"angular_velocity": "gyro", "linear_acceleration": "accel"}
_PEEK = 64  # messages that say whether a sensor is there at all
_YAML_LIMIT = 4 << 20
_FILES = 10_000
_PACKED = (".db3.zstd", ".mcap.zstd")


@dataclass(frozen=True)
class _Stream:
    """What a layout needs to find its numbers again."""

    topic: Topic
    definition: Definition


@register
class RosbagReader(Reader):
    """ROS 1 and ROS 2 recordings, by their signatures; a directory by its metadata.yaml."""

    name: ClassVar[str] = "rosbag"
    extensions: ClassVar[tuple[str, ...]] = (".bag", ".db3", ".mcap", ".yaml", ".zstd")
    folder_sign: ClassVar[str] = "metadata.yaml"

    def sniff(self, path: Path, head: bytes) -> float:
        """1 for the signatures of ROS 1 bags, SQLite, MCAP, or the first key of a bag's metadata.yaml."""
        if head.startswith((b"#ROSBAG V", bag_sqlite.MAGIC, bag_mcap.MAGIC)) or _is_metadata(head):
            return 1.0
        return 1.0 if head.startswith(ZSTD) and path.name.lower().endswith(_PACKED) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """One for each topic whose messages hold numbers."""
        with _opened(path) as storages:
            topics = merged(topic for storage in storages for topic in storage.topics())
            found = [layout for topic in topics if (layout := _layout_or_reason(topic, storages)) is not None]
        if not found:
            known = ", ".join(f"{t.name} ({t.type}, {t.encoding})" for t in topics) or "none"
            raise ReadError(
                f"{path} has no topic whose messages can be read. Its topics: {known}. Messages are read in the "
                "encodings cdr and ros1, of types that ROS comes with or that the recording defines (as ROS 1 and MCAP "
                "do, and databases since ROS 2 Iron)"
            )
        return tuple(found)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """The numbers of a topic, one chunk for each batch of messages."""
        stream: _Stream = layout.state
        names = {k: layout.channels[k].name for k in wanted}
        decoder = Decoder(stream.definition, [name for name in names.values() if name != LOG_TIME])
        with _opened(path) as storages:
            for times, messages in _batches(storages, stream.topic):
                numbers = _decoded(decoder, messages, stream.topic, path)
                logged = np.array(times, dtype=np.int64)
                yield {k: logged if name == LOG_TIME else numbers[name] for k, name in names.items()}


def _is_metadata(head: bytes) -> bool:
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith((b"#", b"%", b"---")))
    return next(lines, b"").startswith(b"rosbag2_bagfile_information")


@contextmanager
def _opened(path: Path) -> Iterator[list[Storage]]:
    """The files of a recording; those that are compressed as a whole are unpacked for as long as they are needed."""
    with TemporaryDirectory(prefix="gmwm-") as folder:
        try:
            with path.open("rb") as file:
                head = file.read(1 << 12)
            files = _listed(path) if _is_metadata(head) else [path]
            yield [_storage(_plain(file, Path(folder))) for file in files]
        except OSError as error:
            raise ReadError(f"{path} cannot be read: {error.strerror or error}") from error


def _storage(path: Path) -> Storage:
    """A file by its signature."""
    with path.open("rb") as file:
        head = file.read(16)
    if head.startswith(bag_mcap.MAGIC):
        return McapStorage(path)
    if head.startswith(bag_sqlite.MAGIC):
        return SqliteStorage(path)
    if head.startswith(bag_ros1.MAGIC):
        return Ros1Storage(path)
    if head.startswith(b"#ROSBAG V"):
        version = head[9:13].decode("ascii", "replace").strip()
        raise ReadError(f"{path} is a ROS 1 bag of version {version}, expected 2.0; convert it with `rosbag fix`")
    raise ReadError(f"{path} is none of a ROS 1 bag, an SQLite database and an MCAP file")


def _plain(path: Path, folder: Path) -> Path:
    """A file, or what is in it when it is compressed as a whole."""
    with path.open("rb") as file:
        if not file.read(4).startswith(ZSTD):
            return path
    target = folder / path.stem
    with CompressedSource(path).open() as packed, target.open("wb") as file:
        shutil.copyfileobj(packed, file, 1 << 20)
    return target


def _listed(path: Path) -> list[Path]:
    """The files that a metadata.yaml lists, all of them there."""
    from ruamel.yaml import YAML

    if path.stat().st_size > _YAML_LIMIT:
        raise ReadError(f"{path} has more than {_YAML_LIMIT} bytes, which no recorder writes")
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        names = [PurePath(str(name)).name for name in content["relative_file_paths"]]
    except OSError:
        raise
    except Exception as error:  # of a library, on a text of a stranger: any kind
        raise ReadError(f"{path} does not list the files of a recording; pass one of them in place of it") from error
    if not 0 < len(names) <= _FILES:
        raise ReadError(f"{path} lists {len(names)} files, expected at least one and no more than {_FILES}")
    # Without its directory: a list cannot lead out of the one it stands in.
    files = [path.parent / name for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise ReadError(f"{path} lists files that are not there: {', '.join(missing[:5])}; copy the whole directory")
    return files


def _batches(storages: Sequence[Storage], topic: Topic) -> Iterator[Batch]:
    """The messages of a topic in all files, whose own numbers for it may differ."""
    for storage in storages:
        for own in storage.topics():
            if (own.name, own.type, own.encoding) == (topic.name, topic.type, topic.encoding):
                for times, messages in storage.batches(own):
                    yield times, unpacked_messages(messages, storage.path) if own.encoding == "cdr" else messages


def _layout_or_reason(topic: Topic, storages: Sequence[Storage]) -> Layout | None:
    """What a topic holds; without columns, and with the reason as its note, where that is not understood.

    What is wrong with one topic is no harm to the others.
    """
    try:
        return _layout(topic, storages)
    except ReadError as error:
        return Layout((), topic=topic.name, notes=(str(error),), inertial=topic.type == IMU)


def _layout(topic: Topic, storages: Sequence[Storage]) -> Layout | None:
    """What a topic holds; None if no numbers."""
    kind = definition(topic)
    if kind is None:
        return None
    leaves = kind.leaves()
    if topic.type == IMU and _imu_leaves() <= set(leaves):
        return _imu_layout(topic, kind, leaves, storages)
    channels = [Channel(leaf, axis=_axis(leaf)) for leaf in leaves]
    if STAMP in leaves:
        channels[leaves.index(STAMP)] = Channel(STAMP, "ns", "time")
    inertial = any(channel.axis in AXES for channel in channels)
    notes: tuple[str, ...] = (f"topic {topic.name}, {topic.type}",)
    timed = any(channel.axis == "time" or recognise(channel.name).axis == "time" for channel in channels)
    if inertial and STAMP in leaves and not _stamped(topic, kind, storages):
        del channels[leaves.index(STAMP)]
        timed = False
    if not timed:
        notes += ("time: when messages were recorded, as they carry no stamp",)
    channels.append(Channel(LOG_TIME, "ns", "" if timed else "time"))
    if len(channels) == 1:
        return None
    return Layout(
        channels=tuple(channels),
        first_row=(),
        topic=topic.name,
        rate=None,
        units={},
        notes=notes,
        state=_Stream(topic, kind),
        inertial=inertial,
    )


def _imu_leaves() -> set[str]:
    """The numbers without which a type is not sensor_msgs/Imu, whatever it is called."""
    return {STAMP, *(f"{sensor}{part}" for sensor in _SENSORS for part in (".x", ".y", ".z", "_covariance[0]"))}


def _imu_layout(topic: Topic, kind: Definition, leaves: Sequence[str], storages: Sequence[Storage]) -> Layout:
    """A topic of sensor_msgs/Imu: a sensor that it says is absent, or that is zero throughout, is left out."""
    names = [leaf for leaf in leaves if leaf == STAMP or leaf.split(".")[0] in _SENSORS]
    first = _first(topic, kind, [*names, *(f"{sensor}_covariance[0]" for sensor in _SENSORS)], storages)
    notes = [f"topic {topic.name}, {topic.type}"]
    absent = set()
    for sensor in _SENSORS:
        axes = [first[name] for name in names if name.startswith(f"{sensor}.")]
        if first[STAMP].size and not any(np.any(values) for values in axes):
            absent.add(sensor)
            notes.append(f"{sensor} is zero in the first {first[STAMP].size} messages: left out")
        elif np.any(first[f"{sensor}_covariance[0]"] == -1):
            absent.add(sensor)
            notes.append(f"{sensor} is marked as absent by its covariance: left out")
    stamped = bool(np.any(first[STAMP]))
    if not stamped and first[STAMP].size:
        notes.append("time: when messages were recorded, as their stamps are zero")
    channels = [Channel(STAMP, "ns", "time")] if stamped else []
    for name in names[1:]:
        sensor, axis = name.split(".")
        if sensor not in absent:
            channels.append(Channel(name, axis=f"{_SENSORS[sensor]}_{axis}"))
    channels.append(Channel(LOG_TIME, "ns", "" if stamped else "time"))
    state = _Stream(topic, kind)
    return Layout(
        channels=tuple(channels),
        first_row=(),
        topic=topic.name,
        rate=None,
        units={},
        notes=tuple(notes),
        state=state,
        inertial=bool(first[STAMP].size),
    )


def _stamped(topic: Topic, kind: Definition, storages: Sequence[Storage]) -> bool:
    return bool(np.any(_first(topic, kind, [STAMP], storages)[STAMP]))


def _first(topic: Topic, kind: Definition, names: Sequence[str], storages: Sequence[Storage]) -> dict[str, Any]:
    """Numbers of the first messages of a topic; empty arrays if there are none."""
    for _, messages in _batches(storages, topic):
        return _decoded(Decoder(kind, names), messages[:_PEEK], topic, storages[0].path)
    return {name: np.empty(0) for name in names}


def _decoded(decoder: Decoder, messages: Sequence[bytes], topic: Topic, path: Path) -> dict[str, Any]:
    try:
        return decoder.decode(messages)
    except ReadError as error:
        raise ReadError(f"{path}, topic {topic.name}: {error}") from error


def _axis(leaf: str) -> str:
    """The axis that a field is by its name; of three numbers in an array, x, y and z."""
    match = _ELEMENT.fullmatch(leaf)
    axis = recognise(f"{match[1]}_{'xyz'[int(match[2])]}" if match else leaf).axis
    return axis if axis in AXES else ""
