"""Read binary files of surveying: .imu, with one of six types of records, and NovAtel's .imr.

Records of 56 bytes have one scale; of 32 bytes there are four types, so the user names one (`format="imu:LN200"`). An
.imr has a header of 512 bytes, and converted raw data (NovAtel, Waypoint, "IMR File", docs.novatel.com)."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import GmwmWarning, ReadError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.reporting import warn
from gmwm.base.text import counted
from gmwm.base.units import AXES, STANDARD_GRAVITY, axis_quantity
from gmwm.files.contract import HEAD_BYTES, Channel, Layout, Mark, Reader, Rows, damage_error, register
from gmwm.recording.imu_records import TYPES, RecordType, record

RECORDS_OF_CHUNK = 1 << 18  # number of records in a chunk

# The limits separate the records of every type and byte order in tests/readers/test_waypoint.py and test_imr.py.
_SLOWEST, _SHORTEST = 10.0, 1e-6
"""Longest and shortest interval (s) between the time stamps of an inertial sensor."""
_NEAR_GRAVITY = 0.2
"""Relative agreement with gravity at rest. The scales of record types are equal or differ by 1.5 or more."""


class RecordsReader(Reader):
    """Base of readers of equal records, from any record on; `state` is their type and the header's size (bytes)."""

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the counts and times in the file, unchanged."""
        return self.chunks_from(path, layout, wanted, Mark(0))

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return a mark for each block of records, and one for the end."""
        records = whole_records(path, *layout.state)
        return (*(Mark(row) for row in range(0, records, RECORDS_OF_CHUNK)), Mark(records))

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield blocks of records from a mark on, each field as float64."""
        dtype, offset = layout.state
        with path.open("rb") as file:
            file.seek(offset + mark.row * dtype.itemsize)
            while (block := np.fromfile(file, dtype, RECORDS_OF_CHUNK)).size:
                yield {k: block[dtype.names[k]].astype(np.float64) for k in wanted}


class _NamedReader(RecordsReader):
    """Reader of one type of .imu file, which the user names in the option `format`."""

    kind: ClassVar[RecordType]

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording with the time and six axes, if the records have the size of this type."""
        return (_layout(path, self.kind, self.kind.name),)


@register
class ImuReader(RecordsReader):
    """Reader of .imu files whose type the user has not named."""

    name: ClassVar[str] = "imu"
    extensions: ClassVar[tuple[str, ...]] = (".imu",)

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.6 if records of one of the two sizes have plausible times, 0.1 for a single .imu record."""
        fitting = [_times(head, kind) for kind in _fitting(head)]
        if any(times.size > 1 for times in fitting):
            return 0.6
        return 0.1 if fitting and path.suffix.lower() in self.extensions else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording with the time and six axes, if the scale is known."""
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
        fitting = _fitting(head)
        if len({kind.scales for kind in fitting}) == 1:
            return (_layout(path, fitting[0], " or ".join(kind.name for kind in fitting)),)
        if not fitting:
            raise ReadError(
                f"{path} does not begin with .imu records: neither with 32 nor with 56 bytes are their times in order",
                code="wrong-format",
                advice="Check the name of the format, or leave {--format} out.",
            )
        meaning = ", ".join(f"{_gravity(head, kind):.3g} m/s² as {kind.name}" for kind in fitting)
        likely = [kind for kind in fitting if _heavy(head, kind)] or fitting
        raise ReadError(
            f"{path} holds records of 32 bytes, whose scale depends on the sensor; its accelerometers show {meaning}",
            code="sensor-ambiguous", argument="format", advice="Name the sensor with {--format}; these fit: {formats}.",
            formats=_formats(likely),
        )  # fmt: skip


def _register(of: RecordType) -> None:
    @register
    class NamedType(_NamedReader):
        __doc__ = f".imu records of the type {of.name}."
        name = of.format
        kind = of


for _type in TYPES:
    _register(_type)


def record_channels(
    units: tuple[str, str], scales: tuple[float, float], increments: tuple[bool, bool] = (True, True)
) -> tuple[Channel, ...]:
    """Return the columns of a record: time (s), gyroscopes and accelerometers."""
    sensors = zip(("gyro", "accel"), units, scales, increments, strict=True)
    by_sensor = {name: (unit, flag, scale) for name, unit, scale, flag in sensors}
    axes = (
        Channel(axis, unit, axis=axis, increments=flag, scale=scale)
        for axis in AXES
        for unit, flag, scale in (by_sensor[axis_quantity(axis)],)
    )
    return (Channel("time", "s", "time"), *axes)


def whole_records(path: Path, dtype: np.dtype[Any], offset: int = 0) -> int:
    """Return the number of records after the header."""
    records, over = divmod(path.stat().st_size - offset, dtype.itemsize)
    if over:
        raise ReadError(
            f"{path} holds {counted(records, 'record')} of {dtype.itemsize} bytes and {counted(over, 'byte')} more",
            code="cut-off",
            advice="Copy it again, or name another format with {--format}.",
        )
    if records < 1:
        raise ReadError(f"{path} holds no records", code="empty", advice="Check whether the recording was interrupted.")
    return int(records)


def require_times(
    path: Path, dtype: np.dtype[Any], offset: int = 0, advice: str = "", formats: tuple[str, ...] = ()
) -> None:
    """Require that the first records have plausible times. `formats` are values of `format` that fit better."""
    with path.open("rb") as file:
        file.seek(offset)
        head = file.read(HEAD_BYTES)
    times = _column(head, dtype, "time")
    if not _plausible(times):
        first = ", ".join(f"{t:.6g}" for t in times[:4])
        raise ReadError(
            f"{path}: as records of {dtype.itemsize} bytes its times are not plausible ({first})",
            code="time-implausible", advice=advice, formats=formats,
        )  # fmt: skip


def _layout(path: Path, kind: RecordType, name: str) -> Layout:
    """Return the layout of records of one type, with a warning if the accelerometers do not show gravity."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    others = [other for other in _fitting(head) if other.dtype != kind.dtype]
    advice = "Records of the other size fit; name their type with {--format}, one of {formats}." if others else ""
    require_times(path, kind.dtype, advice=advice, formats=_formats(others))
    whole_records(path, kind.dtype)
    remarks: list[Remark] = []
    if not _heavy(head, kind):
        better = [other for other in TYPES if other.dtype == kind.dtype and _heavy(head, other)]
        gravity = Quantity(_gravity(head, kind), "m/s²")
        decided = "yes" if better else "no"
        doubtful = Remark.of(
            "record-type-doubtful", str(path), type=name, gravity=gravity, better=decided, formats=_formats(better)
        )
        remarks.append(doubtful)
        warn(GmwmWarning(doubtful), stacklevel=2)
    for sensor, factor, unit in (("gyro", kind.gyro, "rad"), ("accel", kind.accel, "m/s")):
        remarks.append(
            Remark.of("unit-named", sensor, case="factor", factor=factor, unit=unit, source="format", type=name)
        )
        remarks.append(Remark.of("unit-named", sensor, case="increments", source="file"))
    channels = record_channels(("rad/s", "m/s²"), (kind.gyro, kind.accel))
    return Layout(channels, remarks=tuple(remarks), state=(kind.dtype, 0))


def _formats(kinds: Sequence[RecordType]) -> tuple[str, ...]:
    """Return the values of the `format` option for some types."""
    return tuple(kind.format for kind in kinds)


def _fitting(head: bytes) -> list[RecordType]:
    """Return the types whose records have plausible times."""
    return [kind for kind in TYPES if len(head) >= kind.dtype.itemsize and _plausible(_times(head, kind))]


def _column(head: bytes, dtype: np.dtype[Any], name: str) -> NDArray[Any]:
    return np.frombuffer(head, dtype, len(head) // dtype.itemsize)[name]


def _times(head: bytes, kind: RecordType) -> Vector:
    return np.asarray(_column(head, kind.dtype, "time"), dtype=np.float64)


def _plausible(times: NDArray[Any]) -> bool:
    """Return whether numbers can be the time stamps of a recording (s)."""
    with np.errstate(all="ignore"):
        # Upper limit of time stamps (s), for seconds of a week and for seconds since 1970
        if not times.size or not np.all(np.abs(times) < 1e10):
            return False
        steps = np.diff(times)
        possible = np.mean((steps >= 0) & (steps <= _SLOWEST)) if steps.size else 1.0
        # Smallest share of plausible intervals; the other intervals are gaps and resets of the clock
        return bool(possible >= 0.9 and (not steps.size or np.median(steps) >= _SHORTEST))


def _gravity(head: bytes, kind: RecordType) -> float:
    """Return the norm of the mean specific force (m/s²) in the first records if they are of this type."""
    with np.errstate(all="ignore"):  # records of another type may overflow
        times = _times(head, kind)
        rate = 1 / float(np.median(np.diff(times))) if times.size > 1 else np.nan
        means = [float(np.mean(_column(head, kind.dtype, axis))) for axis in AXES[3:]]
        return float(np.linalg.norm(means)) * kind.accel * rate


def _heavy(head: bytes, kind: RecordType) -> bool:
    """Return whether the accelerometers show gravity if the records are of this type; True for a single record."""
    return not abs(_gravity(head, kind) / STANDARD_GRAVITY - 1) > _NEAR_GRAVITY


_SIGNATURE = b"$IMURAW\0"
_HEADER_BYTES = 512
# Fields after the byte order: version, whether increments, rate, scales, types and bias of time, sensor's name.
_ORDERS = {0: "<", 1: ">"}
_CLOCKS = {1: "UTC", 2: "GPS"}


@dataclass(frozen=True)
class _Header:
    """Byte order, whether each sensor records increments, rate (Hz), scales to deg and m/s, and remarks."""

    order: str
    increments: tuple[bool, bool]
    rate: float
    scales: tuple[float, float]
    remarks: tuple[Remark, ...]


@register
class ImrReader(RecordsReader):
    """Reader of NovAtel's .imr files, which begin with $IMURAW."""

    name: ClassVar[str] = "imr"
    extensions: ClassVar[tuple[str, ...]] = (".imr",)
    signatures: ClassVar[tuple[bytes, ...]] = (_SIGNATURE,)

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording with the time and six axes, scaled by the factors in the header."""
        header = _header(path)
        dtype = record("i4", header.order)
        whole_records(path, dtype, _HEADER_BYTES)
        advice = "Check the byte order in its header, the ninth byte: 0 is little-endian, 1 is big-endian."
        require_times(path, dtype, _HEADER_BYTES, advice=advice)
        channels = record_channels(("deg/s", "m/s²"), header.scales, header.increments)
        return (
            Layout(
                channels,
                rate=header.rate,
                remarks=(*header.remarks, *_rate(path, header)),
                state=(dtype, _HEADER_BYTES),
            ),
        )


def _header(path: Path) -> _Header:
    """Read the header and check each field."""
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(_SIGNATURE):
        raise ReadError(
            f"{path} does not begin with $IMURAW and a zero byte, as an .imr file does",
            code="wrong-format",
            advice="Check the name of the format, or leave {--format} out.",
        )
    if len(head) < _HEADER_BYTES:
        raise damage_error(f"{path} ends within its header, after {len(head)} of {_HEADER_BYTES} bytes", "cut-off")
    if head[8] not in _ORDERS:
        raise damage_error(f"{path}: the byte order in its header is {head[8]}, expected 0 or 1", "header-damaged")
    order = _ORDERS[head[8]]
    _, angle, velocity, rate, gyro, accel, clock, _, _, name = struct.unpack_from(order + "dii3diid32s", head, 9)
    for what, value in (("bDeltaTheta", angle), ("bDeltaVelocity", velocity)):
        if value not in (0, 1):
            raise damage_error(f"{path}: {what} in its header is {value}, expected 0 or 1", "header-damaged")
    for what, value in (("dDataRateHz", rate), ("dGyroScaleFactor", gyro), ("dAccelScaleFactor", accel)):
        if not (math.isfinite(value) and value > 0):
            raise damage_error(
                f"{path}: {what} in its header is {value:g}, expected a positive number", "header-damaged"
            )
    sensor = name.split(b"\0")[0].decode("latin-1").strip()
    remarks = [
        Remark.of("unit-named", name, case="increments", source="file")
        for name, flag in (("gyro", angle), ("accel", velocity))
        if flag
    ]
    remarks += [Remark.of("file-content", case="sensor", name=sensor)] if sensor else []
    remarks += [Remark.of("time-read", case="read", form="week", clock=_CLOCKS[clock])] if clock in _CLOCKS else []
    return _Header(order, (bool(angle), bool(velocity)), rate=rate, scales=(gyro, accel), remarks=tuple(remarks))


def _rate(path: Path, header: _Header) -> tuple[Remark, ...]:
    """Return a remark if first stamps contradict the header's rate, maybe a setting, by over 1 %."""
    times = np.fromfile(path, record("i4", header.order), 2048, offset=_HEADER_BYTES)["time"].astype(np.float64)
    interval = float(np.median(np.diff(times))) if times.size > 1 else 1 / header.rate
    if abs(interval * header.rate - 1) <= 0.01:
        return ()
    stated, stamps = Quantity(header.rate, "Hz"), Quantity(1 / interval, "Hz")
    return (Remark.of("rate-stated", case="stated", rate=stated, used="no", stamps=stamps),)
