"""gmwm report: a calibration as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.options import RESULT, Json

EXAMPLES = ("gmwm report results/calibration.json", "gmwm report results/calibration.json --output unit7.html")


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
    json: Json = False,
) -> None:
    """Write a calibration as one HTML page, to read without a network, to print and to pass on.

    Verdict, recording, curves with their values under the pointer, numbers in the units of datasheets and in SI, models
    compared, outliers, configuration files to paste, and how to cite.
    """
    from gmwm import Calibration
    from gmwm.cli.output import calibration_file, print_json, print_written, progress, told_warnings

    with told_warnings() as told:
        file = calibration_file(file)
        with progress("writing the report"):
            found = Calibration.load(file)
            page = found.report(file.with_name("report.html") if output is None else output)
        if json:
            print_json("report", {"file": str(file), "written": [str(page)]}, told)
        else:
            print_written([page])
