"""gmwm report: write a calibration as an HTML page."""

from __future__ import annotations

from pathlib import Path

import gmwm
from gmwm.base.errors import OptionError
from gmwm.cli.command import command
from gmwm.cli.output import Outcome, calibration_file, progress

EXAMPLES = (
    "gmwm report results/calibration.json",
    "gmwm report results/calibration.json --output unit7.html",
    "gmwm report results --one-page --pdf",
)


@command
def report(
    file: Path,
    one_page: bool = False,
    pdf: bool = False,
    output: Path | None = None,
) -> Outcome:
    """Write a calibration as one HTML page that needs no network, or as a PDF.

    The page shows the verdict, the recording, interactive curves, the numbers in SI units and in units of datasheets,
    the comparison of models, outliers, configuration files for other programs, and how to cite gmwm.

    Arguments:
        file (CALIBRATION): The calibration.json that gmwm calibrate --output wrote, or its folder.
    Options:
        one_page: Write only what fits on one page: the verdict, four numbers of each axis, one plot, the cautions and
            the data.
        pdf: Write a PDF. This needs Chromium or Chrome, except with --one-page, which uses Matplotlib.
    Result:
        output (--output, -o): Write to this file. Default: report.html, or one_page.html, in the folder of the
            calibration."""
    file = calibration_file(file)
    with progress("writing the report"):
        calibration = gmwm.Calibration.load(file)
        name = f"{'one_page' if one_page else 'report'}.{'pdf' if pdf else 'html'}"
        if pdf and output is not None and output.suffix.lower() != ".pdf":
            raise OptionError(argument="output", expected="a file name that ends in .pdf with {--pdf}", got=str(output))
        page = calibration.report(file.with_name(name) if output is None else output, one_page=one_page)
    return Outcome(command="report", document={"file": str(file), "written": [str(page)]}, written=(page,))
