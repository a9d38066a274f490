"""gmwm report: write a calibration as an HTML page."""

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
            help="calibration.json of gmwm calibrate --output, or its folder.",
            metavar="CALIBRATION",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Write to this file. Default: report.html in the folder of the calibration.",
            rich_help_panel=RESULT,
            show_default=False,
        ),
    ] = None,
) -> Outcome:
    """Write a calibration as one HTML page that needs no network.

    The page shows the verdict, the recording, interactive curves, the numbers in SI units and in units of datasheets,
    the comparison of models, outliers, configuration files for other programs, and how to cite gmwm.
    """
    from gmwm import Calibration

    file = calibration_file(file)
    with progress("writing the report"):
        found = Calibration.load(file)
        page = found.report(file.with_name("report.html") if output is None else output)
    return Outcome(command="report", document={"file": str(file), "written": [str(page)]}, written=(page,))
