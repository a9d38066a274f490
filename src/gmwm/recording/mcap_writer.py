"""Write a recording as an MCAP file with messages sensor_msgs/msg/Imu of ROS 2. Source: mcap.dev/spec, version 0."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from gmwm.base.atomic_files import written_whole
from gmwm.base.errors import DataError
from gmwm.recording.signals import Imu

MCAP = ".mcap"
"""Extension of MCAP files."""
TOPIC = "/imu/data_raw"
_MAGIC = b"\x89MCAP0\r\n"
_ROWS = 1 << 18
"""Number of messages that are written at once: 91 MB."""
_DEFINITION = """std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{0}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{0}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{0}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
{0}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
""".format("=" * 80)
_MESSAGE = np.dtype(
    [
        # the record of a message: its kind, length, channel, number and two times
        ("kind", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("logged", "<u8"), ("sent", "<u8"),
        # the message in CDR, little-endian: every number is aligned, because frame_id has four bytes
        ("cdr", "V4"), ("sec", "<i4"), ("nanosec", "<u4"), ("frame_length", "<u4"), ("frame", "V4"),
        ("orientation", "<f8", 4), ("orientation_covariance", "<f8", 9),
        ("gyro", "<f8", 3), ("gyro_covariance", "<f8", 9), ("accel", "<f8", 3), ("accel_covariance", "<f8", 9),
    ]
)  # fmt: skip


def write_mcap(imu: Imu, path: Path) -> None:
    """Write a recording to an .mcap file. A sensor that is not recorded is marked by a covariance of −1, as the message
    defines it. The stamps are whole nanoseconds."""
    sensors = {sensor: [f"{sensor}_{axis}" in imu.axes for axis in "xyz"] for sensor in ("gyro", "accel")}
    for sensor, present in sensors.items():
        if any(present) and not all(present):
            raise DataError(
                f"a message holds three axes of a sensor, but the recording has {sum(present)} of {sensor}",
                advice="Write a .csv or .parquet file.",
            )
    first = imu[imu.axes[0]]
    # Within a segment, stamps are exact to the nanosecond. Seconds since 1970 as float64 are exact to 0.2 µs only.
    times = np.concatenate(
        [round(start * 1e9) + np.rint(np.arange(b - a) * (1e9 / imu.rate)).astype(np.int64)
         for (a, b), start in zip(imu.segments, first.starts, strict=True)]
    )  # fmt: skip
    schema = _record(3, struct.pack("<H", 1) + _text("sensor_msgs/msg/Imu") + _text("ros2msg") + _text(_DEFINITION))
    channel = _record(4, struct.pack("<HH", 1, 1) + _text(TOPIC) + _text("cdr") + _text(""))
    counts = struct.pack("<QHIIIIQQIHQ", times.size, 1, 1, 0, 0, 0, times[0], times[-1], 10, 1, times.size)
    with written_whole(path) as temporary, temporary.open("wb") as file:
        file.write(_MAGIC + _record(1, _text("ros2") + _text("gmwm")) + schema + channel)
        for begin in range(0, times.size, _ROWS):
            part = times[begin : begin + _ROWS]
            rows = np.zeros(part.size, _MESSAGE)
            rows["kind"], rows["length"], rows["channel"] = 5, _MESSAGE.itemsize - 9, 1
            rows["number"] = np.arange(begin, begin + part.size)
            rows["logged"] = rows["sent"] = part
            rows["cdr"], rows["frame_length"], rows["frame"] = b"\0\1\0\0", 4, b"imu\0"
            rows["sec"], rows["nanosec"] = np.divmod(part, 10**9)
            rows["orientation_covariance"][:, 0] = -1
            for sensor, present in sensors.items():
                if not any(present):
                    rows[f"{sensor}_covariance"][:, 0] = -1
                    continue
                for k, axis in enumerate("xyz"):
                    rows[sensor][:, k] = imu[f"{sensor}_{axis}"].values[begin : begin + part.size]
            file.write(rows.tobytes())
        file.write(_record(15, struct.pack("<I", 0)))
        summary = file.tell()
        file.write(schema + channel + _record(11, counts) + _record(2, struct.pack("<QQI", summary, 0, 0)) + _MAGIC)


def _record(kind: int, content: bytes) -> bytes:
    """Return a record: its kind, the length of its content, and the content."""
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    """Return a text after its length; for "" also an empty map."""
    data = text.encode()
    return struct.pack("<I", len(data)) + data
