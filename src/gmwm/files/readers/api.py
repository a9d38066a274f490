"""Read a file, into memory or as a stream, in the same way for every format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.files.clock.clock import rows_between
from gmwm.files.columns.axis_units import time_unit
from gmwm.files.columns.columns import choose
from gmwm.files.readers.builder import SampleBuilder, collect_samples
from gmwm.files.readers.interpretation import Interpretation, RowSource, require_time, understand
from gmwm.files.readers.reading_warnings import of_file, warn
from gmwm.files.readers.several_files import Source, found_reader, source_words
from gmwm.files.readers.streams import CHUNK_SAMPLES, FileRows, HeldRows, Stream
from gmwm.files.readers.topics import one_layout
from gmwm.recording.options import BadLines, Columns, Gaps, ReadOptions, as_whole_number
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
    """Read a static recording from a file, in rad/s and m/s².

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
        Any of {"gyro": "deg/s", "accel": "g", "time": "ms"}; it replaces the units that the file states. If a unit is
        neither declared here nor stated in the file, the unit of the accelerometers is inferred from the norm of
        gravity, and the unit of the time stamps if only one is plausible. Otherwise an error is raised.
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
        layout = one_layout(reader, file, options.topic)
        choice = choose(layout, options.columns, file)
        require_time(layout, choice, options.rate, file)
        layout = replace(layout, skip_bad_lines=options.bad_lines == "skip", stamped="time" in choice.columns)
        origin = FileRows(file, reader, layout, topic=options.topic)
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
