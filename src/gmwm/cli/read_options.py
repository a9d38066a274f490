"""The options of the shell for reading a recording, and the axes that are used of it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm._template import shell_option
from gmwm.cli.durations import parse_length
from gmwm.errors import DataError, OptionError
from gmwm.options import ReadOptions
from gmwm.units import SI_UNIT

if TYPE_CHECKING:
    from gmwm.signals import Imu, Signal

INPUT = "Input"

File = Annotated[
    Path, typer.Argument(help="Recording, in any format that is read.", metavar="FILE", show_default=False)
]
Rate = Annotated[
    float | None,
    typer.Option(help="Samples per second (Hz). Not needed if the file has time stamps.", rich_help_panel=INPUT),
]
Units = Annotated[
    str | None,
    typer.Option(
        help="Units where the file does not name them. Gyroscopes: rad/s, deg/s, mdeg/s, deg/h; "
        "accelerometers: m/s², g, mg, mGal, µg; time: s, ms, us, ns.",
        metavar="gyro=deg/s,accel=g",
        rich_help_panel=INPUT,
    ),
]
Scale = Annotated[
    str | None,
    typer.Option(
        help="Factors for raw counts, by sensor or axis: a number of the file times its factor is in the unit.",
        metavar="gyro=1/131,accel_x=6.1e-5",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Increments = Annotated[
    str | None,
    typer.Option(
        help="Sensors or axes whose numbers are angles and velocities gained in a sample: they are multiplied by the "
        "rate; their unit is told as that of the rate, deg/s for degrees.",
        metavar="gyro,accel",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Columns = Annotated[
    str | None,
    typer.Option(
        help="Which column is what, where the names do not tell: all in order (nothing between commas skips one), "
        "or axis=NAME and axis=NUMBER with numbers from 0; time= leaves the time out.",
        metavar="time,gyro_x,gyro_y,…",
        rich_help_panel=INPUT,
    ),
]
Gaps = Annotated[
    Literal["keep", "longest"],
    typer.Option(
        help="A recording with missing samples: keep its segments apart, or cut it to the longest one.",
        rich_help_panel=INPUT,
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        help="Format of the file, where its content should not decide or cannot: imu:LN200 for .imu records of that "
        "sensor, say. A wrong name is answered with all of them.",
        metavar="NAME",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


Start = Annotated[
    str | None,
    typer.Option(
        help="Leave out what comes before, counted from the first sample: 90s, 10min, 1h30m or seconds.",
        metavar="LENGTH",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Stop = Annotated[
    str | None,
    typer.Option(
        help="Leave out what comes after, counted from the first sample.",
        metavar="LENGTH",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Skip = Annotated[
    list[str] | None,
    typer.Option(
        help="Leave out what lies between two times from the first sample, as 20min-25min; repeat it or use commas.",
        metavar="FROM-TO",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(
        help="Which recording of several in one file, a topic of a ROS bag for one, where not exactly one is inertial; "
        "without it they are listed.",
        metavar="NAME",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


@dataclass(frozen=True, kw_only=True)
class ReadOptionTexts:
    """The options that all commands with a recording share, as they are typed, in the order of their help."""

    rate: Rate = None
    units: Units = None
    columns: Columns = None
    gaps: Gaps = "keep"
    start: Start = None
    stop: Stop = None
    skip: Skip = None
    format: Format = None
    topic: Topic = None
    scale: Scale = None
    increments: Increments = None

    def parsed(self) -> ReadOptions:
        """The same as values, checked."""
        return ReadOptions(
            rate=self.rate,
            columns=parse_columns(self.columns),
            units=parse_units(self.units) or {},
            gaps=self.gaps,
            start=_length(self.start, "start"),
            stop=_length(self.stop, "stop"),
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
        help="Axis to use: gyro_x … accel_z, or gyro or accel for three; repeat it or use commas. Default: all.",
        metavar="AXIS",
        rich_help_panel=INPUT,
        show_default=False,
    ),
]


def load(path: Path, reading: ReadOptions) -> Imu:
    """The recording in a file."""
    from gmwm.cli.output import progress
    from gmwm.readers.api import read_file

    with progress(f"reading {path.name}"):
        return read_file(path, reading)


def _length(text: str | None, argument: str) -> float | None:
    return None if text is None else parse_length(text, shell_option(argument))


def parse_skips(texts: Sequence[str] | None) -> list[tuple[float, float]]:
    """Ranges of time to leave out (s).

    >>> parse_skips(["20min-25min,1h-1h30s"])
    [(1200.0, 1500.0), (3600.0, 3630.0)]
    """
    skips = []
    for part in (part.strip() for text in texts or () for part in text.split(",")):
        # A number may have a minus sign after its e.
        ends = re.split(r"(?<![0-9.][eE])-", part)
        if len(ends) != 2:
            raise OptionError(f"--skip takes two times with a minus sign between, as 20min-25min; got {part!r}")
        begin, end = (parse_length(text, "--skip") for text in ends)
        skips.append((begin, end))
    return skips


def parse_units(text: str | None) -> dict[str, str] | None:
    """Units as `gmwm.read` takes them.

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
            raise OptionError(
                f"--units takes a unit for {', '.join(known)}, as gyro=deg/s,accel=g; got {part.strip()!r}"
            )
        units[name] = unit
    return units


def parse_scale(text: str | None) -> dict[str, float] | None:
    """Factors as `gmwm.read` takes them, each a number or a fraction.

    >>> parse_scale("gyro=1/131,accel_x=6.1e-5")
    {'gyro': 0.007633587786259542, 'accel_x': 6.1e-05}
    """
    if text is None:
        return None
    factors = {}
    for part in text.split(","):
        name, mark, number = (piece.strip() for piece in part.partition("="))
        above, _, below = number.partition("/")
        try:
            factors[name] = float(above) / float(below or 1)
        except (ValueError, ZeroDivisionError):
            mark = ""
        if not mark or not name:
            raise OptionError(f"--scale takes a factor for each, as gyro=1/131,accel_x=6.1e-5; got {part.strip()!r}")
    return factors


def parse_columns(text: str | None) -> dict[str, str | int | None] | list[str] | None:
    """Columns as `gmwm.read` takes them.

    >>> parse_columns("time,gyro_x,,accel_z")
    ['time', 'gyro_x', '', 'accel_z']
    >>> parse_columns("gyro_x=wx,gyro_y=3,time=")
    {'gyro_x': 'wx', 'gyro_y': 3, 'time': None}
    """
    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if "=" not in text:
        return parts
    columns: dict[str, str | int | None] = {}
    for part in parts:
        axis, mark, column = (piece.strip() for piece in part.partition("="))
        if not mark or not axis:
            raise OptionError(f"--columns takes axis=COLUMN for each, as gyro_x=wx,gyro_y=3; got {part!r}")
        columns[axis] = int(column) if column.isdecimal() else column or None
    return columns


def require_whole(imu: Imu) -> None:
    """An error where a recording has gaps, for what is not measured over several segments."""
    if len(imu.segments) > 1:
        sizes = ", ".join(str(stop - start) for start, stop in imu.segments[:5])
        raise DataError(
            f"the recording has gaps: {len(imu.segments)} segments of {sizes}{', …' if len(imu.segments) > 5 else ''} "
            "samples, which are never glued; pass --gaps longest to use the longest of them"
        )


def chosen_axes(imu: Imu, wanted: Sequence[str] | None) -> Mapping[str, Signal]:
    """The signals that --axis names, all by default."""
    return {axis: imu[axis] for axis in chosen_names(imu.axes, wanted)}


def chosen_names(known: Sequence[str], wanted: Sequence[str] | None) -> list[str]:
    """The axes among the known ones that --axis names, all by default.

    >>> chosen_names(["gyro_x", "gyro_y", "accel_x"], ["gyro"])
    ['gyro_x', 'gyro_y']
    """
    if not wanted:
        return list(known)
    axes: list[str] = []
    for name in (part.strip() for text in wanted for part in text.split(",")):
        triad = [axis for axis in known if axis.startswith(f"{name}_")]
        if name not in known and not triad:
            raise OptionError(f"--axis must be one of {', '.join(known)}; got {name!r}")
        axes += triad or [name]
    return [axis for axis in known if axis in axes]
