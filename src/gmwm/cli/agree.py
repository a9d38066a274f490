"""gmwm agree: test whether calibrations of one unit agree with each other and with its datasheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.output import Outcome, calibration_file, progress
from gmwm.cli.read_options import names_of
from gmwm.durations import parse_length
from gmwm.errors import OptionError
from gmwm.importers.quantities import parse_reference

if TYPE_CHECKING:
    from gmwm import Calibration

EXAMPLES = (
    "gmwm agree monday/calibration.json tuesday/calibration.json",
    "gmwm agree day*/calibration.json --reference gyro.N=2.0deg/√h --json",
    "gmwm agree results --reference old_vins.yaml",
    "gmwm agree results --reference gyro.N=0.15deg/√h --reference gyro.B=3deg/h",
)


@command
def agree(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="calibration.json of each recording, from gmwm calibrate --output, or its folder. One is enough with "
            "--reference.",
            metavar="CALIBRATION…",
            show_default=False,
        ),
    ],
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="Value from a datasheet, for a sensor or an axis: gyro.N=2.0deg/√h, accel_z.B=0.2mg. Repeat the "
            "option for more values. √ can be written sqrt. Or a file of another program, as for gmwm export --from.",
            metavar="SYMBOL=VALUE|FILE",
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
    horizon: Annotated[
        str,
        typer.Option(
            help="Horizon of N and K, for a comparison of one calibration with a file: see gmwm export.",
            metavar="LENGTH",
        ),
    ] = "1s",
) -> Outcome:
    """Test whether calibrations of one unit agree with each other, or with a reference.

    N, B, K, R and Q of the calibrations are compared, and T_c and q_c if the models are the same. A number that
    differs by more than chance is marked. --reference compares them with values from a datasheet, or with a file of
    another program. One calibration with a file is compared in the convention of the file, with the factor of each
    number.
    """
    from gmwm import Calibration, agree

    references = parse_references(reference or ())
    with progress("reading"):
        calibrations = [Calibration.load(calibration_file(file)) for file in files]
    if len(calibrations) == 1 and not references:
        raise OptionError(
            "one calibration needs a reference to agree with",
            argument="reference",
            got=None,
            advice="Pass another calibration of the unit, or numbers or a file with {--reference}.",
        )
    if len(calibrations) == 1:
        checked = calibrations[0].agree(references, horizon=parse_length(horizon, "horizon"))
        return Outcome(
            command="agree", document={"files": [str(files[0])], **checked.to_dict()}, text=checked.summary()
        )
    if not isinstance(references, dict):
        references = _of_axes(references, calibrations[0])
    recordings = {Path(found.source).stem for found in calibrations} - {""}
    # The library names the calibrations after their recordings; if these are not unique, the files name them.
    names = label or (None if len(recordings) == len(files) else names_of(files))
    found = agree(calibrations, size=size, labels=names, reference=references)
    return Outcome(
        command="agree", document={"files": list(map(str, files)), **found.to_dict()}, text=found.summary()
    )  # fmt: skip


def parse_references(texts: Sequence[str]) -> dict[str, tuple[float, str]] | str:
    """Parse the values of --reference: single numbers, or one source of noise without a recording.

    >>> parse_references(["gyro.N=2.0deg/√h"]), parse_references(["old.yaml"])
    ({'gyro.N': (2.0, 'deg/√h')}, 'old.yaml')
    """
    if len(texts) == 1 and (Path(texts[0]).is_file() or ":" in texts[0] or "=" not in texts[0]):
        return texts[0]
    found = dict(parse_reference(text) for text in texts)
    if len(found) != len(texts):
        raise OptionError(argument="reference", expected="given once for each number", got=list(texts))
    return found


def _of_axes(source: str, calibration: Calibration) -> dict[str, tuple[float, str]]:
    """Return N, K and B of a source as single numbers of each axis, for several calibrations."""
    from gmwm.calibration.reference_check import check_reference

    return {f"{row.axis}.{row.symbol}": row.shown for row in check_reference(calibration, source)}
