"""Write recordings to CSV, Parquet (both keep every bit), MCAP or .imu records, and as tables in memory."""

from __future__ import annotations

import os
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.atomic_files import written_whole
from gmwm.base.axis_names import AXES
from gmwm.base.errors import DataError, OptionError
from gmwm.base.forks import require_threads
from gmwm.recording.imu_records import TYPES, RecordType, counts
from gmwm.recording.mcap_writer import MCAP, write_mcap
from gmwm.recording.signals import Imu, Signal

SUFFIXES = (".csv", ".parquet")
"""File name extensions of tables; the extension chooses the format."""

RECORDS = ".imu"
"""Extension of files of .imu records; the option `format` chooses the type of the records."""


def write(imu: Imu | Signal, path: str | os.PathLike[str], *, format: str | None = None) -> None:
    """Write a recording; see `Imu.write`."""
    imu, target = _recording(imu), Path(path)
    suffix = target.suffix.lower()
    if suffix not in (*SUFFIXES, MCAP, RECORDS):
        raise OptionError(
            argument="path",
            expected=f"a path that ends in {', '.join((*SUFFIXES, MCAP))} or {RECORDS}",
            got=target.name,
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
        raise OptionError(argument="path", expected=f"a path that ends in {' or '.join(SUFFIXES)}", got=target.name)
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
    rows = "".join(
        f"<tr><td>{axis}</td><td>{signal.values.mean():.6g}</td><td>{signal.values.std():.4g}</td>"
        f"<td>{escape(signal.unit)}</td></tr>"
        for axis, signal in imu.signals.items()
    )
    heads = "".join(f"<th>{name}</th>" for name in ("axis", "mean", "standard deviation", "unit"))
    size = f"{len(imu)} samples at {imu.rate:g} Hz, {imu.duration:g} s"
    segments = f", {len(imu.segments)} segments between gaps" if len(imu.segments) > 1 else ""
    title = f"{escape(imu.source)}: {size}" if imu.source else size
    return f"<p>{title}{segments}</p><table><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>"


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
