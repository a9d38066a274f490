"""NovAtel's .imr: the raw measurements of an inertial sensor as Waypoint converts them, with a header of 512 bytes.

Source: NovAtel, Waypoint documentation, "IMR File" (docs.novatel.com).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from gmwm.errors import ReadError
from gmwm.imu_records import record
from gmwm.readers.base import Layout, Mark, Reader, Rows, register
from gmwm.readers.waypoint import record_channels, record_chunks, record_marks, require_times, whole_records

_SIGNATURE = b"$IMURAW\0"
_HEADER_BYTES = 512
# Behind the signature and the byte order: version, increments of angle? of velocity?, rate, two scales, two kinds of
# time, bias of time, name of the sensor. What follows is of no use here.
_FIELDS = "dii3diid32s"
_ORDERS = {0: "<", 1: ">"}
_CLOCKS = {1: "UTC", 2: "GPS"}


@dataclass(frozen=True)
class _Header:
    """What the header says: byte order, which sensors give increments, rate (Hz), scales to deg and m/s, notes."""

    order: str
    increments: tuple[bool, bool]
    rate: float
    scales: tuple[float, float]
    notes: tuple[str, ...]


@register
class ImrReader(Reader):
    """NovAtel Waypoint .imr, by its signature $IMURAW."""

    name: ClassVar[str] = "imr"
    extensions: ClassVar[tuple[str, ...]] = (".imr",)

    def sniff(self, path: Path, head: bytes) -> float:
        """1 if the file begins with $IMURAW and a zero."""
        return 1.0 if head.startswith(_SIGNATURE) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Time and six axes, as the header scales them."""
        header = _header(path)
        dtype = record("i4", header.order)
        whole_records(path, dtype, _HEADER_BYTES)
        way_out = "; does the byte order in its header (the ninth byte: 0 little-endian, 1 big-endian) hold?"
        require_times(path, dtype, _HEADER_BYTES, way_out)
        channels = record_channels(("deg/s", "m/s²"), header.scales, header.increments)
        return (Layout(channels, rate=header.rate, notes=(*header.notes, *_pace(path, header)), state=header),)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Counts and times as they stand in the file."""
        header: _Header = layout.state
        return record_chunks(path, record("i4", header.order), _HEADER_BYTES, wanted)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Any record."""
        return record_marks(path, record("i4", layout.state.order), _HEADER_BYTES)

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Records from one on."""
        return record_chunks(
            path, record("i4", layout.state.order), offset=_HEADER_BYTES, wanted=wanted, first=mark.row
        )


def _header(path: Path) -> _Header:
    """The header, checked field by field."""
    with path.open("rb") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(_SIGNATURE):
        raise ReadError(f"{path} does not begin with $IMURAW and a zero, as an .imr file does")
    if len(head) < _HEADER_BYTES:
        raise ReadError(f"{path} ends within its header, after {len(head)} of {_HEADER_BYTES} bytes; was it cut off?")
    if head[8] not in _ORDERS:
        raise ReadError(f"{path}: the byte order in its header must be 0 or 1, got {head[8]}")
    order = _ORDERS[head[8]]
    _, angle, velocity, rate, gyro, accel, clock, _, _, name = struct.unpack_from(order + _FIELDS, head, 9)
    for what, value in (("bDeltaTheta", angle), ("bDeltaVelocity", velocity)):
        if value not in (0, 1):
            raise ReadError(f"{path}: {what} in its header must be 0 or 1, got {value}")
    for what, value in (("dDataRateHz", rate), ("dGyroScaleFactor", gyro), ("dAccelScaleFactor", accel)):
        if not (math.isfinite(value) and value > 0):
            raise ReadError(f"{path}: {what} in its header must be a positive number, got {value:g}")
    sensor = name.split(b"\0")[0].decode("latin-1").strip()
    kinds = " and ".join(
        f"{'increments' if flag else 'rates'} of {what}" for what, flag in (("angle", angle), ("velocity", velocity))
    )
    notes = [f"{kinds}; increments times the rate" if angle or velocity else kinds]
    notes += [f"sensor {sensor!r}"] if sensor else []
    notes += [f"times are seconds of the {_CLOCKS[clock]} week"] if clock in _CLOCKS else []
    return _Header(order, (bool(angle), bool(velocity)), rate=rate, scales=(gyro, accel), notes=tuple(notes))


def _pace(path: Path, header: _Header) -> tuple[str, ...]:
    """A remark where the first time stamps contradict the rate of the header."""
    times = np.fromfile(path, record("i4", header.order), 2048, offset=_HEADER_BYTES)["time"].astype(np.float64)
    interval = float(np.median(np.diff(times))) if times.size > 1 else 1 / header.rate
    if abs(interval * header.rate - 1) <= 0.01:
        return ()
    return (f"the header states {header.rate:g} Hz, the first time stamps {1 / interval:.6g} Hz: the stamps are used",)
