"""gmwm agree: do the calibrations of several recordings of one unit agree, with one another and with its datasheet?"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.output import Outcome, calibration_file, progress
from gmwm.errors import OptionError

EXAMPLES = (
    "gmwm agree monday/calibration.json tuesday/calibration.json",
    "gmwm agree day*/calibration.json --reference gyro.N=2.0deg/√h --json",
)
# A value as it was typed: what looks like a number, and the rest, its unit. A unit may begin with an e.
_VALUE = re.compile(r"([-+0-9.,']*(?:[eE][-+]?[0-9]+)?)\s*(.*)")


@command
def agree(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="What gmwm calibrate --output wrote for each recording: calibration.json, or its folder.",
            metavar="CALIBRATION…",
            show_default=False,
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
) -> Outcome:
    """Tell which numbers of several recordings of one unit differ by more than chance.

    The recordings are calibrated each by itself. N, B, K, R and Q are compared whatever their models, T_c and q_c where
    the models are the same. --reference sets the datasheet's values beside them.
    """
    from gmwm import Calibration, agree

    references = dict(parse_reference(text) for text in reference or ())
    if len(references) != len(reference or ()):
        raise OptionError("--reference names each number once")
    with progress("reading"):
        calibrations = [Calibration.load(calibration_file(file)) for file in files]
    stems = {Path(found.source).stem for found in calibrations} - {""}
    # Names of the recordings if they have them.
    names = label or (None if len(stems) == len(files) else names_of(files))
    found = agree(calibrations, size=size, labels=names, reference=references)
    return Outcome(
        command="agree", document={"files": list(map(str, files)), **found.to_dict()}, text=found.summary()
    )  # fmt: skip


def parse_reference(text: str) -> tuple[str, tuple[float, str]]:
    """The name of a number, and the maker's value with its unit.

    >>> parse_reference("gyro.N = 2.0 deg/√h")
    ('gyro.N', (2.0, 'deg/√h'))
    """
    name, mark, given = (part.strip() for part in text.partition("="))
    match = _VALUE.fullmatch(given)
    sensor, dot, symbol = name.rpartition(".")
    if not mark or not sensor or not dot or not symbol or match is None or not given:
        raise OptionError(f"--reference takes NUMBER=VALUE with a unit, as gyro.N=2.0deg/√h; got {text!r}")
    try:
        value = float(match[1])
    except ValueError:
        hint = f": write {match[1].replace(',', '.')}" if match[1].count(",") == 1 and "." not in match[1] else ""
        raise OptionError(
            f"--reference {name} must begin with a number that can be read, got {match[1] or given!r}{hint}"
        ) from None
    if not match[2]:
        raise OptionError(f"--reference {name} lacks its unit, as 2.0deg/√h for gyro.N; got {given!r}")
    return name, (value, match[2])


def names_of(files: Sequence[Path]) -> list[str]:
    """What tells the files apart: their names, their folders or their paths."""
    for names in ([file.stem for file in files], [file.resolve().parent.name for file in files]):
        if len(set(names)) == len(names):
            return names
    paths = [str(file) for file in files]
    if len(set(paths)) == len(paths):
        return paths
    raise OptionError(f"each calibration can be compared once, got {', '.join(paths)}")
