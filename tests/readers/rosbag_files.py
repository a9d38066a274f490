"""Recordings of ROS, written by rosbags: containers and messages for the tests."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000 * 10**9
STEP = 5_000_000  # ns

CONTAINERS = (
    "ros1", "ros1-bz2", "ros1-lz4", "db3", "db3-message", "db3-file", "mcap", "mcap-zstd", "mcap-message", "mcap-file",
)  # fmt: skip

FLAT = "uint64 timestamp\nfloat32 temperature\nbool ok\nfloat64 gx\nfloat64 gy\nfloat32 ax\nint16 counts\nstring tag"
NESTED = (
    "std_msgs/Header header\nstring[] names\nfloat32[3] gyro\nvn_msgs/Part[2] parts\nfloat64[] rest\n"
    "builtin_interfaces/Time when\nint8 small\nuint8[20] raw\n"
)
PART = "uint8 flag\nint64 big\nfloat64 value\nstring label"


def store_of(container):
    ros1 = container.startswith("ros1")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    kinds = get_types_from_msg(FLAT, "my_msgs/msg/Flat") | get_types_from_msg(PART, "vn_msgs/msg/Part")
    store.register(kinds | get_types_from_msg(NESTED, "vn_msgs/msg/Nested"))
    return store


def numbers(count=60, seed=1):
    """Gyroscopes and accelerometers, (count, 6), at rest."""
    return np.random.default_rng(seed).normal(size=(count, 6)) * 1e-3 + [0, 0, 0, 0.1, 0.2, 9.8]


def header(store, stamp, frame="imu"):
    time = store.types["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
    kind = store.types["std_msgs/msg/Header"]
    return kind(7, time, frame) if "seq" in kind.__dataclass_fields__ else kind(time, frame)


def imu(store, stamp, row, frame="imu", covariance=(0.0, 0.0)):
    vector, quaternion = (store.types[f"geometry_msgs/msg/{name}"] for name in ("Vector3", "Quaternion"))
    gyro, accel = (np.array([first, *[0.0] * 8]) for first in covariance)
    return store.types["sensor_msgs/msg/Imu"](
        header(store, stamp, frame),
        quaternion(0, 0, 0, 1),
        np.zeros(9),
        vector(*row[:3]),
        gyro,
        vector(*row[3:]),
        accel,
    )


def flat(store, stamp, row, tag="a"):
    return store.types["my_msgs/msg/Flat"](stamp // 1000, 20.5, True, row[0], row[1], row[5], -3, tag)


def nested(store, stamp, row, k=0):
    """A message with all that moves what stands behind it; `k` says how long the movable parts are."""
    part = store.types["vn_msgs/msg/Part"]
    time = store.types["builtin_interfaces/msg/Time"]
    return store.types["vn_msgs/msg/Nested"](
        header(store, stamp, "f" * k), ["x" * j for j in range(k)], np.float32(row[:3]),
        [part(1, -k, row[3], "l" * k), part(2, 2**62 + k, row[4], "")], np.arange(k, dtype=float),
        time(stamp // 10**9, stamp % 10**9), -5, np.arange(20, dtype=np.uint8),
    )  # fmt: skip


def written(folder, container, topics):
    """A recording in a container; `topics` maps names to (type, messages), a message being (log time, object)."""
    store = store_of(container)
    path = Path(tempfile.mkdtemp(dir=folder))
    rows = [(time, name, kind, message) for name, (kind, content) in topics.items() for time, message in content]
    rows.sort(key=lambda row: row[0])
    if container.startswith("ros1"):
        path = path / "made.bag"
        writer = Writer1(path)
        if container != "ros1":
            writer.set_compression(getattr(Writer1.CompressionFormat, container[5:].upper()))
        serialise = store.serialize_ros1
    else:
        path = path / "made"
        plugin, _, mode = container.partition("-")
        writer = Writer2(path, version=9, storage_plugin=getattr(StoragePlugin, {"db3": "SQLITE3"}.get(plugin, "MCAP")))
        if mode:
            by = {"zstd": "STORAGE"}.get(mode, mode.upper())
            writer.set_compression(CompressionMode[by], CompressionFormat.ZSTD)
        serialise = store.serialize_cdr
    with writer:
        connections = {name: writer.add_connection(name, kind, typestore=store) for name, (kind, _) in topics.items()}
        for time, name, kind, message in rows:
            writer.write(connections[name], time, bytes(serialise(message, kind)))
    return path


def recorded(folder, container="mcap", data=None, **options):
    """A recording of one topic of sensor_msgs/Imu, and its numbers."""
    data = numbers() if data is None else data
    store = store_of(container)
    messages = [(START + k * STEP + 999, imu(store, START + k * STEP, row, **options)) for k, row in enumerate(data)]
    return written(folder, container, {"/imu/data": ("sensor_msgs/msg/Imu", messages)})
