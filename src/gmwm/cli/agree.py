"""gmwm agree: test whether calibrations of one unit agree with each other and with its datasheet."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.output import Outcome, calibration_file, progress
from gmwm.cli.read_options import names_of
from gmwm.errors import OptionError
from gmwm.importers.quantities import parse_reference

EXAMPLES = (
    "gmwm agree monday/calibration.json tuesday/calibration.json",
    "gmwm agree day*/calibration.json --reference gyro.N=2.0deg/√h --json",
)


@command
def agree(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="calibration.json of each recording, from gmwm calibrate --output, or its folder.",
            metavar="CALIBRATION…",
            show_default=False,
        ),
    ],
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="Value from a datasheet, for a sensor or an axis: gyro.N=2.0deg/√h, accel_z.B=0.2mg. Repeat the "
            "option for more values. √ can be written sqrt.",
            metavar="NUMBER=VALUE",
            show_default=False,
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(
            help="Name of a recording. Repeat the option, once for each recording in their order.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    size: Annotated[float, typer.Option(help="Significance level of the test of all numbers together.")] = 0.05,
) -> Outcome:
    """Test whether calibrations of several recordings of one unit agree.

    N, B, K, R and Q of the calibrations are compared, and T_c and q_c if the models are the same. A number that
    differs by more than chance is marked. --reference compares with values from a datasheet.
    """
    from gmwm import Calibration, agree

    references = dict(parse_reference(text) for text in reference or ())
    if len(references) != len(reference or ()):
        raise OptionError(argument="reference", expected="given once for each number", got=list(reference or ()))
    with progress("reading"):
        calibrations = [Calibration.load(calibration_file(file)) for file in files]
    recordings = {Path(found.source).stem for found in calibrations} - {""}
    # The library names the calibrations after their recordings; if these are not unique, the files name them.
    names = label or (None if len(recordings) == len(files) else names_of(files))
    found = agree(calibrations, size=size, labels=names, reference=references)
    return Outcome(
        command="agree", document={"files": list(map(str, files)), **found.to_dict()}, text=found.summary()
    )  # fmt: skip
