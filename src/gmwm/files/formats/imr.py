"""Read NovAtel's .imr files: a header of 512 bytes, and raw inertial measurements that Waypoint has converted.

Source: NovAtel, Waypoint documentation, "IMR File" (docs.novatel.com).
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Quantity, Remark
from gmwm.files.contract import Layout, damage_error, register
from gmwm.files.formats.waypoint import RecordsReader, record_channels, require_times, whole_records
from gmwm.recording.imu_records import record

_SIGNATURE = b"$IMURAW\0"
_HEADER_BYTES = 512
# Fields after the signature and the byte order: version, whether angles and velocities are increments, rate, two
# scales, two types of time, bias of time, and name of the sensor. The rest of the header is not used.
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
    """Return a remark if the first time stamps contradict the rate of the header by more than 1 %: it may be a
    setting."""
    times = np.fromfile(path, record("i4", header.order), 2048, offset=_HEADER_BYTES)["time"].astype(np.float64)
    interval = float(np.median(np.diff(times))) if times.size > 1 else 1 / header.rate
    if abs(interval * header.rate - 1) <= 0.01:
        return ()
    stated, stamps = Quantity(header.rate, "Hz"), Quantity(1 / interval, "Hz")
    return (Remark.of("rate-stated", case="stated", rate=stated, used="no", stamps=stamps),)
