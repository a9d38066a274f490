"""gmwm report: a calibration as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.options import RESULT
from gmwm.cli.output import Outcome, calibration_file, progress

EXAMPLES = ("gmwm report results/calibration.json", "gmwm report results/calibration.json --output unit7.html")


@command
def report(
    file: Annotated[
        Path,
        typer.Argument(
            help="What gmwm calibrate --output wrote: calibration.json, or its folder.",
            metavar="CALIBRATION",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="The page; report.html beside the calibration by default.",
            rich_help_panel=RESULT,
            show_default=False,
        ),
    ] = None,
) -> Outcome:
    """Write a calibration as one HTML page, to read without a network, to print and to pass on.

    Verdict, recording, curves with their values under the pointer, numbers in the units of datasheets and in SI, models
    compared, outliers, configuration files to paste, and how to cite.
    """
    from gmwm import Calibration

    file = calibration_file(file)
    with progress("writing the report"):
        found = Calibration.load(file)
        page = found.report(file.with_name("report.html") if output is None else output)
    return Outcome(command="report", document={"file": str(file), "written": [str(page)]}, written=(page,))
