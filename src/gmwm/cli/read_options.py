"""Options for reading a recording and for selecting its axes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.durations import parse_length
from gmwm.errors import OptionError
from gmwm.options import ReadOptions
from gmwm.readers.columns import parse_columns
from gmwm.readers.scale_factors import parse_scale
from gmwm.units import SI_UNIT

if TYPE_CHECKING:
    from gmwm.signals import Imu, Signal

INPUT = "Input"

File = Annotated[
    Path,
    typer.Argument(
        help="Recording, in any supported format; or a pattern in quotes, 'hour_*.csv', of files that continue one "
        "another.",
        metavar="FILE",
        show_default=False,
    ),
]
Files = Annotated[
    list[Path],
    typer.Argument(
        help="Recording, in any supported format; or a pattern in quotes, 'hour_*.csv', of files that continue one "
        "another. Several files are recordings of one unit: one model is fitted to all of them. Their "
        "lengths may differ.",
        metavar="FILE…",
        show_default=False,
    ),
]
Rate = Annotated[
    float | None,
    typer.Option(help="Sampling rate (Hz). Not needed if the file has time stamps.", rich_help_panel=INPUT),
]
Units = Annotated[
    str | None,
    typer.Option(
        help="Units, if the file does not state them. Gyroscopes: rad/s, deg/s, mdeg/s, deg/h; accelerometers: m/s², "
        "g, mg, mGal, µg; time: s, ms, us, ns.",
        metavar="gyro=deg/s,accel=g",
        rich_help_panel=INPUT,
    ),
]
Scale = Annotated[
    str | None,
    typer.Option(
        help="Scale factors for raw counts, by sensor or axis. Each number in the file is multiplied by its factor.",
        metavar="gyro=1/131,accel_x=6.1e-5",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Increments = Annotated[
    str | None,
    typer.Option(
        help="Sensors or axes whose numbers are increments of angle or velocity per sample. They are multiplied by "
        "the rate; with --units, state the unit of the rate: deg/s for degrees.",
        metavar="gyro,accel",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Axes of the columns, if the file does not name them: a list in the order of the columns (an empty item "
        "skips a column), or axis=NAME or axis=INDEX with indices from 0. time= ignores the time stamps.",
        metavar="time,gyro_x,gyro_y,…",
        rich_help_panel=INPUT,
    ),
]
Gaps = Annotated[
    Literal["keep", "longest"],
    typer.Option(
        help="If samples are missing: keep all segments between the gaps, or use only the longest segment.",
        rich_help_panel=INPUT,
    ),
]
BadLines = Annotated[
    Literal["error", "skip"],
    typer.Option(
        help="If a line of a text file cannot be read: stop with an error that names the line, or skip it. A skipped "
        "line is a gap.",
        rich_help_panel=INPUT,
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        help="Format of the file, if its content does not show it. For example, imu:LN200 for .imu records of that "
        "sensor. An unknown name prints all formats.",
        metavar="NAME",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


Start = Annotated[
    str | None,
    typer.Option(
        help="Start at this time after the first sample: 90s, 10min, 1h30m or seconds.",
        metavar="LENGTH",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Stop = Annotated[
    str | None,
    typer.Option(
        help="Stop at this time after the first sample.",
        metavar="LENGTH",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Skip = Annotated[
    list[str] | None,
    typer.Option(
        help="Leave out a time range, such as 20min-25min after the first sample. Repeat the option, or use commas.",
        metavar="FROM-TO",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(
        help="Recording to read from a file with several, for example the topic of a ROS bag. If the file has "
        "several and none is named, the error lists them.",
        metavar="NAME",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


@dataclass(frozen=True, kw_only=True)
class ReadOptionTexts:
    """Texts of the options for reading a recording, in the order of the help."""

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

    def parsed(self) -> ReadOptions:
        """Parse and check the options.

        Raises
        ------
        OptionError, UnitError
            If a value is not allowed.
        """
        return ReadOptions(
            rate=self.rate,
            columns=parse_columns(self.columns),
            units=parse_units(self.units) or {},
            gaps=self.gaps,
            bad_lines=self.bad_lines,
            start=None if self.start is None else parse_length(self.start, "start"),
            stop=None if self.stop is None else parse_length(self.stop, "stop"),
            skip=parse_skips(self.skip),
            format=self.format,
            topic=self.topic,
            scale=parse_scale(self.scale) or {},
            increments=[part.strip() for part in (self.increments or "").split(",") if part.strip()],
        )


Axes = Annotated[
    list[str] | None,
    typer.Option(
        "--axis",
        help="Axis to use: gyro_x … accel_z; gyro or accel for all three. Repeat the option, or use commas. Default: "
        "all axes.",
        metavar="AXIS",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


def load(path: Path, reading: ReadOptions) -> Imu:
    """Read the recording in a file."""
    from gmwm.cli.output import progress
    from gmwm.readers.api import read_file

    with progress(f"reading {path.name}"):
        return read_file(path, reading)


def parse_skips(texts: Sequence[str] | None) -> list[tuple[float, float]]:
    """Parse time ranges (s) to leave out.

    >>> parse_skips(["20min-25min,1h-1h30s"])
    [(1200.0, 1500.0), (3600.0, 3630.0)]
    """
    skips = []
    for part in (part.strip() for text in texts or () for part in text.split(",")):
        # An exponent may have a minus sign: 1e-3.
        ends = re.split(r"(?<![0-9.][eE])-", part)
        if len(ends) != 2:
            raise OptionError(argument="skip", expected="a time range such as 20min-25min", got=part)
        begin, end = (parse_length(text, "skip") for text in ends)
        skips.append((begin, end))
    return skips


def parse_units(text: str | None) -> dict[str, str] | None:
    """Parse units to the mapping that `gmwm.read` takes.

    >>> parse_units("gyro=deg/s,accel=g")
    {'gyro': 'deg/s', 'accel': 'g'}
    """
    if text is None:
        return None
    known = (*SI_UNIT, "time")
    units = {}
    for part in text.split(","):
        name, mark, unit = (piece.strip() for piece in part.partition("="))
        if not mark or name not in known or not unit:
            expected = f"units of {', '.join(known)}, such as gyro=deg/s,accel=g"
            raise OptionError(argument="units", expected=expected, got=part.strip())
        units[name] = unit
    return units


def chosen_axes(imu: Imu, wanted: Sequence[str] | None) -> Mapping[str, Signal]:
    """Return the signals that --axis selects. Default: all."""
    return {axis: imu[axis] for axis in chosen_names(imu.axes, wanted)}


def chosen_names(known: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """Return the known axes that --axis selects. Default: all.

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


def names_of(files: Sequence[Path]) -> list[str]:
    """Return unique names of files: their stems, the names of their folders, or their paths.

    Raises
    ------
    OptionError
        If a file is given twice.
    """
    for names in ([file.stem for file in files], [file.resolve().parent.name for file in files]):
        if len(set(names)) == len(names):
            return names
    paths = [str(file) for file in files]
    if len(set(paths)) == len(paths):
        return paths
    raise OptionError(f"a file is given twice: {', '.join(paths)}", argument="files", got=paths)


def document_of(files: Sequence[Path]) -> dict[str, object]:
    """Return the key "file" of a document, or "files" if there are several."""
    return {"file": str(files[0])} if len(files) == 1 else {"files": list(map(str, files))}


def only_file(files: Sequence[Path], option: str) -> Path:
    """Return the only file; raise an error if there are several.

    Raises
    ------
    OptionError
        If there are several, which `option` does not allow.
    """
    if len(files) > 1:
        raise OptionError(
            f"{option} needs one recording, but {len(files)} are given", argument="files",
            got=[str(file) for file in files], advice="Pass one file, or leave the option out.",
        )  # fmt: skip
    return files[0]
