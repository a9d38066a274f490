"""gmwm agree: do the calibrations of several recordings of one unit agree, with one another and with its datasheet?"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.cli.options import Json
from gmwm.errors import OptionError

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

EXAMPLES = (
    "gmwm agree monday/calibration.json tuesday/calibration.json",
    "gmwm agree day*/calibration.json --reference gyro.N=2.0deg/√h --reference accel.N=0.2m/s/√h --json",
)
_REFERENCE = re.compile(r"\s*([^=]+\.[^=]+?)\s*=\s*([+-]?[0-9.]+(?:e[+-]?[0-9]+)?)\s*([^\s0-9].*?)\s*", re.IGNORECASE)


def agree(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="What gmwm calibrate --output wrote for each recording.", metavar="CALIBRATION…", show_default=False
        ),
    ],
    reference: Annotated[
        list[str] | None,
        typer.Option(
            help="A value of the maker, of a sensor or an axis: gyro.N=2.0deg/√h, accel_z.B=0.2mg. May be repeated; "
            "√ may be written sqrt.",
            metavar="NUMBER=VALUE",
            show_default=False,
        ),
    ] = None,
    label: Annotated[
        list[str] | None,
        typer.Option(help="Name of a recording; once for each, in their order.", metavar="NAME", show_default=False),
    ] = None,
    size: Annotated[
        float, typer.Option(help="Probability of any disagreement where there is none, of all numbers together.")
    ] = 0.05,
    json: Json = False,
) -> None:
    """Tell which numbers of several recordings of one unit differ by more than chance.

    The recordings are calibrated each by itself. N, B, K, R and Q are compared whatever their models, T_c and q_c where
    the models are the same. --reference sets the datasheet's values beside them.
    """
    from gmwm import agreement
    from gmwm.cli.output import print_json, progress, told_warnings

    references = dict(parse_reference(text) for text in reference or ())
    if len(references) != len(reference or ()):
        raise OptionError("--reference names each number once")
    with told_warnings() as told:
        with progress("reading"):
            calibrations = [loaded(file) for file in files]
        stems = {Path(found.source).stem for found in calibrations} - {""}
        # Names of the recordings if they have them.
        names = label or (None if len(stems) == len(files) else names_of(files))
        found = agreement(calibrations, size=size, labels=names, reference=references)
        if json:
            print_json("agree", {"files": list(map(str, files)), **found.to_dict()}, told)
            return
        print(found.summary())


def parse_reference(text: str) -> tuple[str, tuple[float, str]]:
    """The name of a number, and the maker's value with its unit.

    >>> parse_reference("gyro.N = 2.0 deg/√h")
    ('gyro.N', (2.0, 'deg/√h'))
    """
    match = _REFERENCE.fullmatch(text)
    try:
        if match is None:
            raise ValueError
        return match[1], (float(match[2]), match[3])
    except ValueError:
        raise OptionError(f"--reference takes NUMBER=VALUE with a unit, as gyro.N=2.0deg/√h, got {text!r}") from None


def names_of(files: Sequence[Path]) -> list[str]:
    """What tells the files apart: their names, their folders or their paths."""
    for names in ([file.stem for file in files], [file.resolve().parent.name for file in files]):
        if len(set(names)) == len(names):
            return names
    paths = [str(file) for file in files]
    if len(set(paths)) == len(paths):
        return paths
    raise OptionError(f"each calibration can be compared once, got {', '.join(paths)}")


def loaded(file: Path) -> Calibration:
    """The calibration in a file; an error names the file."""
    from gmwm import Calibration
    from gmwm.errors import ReadError

    try:
        return Calibration.load(file)
    except ReadError as error:
        raise ReadError(str(error) if str(file) in str(error) else f"{file}: {error}") from error
