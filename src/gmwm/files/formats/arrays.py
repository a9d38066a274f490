"""Convert named arrays to the columns of a recording, for NumPy, MATLAB and HDF5 files.

Arrays of equal length form a recording, three columns named as a sensor x, y, z; scalars, as the rate, describe it."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES, find_unit
from gmwm.files.columns.column_names import recognise, role_of
from gmwm.files.contract import Channel, Layout, Mark, Reader, Rows

ARRAY_ROWS = 1 << 20  # number of rows in a chunk

MAX_ARRAYS = 1000
"""Largest number of arrays that are read from a file. A file with more is no recording, and takes long to read."""

MAX_COLUMNS = 64
"""Largest number of columns of a table. An array with more columns is an image or a matrix, not a recording."""

RowReader = Callable[[int, int, int], NDArray[Any]]
"""Function of (start, stop, axis) that reads a part of an array along axis 0 or 1. A scalar is read whole."""

_RATE_NAMES = {
    "rate", "fs", "freq", "frequency", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency",
    "updaterate", "imurate", "f",
}  # fmt: skip
_SLASH = re.compile(r"/(?![^\[({]*[\])}])")
_STATED = re.compile(r"[`'\"]?(\w+)[`'\"]?\s+(?:(?:is|are|given|measured)\s+)*in\s+([^\s,;()]*[^\s,;().])")
_DESCRIPTION = 1 << 14  # characters of a description that are searched
_BRACKET = re.compile(r"\s*[\[({<].*$")


@dataclass(frozen=True)
class Array:
    """An array in a file."""

    name: str  # path in the file; its last part is the name of the array
    shape: tuple[int, ...]  # (N,) for a column, (N, k) for a table
    dtype: np.dtype[Any]  # type of the numbers in the array
    rows: RowReader  # function that reads a part of the array; see `RowReader`
    unit: str = ""  # unit that the file states for the array; "" if none
    # role of each column ("time" or an axis such as "gyro_x") if the format determines it; "" for no role
    axes: tuple[str, ...] = ()
    units: tuple[str, ...] = ()  # unit of each column if the format determines it

    @property
    def columns(self) -> int:
        """Number of columns; 1 for a one-dimensional array."""
        return self.shape[1] if len(self.shape) == 2 else 1


def upright(array: Array) -> Array:
    """Transpose an array with more columns than rows, and remove axes of length 1, so that rows are samples."""
    shape, load = array.shape, array.rows
    if len(shape) != 2:
        return array
    if shape[1] == 1:
        return replace(array, shape=shape[:1], rows=lambda start, stop, axis: load(start, stop, 0)[:, 0])
    if shape[0] == 1:
        return replace(array, shape=shape[1:], rows=lambda start, stop, axis: load(start, stop, 1)[0])
    if shape[0] < min(shape[1], MAX_COLUMNS + 1):
        return replace(array, shape=shape[::-1], rows=lambda start, stop, axis: load(start, stop, 1 - axis).T)
    return array


def is_rate(name: str) -> bool:
    """Return whether a scalar with this name is a sampling rate.

    >>> is_rate("sample_rate"), is_rate("rate_max")
    (True, False)
    """
    return re.sub(r"[^a-z]", "", name.casefold()) in _RATE_NAMES


def with_stated_units(arrays: Sequence[Array], texts: Sequence[str]) -> list[Array]:
    """Return the arrays with the units that a description in the file states, such as "`imu_gyr` in rad/s"."""
    units: dict[str, str] = {}
    for text in texts:
        for name, unit in _STATED.findall(text[:_DESCRIPTION]):
            if find_unit(unit) is not None:
                units.setdefault(name, unit)
    return [array if array.unit else replace(array, unit=units.get(split_path(array.name)[1], "")) for array in arrays]


def layouts_of(arrays: Sequence[Array], path: object, remarks: tuple[Remark, ...] = ()) -> tuple[Layout, ...]:
    """Group arrays of the same length into recordings, and by their folders in the file if an axis occurs twice."""
    usable = [upright(array) for array in arrays if array.dtype.kind in "iufMm" and len(array.shape) <= 2]
    series = [a for a in usable if len(a.shape) in (1, 2) and a.shape[0] > 1 and 0 < a.columns <= MAX_COLUMNS]
    if not series:
        shown = ", ".join(f"{a.name} {'×'.join(map(str, a.shape)) or 'number'}" for a in arrays[:8])
        raise ReadError(
            f"{path} holds no columns of numbers; its arrays: {shown or 'none'}",
            code="no-numbers",
            advice="Save one array of shape (samples, columns), or one array for each axis or sensor.",
        )
    groups: dict[object, list[Array]] = {}
    for array in series:
        groups.setdefault(array.shape[0], []).append(array)
    split = [part for group in groups.values() for part in _folder_groups(group)]
    inertial = [part for part in split if any(axis in AXES for axis in _roles(part))]
    chosen = inertial or [max(split, key=lambda part: (part[0].shape[0], sum(a.columns for a in part)))]
    unused = [a.name for part in split if part not in chosen for a in part]
    left_out = (Remark.of("left-out", case="names", kind="arrays", names=tuple(unused)),) if unused else ()
    topics = _topics(chosen)
    return tuple(
        _layout(part, _rate(usable, part), topic=topic, remarks=(*remarks, *left_out), stray=_stray_time(part, split))
        for part, topic in zip(chosen, topics, strict=True)
    )


class ArraysReader(Reader):
    """Base class of the readers of named arrays. A layout has its arrays and their columns as `state`."""

    random_access: ClassVar[bool] = False  # whether a file can be read from any row

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield rows of the arrays."""
        return chunks_of(layout, wanted, path)

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return a mark for each chunk, and one for the end of the arrays."""
        total = layout.state[0][0].shape[0]
        return (*(Mark(row) for row in range(0, total, ARRAY_ROWS)), Mark(total)) if self.random_access else ()

    def chunks_from(self, path: Path, layout: Layout, wanted: Sequence[int], mark: Mark) -> Iterator[Rows]:
        """Yield the rows from a mark on."""
        return chunks_of(layout, wanted, path, mark.row)


def chunks_of(layout: Layout, wanted: Sequence[int], path: object, first: int = 0) -> Iterator[Rows]:
    """Yield wanted columns, `ARRAY_ROWS` rows at a time; integers as int64, others as float64."""
    columns: tuple[tuple[Array, int], ...] = layout.state
    total = columns[0][0].shape[0]
    for start in range(first, total, ARRAY_ROWS):
        stop = min(start + ARRAY_ROWS, total)
        read: dict[int, NDArray[Any]] = {}
        chunk = {}
        for k in wanted:
            array, column = columns[k]
            if id(array) not in read:
                read[id(array)] = array.rows(start, stop, 0)
            values = read[id(array)]
            chunk[k] = _plain(values if values.ndim == 1 else values[:, column], array.name, path)
        yield chunk


def _plain(values: NDArray[Any], name: str, path: object) -> NDArray[Any]:
    if values.dtype.kind in "Mm":
        values = values.astype(np.int64)
    if values.dtype.kind == "u" and values.size and int(values.max()) > np.iinfo(np.int64).max:
        raise ReadError(
            f"{path}: {name} holds integers above 2⁶³",
            code="integers-too-large",
            advice="Leave it out with {--columns}.",
        )
    target = np.int64 if values.dtype.kind in "iu" else np.float64
    return np.ascontiguousarray(values, dtype=target)


def fields_of(name: str, shape: tuple[int, ...], dtype: np.dtype[Any], rows: RowReader, unit: str = "") -> list[Array]:
    """Describe an array in a file. If its elements are records, return one `Array` for each field of the records."""
    if dtype.names is None:
        return [Array(name, shape, dtype=dtype, rows=rows, unit=unit or _date_unit(dtype))]
    arrays = []
    for field in dtype.names:
        base, inner = dtype[field].subdtype or (dtype[field], ())
        path = f"{name}/{field}" if name else field
        arrays.append(
            Array(path, (*shape, *inner), dtype=base, rows=_Field(rows, field), unit=unit or _date_unit(base))
        )
    return arrays


class _Field:
    """One named field of an array of records."""

    def __init__(self, rows: RowReader, name: str) -> None:
        self._rows, self._name = rows, name

    def __call__(self, start: int, stop: int, axis: int) -> NDArray[Any]:
        if axis == 0:
            return np.asarray(self._rows(start, stop, 0)[self._name])
        return np.asarray(self._rows(0, sys.maxsize, 0)[self._name][:, start:stop])


def part_of(array: NDArray[Any], start: int, stop: int, axis: int) -> NDArray[Any]:
    """Return a part of an array in memory; see `RowReader`."""
    if array.ndim == 0:
        return array
    return array[start:stop] if axis == 0 else array[:, start:stop]


def _date_unit(dtype: np.dtype[Any]) -> str:
    """Return the unit of a type of dates or durations; "" for numbers, and for steps of several units such as 10 ms."""
    unit, count = np.datetime_data(dtype) if dtype.kind in "Mm" else ("", 1)
    return unit if count == 1 else ""


def _roles(part: Sequence[Array]) -> list[str]:
    """Return the roles ("time" or an axis) of the columns of the arrays. Columns without a role are omitted."""
    channels = _channels(part)
    return [role for c in channels if (role := role_of(c))]


def _folder_groups(group: list[Array]) -> list[list[Array]]:
    """Divide arrays of the same length by their groups in the file if an axis occurs twice."""
    roles = [role for role in _roles(group) if role in AXES]
    if len(set(roles)) == len(roles):
        return [group]
    parts: dict[str, list[Array]] = {}
    for array in group:
        parts.setdefault(split_path(array.name)[0], []).append(array)
    return list(parts.values())


def _topics(parts: Sequence[Sequence[Array]]) -> list[str]:
    """Return the names of the recordings of a file; "" if there is only one."""
    if len(parts) == 1:
        return [""]
    folders = [split_path(part[0].name)[0] for part in parts]
    return folders if len(set(folders)) == len(folders) and all(folders) else [part[0].name for part in parts]


def _channels(part: Sequence[Array]) -> tuple[Channel, ...]:
    lonely = len(part) == 1 and part[0].columns > 1 and not part[0].axes
    out = []
    for array in part:
        label = _own_name(array, part)
        names = _column_names(label, array.columns)
        if lonely and not any(recognise(name).axis for name in names):
            names = [""] * array.columns  # the columns of a single matrix are named by the user, in their order
        for k, name in enumerate(names):
            unit = array.units[k] if array.units else array.unit
            dates = "time" if array.dtype.kind in "Mm" else ""
            out.append(Channel(name, unit, array.axes[k] if array.axes else dates))
    return tuple(out)


def split_path(name: str) -> tuple[str, str]:
    """Split the path of an array into its folder and its own name. A slash in a unit does not separate folders.

    >>> split_path("imu0/gyro [rad/s]")
    ('imu0', 'gyro [rad/s]')
    """
    folder, separator, label = _SLASH.sub("\0", name).rpartition("\0")
    return (folder.replace("\0", "/"), label) if separator else ("", name)


def _own_name(array: Array, part: Sequence[Array]) -> str:
    """Return the last part of the path of an array, or the whole path if the last part is not unique."""
    last = split_path(array.name)[1]
    alone = sum(split_path(other.name)[1] == last for other in part) == 1
    return (
        last if alone and (recognise(last).axis or array.columns > 1 or not split_path(array.name)[0]) else array.name
    )


def _column_names(name: str, columns: int) -> list[str]:
    if columns == 1:
        return [name]
    bracket = _BRACKET.search(name)
    stem, tail = (name[: bracket.start()], name[bracket.start() :]) if bracket else (name, "")
    if columns == 3:
        return [f"{stem}_{axis}{tail}" for axis in "xyz"]
    return [f"{stem}_{k}{tail}" for k in range(columns)]


def _rate(arrays: Sequence[Array], part: Sequence[Array]) -> float | None:
    """Return the rate (Hz) that a scalar in the file states. A scalar in the group of the columns has priority."""
    folder = split_path(part[0].name)[0]
    candidates = []
    for array in arrays:
        where, label = split_path(array.name)
        if int(np.prod(array.shape)) == 1 and is_rate(label):
            candidates.append((where != folder, float(array.rows(0, 1, 0).reshape(-1)[0])))
    rates = {rate for outside, rate in sorted(candidates) if outside == min(candidates)[0]}
    rate = rates.pop() if len(rates) == 1 else None
    return rate if rate is not None and np.isfinite(rate) and rate > 0 else None


def _stray_time(part: Sequence[Array], parts: Sequence[Sequence[Array]]) -> str:
    """Describe time stamps in the folder of a recording that cannot belong to it; "" if there are none."""
    if "time" in _roles(part):
        return ""
    folder = split_path(part[0].name)[0]
    for other in parts:
        neighbours = [array for array in other if split_path(array.name)[0] == folder]
        if other is not part and neighbours and all(_roles([array]) == ["time"] for array in neighbours):
            return (
                f"the {neighbours[0].shape[0]} time stamps of {neighbours[0].name} do not belong to the "
                f"{part[0].shape[0]} samples of {part[0].name}"
            )
    return ""


def _layout(part: Sequence[Array], rate: float | None, topic: str, remarks: tuple[Remark, ...], stray: str) -> Layout:
    channels = _channels(part)
    state = tuple((array, k) for array in part for k in range(array.columns))
    first = tuple(str(value) for array in part for value in array.rows(0, 1, 0).reshape(-1))
    return Layout(channels, first, topic, rate, remarks=remarks, state=state, stray_time=stray, rate_of_samples=True)


def first_line(error: Exception) -> str:
    """Return the first line of the message of a library error, or the type of the error if it has no message."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__
