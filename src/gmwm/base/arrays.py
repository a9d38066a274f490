"""Convert array-likes to contiguous, finite float64 arrays, and check rates and levels."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from types import MappingProxyType
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.errors import DataError, OptionError
from gmwm.base.text import counted, with_article

Vector = NDArray[np.float64]  # a one-dimensional float64 array
Matrix = NDArray[np.float64]  # a two-dimensional float64 array
Integers = NDArray[np.int64]
Booleans = NDArray[np.bool_]

NEGLIGIBLE_EXPONENT = 40.0  # x beyond which e^(−x) = 4·10⁻¹⁸ is below the rounding error of 1

MISSING_SAMPLES = "Mark missing samples as gaps with `gmwm.Signal.from_missing(x, rate)`; do not remove them."
"""Advice for NaN and masked values. Cutting them out would join samples that are not neighbours in time."""


def as_vector(values: ArrayLike, name: str, *, at_least: int = 1, finite: bool = True) -> Vector:
    """Convert to a contiguous one-dimensional float64 array."""
    if _is_vector(values) and values.size >= max(at_least, 1) and (not finite or math.isfinite(_core.mean(values))):
        return values
    if isinstance(values, np.ma.MaskedArray) and np.ma.is_masked(values):
        masked = int(np.ma.getmaskarray(values).sum())
        raise DataError(
            f"{name} has {counted(masked, 'masked value')}", argument=name, got=values, advice=MISSING_SAMPLES
        )
    if isinstance(values, Mapping):
        raise DataError(
            f"{name} must be one axis; got {with_article(type(values).__name__)} of {', '.join(values)}",
            argument=name, got=values, advice="Pass one of its axes, for example `data[{axis}]`.",
            axis=repr(next(iter(values), "gyro_x")),
        )  # fmt: skip
    _require_samples(values, name)
    try:
        array: NDArray[Any] = np.asarray(values)
        if array.dtype.kind not in "fiub":
            raise TypeError(f"dtype {array.dtype}")
        vector = np.ascontiguousarray(array, dtype=np.float64)
        if not vector.flags.aligned:  # for example, a part of a file in memory
            vector = vector.copy()
    except (TypeError, ValueError, OverflowError) as error:
        message = f"{name} must be real numbers; got {type(values).__name__} ({error})"
        raise DataError(message, argument=name, got=values) from error
    if array.ndim != 1:
        advice = "Pass one axis at a time, for example `data[:, 0]`." if array.ndim == 2 else ""
        message = f"{name} must be one-dimensional; got shape {array.shape}"
        raise DataError(message, argument=name, got=values, advice=advice)
    if vector.size < at_least:
        message = f"{name} must have at least {counted(at_least, 'value')}; got {vector.size}"
        raise DataError(message, argument=name, got=values)
    if finite:
        require_finite(vector, name)
    return vector


def _is_vector(values: object) -> TypeGuard[Vector]:
    """Return whether `values` is already a vector; for chunks, other checks take ten times as long as a sum."""
    return (
        type(values) is np.ndarray
        and values.ndim == 1
        and values.dtype == np.float64
        and values.flags.c_contiguous
        and values.flags.aligned
    )


def require_finite(vector: Vector, name: str) -> None:
    """Raise a DataError with the number of values that are not finite and the index of the first one."""
    # The sum is finite unless a value is not finite or the sum overflows: one fast pass is enough for most data.
    with np.errstate(over="ignore", invalid="ignore"):
        total = float(np.sum(vector))
    if np.isfinite(total):
        return
    bad = ~np.isfinite(vector)
    count = int(np.count_nonzero(bad))
    if count:
        raise DataError(
            f"{name} must be finite; {count} of {vector.size} values are NaN or infinite, the first at index "
            f"{int(np.argmax(bad))}", argument=name, got=vector, advice=MISSING_SAMPLES, count=count,
            index=int(np.argmax(bad)),
        )  # fmt: skip


def _require_samples(values: object, name: str) -> None:
    """Raise a DataError if `values` is not an array, but the path of a file, a recording or a simulation."""
    if isinstance(values, str | bytes | os.PathLike):
        raise DataError(
            f"{name} must be a signal or its samples; got {values!r}", argument=name, got=values,
            advice="Read the file with `gmwm.read(path)`, and pass one of its axes.",
        )  # fmt: skip
    # An Imu, a SimulatedImu and a SimulatedSignal. This module cannot import them, because their layers are higher.
    for attribute, access in (("signals", "[{!r}]"), ("axes", ".imu[{!r}]"), ("components", ".signal")):
        held = getattr(values, attribute, None)
        if isinstance(held, Mapping) and (attribute != "axes" or hasattr(values, "imu")):
            raise DataError(
                f"{name} must be one signal; got {with_article(type(values).__name__)} of {', '.join(held)}",
                argument=name, got=values, advice="Pass `{one}`.", one=name + access.format(next(iter(held))),
            )  # fmt: skip


def as_whole_number(value: int, name: str, least: int, most: float = math.inf, *, expected: str = "") -> int:
    """Check a whole number from `least` to `most`; the error may state them in the words `expected`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        usual = f"a whole number of at least {least}" if most == math.inf else f"a whole number from {least} to {most}"
        raise OptionError(argument=name, expected=expected or usual, got=value)
    return int(value)


def as_number(value: float, name: str, within: Callable[[float], bool], expected: str) -> float:
    """Check a finite number for which `within` holds; the error says what was `expected`."""
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not (is_number and abs(value) <= sys.float_info.max and within(value)):
        raise OptionError(argument=name, expected=expected, got=value)
    return float(value)


def as_rate(rate: float | None) -> float:
    """Check a sampling rate: a positive, finite number (Hz)."""
    if type(rate) is float and 0 < rate < math.inf:
        return rate
    if rate is None:
        raise OptionError(
            "the sampling rate is missing", argument="rate", advice="Pass the samples per second with {--rate}."
        )
    if isinstance(rate, bool | np.bool_ | str | bytes):
        raise OptionError(argument="rate", expected="a positive number (Hz)", got=rate)
    try:
        value = float(rate)
    except (TypeError, ValueError, OverflowError) as error:
        raise OptionError(argument="rate", expected="a positive number (Hz)", got=rate) from error
    if not (np.isfinite(value) and value > 0):
        raise OptionError(
            argument="rate", expected="a positive, finite number (Hz)", got=rate,
            advice="Pass the sampling rate, not the sampling interval.",
        )  # fmt: skip
    return value


def require_rate(rate: float | None, known: float, owner: str = "signal") -> None:
    """Raise OptionError if a `rate` is given that differs from the `known` rate (Hz) of its owner."""
    if rate is not None and as_rate(rate) != known:
        raise OptionError(
            f"the rate of {rate:g} Hz contradicts the {owner}, which has {known:g} Hz", argument="rate", got=rate,
            advice="Leave {--rate} out.",
        )  # fmt: skip


def as_levels(levels: int | ArrayLike) -> NDArray[np.int64]:
    """Check wavelet levels: ascending integers from 1 to 62 (scales of 64 bits), or a number J for 1, …, J."""
    if type(levels) is np.ndarray and levels.dtype == np.int64 and levels.ndim == 1 and _are_levels(levels.tobytes()):
        return levels
    expected = "ascending integers from 1 to 62, or the number of levels"
    array = np.asarray(levels)
    if array.dtype.kind not in "iu":
        raise OptionError(argument="levels", expected=expected, got=levels)
    result = np.arange(1, int(array) + 1, dtype=np.int64) if array.ndim == 0 else array.astype(np.int64)
    if result.ndim != 1 or not _are_levels(result.tobytes()):
        raise OptionError(argument="levels", expected=expected, got=levels)
    return result


@lru_cache(maxsize=128)
def _are_levels(content: bytes) -> bool:
    """Return whether the bytes of an array are ascending levels; every curve of a fit asks this for the same levels."""
    levels = np.frombuffer(content, dtype=np.int64)
    return bool(levels.size and levels[0] >= 1 and levels[-1] <= 62 and np.all(levels[1:] > levels[:-1]))


def row_medians(rows: Matrix) -> Vector:
    """Return the median of each row of finite values (n, m), three times as fast as `numpy.median`."""
    middle = rows.shape[1] // 2
    if middle > 128 and rows.size:  # the vector instructions of NumPy are faster for shorter rows only
        return _core.row_medians(np.ascontiguousarray(rows))
    parted = np.partition(rows, middle, axis=1)
    upper = parted[:, middle]
    return upper.copy() if rows.shape[1] % 2 else (parted[:, :middle].max(axis=1) + upper) / 2


def runs_of(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the half-open index ranges (k, 2) of consecutive true values.

    >>> runs_of(np.array([True, False, True, True])).tolist()
    [[0, 1], [2, 4]]
    """
    padded = np.concatenate([[False], flags, [False]])
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)


def joined(parts: Sequence[Vector]) -> Vector:
    """Join one or more arrays to a read-only one, without a copy if they are consecutive parts of one array.

    >>> x = np.arange(6.0)
    >>> np.shares_memory(joined([x[1:3], x[3:6]]), x), joined([x[3:], x[:2]]).tolist()
    (True, [3.0, 4.0, 5.0, 0.0, 1.0])
    """
    owner, address = parts[0].base, parts[0].ctypes.data
    if isinstance(owner, np.ndarray) and owner.ndim == 1 and owner.flags.c_contiguous:
        begins = np.cumsum([address, *(part.nbytes for part in parts)]).tolist()
        if all(
            part.base is owner and part.dtype == owner.dtype and part.flags.c_contiguous and part.ctypes.data == begin
            for part, begin in zip(parts, begins, strict=False)
        ):
            at = (address - owner.ctypes.data) // owner.itemsize
            return freeze(owner[at : at + sum(part.size for part in parts)])
    return freeze(np.concatenate(parts))


def freeze(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array


class FrozenArrays:
    """Base of dataclasses whose arrays, also those in a mapping, become read-only."""

    def __post_init__(self) -> None:
        for value in vars(self).values():
            for array in value.values() if isinstance(value, Mapping) else (value,):
                if isinstance(array, np.ndarray):
                    freeze(array)


@dataclass(frozen=True, eq=False, repr=False)
class FrozenMappings:
    """Base of dataclasses whose mappings become read-only, and that can still be copied and pickled."""

    def __post_init__(self) -> None:
        for field in fields(self):
            if isinstance(value := getattr(self, field.name), Mapping):
                object.__setattr__(self, field.name, MappingProxyType(dict(value)))

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled, so the copy is built from dicts.
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        plain = {name: value.copy() if isinstance(value, MappingProxyType) else value for name, value in values.items()}
        return partial(type(self), **plain), ()
