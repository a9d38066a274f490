"""Read recordings from tables in memory: data frames, xarray objects, and mappings with a time or missing values.

The libraries are recognised by their methods, so that none of them is imported.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.axis_names import AXES, axis_quantity
from gmwm.base.errors import DataError
from gmwm.base.units import SI_UNIT
from gmwm.files.columns.column_names import named_unit, unit_of
from gmwm.files.columns.columns import ColumnChoice, choose
from gmwm.files.contract import Layout
from gmwm.files.formats.arrays import Array, chunks_of, fields_of, layouts_of, part_of
from gmwm.files.readers.api import recording_of
from gmwm.files.readers.interpretation import require_time, understand
from gmwm.files.readers.reading_warnings import warn
from gmwm.files.readers.streams import HeldRows
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

_NAME = Path("the table")


def is_table(data: object) -> bool:
    """Return whether data are a data frame, an Arrow table, an xarray object, an array of records, or a mapping in
    which some names are not axes or some values are missing.

    >>> is_table(np.zeros((9, 6))), is_table(np.zeros(9, dtype=[("gyro_x", float)]))
    (False, True)
    >>> is_table({"gyro_x": [0.0]}), is_table({"gyro_x": [0.0], "time": [0.0]}), is_table({"gyro_x": [np.nan]})
    (False, True, True)
    """
    if isinstance(data, Mapping) and not hasattr(data, "coords"):
        return any(not _is_axis(name) or _has_missing(values) for name, values in data.items())
    framed = any(hasattr(type(data), name) for name in ("columns", "column_names", "collect_schema"))
    return framed or hasattr(data, "coords") or getattr(getattr(data, "dtype", None), "names", None) is not None


def _is_axis(name: object) -> bool:
    """Return whether a name is an axis, or that of a sensor of an array, such as gyro_1."""
    return name in AXES or (isinstance(name, str) and re.fullmatch(r"(gyro|accel)_\d+", name) is not None)


def _has_missing(values: Any) -> bool:
    array = values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
    return bool(np.ma.is_masked(array)) or (array.dtype.kind == "f" and not np.isfinite(np.sum(array)))


def read_table(data: Any, rate: float | None, units: Mapping[str, str] | None, source: str) -> Imu:
    """Read the recording in a table, with names as in a file. Without a stated unit, rad/s and m/s² are assumed."""
    options = ReadOptions(rate=rate, units={} if units is None else units)
    arrays = [entry for name, values in _columns(data) for entry in _arrays(str(name), values)]
    layouts = layouts_of(arrays, _NAME)
    if len(layouts) > 1:
        raise DataError(
            argument="arrays", expected="columns of one recording, of the same length",
            got=", ".join(array.name for array in arrays), advice="Pass the columns of one sensor.",
        )  # fmt: skip
    layout = layouts[0]
    choice = choose(layout, options.columns, _NAME)
    require_time(layout, choice, options.rate, _NAME)
    columns = list(choice.columns.values())
    parts = list(chunks_of(layout, columns, _NAME))
    held = HeldRows({k: np.concatenate([part[k] for part in parts]) for k in columns})
    options = replace(options, units={**_default_units(layout, choice), **options.units})
    interpretation = understand(layout, choice, held.rows, path=_NAME, options=options, source=held)
    imu = recording_of(interpretation, held, _NAME)
    warn(imu.remarks, stacklevel=3)
    return replace(imu, source=source)


def _default_units(layout: Layout, choice: ColumnChoice) -> dict[str, str]:
    """Return SI units for the sensors whose columns state no unit."""
    stated = {
        axis_quantity(axis)
        for axis in choice.axes
        if named_unit((channel := layout.channels[choice.columns[axis]]).name, axis) or unit_of(channel.unit, axis)
    }
    return {quantity: unit for quantity, unit in SI_UNIT.items() if quantity not in stated}


def _columns(data: Any) -> Iterator[tuple[str, Any]]:
    """Yield names and values of the columns of a table, with its index if the index is a time."""
    if hasattr(data, "collect_schema") and hasattr(data, "collect"):  # a lazy frame of Polars
        data = data.collect()
    if isinstance(data, Mapping) and not hasattr(data, "coords"):
        yield from data.items()
    elif hasattr(data, "get_columns"):  # Polars
        for series in data.get_columns():
            yield series.name, series.to_numpy()
    elif hasattr(data, "coords"):
        yield from _of_xarray(data)
    elif hasattr(data, "column_names"):  # Arrow
        for name in data.column_names:
            yield name, data.column(name).to_numpy()
    elif hasattr(data, "columns"):  # pandas
        index = data.index
        if index.dtype.kind in "Mm" or index.name is not None:
            yield str(index.name or "time"), _of_pandas(index)
        for k, name in enumerate(data.columns):
            words = " ".join(map(str, name)) if isinstance(name, tuple) else str(name)
            yield words, _of_pandas(data.iloc[:, k])
    else:
        yield "", np.asarray(data)


def _of_pandas(column: Any) -> NDArray[Any]:
    """Return the values of a column or an index. Dates with a time zone are converted to UTC."""
    zoned = getattr(column.dtype, "tz", None) is not None
    return np.asarray(column.to_numpy(dtype="M8[ns]") if zoned else column.to_numpy())


def _of_xarray(data: Any) -> Iterator[tuple[str, Any]]:
    """Yield the variables of a data set, or the columns of a data array, with its time."""
    first = next(iter(data.data_vars.values())) if hasattr(data, "data_vars") else data
    along = first.dims[0]
    if along in data.coords:
        unit = data.coords[along].attrs.get("units")
        yield f"{along} [{unit}]" if unit else str(along), np.asarray(data.coords[along].values)
    if hasattr(data, "data_vars"):
        for name, variable in data.data_vars.items():
            unit = variable.attrs.get("units")
            yield f"{name} [{unit}]" if unit else str(name), np.asarray(variable.values)
        return
    labels = data.coords[data.dims[1]].values if data.ndim == 2 and data.dims[1] in data.coords else None
    values = np.asarray(data.values)
    if labels is None:
        yield str(data.name or ""), values
    else:
        yield from ((str(label), values[:, k]) for k, label in enumerate(labels))


def _arrays(name: str, values: Any) -> list[Array]:
    """Convert a column or a table to arrays, with NaN for missing values; [] if the values are not numbers."""
    if isinstance(values, np.ma.MaskedArray):
        values = np.ma.filled(values.astype(np.float64), np.nan)
    array: NDArray[Any] = np.asarray(values)
    if array.dtype.kind == "O":
        try:
            array = array.astype(np.float64)  # None becomes NaN
        except (TypeError, ValueError, OverflowError):
            return []
    if array.dtype.kind in "Mm":
        array = array.astype("M8[ns]" if array.dtype.kind == "M" else "m8[ns]")
    return fields_of(name, array.shape, dtype=array.dtype, rows=partial(part_of, array))
