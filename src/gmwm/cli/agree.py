"""gmwm agree: test whether calibrations of one unit agree with each other and with its datasheet."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import gmwm
from gmwm import Calibration
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.output import Outcome, plot_file, progress
from gmwm.cli.read_options import names_of
from gmwm.files.importers.values import parse_reference

EXAMPLES = (
    "gmwm agree monday/calibration.json tuesday/calibration.json",
    "gmwm agree day*/calibration.json --reference gyro.N=2.0deg/√h --json",
    "gmwm agree results --reference old_vins.yaml",
    "gmwm agree results --reference gyro.N=0.15deg/√h --reference gyro.B=3deg/h",
)


@command
def agree(
    files: list[Path],
    reference: list[str] | None = None,
    label: list[str] | None = None,
    size: float = 0.05,
    horizon: str = "1s",
    plot: Path | None = None,
) -> Outcome:
    """Test whether calibrations of one unit agree with each other, or with a reference.

    The command compares N, B, K, R and Q of the calibrations, and also T_c and q_c if the models are the same. It marks
    each number that differs by more than chance. With --reference, it compares the calibrations with values from a
    datasheet or with a file of another program. If one calibration is compared with a file, its numbers are converted
    to the convention of the file, and the table shows the ratio of both values.

    Arguments:
        files (CALIBRATION…): The calibration.json that gmwm calibrate --output wrote for each recording, or its folder.
            With --reference, one calibration is enough.
    Options:
        reference (SYMBOL=VALUE|FILE): Value from a datasheet for a sensor or an axis, such as gyro.N=2.0deg/√h or
            accel_z.B=0.2mg (√ can be written sqrt). Repeat the option for more values. Alternatively, give a file of
            another program, as for gmwm export --from.
        label (NAME): Name of a recording in the output. Give the option once for each recording, in the same order.
        size: Significance level: probability that any number is marked if all agree.
        horizon (LENGTH): Time horizon of N and K if one calibration is compared with a file, as for gmwm export."""
    references = parse_references(reference or ())
    with progress("reading"):
        calibrations = [gmwm.Calibration.load(file) for file in files]
    if len(calibrations) == 1 and not references:
        raise OptionError(
            "one calibration needs a reference to agree with", argument="reference", got=None,
            advice="Pass another calibration of the unit, or numbers or a file with {--reference}.",
        )  # fmt: skip
    if len(calibrations) == 1:
        if plot is not None:
            raise OptionError("--plot draws several calibrations", argument="plot", got=plot, advice="Leave it out.")
        checked = calibrations[0].agree(references, horizon=parse_length(horizon, "horizon"))
        return Outcome(
            command="agree",
            document={"files": [str(files[0])], **checked.to_dict()},
            text=checked.summary(Dialect.SHELL),
        )
    if not isinstance(references, dict):
        references = _of_axes(references, calibrations[0])
    recordings = {Path(agreement.source).stem for agreement in calibrations} - {""}
    # Calibrations are named after their recordings, or after their files if these names are not unique.
    names = label or (None if len(recordings) == len(files) else names_of(files))
    agreement = gmwm.agree(calibrations, size=size, labels=names, reference=references)
    return Outcome(
        command="agree", document={"files": list(map(str, files)), **agreement.to_dict()},
        text=agreement.summary(Dialect.SHELL), files=plot_file(plot, lambda path: agreement.plot(path=path)),
    )  # fmt: skip


def parse_references(texts: Sequence[str]) -> dict[str, tuple[float, str]] | str:
    """Parse the values of --reference, which are single numbers, or one file or datasheet with the numbers of all axes.

    >>> parse_references(["gyro.N=2.0deg/√h"]), parse_references(["old.yaml"])
    ({'gyro.N': (2.0, 'deg/√h')}, 'old.yaml')
    """
    if len(texts) == 1 and (Path(texts[0]).is_file() or ":" in texts[0] or "=" not in texts[0]):
        return texts[0]
    references = dict(parse_reference(text) for text in texts)
    if len(references) != len(texts):
        raise OptionError(argument="reference", expected="given once for each number", got=list(texts))
    return references


def _of_axes(source: str, calibration: Calibration) -> dict[str, tuple[float, str]]:
    """Return N, K and B from a file or datasheet, keyed by axis and symbol such as "gyro_x.N", with their units."""
    from gmwm.calibration.reference_check import check_reference

    return {f"{row.axis}.{row.symbol}": row.shown for row in check_reference(calibration, source)}
