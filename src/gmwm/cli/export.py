"""gmwm export: the noise of a calibrated unit as other programs read it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.cli.durations import parse_length
from gmwm.cli.options import RESULT, Json
from gmwm.errors import DataError, GmwmWarning, MissingTheoryError, OptionError
from gmwm.exporters import export_formats
from gmwm.exporters.base import HORIZON

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

EXAMPLES = (
    "gmwm export results/calibration.json --format kalibr --output imu.yaml",
    "gmwm export results/calibration.json --format openvins --inflation 10",
    "gmwm export results/calibration.json --all exported",
)
DEFAULT = "kalibr"


def export(
    calibration: Annotated[
        Path,
        typer.Argument(
            help="What gmwm calibrate --output wrote: calibration.json, or its folder.",
            metavar="CALIBRATION",
            show_default=False,
        ),
    ],
    format: Annotated[
        str | None,
        typer.Option(
            help=f"One of {', '.join(export_formats())}. Default: {DEFAULT}.", metavar="NAME", show_default=False
        ),
    ] = None,
    axes: Annotated[
        Literal["worst", "mean", "each"] | None,
        typer.Option(
            help="Of the axes of a sensor the largest number, the root mean square, or one for each where the format "
            "takes such. Default: worst for filters, each for simulators and messages.",
            show_default=False,
        ),
    ] = None,
    inflation: Annotated[
        float, typer.Option(help="Factor on standard deviations; variances grow by its square.")
    ] = 1.0,
    horizon: Annotated[
        str,
        typer.Option(
            help="How long the program relies on the sensor alone, as 100ms, 1s, 1min or seconds: what is correlated "
            "for less is white noise to it, for longer a random walk.",
            metavar="LENGTH",
        ),
    ] = f"{HORIZON:g}s",
    rate: Annotated[
        float | None,
        typer.Option(
            help="Samples per second (Hz) that the program gets. Default: of the recording.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Write this file; without it the text is printed.", rich_help_panel=RESULT),
    ] = None,
    all: Annotated[
        Path | None,
        typer.Option("--all", help="Write a file of each format into this directory.", rich_help_panel=RESULT),
    ] = None,
    json: Json = False,
) -> None:
    """Write the noise of a calibrated unit as other programs read it.

    Most of them know white noise N and a random walk K of the bias, and no more. Where the model has nothing of the
    kind, the file has the upper limit that the data give, and says so: never a zero. The head of each file says units,
    continuous or discrete, axes, inflation, horizon, models and source.
    """
    from gmwm import Calibration
    from gmwm.cli.output import calibration_file, made_directory, print_json, print_written, told_warnings
    from gmwm.exporters import export as exported

    if all is not None and (format is not None or output is not None):
        raise OptionError("--all writes every format into a directory; leave --format and --output out")
    time = parse_length(horizon, "--horizon")
    with told_warnings() as told:
        file = calibration_file(calibration)
        found = Calibration.load(file)
        if all is not None:
            made_directory(all, "--all")
            written, left = _all(found, all, axes=axes, inflation=inflation, horizon=time, rate=rate)
            _tell_left(left, told)
            if json:
                paths = list(map(str, written))
                print_json("export", {"file": str(file), "written": paths, "left_out": left}, told)
                return
            print_written(written)
            print(f"\n{len(written)} of {len(written) + len(left)} formats written")
            return
        name = DEFAULT if format is None else format
        text = exported(found, output, name, axes=axes, inflation=inflation, horizon=time, rate=rate)
        if json:
            written = [] if output is None else [output]
            content = {"file": str(file), "format": name, "text": text, "written": list(map(str, written))}
            print_json("export", content, told)
        elif output is None:
            print(text, end="")
        else:
            print_written([output])


def _all(
    found: Calibration,
    folder: Path,
    axes: Literal["worst", "mean", "each"] | None,
    inflation: float,
    horizon: float,
    rate: float | None,
) -> tuple[list[Path], dict[str, str]]:
    """Every format that there can be of a calibration; and of the others, why not."""
    from gmwm.exporters import export_all

    written, left = export_all(found, folder, axes=axes, inflation=inflation, horizon=horizon, rate=rate)
    return list(written.values()), left


def _tell_left(left: Mapping[str, str], told: list[str]) -> None:
    """Each reason once, after the formats that it keeps from being written."""
    from gmwm.cli.output import tell

    reasons: dict[str, list[str]] = {}
    for name, why in left.items():
        reasons.setdefault(why.removeprefix(f"{name} "), []).append(name)
    for why, names in reasons.items():
        each = "each " if len(names) > 1 and why.startswith("needs") else ""
        tell(told, f"not written: {', '.join(names)}: {each}{why}")


def written_for_kalibr(found: Calibration, room: Path, folder: Path) -> list[str]:
    """imu.yaml in `room`, if both sensors are calibrated and the data bound what it needs; else `folder`'s own goes."""
    import warnings

    from gmwm.exporters import export as exported
    from gmwm.signals import sensor_of

    target = room / "imu.yaml"
    if {"gyro", "accel"} <= {sensor_of(axis) for axis in found}:
        try:
            exported(found, target)
        except (DataError, MissingTheoryError) as error:
            warnings.warn(f"{target.name} is not written: {error}", GmwmWarning, stacklevel=2)
        else:
            return [target.name]
    # Another run would have written over it; beside the new numbers it would be taken for theirs.
    old = folder / target.name
    if old.is_file():
        old.unlink()
        warnings.warn(f"the {target.name} of an earlier run is removed: it is not of this calibration", GmwmWarning,
                      stacklevel=2)  # fmt: skip
    return []
