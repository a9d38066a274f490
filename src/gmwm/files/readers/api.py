"""Read a file of any format into memory or as a stream, an array of units, or a table in memory. The library of a table
is recognised by its methods and not imported."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import as_whole_number
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES, POSITIONS, SI_UNIT, axis_quantity
from gmwm.files.clock.clock import rows_between
from gmwm.files.columns.axis_units import time_unit
from gmwm.files.columns.column_names import named_unit, recognise, unit_of
from gmwm.files.columns.columns import ColumnChoice, choose
from gmwm.files.contract import Layout
from gmwm.files.formats.arrays import Array, chunks_of, fields_of, layouts_of, part_of
from gmwm.files.formats.series import SeriesReader
from gmwm.files.formats.text import TextReader
from gmwm.files.readers.builder import SampleBuilder, collect_samples
from gmwm.files.readers.interpretation import Interpretation, RowSource, of_file, require_time, understand, warn
from gmwm.files.readers.streams import CHUNK_SAMPLES, FileRows, HeldRows, Stream
from gmwm.files.readers.topics import Source, found_reader, inertial_topics, one_layout, source_words
from gmwm.recording.options import BadLines, Columns, Gaps, ReadOptions
from gmwm.recording.signals import Imu
from gmwm.recording.time_ranges import kept_ranges


def read(
    path: Source, rate: float | None = None, columns: Columns | None = None, units: Mapping[str, str] | None = None,
    *,
    gaps: Gaps = "keep", bad_lines: BadLines = "error", format: str | None = None,
    scale: Mapping[str, float] | None = None, increments: bool | Sequence[str] = (),
    mount: Mapping[str, str] | None = None, topic: str | None = None, start: float | None = None,
    stop: float | None = None, skip: Sequence[tuple[float, float]] = (),
) -> Imu:  # fmt: skip
    """Read a static recording from a file, in rad/s and m/s², or a position series, in m.

    Parameters
    ----------
    path : path or sequence of paths
        A file in any of the formats of docs/formats.md. The content decides the format, not the name. A list, or
        a pattern such as "logs/hour_*.csv", is one recording in several files that continue one another.
    rate : float, optional
        Samples per second (Hz). It is required if the file has no time stamps. If the file has time stamps, the rate
        must agree with them within 1 %, and replaces the rate that they give.
    columns : mapping or sequence, optional
        A mapping from axis to column name or index (from 0), such as {"gyro_x": "ch1", "time": 0}, in which None leaves
        an axis out; or a sequence of the axes in the order of the columns, such as ["time", "gyro_x", None]. By
        default, common names in the header are recognised.
    units : mapping, optional
        Any of {"gyro": "deg/s", "accel": "g", "position": "mm", "time": "ms"}; it replaces the units in the file. If a
        unit is neither declared here nor stated in the file, the unit of the accelerometers is inferred from the norm
        of gravity, and that of the time stamps if only one is plausible. Otherwise an error is raised.
    gaps : "keep" or "longest"
        Keep all segments between gaps, or only the longest one.
    bad_lines : "error" or "skip"
        What to do with lines of a text file that cannot be read: raise an error that names the line, or count each as a
        lost sample. A value that is missing (empty, NaN or NA) is a lost sample in either case.
    format : str, optional
        Name of the reader, if the content cannot decide: "imu:LN200" for the .imu records of that sensor.
        `[reader.name for reader in gmwm.readers.registered()]` lists all names.
    scale : mapping, optional
        Factors for raw counts by axis or sensor, such as {"gyro": 1 / 131, "accel_x": 6.1e-5}. Each number of the file
        is multiplied by its factor; the result is in the unit of `units` or of the file.
    increments : bool or sequence, optional
        The sensors or axes whose numbers are integrals over a sample interval (increments), such as ["gyro"]; True for
        all. They are multiplied by the rate. Declare the unit of the rate, for example "deg/s" for increments in
        degrees.
    mount : mapping, optional
        How the unit is mounted: the axis of the unit, with its sign, that points along each axis of the vehicle, such
        as {"x": "-y", "y": "x", "z": "z"}. Other options and remarks on columns name the axes of the unit; the
        recording has those of the vehicle.
    topic : str, optional
        Name of the recording in a file with several recordings, such as the topic of a ROS bag. It is required unless
        exactly one recording in the file is recognised as inertial.
    start, stop : float, optional
        Leave out the samples before and after these times, in seconds from the first sample.
    skip : sequence of (from, to)
        Leave out these ranges of time, in seconds from the first sample; each becomes a gap.

    Returns
    -------
    Imu
        The recording. Its `remarks` describe how the file was interpreted, and its `time_base` describes the time
        stamps.

    Raises
    ------
    ReadError, UnitError
        If the file cannot be read; the message states which option helps.
    DataError
        If all axes are constant, fewer than 8 samples are left, or most rows lack the values of some axes.
    OptionError
        If the value of an option is not allowed.

    Warns
    -----
    InferredUnitWarning
        If the unit of the accelerometers was inferred from their norm.
    TimeBaseWarning
        If a few time stamps repeat, step backward, or jitter by more than half an interval, or if the time stamps
        contradict a declared or stated rate.
    GmwmWarning
        If samples are lost, an axis is constant and left out, the norm of the accelerometers contradicts their unit, or
        `stop` is after the end of the recording.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "static.csv")
    >>> rows = "".join(f"{k / 100:.2f},{(-1) ** k * 0.1}\\n" for k in range(8))
    >>> _ = path.write_text("time,gyro_x [deg/s]\\n" + rows)
    >>> read(path)
    Imu(gyro_x: 8 samples at 100 Hz, 0.08 s)
    >>> folder.cleanup()
    """
    options = ReadOptions(
        rate=rate, columns=columns, units={} if units is None else units, gaps=gaps, start=start, stop=stop, skip=skip,
        format=format, topic=topic, scale={} if scale is None else scale, increments=increments, mount=mount or {},
        bad_lines=bad_lines,
    )  # fmt: skip
    return read_file(path, options)


def stream(
    path: Source, rate: float | None = None, columns: Columns | None = None, units: Mapping[str, str] | None = None,
    *,
    chunk: int = CHUNK_SAMPLES, format: str | None = None, scale: Mapping[str, float] | None = None,
    increments: bool | Sequence[str] = (), mount: Mapping[str, str] | None = None, topic: str | None = None,
    start: float | None = None, stop: float | None = None, skip: Sequence[tuple[float, float]] = (),
    bad_lines: BadLines = "error",
) -> Stream:  # fmt: skip
    """Stream a static recording from a file, in rad/s and m/s², chunk by chunk, for files larger than memory.

    Samples, temperature, rate, segments and remarks are the same as from `read`: the time stamps of the whole file are
    read first, and an axis is left out only if it is constant in the whole file. Memory does not grow with the file if
    it is text, Parquet, .npy, HDF5 or .imu; files that are compressed as a whole (.npz, zip, MATLAB) are unpacked as a
    whole. `.wavelet_variance()` measures all axes in one pass.

    Parameters
    ----------
    path, rate, columns, units, format, scale, increments, mount, topic, start, stop, skip, bad_lines
        As for `read`. For the rows after `stop`, only the time stamps are read.
    chunk : int
        Largest number of samples in a chunk.

    Returns
    -------
    Stream
        The stream. Each iteration over it yields all chunks from the start of the recording.

    Raises
    ------
    ReadError, UnitError, DataError, OptionError
        In the same cases as `read`. An error in later rows is raised when the iteration reaches them.

    Warns
    -----
    InferredUnitWarning
        If the unit of the accelerometers was inferred from their norm.
    TimeBaseWarning
        If the file states another rate than its time stamps show, or if time stamps repeat, step backward or jitter.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "static.csv")
    >>> rows = "".join(f"{k / 100 + (k > 5):.2f},{(-1) ** k * 0.1}\\n" for k in range(16))
    >>> _ = path.write_text("time,gyro_x [rad/s]\\n" + rows)
    >>> sorted({(chunk.segment, chunk.values["gyro_x"].size <= 4) for chunk in stream(path, chunk=4)})
    [(0, True), (1, True)]
    >>> folder.cleanup()
    """
    options = ReadOptions(
        rate=rate, columns=columns, units={} if units is None else units, start=start, stop=stop, skip=skip,
        format=format, topic=topic, scale={} if scale is None else scale, increments=increments, mount=mount or {},
        bad_lines=bad_lines,
    )  # fmt: skip
    return stream_file(path, options, as_whole_number(chunk, "chunk", 1))


def read_file(path: Source, options: ReadOptions) -> Imu:
    """Read the recording in a file into memory, with options that are already checked; see `read`."""
    with np.errstate(all="ignore"):  # checks find damaged numbers, so NumPy need not warn
        source = _OpenFile.of(path, options, in_memory=True)
        imu = replace(recording_of(source.found, source.rows, source.path), source=source_words(path))
    warn(imu.remarks, stacklevel=3)
    if options.ranges is not None:
        imu = imu.between(*source.times(options))
    return imu.longest() if options.gaps == "longest" else imu


def stream_file(path: Source, options: ReadOptions, chunk: int = CHUNK_SAMPLES) -> Stream:
    """Open a recording as a stream, with checked options; see `stream`. The option `gaps` is not applied."""
    with np.errstate(all="ignore"):
        source = _OpenFile.of(path, options, in_memory=False)
    warn(source.found.remarks, stacklevel=3)
    ranges = None if options.ranges is None else kept_ranges(*source.times(options))
    return Stream(source_words(path), source.found, source.rows, size=chunk, kept=ranges)


def recording_of(found: Interpretation, rows: RowSource, path: object) -> Imu:
    """Make a recording from rows in memory. The arrays of the rows are changed."""
    builder = SampleBuilder(found, owned=True)
    parts = list(builder.samples(rows))
    summary = builder.summary()
    remarks = (*found.remarks, *of_file(summary.remarks(found), path))
    return collect_samples(parts, found, summary.time_base(found), remarks)


@dataclass(frozen=True, eq=False)
class _OpenFile:
    """A recording in a file: the source of its rows, and the interpretation of its columns."""

    path: Path
    rows: FileRows | HeldRows
    found: Interpretation

    @classmethod
    def of(cls, path: Source, options: ReadOptions, *, in_memory: bool) -> _OpenFile:
        """Open a file."""
        file, reader = found_reader(path, options.format)
        if type(reader) is TextReader and not set(POSITIONS).isdisjoint(options.columns or ()):
            file, reader = found_reader(path, SeriesReader.name)
        layout = one_layout(reader, file, options.topic)
        choice = choose(layout, options.columns, file)
        layout = replace(layout, skip_bad_lines=options.bad_lines == "skip")
        origin = FileRows(file, reader, layout, topic=options.topic)
        if options.rate is None:
            origin = origin.with_intervals(choice, options.columns)
        if (time := origin.intervals) is not None:
            if "time" not in choice.columns:
                others = options.columns if isinstance(options.columns, Mapping) else {}
                choice = choose(layout, {**others, "time": time}, file)
            remark = Remark.of("time-read", case="read", form="intervals", columns=(layout.channels[time].name,))
            choice = replace(choice, remarks=(*choice.remarks, remark))
        require_time(layout, choice, options.rate, file)
        layout = replace(layout, stamped="time" in choice.columns)
        origin = replace(origin, layout=layout)
        rows = origin.hold(choice) if in_memory else origin

        def open_rows(rows: FileRows | HeldRows, begin: float = 0.0) -> _OpenFile:
            interpretation = understand(layout, choice, rows.first(choice), path=file, options=options, source=rows)
            timing = replace(interpretation.timing, base=replace(interpretation.timing.base, left=begin))
            return cls(file, rows, replace(interpretation, timing=timing).mounted(options.mount))

        try:
            return open_rows(rows)
        except ReadError as error:
            if not options.ranges or "when" not in error.facts:
                raise
        # The rows between the start and stop times may have a constant rate although the whole file does not.
        unit, column = time_unit(layout, choice, options.units)[0], choice.columns["time"]
        stamps = np.concatenate([chunk[column] for chunk in rows.chunks([column])])
        times = options.ranges[0][0], options.ranges[-1][1]
        part, begin = rows_between(stamps, unit, options.rate, begin=times[0], end=times[1])
        return open_rows(rows.limit(part.start, part.stop), begin)

    def times(self, options: ReadOptions) -> tuple[float, float | None, list[tuple[float, float]]]:
        """Return the options `start`, `stop` and `skip` in seconds from the first row that is read."""
        begin = self.found.timing.base.left
        stop = None if options.stop is None else options.stop - begin
        return (
            max((options.start or 0.0) - begin, 0.0),
            stop,
            [(max(a - begin, 0.0), b - begin) for a, b in options.skip if b > begin],
        )


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
    """Return axes' columns by unit number in names, if several; the index in gyro[0], gyro[1], gyro[2] is an axis."""
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


_NAME = Path("the table")


def is_table(data: object) -> bool:
    """Return whether data are a data frame, Arrow table, xarray object, record array, or not only complete axes.

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
