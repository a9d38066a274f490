"""Read the recordings of an array of several sensors (units), from one file or from a file for each unit."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gmwm.base.axis_names import AXES
from gmwm.base.errors import OptionError, ReadError
from gmwm.files.columns.column_names import recognise
from gmwm.files.contract import Layout
from gmwm.files.readers.api import read_file
from gmwm.files.readers.several_files import found_reader
from gmwm.files.readers.topics import inertial_topics, one_layout
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu

# The number of a sensor is in brackets, or it is the first digits that are not the exponent of a unit such as m/s2.
_NUMBERS = (re.compile(r"\[\s*(\d+)\s*\]|\(\s*(\d+)\s*\)"), re.compile(r"(?<![\ds^])(\d+)"))


def read_array(path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], **reading: Any) -> dict[str, Imu]:
    """Read the recordings of all units (sensors) of an array.

    Parameters
    ----------
    path : path or sequence of paths
        One file whose columns have the numbers of the units, such as gyro_x[2] or imu2_acc_x; one file with several
        inertial topics; or a file for each unit.
    **reading
        Options of `gmwm.read`, which are the same for all units. `columns` is not allowed for numbered columns.

    Returns
    -------
    dict of str to Imu
        The recording of each unit, by the number of the unit, the topic, or the name of the file.

    Raises
    ------
    ReadError
        If a single file has neither numbered columns nor several topics, and in the same cases as `gmwm.read`.
    """
    return read_units(path, ReadOptions(**reading))


def read_units(path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], options: ReadOptions) -> dict[str, Imu]:
    """Read the recordings of all units of an array, with options that are already checked; see `read_array`."""
    if not isinstance(path, str | os.PathLike):
        files = [Path(file) for file in path]
        if len(files) != 1:
            names = [file.stem for file in files]
            names = names if len(set(names)) == len(names) else [str(file) for file in files]
            if len(set(names)) < len(names):
                raise OptionError(argument="path", expected="a different file for each unit", got=names)
            return {name: read_file(file, options) for name, file in zip(names, files, strict=True)}
        (path,) = files
    topics = [] if options.topic is not None else inertial_topics(path, options.format)
    if len(topics) > 1:
        return {topic: read_file(path, replace(options, topic=topic)) for topic in topics}
    file, reader = found_reader(path, options.format)
    units = numbered_columns(one_layout(reader, file, options.topic))
    if not units:
        raise ReadError(
            f"{path} has one unit, without numbered columns such as gyro_x[0] and gyro_x[1]",
            code="no-array",
            advice="Give a file for each unit, or number the columns.",
        )
    if options.columns is not None:
        raise OptionError(argument="columns", expected="left out for numbered columns", got=options.columns)
    return {unit: read_file(path, replace(options, columns=columns)) for unit, columns in units.items()}


def numbered_columns(layout: Layout) -> dict[str, dict[str, int]]:
    """Return the column of each axis of each unit, by the number of the unit in its name, if there are several. The
    index in gyro[0], gyro[1], gyro[2] is an axis, not a unit."""
    units: dict[str, dict[str, int]] = {}
    for k, channel in enumerate(layout.channels):
        numbered = _unit_axis(channel.name)
        if numbered is not None:
            unit, axis = numbered
            units.setdefault(unit, {}).setdefault(axis, k)
    return dict(sorted(units.items(), key=lambda item: int(item[0]))) if len(units) > 1 else {}


def _unit_axis(name: str) -> tuple[str, str] | None:
    """Split a column name into the number of the unit and the axis; None if it has none.

    >>> [_unit_axis(name) for name in ("gyro_x[3] [rad/s]", "imu12.acc_y_mps2", "acc_x [m/s2]", "gyro[2]")]
    [('3', 'gyro_x'), ('12', 'accel_y'), None, None]
    """
    for pattern in _NUMBERS:
        match = pattern.search(name)
        if match is not None:
            axis = recognise(name[: match.start()] + name[match.end() :]).axis
            return (match[match.lastindex or 0], axis) if axis in AXES else None
    return None
