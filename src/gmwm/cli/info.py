"""gmwm info: what a file holds, as it was understood."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.measuring import Chunked, opened
from gmwm.cli.options import RESULT
from gmwm.cli.output import NewFile, Outcome, progress
from gmwm.cli.read_options import File
from gmwm.inspection.result import text
from gmwm.options import ReadOptions
from gmwm.remarks import Dialect
from gmwm.signals import Imu

EXAMPLES = (
    "gmwm info static.csv",
    "gmwm info log.txt --rate 100 --units gyro=deg/s,accel=g",
    "gmwm info static.csv --plot recording.png",
)


@command
def info(
    file: File,
    reading: ReadOptions,
    chunked: Chunked = "auto",
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw all axes over time to this .png, .pdf or .svg file.", rich_help_panel=RESULT),
    ] = None,
) -> Outcome:
    """Say what a recording holds and whether it can be used.

    Rate and duration, gaps and jitter of the time stamps, axes and units as understood, the least significant
    bit, whether the unit stood still, knocks and steps, warm-up, temperature, and what to beware of.

    In the table, all in SI units: mean; sd, the standard deviation of all samples; noise, that of white noise with
    the same differences from sample to sample, which offset and slow drift do not reach; LSB, the quantisation step
    where one shows; wander, the largest difference between the means of 64 equal windows of the recording.
    """
    from gmwm.inspection import inspect

    recording = opened(file, reading, chunked, whole="" if plot is None else "--plot")
    with progress("inspecting"):
        inspection = inspect(recording)
    files = []
    if plot is not None and isinstance(recording, Imu):
        files.append(NewFile(plot, partial(_draw, recording), f"drawing {plot.name}"))
    return Outcome(
        command="info",
        document={"file": str(file), **inspection.to_dict()},
        text=text(inspection, Dialect.SHELL),
        all_text=text(inspection, Dialect.SHELL, every=True),
        files=tuple(files),
    )


def _draw(recording: Imu, path: Path) -> None:
    recording.plot(path=path)
