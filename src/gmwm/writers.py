"""Recordings written to CSV, Parquet or .imu records; the first two give the same numbers back, bit for bit."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gmwm._arrays import Vector
from gmwm._files import written_whole
from gmwm.errors import DataError, OptionError
from gmwm.imu_records import TYPES, RecordType, counts
from gmwm.signals import AXES, Imu, Signal

SUFFIXES = (".csv", ".parquet")
"""The file name extensions of tables, which choose their format."""

RECORDS = ".imu"
"""The extension of bare records; which of the six types they are is said by `format`."""


def write(imu: Imu | Signal, path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Write a recording: see `Imu.write`."""
    imu, target = _recording(imu), Path(path)
    suffix = target.suffix.lower()
    if suffix not in (*SUFFIXES, RECORDS):
        raise OptionError(f"path must end in {', '.join(SUFFIXES)} or {RECORDS}, got {target.name!r}")
    if suffix == RECORDS:
        _write_records(imu, target, _record_type(format, target))
    elif format is not None:
        raise OptionError(f"format is for {RECORDS} files alone, {target.name!r} needs none; got {format!r}")
    else:
        write_table(_columns(imu), target)


def _recording(given: object) -> Imu:
    """The recording that is to be written."""
    if isinstance(given, Imu):
        return given
    if isinstance(given, Signal) and given.axis in AXES:
        return Imu({given.axis: given})
    known = ", ".join(AXES)
    if isinstance(given, Signal):
        raise OptionError(
            f"a signal that is written must be one of {known}, got axis={given.axis!r}; name it, as "
            "gmwm.Imu.from_arrays({'gyro_x': signal.values}, signal.rate)"
        )
    raise OptionError(
        f"imu must be an Imu, got {type(given).__name__}; make one of arrays: gmwm.Imu.from_arrays({{'gyro_x': x}}, "
        "rate=…)"
    )


def table_path(path: str | os.PathLike[str]) -> Path:
    """Where a table goes: a path that ends in .csv or .parquet.

    Raises
    ------
    OptionError
        If it ends in anything else.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise OptionError(f"path must end in {' or '.join(SUFFIXES)}, got {target.name!r}")
    return target


def write_table(columns: Mapping[str, Vector], path: str | os.PathLike[str]) -> None:
    """Write columns of one length by name as .csv or .parquet, whole or not at all."""
    import polars as pl

    target = table_path(path)
    frame = pl.DataFrame(dict(columns))
    with written_whole(target) as temporary:
        if target.suffix.lower() == ".csv":
            frame.write_csv(temporary)
        else:
            frame.write_parquet(temporary)


def _columns(imu: Imu) -> dict[str, Vector]:
    columns = {"time [s]": imu[imu.axes[0]].times()}
    for axis in imu:
        unit = imu[axis].unit
        columns[f"{axis} [{unit}]" if unit else axis] = imu[axis].values
    if imu.temperature is not None:
        columns["temperature [°C]"] = imu.temperature
    return columns


def _record_type(format: str | None, target: Path) -> RecordType:
    named = {kind.format.casefold(): kind for kind in TYPES}
    if format is None:
        known = ", ".join(kind.format for kind in TYPES)
        raise OptionError(f"{target.name!r} needs the type of its records; pass format=, one of {known}")
    if not isinstance(format, str) or format.casefold() not in named:
        raise OptionError(f"format must be one of {', '.join(kind.format for kind in TYPES)}; got {format!r}")
    return named[format.casefold()]


def _write_records(imu: Imu, target: Path, kind: RecordType) -> None:
    """Time and six increments a record, in the counts of the type."""
    missing = [axis for axis in AXES if axis not in imu.axes]
    if missing:
        raise DataError(f"an {RECORDS} file holds six axes, the recording has no {', '.join(missing)}; write a table")
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
            raise DataError(f"{axis} reaches {largest:.3g} counts of {kind.format}, more than the {limit} of 32 bits")
        records[axis] = counts(values, scale * imu.rate)
    with written_whole(target) as temporary:
        records.tofile(temporary)
