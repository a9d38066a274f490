"""Write recordings to CSV, Parquet (both keep every bit), MCAP (sensor_msgs/msg/Imu of ROS 2; mcap.dev/spec, version 0)
or .imu records, and as tables in memory."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.atomic_files import written_whole
from gmwm.base.errors import DataError, OptionError
from gmwm.base.text import html_table
from gmwm.base.threads import require_threads
from gmwm.base.units import AXES
from gmwm.recording.imu_records import TYPES, RecordType, counts
from gmwm.recording.signals import Imu, Signal

MCAP = ".mcap"  # extension of MCAP files
TOPIC = "/imu/data_raw"
_MAGIC = b"\x89MCAP0\r\n"
_ROWS = 1 << 18  # number of messages that are written at once: 91 MB
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
    """Write an .mcap file in whole nanoseconds; a covariance of −1 marks a missing sensor, as the message defines."""
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


SUFFIXES = (".csv", ".parquet")  # file name extensions of tables; the extension chooses the format

RECORDS = ".imu"  # extension of files of .imu records; the option `format` chooses the type of the records


def write(imu: Imu | Signal, path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Write a recording; see `Imu.write`."""
    imu, target = _recording(imu), Path(path)
    suffix = target.suffix.lower()
    if suffix not in (*SUFFIXES, MCAP, RECORDS):
        raise OptionError(
            argument="path", expected=f"a path that ends in {', '.join((*SUFFIXES, MCAP))} or {RECORDS}", got=str(path)
        )
    if suffix == RECORDS:
        _write_records(imu, target, _record_type(format, target))
    elif format is not None:
        raise OptionError(argument="format", expected=f"left out for a file other than {RECORDS}", got=format)
    elif suffix == MCAP:
        write_mcap(imu, target)
    else:
        write_table(columns_of(imu), target)


def _recording(given: object) -> Imu:
    """Return the recording to write."""
    if isinstance(given, Imu):
        return given
    if isinstance(given, Signal) and given.axis in AXES:
        return Imu({given.axis: given})
    if isinstance(given, Signal):
        raise OptionError(
            argument="imu", expected=f"an Imu or a Signal whose axis is one of {', '.join(AXES)}", got=given,
            advice="Name the axis: `gmwm.Imu.from_arrays({example}, signal.rate)`.",
            example="{'gyro_x': signal.values}",
        )  # fmt: skip
    raise OptionError(
        argument="imu", expected="an Imu", got=given,
        advice="Make one from arrays: `gmwm.Imu.from_arrays({example}, rate)`.", example="{'gyro_x': x}",
    )  # fmt: skip


def table_path(path: str | os.PathLike[str]) -> Path:
    """Return the path of a table, which ends in .csv or .parquet."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise OptionError(argument="path", expected=f"a path that ends in {' or '.join(SUFFIXES)}", got=str(path))
    return target


def write_table(columns: Mapping[str, Vector], path: str | os.PathLike[str]) -> None:
    """Write named columns of the same length to a .csv or .parquet file, which is replaced when it is complete."""
    import polars as pl

    target = table_path(path)
    require_threads(target)
    frame = pl.DataFrame(dict(columns))
    # Polars opens no path that is not UTF-8.
    with written_whole(target) as temporary, temporary.open("wb") as file:
        if target.suffix.lower() == ".csv":
            frame.write_csv(file)
        else:
            frame.write_parquet(file)


def columns_of(imu: Imu) -> dict[str, Vector]:
    """Return the columns of a table by name: the time, the axes and the temperature."""
    columns = {"time [s]": imu[imu.axes[0]].times()}
    for axis in imu:
        unit = imu[axis].unit
        columns[f"{axis} [{unit}]" if unit else axis] = imu[axis].values
    if imu.temperature is not None:
        columns["temperature [°C]"] = imu.temperature
    return columns


def xarray_of(imu: Imu) -> Any:
    """Return a recording as a data set of xarray."""
    import xarray

    variables = {axis: ("time", signal.values, {"units": signal.unit}) for axis, signal in imu.signals.items()}
    if imu.temperature is not None:
        variables["temperature"] = ("time", imu.temperature, {"units": "°C"})
    times = ("time", imu[imu.axes[0]].times(), {"units": "s"})
    return xarray.Dataset(variables, coords={"time": times}, attrs={"source": imu.source})


def html_of(imu: Imu) -> str:
    """Return the mean and the standard deviation of each axis as a table for notebooks."""
    rows = (
        (axis, f"{signal.values.mean():.6g}", f"{signal.values.std():.4g}", signal.unit)
        for axis, signal in imu.signals.items()
    )
    size = f"{len(imu)} samples at {imu.rate:g} Hz, {imu.duration:g} s"
    segments = f", {len(imu.segments)} segments between gaps" if len(imu.segments) > 1 else ""
    title = f"{escape(imu.source)}: {size}" if imu.source else size
    return f"<p>{title}{segments}</p>{html_table(('axis', 'mean', 'standard deviation', 'unit'), rows)}"


def _record_type(format: str | None, target: Path) -> RecordType:
    """Return the type of the records to write."""
    named = {kind.format.casefold(): kind for kind in TYPES}
    names = ", ".join(kind.format for kind in TYPES)
    if format is None:
        raise OptionError(argument="format", expected=f"one of {names} for {target.name}", got=None)
    if not isinstance(format, str) or format.casefold() not in named:
        raise OptionError(argument="format", expected=f"one of {names}", got=format)
    return named[format.casefold()]


def _write_records(imu: Imu, target: Path, kind: RecordType) -> None:
    """Write records with a time and six increments, in the counts of the record type."""
    missing = [axis for axis in AXES if axis not in imu.axes]
    if missing:
        raise DataError(
            f"an {RECORDS} file holds six axes, but the recording has no {', '.join(missing)}",
            advice="Write a .csv or .parquet file.",
        )
    records = np.empty(len(imu), kind.dtype)
    records["time"] = imu[AXES[0]].times()
    for axis, scale in zip(AXES, kind.scales, strict=True):
        values = imu[axis].values
        if kind.word == "f8":
            records[axis] = values / (scale * imu.rate)
            continue
        limit = np.iinfo(np.int32).max
        largest = float(np.max(np.abs(values))) / (scale * imu.rate)
        if largest >= limit:
            raise DataError(
                f"{axis} reaches {largest:.3g} counts of {kind.format}, but 32 bits hold at most {limit}",
                argument="imu",
                got=axis,
            )
        records[axis] = counts(values, scale * imu.rate)
    with written_whole(target) as temporary:
        records.tofile(temporary)
