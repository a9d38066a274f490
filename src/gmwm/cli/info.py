"""gmwm info: what a file holds, as it was understood."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.measuring import Chunked, opened
from gmwm.cli.options import RESULT, Json
from gmwm.cli.read_options import File, Opening, opens

EXAMPLES = (
    "gmwm info static.csv",
    "gmwm info log.txt --rate 100 --units gyro=deg/s,accel=g",
    "gmwm info static.csv --plot recording.png",
)


@opens
def info(
    file: File,
    opening: Opening,
    chunked: Chunked = "auto",
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw all axes over time to this .png, .pdf or .svg file.", rich_help_panel=RESULT),
    ] = None,
    json: Json = False,
) -> None:
    """Say what a recording holds and whether it can be used.

    Rate and duration, gaps and jitter of the time stamps, axes and units as understood, the least significant
    bit, whether the unit stood still, knocks and steps, warm-up, temperature, and what to beware of.

    In the table, all in SI units: mean; sd, the standard deviation of all samples; noise, that of white noise with
    the same differences from sample to sample, which offset and slow drift do not reach; LSB, the quantisation step
    where one shows; wander, the largest difference between the means of 64 equal windows of the recording.
    """
    from gmwm.cli.errors import as_options
    from gmwm.cli.output import print_json, print_written, progress, tell, told_warnings
    from gmwm.inspection import inspect
    from gmwm.signals import Imu

    with told_warnings() as told:
        recording = opened(file, opening, chunked, whole="" if plot is None else "--plot")
        with progress("inspecting"):
            inspection = inspect(recording)
        if plot is not None and isinstance(recording, Imu):
            with progress(f"drawing {plot.name}"):
                recording.plot(path=plot)
        if json:
            for warning in inspection.warnings:
                tell(told, warning)
            print_json("info", {"file": str(file), **inspection.to_dict()}, told)
        else:
            print(as_options(inspection.summary()))
            print_written([plot] if plot is not None else [])
