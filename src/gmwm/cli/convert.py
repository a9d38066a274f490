"""gmwm convert: convert a recording to Parquet, CSV, MCAP or .imu."""

from __future__ import annotations

from pathlib import Path

from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.cli.command import command
from gmwm.cli.options import named_as_options
from gmwm.cli.output import Outcome, progress
from gmwm.cli.read_options import load
from gmwm.recording.options import ReadOptions

EXAMPLES = (
    "gmwm convert flight.imr static.parquet",
    "gmwm convert survey.imu static.csv --format imu:LN200",
    "gmwm convert static.csv static.mcap",
    "gmwm convert static.csv static.imu --to imu:IXSEA",
)


@command
def convert(
    file: Path,
    reading: ReadOptions,
    output: Path,
    to: str | None = None,
) -> Outcome:
    """Convert a recording to Parquet, CSV, MCAP or .imu.

    The output is in rad/s and m/s². Its time stamps are uniform between gaps: gaps are kept, and jitter is removed.
    Parquet and CSV files keep all digits. An .mcap file holds messages sensor_msgs/msg/Imu of ROS 2, with stamps in
    whole nanoseconds and no temperature. An .imu file holds increments as integer counts, whose size depends on the
    type of its records, and no temperature.

    Arguments:
        output (OUT): File to write: .parquet, .csv, .mcap or .imu.
    Result:
        to (FORMAT): Type of the records of an .imu file: imu:IMAR, imu:LN200, imu:LN200IG, imu:IXSEA, imu:NAVCHIP_INT
            or imu:NAVCHIP_FLT. An .imu file does not state its type, so the option is needed for it."""
    from gmwm.recording.writers import MCAP, RECORDS

    if output.exists() and output.resolve() == file.resolve():
        raise OptionError(f"FILE and OUT are the same file, {output}", argument="output", got=str(output))
    imu = load(file, reading)
    # The argument `format` of the library is the option --to, because --format is the format of the input.
    with progress(f"writing {output.name}"), named_as_options({"format": "--to"}):
        imu.write(output, format=to)
    suffix = output.suffix.lower()
    lost = suffix in (MCAP, RECORDS) and imu.temperature is not None
    wrote = f"Wrote {output}: {len(imu)} samples at {imu.rate:g} Hz, {imu.duration:g} s, {', '.join(imu.axes)}"
    return Outcome(
        command="convert",
        document={
            "file": str(file), "output": str(output), "axes": list(imu.axes), "rate": imu.rate, "samples": len(imu),
            "duration": imu.duration, "segments": [list(segment) for segment in imu.segments],
            "units": {axis: imu[axis].unit for axis in imu}, "remarks": [remark.to_dict() for remark in imu.remarks],
        },
        text="\n".join([*texts(imu.remarks, Dialect.SHELL), wrote]),
        written=(output,),
        listed=False,
        remarks=(Remark.of("not-in-file", str(output), case="temperature", format=suffix),) if lost else (),
    )  # fmt: skip
