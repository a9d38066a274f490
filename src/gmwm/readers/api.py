"""Read a file into an Imu, in the same way for every format."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector, as_rate
from gmwm._text import counted, duration_text
from gmwm.axis_names import AXES, axis_quantity
from gmwm.errors import DataError, OptionError, ReadError
from gmwm.options import BadLines, Columns, Gaps, ReadOptions
from gmwm.readers.axis_units import Scales, resolve, time_unit
from gmwm.readers.base import Layout, Reader, Rows
from gmwm.readers.clock import clock_of, rows_between
from gmwm.readers.columns import Choice, choose, described
from gmwm.readers.lost_samples import (
    Sifted,
    about_lost,
    as_floats,
    dead_axes,
    is_missing,
    sift,
    temperature_of,
    without_lost,
)
from gmwm.readers.reading_warnings import of_file, warn
from gmwm.readers.scale_factors import multiply
from gmwm.readers.several_files import Source, found_reader, source_words
from gmwm.readers.text_stamps import holds_stamps, require_readable
from gmwm.readers.time_stamps import Timing, beside_stated, unstamped
from gmwm.remarks import Remark
from gmwm.signals import MINIMUM_SAMPLES, Imu, Signal
from gmwm.time_ranges import cut
from gmwm.units import SI_UNIT


def read(
    path: Source,
    rate: float | None = None,
    columns: Columns | None = None,
    units: Mapping[str, str] | None = None,
    *,
    gaps: Gaps = "keep",
    bad_lines: BadLines = "error",
    format: str | None = None,
    scale: Mapping[str, float] | None = None,
    increments: bool | Sequence[str] = (),
    topic: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    skip: Sequence[tuple[float, float]] = (),
) -> Imu:
    """Read a static recording from a file, in rad/s and m/s².

    Parameters
    ----------
    path : path or sequence of paths
        A file in any of the formats of docs/formats.md. The content decides the format, not the name. A list, or
        a pattern such as "logs/hour_*.csv", is one recording in several files that continue one another.
    rate : float, optional
        Samples per second (Hz). It is needed if the file has no time stamps. If it has, the rate must agree with them
        within 1 %, and is used instead of theirs.
    columns : mapping or sequence, optional
        Axis to column name or index (from 0), such as {"gyro_x": "ch1", "time": 0}; None leaves an axis out. Or the
        axes in the order of the columns, such as ["time", "gyro_x", None]. By default the usual names in the header are
        recognised.
    units : mapping, optional
        Any of {"gyro": "deg/s", "accel": "g", "time": "ms"}; it overrides the file. A unit that is neither declared nor
        stated is an error, except for accelerometers whose norm is gravity, and for time stamps that are plausible in
        one unit only.
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
        True, or the sensors or axes whose numbers are integrals over a sample, such as ["gyro"]. They are multiplied by
        the rate. Declare the unit of the rate, for example "deg/s" for increments in degrees.
    topic : str, optional
        Name of the recording, such as the topic of a ROS bag. It is needed unless exactly one recording of the file is
        known as inertial.
    start, stop : float, optional
        Leave out the samples before and after these times, in seconds from the first sample.
    skip : sequence of (from, to)
        Leave out these ranges of time, in seconds from the first sample; each becomes a gap.

    Returns
    -------
    Imu
        Its `remarks` describe how the file was understood, its `time_base` the time stamps.

    Raises
    ------
    ReadError, UnitError
        If the file cannot be read; the message states which option helps.
    DataError
        If all axes are constant, fewer than 8 samples are left, or most rows lack the values of some axes.
    OptionError
        If an option has a value that it may not have.

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
        format=format, topic=topic, scale={} if scale is None else scale, increments=increments, bad_lines=bad_lines,
    )  # fmt: skip
    return read_file(path, options)


def read_file(path: Source, options: ReadOptions) -> Imu:
    """The recording in a file, as `read` gives it, by options that are checked."""
    rate, units = options.rate, options.units
    file, reader = found_reader(path, options.format)
    layout = one_layout(reader, file, options.topic)
    choice = choose(layout, options.columns, file)
    require_time(layout, choice, rate, file)
    layout = layout.read_as(options.bad_lines, "time" in choice.columns)
    rows = _all_rows(reader, file, layout, choice)
    begin = 0.0
    try:
        imu = recording_of(rows, layout, choice, options=options, units=units, path=file)
    except ReadError as error:
        if not options.ranges or "when" not in error.facts:
            raise
        # The part between two times may have one rate although the whole has not.
        unit, stamps = time_unit(layout, choice, units)[0], rows[choice.columns["time"]]
        times = (options.ranges[0][0], options.ranges[-1][1])
        part, begin = rows_between(stamps, unit, options.rate, begin=times[0], end=times[1])
        rows = {k: column[part] for k, column in rows.items()}
        imu = recording_of(rows, layout, choice, options=options, units=units, path=file)
    warn(imu.remarks, stacklevel=3)
    imu = replace(imu, source=source_words(path))
    if options.ranges is not None:
        imu = replace(imu, time_base=imu.time_base and replace(imu.time_base, left=begin))
        skip = [(max(a - begin, 0.0), b - begin) for a, b in options.skip if b > begin]
        stop = None if options.stop is None else options.stop - begin
        imu = cut(imu, max((options.start or 0.0) - begin, 0.0), stop, skip)
    return imu.longest() if options.gaps == "longest" else imu


def recording_of(
    rows: Rows, layout: Layout, choice: Choice, *, options: ReadOptions, units: Mapping[str, str], path: Path
) -> Imu:
    """The recording in the rows of a table: its clock, its lost samples, its units.

    Parameters
    ----------
    rows : mapping of column index to (n,) array
        All rows of the chosen columns.
    layout, choice
        Description of the table, and the columns that are read.
    options : ReadOptions
        Rate, factors and increments.
    units : mapping
        Declared units.
    path : Path
        The file, for messages.
    """
    usable = usable_samples(rows, layout, choice, path=path)
    raw = dict(usable.raw)
    samples = next(iter(raw.values())).size
    stamps = [raw["time"]] if "time" in raw else None
    time, time_remarks = timing_of(layout, choice, units=units, stamps=stamps, samples=samples, rate=options.rate)
    time = without_lost(time, usable.sifted)
    raw = usable.present(raw)
    integrals, base_rate = options.integrals, time.base.rate
    scale_remarks = multiply(layout, choice, factors=options.scale, increments=integrals, raw=raw, rate=base_rate)
    scales = resolve(layout, choice, declared=units, values=raw, rate=base_rate, increments=integrals)
    remarks = (*layout.remarks, *choice.remarks, *usable.remarks, *scale_remarks, *scales.remarks, *time_remarks)
    remarks = of_file((*remarks, *time.remarks, *about_lost(time.base)), path)
    signals = _signals(usable.axes, raw=raw, scales=scales, time=time)
    return Imu(signals, str(path), remarks=remarks, time_base=time.base, temperature=usable.temperature)


def one_layout(reader: Reader, path: Path, topic: str | None) -> Layout:
    """Choose the recording to read: the one named `topic`, or the only one that is inertial.

    Raises
    ------
    OptionError
        If there is no recording of this name, or several.
    ReadError
        If the choice is not unique without a name, or the recording cannot be read.
    """
    layouts = reader.layouts(path)
    if topic is not None:
        # The first instance of a message, and a topic of ROS without its slash.
        spelled = ((topic,), (f"{topic}_0", f"/{topic}"))
        named = next((found for names in spelled if (found := [x for x in layouts if x.topic in names])), [])
        if len(named) == 1:
            return _readable(named[0], path)
        what = f"{len(named)} topics {topic!r}" if named else f"no topic {topic!r}"
        raise OptionError(f"{path} has {what}. Its topics: {_topics(layouts)}", argument="topic", got=topic)
    fitting = [layout for layout in layouts if layout.inertial] if len(layouts) > 1 else layouts
    if len(fitting) == 1:
        return _readable(fitting[0], path)
    preferred = [layout for layout in fitting if layout.preferred]
    if len(preferred) == 1:
        others = tuple(topic_words(layout) for layout in fitting if not layout.preferred)
        chosen = Remark.of("topic-chosen", topic=topic_words(preferred[0]), others=others)
        return _readable(replace(preferred[0], remarks=(chosen, *preferred[0].remarks)), path)
    if not fitting:
        raise ReadError(
            f"{path} holds {len(layouts)} recordings, none of them known as inertial. Its topics: {_topics(layouts)}",
            code="no-inertial-data",
            advice="Choose one with {--topic}, and name its axes with {--columns}.",
        )
    raise ReadError(
        f"{path} holds {len(fitting)} recordings: {_topics(fitting)}",
        code="several-recordings",
        advice="Choose one with {--topic}." + _APART if _apart(fitting) else "Choose one with {--topic}.",
    )


def inertial_topics(path: Source, format: str | None = None) -> tuple[str, ...]:
    """Names of the inertial recordings in a file, in their order.

    Raises
    ------
    ReadError, OptionError
        If the file cannot be read.
    """
    file, reader = found_reader(path, format)
    layouts = reader.layouts(file)
    return tuple(layout.topic for layout in layouts if layout.inertial or len(layouts) == 1)


def _readable(layout: Layout, path: Path) -> Layout:
    """The layout, if it has columns.

    Raises
    ------
    ReadError
        If the recording cannot be read.
    """
    if layout.unreadable is not None:
        raise layout.unreadable
    if not layout.channels:
        raise ReadError(
            f"{path} has no columns", code="no-inertial-data", advice="Check whether the recording was interrupted."
        )
    return layout


def _topics(layouts: Sequence[Layout], most: int = 20) -> str:
    """Topics with their axes, for a message."""
    named = [topic_words(layout) for layout in layouts[:most]]
    return ", ".join(named) + (f" and {len(layouts) - most} more" if len(layouts) > most else "") or "none"


def topic_words(layout: Layout) -> str:
    """A topic with its axes, rate and length, for a message.

    >>> topic_words(Layout((), topic="/imu", extent=(501, 5.0)))
    '/imu (100 Hz, 5 s)'
    """
    axes = [channel.axis for channel in layout.channels if channel.axis in AXES]
    about = [", ".join(axes)] if axes else []
    if layout.extent is not None:
        samples, seconds = layout.extent
        shown = f"{(samples - 1) / seconds:.4g} Hz, {duration_text(seconds)}" if seconds > 0 else ""
        about += [shown or counted(samples, "message")]
    return layout.topic + (f" ({'; '.join(about)})" if about else "")


_APART = " Gyroscopes and accelerometers with different clocks are read and calibrated one after the other."


def _apart(layouts: Sequence[Layout]) -> bool:
    """Whether one recording has only gyroscopes and another only accelerometers."""
    sensors = [{channel.axis[:-2] for channel in layout.channels if channel.axis in AXES} for layout in layouts]
    return {"gyro"} in sensors and {"accel"} in sensors


def require_time(layout: Layout, choice: Choice, rate: float | None, path: Path) -> None:
    """Require time stamps or a rate, and time stamps that are numbers, dates with times, or times of day.

    Raises
    ------
    ReadError
        If there is neither, or the time stamps cannot be read.
    """
    for role, column in choice.columns.items():
        if role != "time" and holds_stamps(layout, column):
            raise ReadError(
                f"{column_words(layout, choice, role, path)} holds dates and times ({layout.first_row[column]!r}), "
                "expected numbers",
                code="column-not-numbers",
                advice="Name another column for it with {--columns}.",
            )
    if "time" not in choice.columns:
        if rate is None and layout.stray_time:
            raise ReadError(
                f"{path}: {layout.stray_time}",
                code="no-time",
                advice="Repair the file, or pass {--rate} to read it without time stamps.",
            )
        if rate is None and layout.rate is None:
            raise ReadError(
                f"{path} has no time column. Its columns: {described(layout)}",
                code="no-time",
                advice="Pass the samples per second with {--rate}, or name the time column with {--columns}.",
            )
        return
    k = choice.columns["time"]
    if not layout.channels[k].axis and k < len(layout.first_row):
        require_readable(layout.first_row[k], path)


def _all_rows(reader: Reader, path: Path, layout: Layout, choice: Choice) -> Rows:
    """All rows of the chosen columns in one array each. Only time stamps need the precision of integers."""
    wanted = list(choice.columns.values())
    parts: dict[int, list[NDArray[Any]]] = {k: [] for k in wanted}
    for chunk in reader.chunks(path, layout, wanted):
        for k in wanted:
            parts[k].append(chunk[k])
    rows: dict[int, NDArray[Any]] = {}
    for role, k in choice.columns.items():
        pieces = parts.pop(k)
        column = np.concatenate(pieces) if pieces else np.empty(0)
        rows[k] = column if role == "time" else as_floats(column)
    return rows


@dataclass(frozen=True, eq=False)
class Usable:
    """The rows of a recording that its clock counts, and the axes that work.

    Attributes
    ----------
    raw : mapping of role to (n,) array
        The rows, including those of lost samples.
    sifted : Sifted
        The same rows by column, and which of them are lost samples.
    axes : tuple of str
        The axes that work.
    temperature : (m,) array or None
        The temperature of each sample that is left.
    remarks : tuple of Remark
        Remarks on axes and rows that are left out.
    """

    raw: Mapping[str, NDArray[Any]]
    sifted: Sifted
    axes: tuple[str, ...]
    temperature: Vector | None
    remarks: tuple[Remark, ...]

    def present(self, raw: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
        """The axes without the rows of lost samples."""
        lost = self.sifted.lost
        return {role: v if lost is None else v[~lost] for role, v in raw.items() if role in AXES}


def usable_samples(rows: Rows, layout: Layout, choice: Choice, path: Path, dead: bool = True) -> Usable:
    """Find the axes that work and the rows that hold samples.

    Parameters
    ----------
    rows : mapping of column index to (n,) array
        All rows of a recording, or the first ones.
    layout, choice, path
        The columns, and the file for messages.
    dead : bool
        Whether to leave out axes that are constant. A few rows do not show whether an axis works.

    Raises
    ------
    DataError
        If no axis works, too few samples are left, or most rows lack the values of some axes.
    """
    words = {role: column_words(layout, choice, role, path) for role in choice.columns}
    constants = dead_axes(rows, choice.columns, choice.axes) if dead else {}
    axes = tuple(axis for axis in choice.axes if axis not in constants)
    size = next(iter(rows.values())).size
    require_samples(size, words[choice.axes[0]])
    if not axes:
        axis, value = next(iter(constants.items()))
        raise constant(words[axis], axis, value, size)
    sifted = sift(rows, choice.columns, axes)
    count = next(iter(sifted.rows.values())).size
    left = count if sifted.lost is None else count - int(np.count_nonzero(sifted.lost))
    if 2 * left < count:
        raise _apart_in_rows(sifted, choice, axes, layout=layout, path=path)
    require_samples(left, words[axes[0]])
    remarks = [
        Remark.of("axis-dead", axis, kind="missing" if np.isnan(value) else "constant", value=value, rows=size)
        for axis, value in constants.items()
    ]
    if sifted.other:
        remarks.append(Remark.of("rows-of-others", count=sifted.other, rows=size))
    return Usable(
        {role: sifted.rows[k] for role, k in choice.columns.items()},
        sifted,
        axes=axes,
        temperature=temperature_of(rows, choice.columns, sifted) if "temperature" in choice.columns else None,
        remarks=tuple(remarks),
    )


def _apart_in_rows(sifted: Sifted, choice: Choice, axes: Sequence[str], layout: Layout, path: Path) -> DataError:
    """The error for a file in which most rows lack the values of some axes, as of sensors with different rates."""
    size = next(iter(sifted.rows.values())).size
    counts = {}
    for axis in axes:
        missing = is_missing(sifted.rows[choice.columns[axis]])
        counts[axis] = size if missing is None else size - int(np.count_nonzero(missing))
    shown = ", ".join(f"{axis} in {count}" for axis, count in counts.items())
    most = max(counts, key=lambda axis: counts[axis])[:-2]
    names = {axis: layout.channels[choice.columns[axis]].name or choice.columns[axis] for axis in axes}
    return DataError(
        f"{path}: most rows have no value in some axis: of {size} rows, {shown} have one",
        advice="If the sensors have different rates, read one after the other, for example with {--columns=@example}.",
        example=",".join(f"{axis}:{names[axis]}" for axis in axes if axis.startswith(most)),
    )


def require_samples(samples: int, what: str) -> None:
    """Require at least `MINIMUM_SAMPLES` samples of the column `what`.

    Raises
    ------
    DataError
        If there are fewer.
    """
    if samples < MINIMUM_SAMPLES:
        raise DataError(
            f"{what} has {counted(samples, 'sample')}, but at least {MINIMUM_SAMPLES} are needed",
            advice="Record longer, or check whether the recording was interrupted.",
        )


def constant(what: str, role: str, value: float, rows: int) -> DataError:
    """The error for a recording in which no axis works."""
    how = "no finite number" if np.isnan(value) else f"the same value {value:g}"
    return DataError(
        f"{what} has {how} in all {counted(rows, 'row')}, and no other axis works",
        advice="Check whether the sensor was connected.",
        axis=role,
    )


def column_words(layout: Layout, choice: Choice, role: str, path: Path) -> str:
    """Name of a column in messages: the file, the role, and the name in the file."""
    k = choice.columns[role]
    name = layout.channels[k].name or f"number {k}"
    return f"{path}: {role}" + ("" if name == role else f" (column {name!r})")


def timing_of(
    layout: Layout,
    choice: Choice,
    units: Mapping[str, str],
    stamps: Iterable[NDArray[Any]] | None,
    samples: int,
    rate: float | None,
) -> tuple[Timing, tuple[Remark, ...]]:
    """The time base, and remarks on the unit or form of the time stamps.

    `stamps` has chunks of the time column, None if there is none; then the recording has one segment of `samples`.
    """
    if stamps is None:
        stated = layout.rate if rate is None else rate
        return unstamped(as_rate(stated), samples), ()
    unit, about_unit = time_unit(layout, choice, units)
    found, about_form = clock_of(stamps, unit, rate)
    if rate is None and layout.rate is not None and layout.rate_of_samples:
        found = beside_stated(found, layout.rate)
    return found, tuple(remark for remark in (about_unit, about_form) if remark is not None)


def _signals(axes: Sequence[str], raw: Mapping[str, Vector], scales: Scales, time: Timing) -> dict[str, Signal]:
    """The axes in SI units."""
    signals = {}
    for axis in axes:
        values = raw[axis]
        factor = scales.units[axis].factor
        if factor != 1:
            values *= factor
        unit = SI_UNIT[axis_quantity(axis)]
        signals[axis] = Signal(
            values=values,
            rate=time.base.rate,
            unit=unit,
            axis=axis,
            start=0.0,
            segments=time.segments,
            starts=time.starts,
        )
    return signals
