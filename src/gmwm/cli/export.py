"""gmwm export: the noise of a calibrated unit as other programs read it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypedDict

import typer

from gmwm.cli.command import command
from gmwm.cli.durations import parse_length
from gmwm.cli.options import RESULT
from gmwm.cli.output import NewFile, Outcome, calibration_file, file_names, made_directory, text_file
from gmwm.errors import DataError, MissingTheoryError, OptionError
from gmwm.exporters import export_formats
from gmwm.exporters.base import HORIZON
from gmwm.remarks import Remark

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

EXAMPLES = (
    "gmwm export results/calibration.json --format kalibr --output imu.yaml",
    "gmwm export results/calibration.json --format openvins --inflation 10",
    "gmwm export results/calibration.json --all exported",
)
DEFAULT = "kalibr"


@command
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
) -> Outcome:
    """Write the noise of a calibrated unit as other programs read it.

    Most of them know white noise N and a random walk K of the bias, and no more. Where the model has nothing of the
    kind, the file has the upper limit that the data give, and says so: never a zero. The head of each file says units,
    continuous or discrete, axes, inflation, horizon, models and source.
    """
    from gmwm import Calibration

    if all is not None and (format is not None or output is not None):
        raise OptionError("--all writes every format into a directory; leave --format and --output out")
    seconds = parse_length(horizon, "--horizon")
    choice: _Choice = {"axes": axes, "inflation": inflation, "horizon": seconds, "rate": rate}
    file = calibration_file(calibration)
    found = Calibration.load(file)
    if all is not None:
        return _all(found, file, made_directory(all, "--all"), choice)
    return _one(found, file, output=output, name=DEFAULT if format is None else format, choice=choice)


class _Choice(TypedDict):
    """The options of an export."""

    axes: Literal["worst", "mean", "each"] | None
    inflation: float
    horizon: float
    rate: float | None


def _one(found: Calibration, file: Path, output: Path | None, name: str, choice: _Choice) -> Outcome:
    """One format, printed if there is no file for it."""
    from gmwm.exporters import export as exported

    text = exported(found, None, name, **choice)
    files = () if output is None else (text_file(output, text),)
    return Outcome(
        command="export",
        document={"file": str(file), "format": name, "text": text, "written": file_names(files)},
        text="" if files else text,
        files=files,
    )


def _all(found: Calibration, file: Path, folder: Path, choice: _Choice) -> Outcome:
    """Every format that there can be of a calibration; and of the others, why not."""
    from gmwm.exporters import export_all

    written, left = export_all(found, folder, **choice)
    paths = tuple(written.values())
    return Outcome(
        command="export",
        document={"file": str(file), "written": list(map(str, paths)), "left_out": left},
        written=paths,
        closing=f"\n{len(paths)} of {len(paths) + len(left)} formats written",
        remarks=tuple(_reasons(left)),
    )


def _reasons(left: Mapping[str, str]) -> Iterator[Remark]:
    """Why formats are not written."""
    for name, why in left.items():
        yield Remark.of("format-not-written", name, reason=why.rstrip("."))


@dataclass(frozen=True)
class KalibrFile:
    """imu.yaml beside a calibration: the file if it can be written, one of an earlier run to remove, and remarks."""

    files: tuple[NewFile, ...] = ()
    obsolete: tuple[Path, ...] = ()
    remarks: tuple[Remark, ...] = ()


def kalibr_file(found: Calibration, folder: Path) -> KalibrFile:
    """imu.yaml in `folder`, if both sensors are calibrated and the data bound what it needs."""
    from gmwm.exporters import export as exported
    from gmwm.signals import sensor_of

    target, remarks = folder / "imu.yaml", []
    if {"gyro", "accel"} <= {sensor_of(axis) for axis in found}:
        try:
            return KalibrFile((text_file(target, exported(found)),))
        except (DataError, MissingTheoryError) as error:
            remarks.append(Remark.of("format-not-written", target.name, reason=str(error).rstrip(".")))
    if not target.is_file():
        return KalibrFile(remarks=tuple(remarks))
    # Another run would have written over it; beside the new numbers it would be taken for theirs.
    remarks.append(Remark.of("old-file-removed", target.name))
    return KalibrFile(obsolete=(target,), remarks=tuple(remarks))
