"""Choose a recording in a file with several, and read several files that continue one another as one.

Files of a pattern such as logs/hour_*.csv are sorted by the numbers in their names. Time stamps show the samples lost
between files; without them, the recording is split there."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from gmwm.base.errors import OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.text import counted, duration_text, printable
from gmwm.base.units import AXES
from gmwm.files.clock.missing_values import CUT
from gmwm.files.contract import Layout, Reader, Rows, existing_file, find_reader

Source = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]  # A file, a pattern, or a sequence of files


def found_reader(path: Source, format: str | None) -> tuple[Path, Reader]:
    """Return the file and its reader; for several files, the first file and a reader of all of them."""
    files = [existing_file(file) for file in files_of(path)]
    readers = [find_reader(file, format) for file in files]
    return files[0], readers[0] if len(files) == 1 else SeveralFiles(files, readers)


def files_of(path: Any) -> list[Any]:
    """Return the paths of a recording: a single path, the items of a sequence, or the matches of a pattern."""
    if isinstance(path, list | tuple) and path:
        return list(path)
    if not isinstance(path, str | os.PathLike) or not re.search(r"[*?\[]", os.fsdecode(path)) or Path(path).exists():
        return [path]
    pattern = Path(os.fsdecode(path))
    anchor = Path(pattern.anchor) if pattern.anchor else Path()
    matches = anchor.glob(str(pattern.relative_to(pattern.anchor) if pattern.anchor else pattern))
    return sorted(matches, key=_in_order) or [path]


def _in_order(path: Path) -> list[tuple[int, str]]:
    """Return a key that sorts numbers in names by their size: hour_2 before hour_10."""
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", str(path))]


def source_words(path: Source) -> str:
    """Return the name of a recording for titles.

    >>> source_words("a.csv"), source_words(["a.csv", "b.csv", "c.csv"])
    ('a.csv', 'a.csv and 2 more')
    """
    if isinstance(path, str | os.PathLike):
        return printable(os.fsdecode(path))
    return printable(f"{path[0]} and {len(path) - 1} more" if len(path) > 1 else str(path[0]))


class SeveralFiles(Reader):
    """Reads several files one after the other. It is not registered: the number of files chooses it."""

    name: ClassVar[str] = "several files"

    def __init__(self, files: Sequence[Path], readers: Sequence[Reader]) -> None:
        self._files, self._readers = tuple(files), tuple(readers)

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings of the first file."""
        joined = Remark.of("file-content", case="files", files=tuple(file.name for file in self._files))
        return tuple(
            replace(layout, remarks=(*layout.remarks, joined)) for layout in self._readers[0].layouts(self._files[0])
        )

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the rows of all files."""
        for k, (file, reader) in enumerate(zip(self._files, self._readers, strict=True)):
            file_layout = layout if k == 0 else self._alike(file, reader, layout, wanted)
            cut = k > 0 and not layout.stamped
            for rows in reader.chunks(file, file_layout, wanted):
                yield _cut_before(rows) if cut else rows
                cut = False

    def _alike(self, file: Path, reader: Reader, layout: Layout, wanted: Sequence[int]) -> Layout:
        """Return the recording of another file that continues the recording of the first file."""
        for candidate in reader.layouts(file):
            names = [channel.name for channel in candidate.channels]
            same = len(names) == len(layout.channels) and all(names[k] == layout.channels[k].name for k in wanted)
            if candidate.topic == layout.topic and same:
                return replace(candidate, skip_bad_lines=layout.skip_bad_lines)
        shown = ", ".join(layout.channels[k].name or f"number {k}" for k in wanted)
        raise ReadError(
            f"{file} does not continue {self._files[0]}: it has no recording with the same columns, {shown}",
            code="not-continued",
            advice="Read the two files one at a time.",
        )


def _cut_before(rows: Rows) -> Rows:
    """Add a mark that splits the recording before the first of the rows."""
    cut = np.zeros(next(iter(rows.values())).size, dtype=bool)
    cut[:1] = True
    return {**rows, CUT: cut}


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
