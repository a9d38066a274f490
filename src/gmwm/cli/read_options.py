"""Options for reading a recording and for selecting its axes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from gmwm.base.errors import OptionError
from gmwm.base.time_base import parse_length
from gmwm.base.units import SI_UNIT
from gmwm.files.columns.axis_units import parse_scale
from gmwm.files.columns.columns import parse_columns
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu, Signal


@dataclass(frozen=True, kw_only=True)
class ReadOptionTexts:
    """The options for reading a recording as the shell passes them, in the order of the help."""

    rate: float | None = None
    units: str | None = None
    columns: str | None = None
    gaps: Literal["keep", "longest"] = "keep"
    bad_lines: Literal["error", "skip"] = "error"
    start: str | None = None
    stop: str | None = None
    skip: list[str] | None = None
    format: str | None = None
    topic: str | None = None
    scale: str | None = None
    increments: str | None = None
    mount: str | None = None

    def parse(self) -> ReadOptions:
        """Parse and check the options, and return them as `ReadOptions`."""
        return ReadOptions(
            rate=self.rate, columns=parse_columns(self.columns), units=parse_units(self.units) or {}, gaps=self.gaps,
            bad_lines=self.bad_lines, start=None if self.start is None else parse_length(self.start, "start"),
            stop=None if self.stop is None else parse_length(self.stop, "stop"), skip=parse_skips(self.skip),
            format=self.format, topic=self.topic, scale=parse_scale(self.scale) or {},
            increments=[part.strip() for part in (self.increments or "").split(",") if part.strip()],
            mount=parse_mount(self.mount),
        )  # fmt: skip


def load(path: Path, reading: ReadOptions) -> Imu:
    """Read the recording in a file into memory, with a progress bar."""
    from gmwm.cli.output import progress
    from gmwm.files.readers.api import read_file

    with progress(f"reading {path.name}"):
        return read_file(path, reading)


def parse_skips(texts: Sequence[str] | None) -> list[tuple[float, float]]:
    """Parse the values of --skip to time ranges (s).

    >>> parse_skips(["20min-25min,1h-1h30s"])
    [(1200.0, 1500.0), (3600.0, 3630.0)]
    """
    skips = []
    for part in (part.strip() for text in texts or () for part in text.split(",")):
        # The minus sign of an exponent, as in 1e-3, does not separate the ends of the range.
        ends = re.split(r"(?<![0-9.][eE])-", part)
        if len(ends) != 2:
            raise OptionError(argument="skip", expected="a time range such as 20min-25min", got=part)
        begin, end = (parse_length(text, "skip") for text in ends)
        skips.append((begin, end))
    return skips


def parse_units(text: str | None) -> dict[str, str] | None:
    """Parse the value of --units to the mapping that `gmwm.read` takes.

    >>> parse_units("gyro=deg/s,accel=g")
    {'gyro': 'deg/s', 'accel': 'g'}
    """
    if text is None:
        return None
    sensors = (*SI_UNIT, "position", "time")
    units = {}
    for part in text.split(","):
        name, mark, unit = (piece.strip() for piece in part.partition("="))
        if not mark or name not in sensors or not unit:
            expected = f"units of {', '.join(sensors)}, such as gyro=deg/s,accel=g"
            raise OptionError(argument="units", expected=expected, got=part.strip())
        units[name] = unit
    return units


def chosen_axes(imu: Imu, wanted: Sequence[str] | None) -> Mapping[str, Signal]:
    """Return the signals that --axis selects; all signals if --axis is not given."""
    return {axis: imu[axis] for axis in chosen_names(imu.axes, wanted)}


def chosen_names(known: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """Return the known axes that --axis selects; all axes if --axis is not given.

    >>> chosen_names(["gyro_x", "gyro_y", "accel_x"], ["gyro"])
    ['gyro_x', 'gyro_y']
    """
    if not wanted:
        return list(known)
    axes: list[str] = []
    for name in (part.strip() for text in wanted for part in text.split(",")):
        triad = [axis for axis in known if axis.startswith(f"{name}_")]
        if name not in known and not triad:
            raise OptionError(argument="axis", expected=f"one of {', '.join(known)}", got=name)
        axes += triad or [name]
    return [axis for axis in known if axis in axes]


def require_one_axis(names: Sequence[str], plot: Path | None, advice: str = "Select one with {--axis}.") -> None:
    """Raise an OptionError if --plot is given, which shows one axis, and several axes are selected."""
    if plot is not None and len(names) > 1:
        raise OptionError(
            f"--plot needs one axis, but {', '.join(names)} are selected", argument="plot", got=names, advice=advice
        )


def names_of(files: Sequence[Path]) -> list[str]:
    """Return a unique name for each file: its stem, the name of its folder, or its path."""
    for names in ([file.stem for file in files], [file.resolve().parent.name for file in files]):
        if len(set(names)) == len(names):
            return names
    paths = [str(file) for file in files]
    if len(set(paths)) == len(paths):
        return paths
    raise OptionError(f"a file is given twice: {', '.join(paths)}", argument="files", got=paths)


def document_of(files: Sequence[Path]) -> dict[str, object]:
    """Return the entry "file" of a JSON document, or "files" if there are several files."""
    return {"file": str(files[0])} if len(files) == 1 else {"files": list(map(str, files))}


def only_file(files: Sequence[Path], option: str) -> Path:
    """Return the only file of a command."""
    if len(files) > 1:
        raise OptionError(
            f"{option} needs one recording, but {len(files)} are given", argument="files",
            got=[str(file) for file in files], advice="Pass one file, or leave the option out.",
        )  # fmt: skip
    return files[0]


def parse_mount(text: str | None) -> dict[str, str]:
    """Parse the text of the option `mount`.

    >>> parse_mount("x=-y,y=x,z=z")
    {'x': '-y', 'y': 'x', 'z': 'z'}
    """
    pairs = [part.partition("=") for part in (text or "").split(",") if part.strip()]
    return {key.strip(): axis.strip() for key, _, axis in pairs}
