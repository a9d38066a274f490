"""gmwm convert: any recording that can be read, as Parquet, CSV or .imu."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.cli.options import Json
from gmwm.cli.read_options import File, Opening, load, opens

if TYPE_CHECKING:
    from gmwm.signals import Imu

EXAMPLES = (
    "gmwm convert flight.imr static.parquet",
    "gmwm convert survey.imu static.csv --format imu:LN200",
    "gmwm convert static.csv static.imu --to imu:IXSEA",
)


@opens
def convert(
    file: File,
    opening: Opening,
    output: Annotated[Path, typer.Argument(help="File to write: .parquet, .csv or .imu.", metavar="OUT")],
    to: Annotated[
        str | None,
        typer.Option(
            help="Type of the records of an .imu file, which it does not state itself: imu:IMAR, imu:LN200, "
            "imu:LN200IG, imu:IXSEA, imu:NAVCHIP_INT or imu:NAVCHIP_FLT.",
            metavar="FORMAT",
            rich_help_panel="Result",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Write a recording as Parquet, CSV or .imu.

    In rad/s and m/s², with the time stamps of a uniform clock in each segment: gaps stay, jitter goes. Parquet and
    CSV keep every digit. An .imu file holds increments in the counts of its type, and no temperature. The file is
    written whole or not at all.
    """
    from gmwm.cli.output import print_json, progress, tell, told_warnings
    from gmwm.errors import OptionError
    from gmwm.writers import RECORDS

    if output.exists() and output.resolve() == file.resolve():
        raise OptionError(f"OUT must be another file than FILE, got {output} for both")
    with told_warnings() as told:
        imu = load(file, opening)
        with progress(f"writing {output.name}"):
            _write(imu, output, to)
        if output.suffix.lower() == RECORDS and imu.temperature is not None:
            tell(told, f"the temperature is left out: {RECORDS} records have no place for it")
        content = {
            "file": str(file), "output": str(output), "axes": list(imu.axes), "rate": imu.rate, "samples": len(imu),
            "duration": imu.duration, "segments": [list(segment) for segment in imu.segments],
            "units": {axis: imu[axis].unit for axis in imu}, "notes": list(imu.notes),
        }  # fmt: skip
        if json:
            print_json("convert", content, told)
            return
        for note in imu.notes:
            print(note)
        print(f"wrote {output}: {len(imu)} samples at {imu.rate:.10g} Hz, {imu.duration:g} s, {', '.join(imu.axes)}")


def _write(imu: Imu, output: Path, to: str | None) -> None:
    """Write; what the library calls format= is --to here, as --format is of the file that is read."""
    from gmwm.errors import OptionError
    from gmwm.writers import write

    try:
        write(imu, output, format=to)
    except OptionError as error:
        raise OptionError(re.sub(r"^format\b|(?<=pass )format=", "--to", str(error))) from None
