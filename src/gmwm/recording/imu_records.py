"""Types of .imu files for reader and writer: records of the time (s), three increments of angle and three of velocity,
little-endian without padding. No header states type or scale."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.base.units import AXES

PREFIX = "imu:"  # prefix of a type in the `format` option

_ARCSECOND = math.pi / 180 / 3600


@dataclass(frozen=True)
class RecordType:
    """A type of .imu file."""

    name: str  # name of the sensor
    word: Literal["i4", "f8"]  # type of the six increments: 32-bit counts (records of 32 bytes) or doubles (56 bytes)
    gyro: float  # size of one count, in rad and m/s
    accel: float

    @property
    def format(self) -> str:
        """The value of the `format` option for this type."""
        return f"{PREFIX}{self.name}"

    @property
    def dtype(self) -> np.dtype[Any]:
        """NumPy type of a record."""
        return record(self.word)

    @property
    def scales(self) -> tuple[float, ...]:
        """Size of one count of each of the six axes, in rad and m/s."""
        return (self.gyro,) * 3 + (self.accel,) * 3


def record(word: str, order: str = "<") -> np.dtype[Any]:
    """Return the NumPy type of a record with the time and the six axes, in the byte order "<" or ">"."""
    return np.dtype([("time", f"{order}f8"), *((axis, f"{order}{word}") for axis in AXES)])


TYPES = (
    RecordType("IMAR", "i4", 0.1 * _ARCSECOND, 0.00152588e-3),
    RecordType("LN200", "i4", 2.0**-21, 2.0**-14),
    RecordType("LN200IG", "i4", 2.0**-19, 2.0**-14),
    RecordType("IXSEA", "f8", _ARCSECOND, 1e-3),
    RecordType("NAVCHIP_INT", "i4", 6.25e-6, 3.90625e-5),
    RecordType("NAVCHIP_FLT", "f8", _ARCSECOND, 1e-3),
)
"""All types. IXSEA and NAVCHIP_FLT differ only in their names."""


def counts(values: NDArray[Any], unit: float) -> NDArray[np.int64]:
    """Round increments (N,) to whole counts of size `unit`, with carried remainders: n_k = [S_k] − [S_{k−1}], S_k =
    (v_1 + … + v_k) / u, so the sum is off by at most half a count."""
    exact = np.asarray(values, dtype=np.float64) / unit
    nearest = np.rint(exact)
    # Restored counts differ from integers by float64 rounding, which a sum would accumulate; 1e-9 is far above it and
    # far below a count (tests/test_writers.py).
    if np.all(np.abs(exact - nearest) <= 1e-9 * np.maximum(np.abs(nearest), 1.0)):
        return nearest.astype(np.int64)
    return np.diff(np.rint(np.cumsum(exact)), prepend=0.0).astype(np.int64)
