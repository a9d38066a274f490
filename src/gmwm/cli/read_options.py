"""Options for reading a recording and for selecting its axes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from gmwm.base.errors import OptionError
from gmwm.base.time_base import parse_length
from gmwm.base.units import SI_UNIT
from gmwm.cli.options import InputOption
from gmwm.files.columns.axis_units import parse_scale
from gmwm.files.columns.columns import parse_columns
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Imu, Signal

File = Annotated[Path, typer.Argument(
    help='Recording in any supported format; or a pattern in quotes, such as "hour_*.csv", for files that continue '
    "one another.", metavar="FILE",
)]  # fmt: skip
Files = Annotated[list[Path], typer.Argument(
    help='Recording in any supported format; or a pattern in quotes, such as "hour_*.csv", for files that continue '
    "one another. If several recordings are given, they must be of one unit, and one model is fitted to all of "
    "them. Their lengths may differ.", metavar="FILE…",
)]  # fmt: skip
Rate = Annotated[float | None, InputOption(help="Sampling rate (Hz). Not needed if the file has time stamps.")]
Units = Annotated[str | None, InputOption(
    help="Units, if the file does not state them. Gyroscopes: rad/s, deg/s, mdeg/s, deg/h; accelerometers: m/s², "
    "g, mg, mGal, µg; position: m, cm, mm; time: s, ms, us, ns.", metavar="gyro=deg/s,accel=g",
)]  # fmt: skip
Scale = Annotated[str | None, InputOption(
    help="Scale factors for raw counts, by sensor or axis. Each number in the file is multiplied by its factor.",
    metavar="gyro=1/131,accel_x=6.1e-5",
)]  # fmt: skip
Increments = Annotated[str | None, InputOption(
    help="Sensors or axes whose numbers are increments of angle or velocity per sample. The increments are "
    "multiplied by the sampling rate; for increments in degrees, give the unit deg/s in --units.", metavar="gyro,accel",
)]  # fmt: skip
Mount = Annotated[str | None, InputOption(
    help="How the unit is mounted: the axis of the unit, with its sign, along each of x, y and z of the vehicle.",
    metavar="x=-y,y=x,z=z",
)]  # fmt: skip
Columns = Annotated[str | None, InputOption(
    help="Axes of the columns, if the file does not name them: a list in the order of the columns, in which an "
    "empty item skips a column; or items axis=NAME or axis=INDEX, with indices from 0. time= ignores the time "
    "stamps.", metavar="time,gyro_x,gyro_y,…",
)]  # fmt: skip
Gaps = Annotated[Literal["keep", "longest"], InputOption(
    help="If samples are missing: use all segments between the gaps (keep), or only the longest segment (longest)."
)]  # fmt: skip
BadLines = Annotated[Literal["error", "skip"], InputOption(
    help="If a line of a text file cannot be read: stop with an error that names the line (error), or treat the "
    "line as missing samples (skip)."
)]  # fmt: skip
Format = Annotated[str | None, InputOption(
    help="Format of the file, if its content does not show it, for example imu:LN200 for .imu records of that "
    "sensor. If the name is unknown, the error lists all formats.", metavar="NAME",
)]  # fmt: skip


Start = Annotated[str | None, InputOption(
    help="Start at this time after the first sample, such as 90s, 10min, 1h30m or a number of seconds.",
    metavar="LENGTH",
)]  # fmt: skip
Stop = Annotated[str | None, InputOption(help="Stop at this time after the first sample.", metavar="LENGTH")]
Skip = Annotated[list[str] | None, InputOption(
    help="Leave out a time range, such as 20min-25min after the first sample. For several ranges, repeat the "
    "option or use commas.", metavar="FROM-TO",
)]  # fmt: skip
Topic = Annotated[str | None, InputOption(
    help="Recording to read from a file that contains several, for example a topic of a ROS bag. If the option is "
    "missing for such a file, the error lists the names.", metavar="NAME",
)]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ReadOptionTexts:
    """The options for reading a recording as the shell passes them, in the order of the help."""

    rate: Rate = None
    units: Units = None
    columns: Columns = None
    gaps: Gaps = "keep"
    bad_lines: BadLines = "error"
    start: Start = None
    stop: Stop = None
    skip: Skip = None
    format: Format = None
    topic: Topic = None
    scale: Scale = None
    increments: Increments = None
    mount: Mount = None

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


Axes = Annotated[list[str] | None, InputOption(
    "--axis",
    help="Axis to use: gyro_x … accel_z, east, north, up or level, or gyro or accel for all three axes of a "
    "sensor. For several axes, repeat the option or use commas. Default: all axes.", metavar="AXIS",
)]  # fmt: skip


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
