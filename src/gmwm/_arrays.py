"""The one door for array-likes: contiguous float64, finite, or an error that says what came."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._text import counted
from gmwm.errors import DataError, OptionError

Vector = NDArray[np.float64]
"""A one-dimensional float64 array."""
Matrix = NDArray[np.float64]
"""A two-dimensional float64 array."""

AS_GAPS = (
    "missing samples are gaps, and gmwm.Signal.from_missing(x, rate) makes them of NaN and masked values; to cut them "
    "out would glue what is left"
)
"""What to do about samples that are not there."""


def as_vector(values: ArrayLike, name: str, *, at_least: int = 1, finite: bool = True) -> Vector:
    """`values` as a contiguous one-dimensional float64 array, all finite (unless the caller checks that itself).

    Raises
    ------
    DataError
        If it is not numeric, not one-dimensional, shorter than `at_least`, or holds NaN or infinities.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        raise DataError(f"{name} has {int(np.ma.getmaskarray(values).sum())} masked values; {AS_GAPS}")
    if isinstance(values, Mapping):
        raise DataError(f"{name} must be one axis, got a {type(values).__name__}; pick one of {', '.join(values)}")
    _require_samples(values, name)
    try:
        array: NDArray[Any] = np.asarray(values)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"dtype {array.dtype}")
        vector = np.ascontiguousarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} must be real numbers, got {type(values).__name__} ({error})") from error
    if array.ndim != 1:
        hint = "; pass one axis at a time, as data[:, k]" if array.ndim == 2 else ""
        raise DataError(f"{name} must be one-dimensional, got shape {array.shape}{hint}")
    if vector.size < at_least:
        raise DataError(f"{name} must have at least {counted(at_least, 'value')}, got {vector.size}")
    if finite:
        require_finite(vector, name)
    return vector


def require_finite(vector: Vector, name: str) -> None:
    """Raise a DataError that says how many values are not finite, and where the first one is."""
    # A sum is finite unless a value is not (or it overflows): one fast pass decides the usual case.
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(np.sum(vector))
    if np.isfinite(total):
        return
    bad = ~np.isfinite(vector)
    count = int(np.count_nonzero(bad))
    if count:
        raise DataError(
            f"{name} must be finite, got {count} NaN or infinite values of {vector.size} "
            f"(the first at index {int(np.argmax(bad))}); {AS_GAPS}"
        )


def _require_samples(values: object, name: str) -> None:
    """Raise where `values` are no samples but what holds them: a file's path, a recording, a simulation."""
    if isinstance(values, str | bytes | os.PathLike):
        raise DataError(
            f"{name} must be a signal or its samples, got {values!r}; a file is read first: gmwm.read(path), and then "
            "an axis of it"
        )
    # An Imu, a SimulatedImu and a SimulatedSignal, which are in higher layers.
    for attribute, way in (("signals", "[{!r}]"), ("axes", ".imu[{!r}]"), ("components", ".signal")):
        held = getattr(values, attribute, None)
        if isinstance(held, Mapping) and (attribute != "axes" or hasattr(values, "imu")):
            raise DataError(
                f"{name} must be one signal, got a whole {type(values).__name__} of {', '.join(held)}; pass "
                f"{name}{way.format(next(iter(held)))}"
            )


def as_rate(rate: float | None, name: str = "rate") -> float:
    """A sampling rate in Hz: positive and finite."""
    if rate is None:
        raise OptionError(f"{name} (Hz) is missing: pass {name}=, samples per second")
    if isinstance(rate, bool | np.bool_ | str | bytes):
        raise OptionError(f"{name} must be a number (Hz), got {rate!r}; pass it as 100.0, samples per second")
    try:
        value = float(rate)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} must be a number (Hz), got {rate!r}") from error
    if not (np.isfinite(value) and value > 0):
        raise OptionError(f"{name} must be positive and finite (Hz), got {rate!r}; did you pass the sampling interval?")
    return value


def as_levels(levels: int | ArrayLike) -> NDArray[np.int64]:
    """Wavelet levels: a number J stands for 1 … J; otherwise integers from 1 to 62, ascending."""
    array = np.asarray(levels)
    if array.dtype.kind not in "iu":
        raise OptionError(f"levels must be integers, got {levels!r}")
    result = np.arange(1, int(array) + 1) if array.ndim == 0 else array.astype(np.int64)
    if result.ndim != 1 or result.size == 0 or result[0] < 1 or result[-1] > 62 or np.any(np.diff(result) <= 0):
        raise OptionError(f"levels must be ascending integers from 1 to 62, or their number J, got {levels!r}")
    return result.astype(np.int64)


def freeze(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, read-only."""
    array.flags.writeable = False
    return array
