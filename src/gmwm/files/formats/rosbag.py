"""Read ROS recordings without ROS: bags of ROS 1, and databases and MCAP files of ROS 2, as files or directories.

Topics with numbers are recordings, inertial by type sensor_msgs/Imu or by names, with times of headers or recording."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from gmwm.base.arrays import Integers, Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES
from gmwm.files.columns.column_names import recognise
from gmwm.files.contract import Channel, Layout, Reader, Rows, register
from gmwm.files.formats import bag_mcap, bag_ros1, bag_sqlite
from gmwm.files.formats.bag_mcap import McapStorage
from gmwm.files.formats.bag_ros1 import Ros1Storage
from gmwm.files.formats.bag_sqlite import SqliteStorage
from gmwm.files.formats.bagfiles import Batch, Storage, Topic, decompress_messages, merge_topics
from gmwm.files.formats.byte_sources import ZSTD, CompressedSource
from gmwm.files.formats.cdr import IMU, Decoder, Definition, definition
from gmwm.files.formats.records import JsonDecoder, JsonType

LOG_TIME = "log_time"  # name of the channel with the time at which a message was recorded

STAMP = "header.stamp"

TEMPERATURE = "(temperature)"  # name of the channel with the temperature of another topic, interpolated to the samples

_ELEMENT = re.compile(r"(.*)\[([012])\]")
_TEMPERATURE_TYPE = "sensor_msgs/msg/Temperature"
_SENSORS = {"angular_velocity": "gyro", "linear_acceleration": "accel"}
# The numbers that a type must have to be sensor_msgs/Imu, in addition to its name.
_IMU_LEAVES = {STAMP, *(f"{sensor}{part}" for sensor in _SENSORS for part in (".x", ".y", ".z", "_covariance[0]"))}
_YAML_LIMIT = 1 << 20  # bytes: a metadata.yaml lists one line for each file and topic; a larger one takes 10 s
_FILES = 10_000  # files of a recording: a bag is split into parts of some hundred MB at least


@dataclass(frozen=True)
class _TopicState:
    """The topic of a layout, the type of its messages, and the topic of its temperature if there is one."""

    topic: Topic
    definition: Definition | JsonType
    temperature: Topic | None = None


@register
class RosbagReader(Reader):
    """Reader of ROS 1 and ROS 2 recordings. Files are recognised by their signatures, directories by metadata.yaml."""

    name: ClassVar[str] = "rosbag"
    extensions: ClassVar[tuple[str, ...]] = (".bag", ".db3", ".mcap", ".yaml", ".zstd")
    folder_sign: ClassVar[str] = "metadata.yaml"

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 1 for the signatures of ROS 1 bags, SQLite and MCAP, and for the first key of a metadata.yaml."""
        if head.startswith((b"#ROSBAG V", bag_sqlite.MAGIC, bag_mcap.MAGIC)) or _is_metadata(head):
            return 1.0
        return 1.0 if head.startswith(ZSTD) and path.name.lower().endswith((".db3.zstd", ".mcap.zstd")) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each topic whose messages contain numbers."""
        with _storages(path) as storages:
            topics = merge_topics(topic for storage in storages for topic in storage.topics())
            layouts = [layout for topic in topics if (layout := _layout_or_error(topic, storages, path)) is not None]
            layouts = _with_temperatures(layouts, topics)
        if not layouts:
            described = ", ".join(f"{t.name} ({t.type}, {t.encoding})" for t in topics) or "none"
            raise ReadError(
                f"{path} has no topic whose messages can be read. Its topics: {described}",
                code="no-inertial-data",
                advice="Messages must be JSON, or have the encoding cdr or ros1 and a type of ROS itself or one that "
                "the recording defines (as ROS 1 and MCAP do, and databases since ROS 2 Iron).",
            )
        return tuple(layouts)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers of a topic, one chunk for each batch of messages."""
        stream: _TopicState = layout.state
        names = {k: layout.channels[k].name for k in wanted}
        stamp = next((c.name for c in layout.channels if c.axis == "time"), LOG_TIME)
        warm = stream.temperature is not None and TEMPERATURE in names.values()
        fields = dict.fromkeys([*names.values(), stamp] if warm else names.values())
        decoder = stream.definition.decoder([name for name in fields if name not in (LOG_TIME, TEMPERATURE)])
        with _storages(path) as storages:
            slow = _temperatures(stream.temperature if warm else None, stamp, storages, path)
            for times, messages in _batches(storages, stream.topic):
                numbers = dict(_decode(decoder, messages, stream.topic, path))
                numbers[LOG_TIME] = np.array(times, dtype=np.int64)
                if warm:
                    numbers[TEMPERATURE] = _interpolate(slow, numbers[stamp])
                yield {k: numbers[name] for k, name in names.items()}


def _is_metadata(head: bytes) -> bool:
    lines = (line for line in head.splitlines() if line.strip() and not line.startswith((b"#", b"%", b"---")))
    return next(lines, b"").startswith(b"rosbag2_bagfile_information")


@contextmanager
def _storages(path: Path) -> Iterator[list[Storage]]:
    """Open the files of a recording; compressed files are unpacked into a temporary folder."""
    with TemporaryDirectory(prefix="gmwm-") as folder:
        try:
            with path.open("rb") as file:
                head = file.read(1 << 12)
            files = _listed_files(path) if _is_metadata(head) else [path]
            yield [_storage(_plain(file, Path(folder))) for file in files]
        except OSError as error:
            raise ReadError(
                f"{path} cannot be read: {error.strerror or error}",
                code="not-readable",
                advice="Check the permissions of the file and the free space of the disk.",
            ) from error


def _storage(path: Path) -> Storage:
    """Open a bag file (ROS 1, SQLite or MCAP); the signature at its beginning shows the format."""
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
        raise ReadError(
            f"{path} is a ROS 1 bag of version {version}, expected 2.0",
            code="unsupported",
            advice="Convert it with `rosbag fix`.",
        )
    raise ReadError(
        f"{path} is neither a ROS 1 bag nor an SQLite database nor an MCAP file",
        code="wrong-format",
        advice="Pass a .bag, .db3 or .mcap file, or the folder with its metadata.yaml.",
    )


def _plain(path: Path, folder: Path) -> Path:
    """Return the file, or its unpacked content in `folder` if it is compressed as a whole."""
    with path.open("rb") as file:
        if not file.read(4).startswith(ZSTD):
            return path
    target = folder / path.stem
    with CompressedSource(path).open() as packed, target.open("wb") as file:
        shutil.copyfileobj(packed, file, 1 << 20)
    return target


def _listed_files(path: Path) -> list[Path]:
    """Return the files that a metadata.yaml lists."""
    from ruamel.yaml import YAML

    if path.stat().st_size > _YAML_LIMIT:
        raise ReadError(
            f"{path} has more than {_YAML_LIMIT} bytes, the limit for a metadata.yaml",
            code="too-large",
            advice="Pass one of the files of the recording instead.",
        )
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        names = [PurePath(str(name)).name for name in content["relative_file_paths"]]
    except OSError:
        raise
    except Exception as error:  # the library raises any type of error for a damaged file
        raise ReadError(
            f"{path} does not list the files of a recording",
            code="no-recording",
            advice="Pass one of its files instead.",
        ) from error
    if not 0 < len(names) <= _FILES:
        raise ReadError(
            f"{path} lists {len(names)} files, expected 1 to {_FILES}",
            code="too-many",
            advice="Pass one of the files of the recording instead.",
        )
    # Folders in the list are ignored, so it cannot refer to files outside its directory.
    files = [path.parent / name for name in names]
    missing = [file.name for file in files if not file.is_file()]
    if missing:
        raise ReadError(
            f"{path} lists files that do not exist: {', '.join(missing[:5])}",
            code="files-missing",
            advice="Copy the whole directory.",
        )
    return files


def _batches(storages: Sequence[Storage], topic: Topic) -> Iterator[Batch]:
    """Yield the messages of a topic in all files. The identifiers of the topic can differ between the files."""
    for storage in storages:
        for part in storage.topics():
            if (part.name, part.type, part.encoding) == (topic.name, topic.type, topic.encoding):
                for times, messages in storage.batches(part):
                    yield times, decompress_messages(messages, storage.path) if part.encoding == "cdr" else messages


def _layout_or_error(topic: Topic, storages: Sequence[Storage], path: Path) -> Layout | None:
    """Return the layout of a topic, or an unreadable layout, so that the other topics remain available."""
    try:
        return _layout(topic, storages, path)
    except ReadError as error:
        return Layout((), topic=topic.name, inertial=topic.type == IMU, unreadable=error)


def _with_temperatures(layouts: Sequence[Layout], topics: Sequence[Topic]) -> list[Layout]:
    """Add each temperature topic to the inertial topic whose name shares the longest beginning with its name."""
    out = list(layouts)
    inertial = [k for k, layout in enumerate(out) if layout.inertial and isinstance(layout.state, _TopicState)]
    for topic in topics:
        if topic.type != _TEMPERATURE_TYPE or topic.count == 0 or not inertial:
            continue
        pairs = {k: zip(topic.name, out[k].topic, strict=False) for k in inertial}
        alike = {k: sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs[k])) for k in inertial}
        best = [k for k in inertial if alike[k] == max(alike.values())]
        layout = out[best[0]]
        has_temperature = any("temperature" in (c.axis, recognise(c.name).axis) for c in layout.channels)
        if len(best) == 1 and not has_temperature:
            remark = Remark.of("file-content", case="temperature", topic=topic.name)
            out[best[0]] = replace(
                layout, channels=(*layout.channels, Channel(TEMPERATURE, "°C", "temperature")),
                state=replace(layout.state, temperature=topic), remarks=(*layout.remarks, remark),
            )  # fmt: skip
    return out


def _temperatures(topic: Topic | None, stamp: str, storages: Sequence[Storage], path: Path) -> tuple[Integers, Vector]:
    """Read the time stamps (ns) and temperatures (°C) of a topic, in the order of time."""
    kind = None if topic is None else definition(topic)
    stamps, values = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    if topic is not None and kind is not None:
        decoder = kind.decoder([STAMP, "temperature"])
        for times, messages in _batches(storages, topic):
            numbers = _decode(decoder, messages, topic, path)
            # The temperatures need times of the same clock as the samples.
            stamps.append(numbers[STAMP] if stamp == STAMP else np.array(times, dtype=np.int64))
            values.append(numbers["temperature"])
    at, degrees = np.concatenate(stamps), np.concatenate(values)
    order = np.argsort(at, kind="stable")
    order = order[np.isfinite(degrees[order])]
    return at[order], degrees[order]


def _interpolate(slow: tuple[Integers, Vector], stamps: Integers) -> Vector:
    """Return the temperature at some time stamps (ns), interpolated linearly; NaN if none was recorded."""
    at, values = slow
    if not at.size:
        return np.full(stamps.size, np.nan)
    temperatures: Vector = np.interp((stamps - at[0]).astype(np.float64), (at - at[0]).astype(np.float64), values)
    return temperatures


def _layout(topic: Topic, storages: Sequence[Storage], path: Path) -> Layout | None:
    """Return the layout of a topic; None if its messages contain no numbers."""
    try:
        kind = _type(topic, storages)
        leaves = () if kind is None else kind.leaves()
    except ReadError as error:
        raise error.at(str(path)) from error
    if kind is None:
        return None
    if topic.type == IMU and set(leaves) >= _IMU_LEAVES:
        return _imu_layout(topic, kind, leaves, storages)
    channels = [Channel(leaf, axis=_axis(leaf)) for leaf in leaves]
    if STAMP in leaves:
        channels[leaves.index(STAMP)] = Channel(STAMP, "ns", "time")
    inertial = any(channel.axis in AXES for channel in channels)
    remarks: tuple[Remark, ...] = (Remark.of("topic-chosen", case="read", topic=topic.name, type=topic.type),)
    timed = any(channel.axis == "time" or recognise(channel.name).axis == "time" for channel in channels)
    if inertial and STAMP in leaves and not np.any(_first(topic, kind, [STAMP], storages)[STAMP]):
        del channels[leaves.index(STAMP)]
        timed = False
    if not timed:
        remarks += (Remark.of("time-read", case="read", form="log", reason="the messages have no stamp"),)
    channels.append(Channel(LOG_TIME, "ns", "spare" if timed else "time"))
    if len(channels) == 1:
        return None
    return Layout(
        channels=tuple(channels), topic=topic.name, remarks=remarks,
        state=_TopicState(topic, kind), inertial=inertial,
    )  # fmt: skip


def _type(topic: Topic, storages: Sequence[Storage]) -> Definition | JsonType | None:
    """Return the type of the messages of a topic; None if it is not known. JSON messages state it by themselves."""
    if topic.encoding != "json":
        return definition(topic)
    return next((JsonType.of(messages[:64], topic.name) for _, messages in _batches(storages, topic)), None)


def _imu_layout(
    topic: Topic, kind: Definition | JsonType, leaves: Sequence[str], storages: Sequence[Storage]
) -> Layout:
    """Return the layout of a sensor_msgs/Imu topic, without sensors that are marked as absent or always zero."""
    names = [leaf for leaf in leaves if leaf == STAMP or leaf.split(".")[0] in _SENSORS]
    first = _first(topic, kind, [*names, *(f"{sensor}_covariance[0]" for sensor in _SENSORS)], storages)
    remarks = [Remark.of("topic-chosen", case="read", topic=topic.name, type=topic.type)]
    absent = set()
    for sensor in _SENSORS:
        axes = [first[name] for name in names if name.startswith(f"{sensor}.")]
        if first[STAMP].size and not any(np.any(values) for values in axes):
            absent.add(sensor)
            remarks.append(
                Remark.of("file-content", sensor, case="absent", reason="zero", count=int(first[STAMP].size))
            )
        elif np.any(first[f"{sensor}_covariance[0]"] == -1):
            absent.add(sensor)
            remarks.append(Remark.of("file-content", sensor, case="absent", reason="absent"))
    stamped = bool(np.any(first[STAMP]))
    if not stamped and first[STAMP].size:
        remarks.append(Remark.of("time-read", case="read", form="log", reason="the stamps of the messages are zero"))
    channels = [Channel(STAMP, "ns", "time")] if stamped else []
    for name in names[1:]:
        sensor, axis = name.split(".")
        if sensor not in absent:
            channels.append(Channel(name, axis=f"{_SENSORS[sensor]}_{axis}"))
    channels.append(Channel(LOG_TIME, "ns", "spare" if stamped else "time"))
    return Layout(
        channels=tuple(channels), topic=topic.name, remarks=tuple(remarks),
        state=_TopicState(topic, kind), inertial=bool(first[STAMP].size),
    )  # fmt: skip


def _first(
    topic: Topic, kind: Definition | JsonType, names: Sequence[str], storages: Sequence[Storage]
) -> dict[str, Any]:
    """Return the numbers `names` of the first messages of a topic; empty arrays if it has no messages."""
    for _, messages in _batches(storages, topic):
        # First messages that show whether a sensor is always zero; noise is not zero in 64 samples
        return _decode(kind.decoder(names), messages[:64], topic, storages[0].path)
    return {name: np.empty(0) for name in names}


def _decode(decoder: Decoder | JsonDecoder, messages: Sequence[bytes], topic: Topic, path: Path) -> dict[str, Any]:
    try:
        return decoder.decode(messages)
    except ReadError as error:
        raise error.at(f"{path}, topic {topic.name}") from error


def _axis(leaf: str) -> str:
    """Return the axis of a field by its name; the three numbers of an array are x, y and z."""
    match = _ELEMENT.fullmatch(leaf)
    axis = recognise(f"{match[1]}_{'xyz'[int(match[2])]}" if match else leaf).axis
    return axis if axis in AXES else ""
