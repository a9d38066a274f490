"""gmwm info: inspect a recording."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.measuring import Chunked, memory_for, opened
from gmwm.cli.options import RESULT, AgainstOption
from gmwm.cli.output import NewFile, Outcome, progress
from gmwm.cli.read_options import File
from gmwm.inspection.result import text
from gmwm.options import ReadOptions
from gmwm.regression.against import AUTO
from gmwm.remarks import Dialect
from gmwm.signals import Imu

EXAMPLES = (
    "gmwm info static.csv",
    "gmwm info log.txt --rate 100 --units gyro=deg/s,accel=g",
    "gmwm info static.csv --against warmup",
    "gmwm info static.csv --plot recording.png",
)


@command
def info(
    file: File,
    reading: ReadOptions,
    chunked: Chunked = "auto",
    against: AgainstOption = AUTO,
    plot: Annotated[
        Path | None,
        typer.Option(help="Plot all axes over time to this .png, .pdf or .svg file.", rich_help_panel=RESULT),
    ] = None,
) -> Outcome:
    """Inspect a recording, and say whether it can be used.

    Prints rate, duration, gaps and jitter of the time stamps, axes and units, quantization, motion, knocks, jumps,
    warm-up, and whether an axis follows the temperature.

    Columns of the table, in SI units: mean; sd, the standard deviation of all samples; noise, the standard deviation of
    white noise with the same differences between neighbouring samples, which offset and slow drift do not affect; LSB,
    the quantization step if there is one; wander, the largest difference between the means of 64 equal windows.
    """
    from gmwm.inspection import inspect

    recording = opened(file, reading, chunked, whole=memory_for(against) if plot is None else "--plot")
    with progress("inspecting"):
        inspection = inspect(recording, against=against)
    files = []
    if plot is not None and isinstance(recording, Imu):
        files.append(NewFile(plot, partial(_draw, recording), f"plotting {plot.name}"))
    return Outcome(
        command="info",
        document={"file": str(file), **inspection.to_dict()},
        text=text(inspection, Dialect.SHELL),
        all_text=text(inspection, Dialect.SHELL, every=True),
        files=tuple(files),
    )


def _draw(recording: Imu, path: Path) -> None:
    recording.plot(path=path)
