"""gmwm convert: any recording that can be read, as Parquet, CSV or .imu."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.option_names import named_as_options
from gmwm.cli.output import Outcome, progress
from gmwm.cli.read_options import File, load
from gmwm.errors import OptionError
from gmwm.options import ReadOptions
from gmwm.remarks import Dialect, Remark, texts

EXAMPLES = (
    "gmwm convert flight.imr static.parquet",
    "gmwm convert survey.imu static.csv --format imu:LN200",
    "gmwm convert static.csv static.imu --to imu:IXSEA",
)


@command
def convert(
    file: File,
    reading: ReadOptions,
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
) -> Outcome:
    """Write a recording as Parquet, CSV or .imu.

    In rad/s and m/s², with the time stamps of a uniform clock in each segment: gaps stay, jitter goes. Parquet and
    CSV keep every digit. An .imu file holds increments in the counts of its type, and no temperature. The file is
    written whole or not at all.
    """
    from gmwm.writers import RECORDS

    if output.exists() and output.resolve() == file.resolve():
        raise OptionError(f"OUT must be another file than FILE, got {output} for both")
    imu = load(file, reading)
    # What the library calls format= is --to here, as --format is of the file that is read.
    with progress(f"writing {output.name}"), named_as_options({"format": "--to"}):
        imu.write(output, format=to)
    lost = output.suffix.lower() == RECORDS and imu.temperature is not None
    said = f"wrote {output}: {len(imu)} samples at {imu.rate:.10g} Hz, {imu.duration:g} s, {', '.join(imu.axes)}"
    return Outcome(
        command="convert",
        document={
            "file": str(file), "output": str(output), "axes": list(imu.axes), "rate": imu.rate, "samples": len(imu),
            "duration": imu.duration, "segments": [list(segment) for segment in imu.segments],
            "units": {axis: imu[axis].unit for axis in imu}, "remarks": [remark.to_dict() for remark in imu.remarks],
        },
        text="\n".join([*texts(imu.remarks, Dialect.SHELL), said]),
        written=(output,),
        listed=False,
        remarks=(Remark.of("temperature-left-out", str(output), format=RECORDS),) if lost else (),
    )  # fmt: skip
