"""`read`: from a file to an Imu, the same way for every format."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector, as_rate
from gmwm._text import counted
from gmwm.errors import DataError, GmwmWarning, InferredUnitWarning, OptionError, ReadError, TimeBaseWarning
from gmwm.options import Columns, Gaps, ReadOptions
from gmwm.readers.axis_units import Scales, resolve, time_unit
from gmwm.readers.base import Layout, Reader, existing_file, find_reader
from gmwm.readers.columns import Choice, choose, described
from gmwm.readers.scale_factors import multiply
from gmwm.readers.text_stamps import holds_stamps, require_readable
from gmwm.readers.time_stamps import Timing, as_stamps, beside_stated, timing, unstamped
from gmwm.signals import AXES, MINIMUM_SAMPLES, Imu, Signal, axis_quantity
from gmwm.time_ranges import cut
from gmwm.units import SI_UNIT


def read(
    path: str | os.PathLike[str],
    rate: float | None = None,
    columns: Columns | None = None,
    units: Mapping[str, str] | None = None,
    *,
    gaps: Gaps = "keep",
    format: str | None = None,
    scale: Mapping[str, float] | None = None,
    increments: bool | Sequence[str] = (),
    topic: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    skip: Sequence[tuple[float, float]] = (),
) -> Imu:
    """A static recording from a file, in rad/s and m/s².

    Parameters
    ----------
    path : path
        A file in any of the formats of docs/formats.md; the content decides which, not the name.
    rate : float, optional
        Samples per second (Hz). Needed where there are no time stamps; where there are, it must agree with
        them within 1 %, and is then what counts.
    columns : mapping or sequence, optional
        Axis to column name or index (from 0), such as {"gyro_x": "ch1", "time": 0}; None leaves one out. Or
        the axes in the order of the columns, such as ["time", "gyro_x", None]. By default the usual names
        in the header are recognised.
    units : mapping, optional
        Any of {"gyro": "deg/s", "accel": "g", "time": "ms"}. It goes before what the file says; what
        neither says is an error, but for accelerometers whose norm is gravity, and clear time stamps.
    gaps : "keep" or "longest"
        Keep all segments between gaps, or the longest one only. Segments are never glued.
    format : str, optional
        Name of the reader, where the content should not decide, or cannot: "imu:LN200" for the .imu records of
        that sensor. `[reader.name for reader in gmwm.readers.registered()]` are all.
    scale : mapping, optional
        Factors for raw counts, by axis or for all three of a sensor: {"gyro": 1 / 131, "accel_x": 6.1e-5}. Each
        number of the file is multiplied by its factor, the result is in the unit of `units` or of the file.
    increments : bool or sequence, optional
        True, or the sensors or axes whose numbers are integrals over a sample: ["gyro"]. They are multiplied by the
        rate; their unit is told as that of the rate, "deg/s" for degrees.
    topic : str, optional
        Which recording of a file that holds several: the topic of a ROS bag. Needed where not exactly one of them is
        known as inertial.
    start, stop : float, optional
        Leave out what comes before and after these times, in seconds from the first sample: warm-up, handling.
    skip : sequence of (from, to)
        Leave out these ranges of time too, in seconds from the first sample; each leaves a gap.

    Returns
    -------
    Imu
        Its `notes` say what was understood, its `time_base` what the stamps are like.

    Raises
    ------
    ReadError, UnitError
        If the file is not understood; the message says what to pass.
    DataError
        If a channel holds NaN or infinities, is constant, or has fewer than 8 samples.
    OptionError
        If an argument is not one of the values it may take.

    Warns
    -----
    InferredUnitWarning
        If the accelerometers' unit was told from their norm.
    TimeBaseWarning
        If a few time stamps repeat, step backward, or jitter by more than half an interval.

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
        format=format, topic=topic, scale={} if scale is None else scale, increments=increments,
    )  # fmt: skip
    return read_file(path, options)


def read_file(path: str | os.PathLike[str], options: ReadOptions) -> Imu:
    """The recording in a file, as `read` gives it, by options that are checked."""
    rate, units = options.rate, options.units
    file = existing_file(path)
    reader = find_reader(file, options.format)
    layout = one_layout(reader, file, options.topic)
    choice = choose(layout, options.columns, file)
    require_time(layout, choice, rate, file)
    raw = _numbers(reader, file, layout, choice)
    time, time_notes = timing_of(layout, choice, units=units, raw=raw, rate=rate)
    raw.pop("time", None)
    temperature = raw.pop("temperature", None)
    integrals, base_rate = options.integrals, time.base.rate
    scale_notes = multiply(layout, choice, factors=options.scale, increments=integrals, raw=raw, rate=base_rate)
    scales = resolve(layout, choice, declared=units, values=raw, rate=base_rate, increments=integrals)
    imu = Imu(
        _signals(layout, choice, raw=raw, scales=scales, time=time),
        str(path),
        notes=(
            *layout.notes,
            *choice.notes,
            *scale_notes,
            *scales.notes,
            *scales.inferred,
            *time_notes,
            *time.notes,
            *time.troubles,
        ),
        time_base=time.base,
        temperature=temperature,
    )
    for category, sentences in (
        (InferredUnitWarning, scales.inferred),
        (GmwmWarning, scales.doubts),
        (TimeBaseWarning, time.troubles),
    ):
        for sentence in sentences:
            warnings.warn(f"{file}: {sentence}", category, stacklevel=3)
    if options.ranges is not None:
        imu = cut(imu, options.start, options.stop, options.skip)
    return imu.longest() if options.gaps == "longest" else imu


def one_layout(reader: Reader, path: Path, topic: str | None) -> Layout:
    """The recording that is read: the one asked for, or the only one that is inertial."""
    layouts = reader.layouts(path)
    if topic is not None:
        named = [layout for layout in layouts if layout.topic == topic]
        if len(named) == 1:
            return _understood(named[0], path)
        what = f"has {len(named)} recordings with the topic {topic!r}" if named else f"has no topic {topic!r}"
        raise OptionError(f"{path} {what}; its topics: {_topics(layouts)}")
    fitting = [layout for layout in layouts if layout.inertial] if len(layouts) > 1 else layouts
    if len(fitting) == 1:
        return _understood(fitting[0], path)
    if not fitting:
        raise ReadError(
            f"{path} holds {len(layouts)} recordings, none of them known as inertial; choose one with topic= and say "
            f"which of its columns are which axes with columns=. Its topics: {_topics(layouts)}"
        )
    raise ReadError(
        f"{path} holds {len(fitting)} recordings, expected one; choose one with topic=: {_topics(fitting)}"
        f"{_apart(fitting)}"
    )


def _understood(layout: Layout, path: Path) -> Layout:
    """A layout with columns; without any it says why."""
    if layout.channels:
        return layout
    reason = "; ".join(layout.notes) or "no columns"
    raise ReadError(reason if reason.startswith(str(path)) else f"{path}: {reason}")


def _topics(layouts: Sequence[Layout], most: int = 20) -> str:
    """Topics with the axes in them."""
    named = []
    for layout in layouts[:most]:
        axes = [channel.axis for channel in layout.channels if channel.axis in AXES]
        named.append(layout.topic + (f" ({', '.join(axes)})" if axes else ""))
    return ", ".join(named) + (f" and {len(layouts) - most} more" if len(layouts) > most else "") or "none"


def _apart(layouts: Sequence[Layout]) -> str:
    """A remark where gyroscopes and accelerometers stand in recordings of their own."""
    sensors = [{channel.axis[:-2] for channel in layout.channels if channel.axis in AXES} for layout in layouts]
    if any(sensor == {"gyro"} for sensor in sensors) and any(sensor == {"accel"} for sensor in sensors):
        return ". Gyroscopes and accelerometers with clocks of their own are read and calibrated one after the other"
    return ""


def require_time(layout: Layout, choice: Choice, rate: float | None, path: Path) -> None:
    """There must be stamps or a rate, and the stamps must be numbers, dates with times, or times of day."""
    for role, column in choice.columns.items():
        if role != "time" and holds_stamps(layout, column):
            raise ReadError(
                f"{column_words(layout, choice, role, path)} holds dates and times ({layout.first_row[column]!r}), "
                "expected numbers; name another column for it with columns="
            )
    if "time" not in choice.columns:
        if rate is None and layout.stray_time:
            raise ReadError(f"{path}: {layout.stray_time}; repair the file, or pass rate= to read it without stamps")
        if rate is None and layout.rate is None:
            raise ReadError(
                f"{path} has no time column (found: {described(layout)}), so rate= is needed (samples per "
                'second); or name the time column: columns={"time": "<column name or index>"}'
            )
        return
    k = choice.columns["time"]
    if not layout.channels[k].axis and k < len(layout.first_row):
        require_readable(layout.first_row[k], path)


def _numbers(reader: Reader, path: Path, layout: Layout, choice: Choice) -> dict[str, NDArray[Any]]:
    """The numbers of each role in one array, checked: finite, long enough, not constant."""
    parts: dict[str, list[NDArray[Any]]] = {role: [] for role in choice.columns}
    for chunk in reader.chunks(path, layout, list(choice.columns.values())):
        for role, k in choice.columns.items():
            parts[role].append(chunk[k])
    raw: dict[str, NDArray[Any]] = {}
    for role in choice.columns:
        pieces = parts.pop(role)
        column = np.concatenate(pieces) if pieces else np.empty(0)
        # Only stamps profit from staying integers.
        raw[role] = column if role == "time" else column.astype(np.float64, copy=False)
        _require_usable(raw[role], role, column_words(layout, choice, role, path))
    return raw


def _require_usable(column: NDArray[Any], role: str, what: str) -> None:
    require_samples(column.size, what)
    require_finite_rows(column, what)
    if role not in ("time", "temperature") and column[0] == column[-1] and np.all(column == column[0]):
        raise constant(what, role, float(column[0]), column.size)


def require_finite_rows(column: NDArray[Any], what: str, row: int = 0) -> None:
    """An error where a number is NaN or infinite, with its row; so many rows came before the column's first."""
    with np.errstate(over="ignore", invalid="ignore"):
        suspect = not np.isfinite(np.sum(column))  # one fast pass decides the usual case
    if suspect and (bad := ~np.isfinite(column)).any():
        first, count = int(np.argmax(bad)), int(np.count_nonzero(bad))
        raise DataError(
            f"{what} is {column[first]} in row {row + first + 1} ({counted(count, 'such row')}); remove these rows, "
            "their time stamps show the gap, or cut the recording there"
        )


def require_samples(samples: int, what: str) -> None:
    """An error where a column is too short for anything."""
    if samples < MINIMUM_SAMPLES:
        raise DataError(f"{what} has {counted(samples, 'sample')}, at least {MINIMUM_SAMPLES} are needed")


def constant(what: str, role: str, value: float, samples: int) -> DataError:
    """The error of an axis that says nothing."""
    return DataError(
        f"{what} is constant ({value:g} in all {samples} samples); is the sensor connected? "
        f'Leave it out with columns={{"{role}": None}}'
    )


def column_words(layout: Layout, choice: Choice, role: str, path: Path) -> str:
    """What a column is called in messages: its file, what it is, and its name in the file."""
    k = choice.columns[role]
    name = layout.channels[k].name or f"number {k}"
    return f"{path}: {role}" + ("" if name == role else f" (column {name!r})")


def timing_of(
    layout: Layout,
    choice: Choice,
    units: Mapping[str, str],
    raw: Mapping[str, NDArray[Any]],
    rate: float | None,
) -> tuple[Timing, tuple[str, ...]]:
    """The time base, and remarks on how the stamps were understood."""
    if "time" not in raw:
        stated = layout.rate if rate is None else rate
        return unstamped(as_rate(stated), raw[choice.axes[0]].size), ()
    unit, overruled = time_unit(layout, choice, units)
    stamps, remark = as_stamps(raw["time"], unit, rate)
    found = timing(stamps, rate)
    if rate is None and layout.rate is not None and layout.rate_of_samples:
        found = beside_stated(found, layout.rate)
    return found, tuple(note for note in (overruled, remark) if note)


def _signals(
    layout: Layout, choice: Choice, raw: Mapping[str, Vector], scales: Scales, time: Timing
) -> dict[str, Signal]:
    """The axes in SI units."""
    signals = {}
    for axis in choice.axes:
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
