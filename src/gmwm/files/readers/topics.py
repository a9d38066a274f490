"""Choose the recording to read in a file that may hold several."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gmwm.base.axis_names import AXES
from gmwm.base.errors import OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.text import counted, duration_text
from gmwm.files.contract import Layout, Reader, existing_file, find_reader
from gmwm.files.readers.several_files import Source, found_reader


def one_layout(reader: Reader, path: Path, topic: str | None) -> Layout:
    """Choose the recording to read: the recording named `topic`, or the only inertial recording."""
    layouts = reader.layouts(path)
    if topic is not None:
        # The number of the first instance of a message, and the slash of a ROS topic, can be left out.
        spelled = ((topic,), (f"{topic}_0", f"/{topic}"))
        named = next((matches for names in spelled if (matches := [x for x in layouts if x.topic in names])), [])
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
        chosen = Remark.of("topic-chosen", case="chosen", topic=topic_words(preferred[0]), others=others)
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


def reopen(path: Path, format: str, topic: str | None, skip_bad_lines: bool) -> tuple[Reader, Layout]:
    """Find the reader and the layout of a file again, in another process, without repeating warnings."""
    reader = find_reader(existing_file(path), format)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return reader, replace(one_layout(reader, path, topic), skip_bad_lines=skip_bad_lines)


def inertial_topics(path: Source, format: str | None = None) -> tuple[str, ...]:
    """Return the names of the inertial recordings in a file, in their order."""
    file, reader = found_reader(path, format)
    layouts = reader.layouts(file)
    return tuple(layout.topic for layout in layouts if layout.inertial or len(layouts) == 1)


def sensor_topics(path: Source, format: str | None = None) -> tuple[str, ...]:
    """Return the names of the recordings with all six axes, or else of all inertial ones; () for single recordings."""
    file, reader = found_reader(path, format)
    if reader.single:
        return ()
    layouts = [layout for layout in reader.layouts(file) if layout.inertial]
    complete = [layout for layout in layouts if set(AXES) <= {channel.axis for channel in layout.channels}]
    return tuple(layout.topic for layout in complete or layouts)


def topic_folder(topic: str) -> str:
    """Return the name of the directory or file for the results of a topic.

    >>> topic_folder("/imu0/data"), topic_folder("sensor_combined_0"), topic_folder("../x")
    ('imu0_data', 'sensor_combined_0', 'x')
    """
    return "_".join(part for part in topic.replace("\\", "/").split("/") if part.strip(".")) or "recording"


def separate_sensors(path: Source, format: str | None = None) -> tuple[str, str] | None:
    """Return the names of the recordings of gyroscopes and of accelerometers, if the file has exactly these two."""
    file, reader = found_reader(path, format)
    layouts = [layout for layout in reader.layouts(file) if layout.inertial]
    named = {tuple(_sensors(layout)): layout.topic for layout in layouts}
    if len(layouts) != 2 or set(named) != {("gyro",), ("accel",)}:
        return None
    return named["gyro",], named["accel",]


def _readable(layout: Layout, path: Path) -> Layout:
    """Return the layout, after a check that it has columns."""
    if layout.unreadable is not None:
        raise layout.unreadable
    if not layout.channels:
        raise ReadError(
            f"{path} has no columns", code="no-inertial-data", advice="Check whether the recording was interrupted."
        )
    return layout


def _topics(layouts: Sequence[Layout], most: int = 20) -> str:
    """List topics with their axes, for a message."""
    named = [topic_words(layout) for layout in layouts[:most]]
    return ", ".join(named) + (f" and {len(layouts) - most} more" if len(layouts) > most else "") or "none"


def topic_words(layout: Layout) -> str:
    """Describe a topic with its axes, rate and length, for a message.

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


_APART = (
    " Gyroscopes and accelerometers with different clocks are read one after the other. The command calibrate "
    "calibrates both."
)


def _apart(layouts: Sequence[Layout]) -> bool:
    """Return whether one recording has only gyroscopes and another only accelerometers."""
    sensors = [_sensors(layout) for layout in layouts]
    return {"gyro"} in sensors and {"accel"} in sensors


def _sensors(layout: Layout) -> set[str]:
    """Return the sensors of a recording: gyro, accel, or both."""
    return {channel.axis[:-2] for channel in layout.channels if channel.axis in AXES}
