"""What the commands that take a file share: its options, in words, and how a recording is loaded by them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.errors import DataError, OptionError
from gmwm.units import SI_UNIT

if TYPE_CHECKING:
    from gmwm.signals import Imu, Signal

INPUT = "Input"
RESULT = "Result"

File = Annotated[Path, typer.Argument(help="Recording: CSV, TXT or Parquet.", metavar="FILE", show_default=False)]
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
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="JSON on stdout and nothing else; warnings and progress on stderr.",
        rich_help_panel=RESULT,
    ),
]
View = Annotated[
    Literal["wavelet", "allan"],
    typer.Option(
        help="Wavelet variance over its scale, or Allan deviation over its averaging time.",
        rich_help_panel=RESULT,
    ),
]
Datasheet = Annotated[
    bool, typer.Option("--datasheet", help="deg/h and mg in place of rad/s and m/s².", rich_help_panel=RESULT)
]
Filter = Annotated[
    str,
    typer.Option(
        help="Wavelet filter: haar, d4 … d16, la8 … la20, fk4 … fk22, bl14, bl20, mb4 … mb24, or one of PyWavelets'.",
        rich_help_panel="Estimation",
    ),
]
TransformName = Annotated[
    Literal["modwt", "dwt"],
    typer.Option(
        "--transform",
        help="Maximal-overlap transform, or the decimated one, which scatters more.",
        rich_help_panel="Estimation",
    ),
]
Robust = Annotated[
    bool,
    typer.Option(
        "--robust", help="By the robust wavelet variance, which outliers do not reach.", rich_help_panel="Estimation"
    ),
]
Efficiency = Annotated[
    float | None,
    typer.Option(
        help="Of the robust wavelet variance under Gaussian noise, from 0.3 to 0.99: a low one stands outliers "
        "that are near, a high one more of those that are far. Default: 0.6.",
        rich_help_panel="Estimation",
        show_default=False,
    ),
]
Within = Annotated[
    str,
    typer.Option(
        help="The largest model; every part of it is compared. Held values are in all: WN(sigma2=fixed(1e-6)).",
        metavar="MODEL",
        rich_help_panel="Estimation",
    ),
]
ChoiceWeighting = Annotated[
    Literal["optimal", "diagonal"],
    typer.Option(
        "--weighting",
        help="Weigh the levels with all their covariances, or each by its own variance.",
        rich_help_panel="Estimation",
    ),
]
CriterionName = Annotated[
    Literal["asymptotic", "bootstrap"],
    typer.Option(
        "--criterion",
        help="The penalty of a model by theory, or from simulated records.",
        rich_help_panel="Estimation",
    ),
]
Confidence = Annotated[
    float,
    typer.Option(
        help="Level of the intervals, and of what counts as equally good.",
        metavar="LEVEL",
        rich_help_panel="Estimation",
    ),
]
Seed = Annotated[
    int, typer.Option(help="Of the records that a choice is tested with.", min=0, rich_help_panel="Estimation")
]


def chosen_efficiency(robust: bool, efficiency: float | None) -> float:
    """The efficiency of what --robust asks for; an error if it is given for nothing."""
    if efficiency is not None and not robust:
        raise OptionError("--efficiency belongs to the robust wavelet variance; pass --robust too, or leave it out")
    return 0.6 if efficiency is None else efficiency


def load(
    path: Path, rate: float | None, units: str | None, columns: str | None, gaps: Literal["keep", "longest"]
) -> Imu:
    """The recording in a file, read as the options say."""
    from gmwm.cli.output import progress
    from gmwm.readers import read

    with progress(f"reading {path.name}"):
        return read(path, rate=rate, columns=parse_columns(columns), units=parse_units(units), gaps=gaps)


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


def chosen_axes(imu: Imu, wanted: Sequence[str] | None) -> Mapping[str, Signal]:
    """The signals that --axis names, all by default; the recording has no gaps."""
    if len(imu.segments) > 1:
        sizes = ", ".join(str(stop - start) for start, stop in imu.segments[:5])
        raise DataError(
            f"the recording has gaps: {len(imu.segments)} segments of {sizes}{', …' if len(imu.segments) > 5 else ''} "
            "samples, which are never glued; pass --gaps longest to use the longest of them"
        )
    if not wanted:
        return imu.signals
    axes: list[str] = []
    for name in (part.strip() for text in wanted for part in text.split(",")):
        triad = [axis for axis in imu.axes if axis.startswith(f"{name}_")]
        if name not in imu.axes and not triad:
            raise OptionError(f"--axis must be one of {', '.join(imu.axes)}; got {name!r}")
        axes += triad or [name]
    return {axis: imu[axis] for axis in imu.axes if axis in axes}
