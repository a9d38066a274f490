"""gmwm fleet: thousands of recordings, each calibrated, and what the units are like together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.calibration.options import WITHIN, CalibrationOptions
from gmwm.cli.calibrate import ROBUST, Outliers
from gmwm.cli.command import command
from gmwm.cli.measuring import MACHINES
from gmwm.cli.options import RESULT, ChoiceWeighting, Confidence, CriterionName, Efficiency, Seed, Within, parse_within
from gmwm.cli.output import NewFile, Outcome, file_names, progress, text_file
from gmwm.cli.read_options import INPUT, Axes
from gmwm.errors import DataError, OptionError
from gmwm.fleets.discovery import FILE
from gmwm.fleets.storage import TABLE
from gmwm.options import ReadOptions
from gmwm.remarks import Remark
from gmwm.variance.biweight import EFFICIENCY

if TYPE_CHECKING:
    from gmwm.fleets import Fleet
    from gmwm.fleets.engine import Progress

EXAMPLES = (
    "gmwm fleet recordings --output results",
    "gmwm fleet recordings --pattern '*.csv' --units gyro=deg/s --output results",
    "gmwm fleet /shared/lot7 --scheduler tcp://10.0.0.5:8786 --output results",
)
SHOWN = 10
"""Failed units that are named on stderr; the table and the summary have all."""


@command
def fleet(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder of recordings, a unit each; all beneath.", metavar="DIR", show_default=False),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            help="Write units/<unit>.json, fleet.json, fleet.parquet, summary.txt and fleet.png into this directory. "
            "What an earlier run left there is not done again.",
            rich_help_panel=RESULT,
            show_default=False,
        ),
    ],
    reading: ReadOptions,
    pattern: Annotated[
        str | None,
        typer.Option(
            help="Which files: '*.csv' by name, 'lot 7/*.csv' by path. Default: all that can be read.",
            metavar="PATTERN",
            rich_help_panel=INPUT,
            show_default=False,
        ),
    ] = None,
    axis: Axes = None,
    within: Within = WITHIN,
    robust: Outliers = "auto",
    efficiency: Efficiency = None,
    weighting: ChoiceWeighting = "optimal",
    criterion: CriterionName = "asymptotic",
    confidence: Confidence = 0.95,
    seed: Seed = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Dask scheduler whose workers do it, as tcp://10.0.0.5:8786; they find the files under the same "
            "paths. Default: this machine.",
            metavar="ADDRESS",
            rich_help_panel=MACHINES,
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            help="Processes on this machine. Default: one for each processor; 0: none, all in this one.",
            min=0,
            rich_help_panel=MACHINES,
            show_default=False,
        ),
    ] = None,
    retries: Annotated[
        int,
        typer.Option(
            help="How often a unit is tried again after an error of the file system or a lost worker.",
            min=0,
            rich_help_panel=MACHINES,
        ),
    ] = 2,
) -> Outcome:
    """Calibrate every recording in a folder, and tell what the units are like and which are not like the others.

    Each unit's calibration is written as soon as it is there; the same command again does only what is missing, failed
    or changed. Units that cannot be calibrated are named with their reasons and end nothing: the exit code is 0 if any
    unit is calibrated, 2 if none is.

    fleet.parquet has a row for each unit and axis; Fleet.load reads the directory.
    """
    from gmwm.fleets.engine import calibrate_fleet

    if efficiency is not None and robust == "no":
        raise OptionError("--efficiency belongs to the robust wavelet variance; leave it or --robust no out")
    if workers is not None and scheduler is not None:
        raise OptionError("--workers are those begun on this machine, a scheduler has its own: leave one of them out")
    if folder.is_file():
        raise OptionError(f"{folder} is one recording, not a folder of them: gmwm calibrate is for one")
    asked = CalibrationOptions(
        within=parse_within(within), robust=ROBUST[robust], weighting=weighting, criterion=criterion,
        confidence=confidence, efficiency=EFFICIENCY if efficiency is None else efficiency, seed=seed,
        axes=[part.strip() for text in axis or () for part in text.split(",")] or None,
    )  # fmt: skip
    with _bar() as advance:
        found = calibrate_fleet(
            folder, output, asked, reading, pattern=pattern, scheduler=scheduler, workers=workers, retries=retries,
            progress=advance,
        )  # fmt: skip
    if not len(found):
        unit, why = next(iter(found.failed.items()))
        raise DataError(f"none of {len(found.units)} units can be calibrated; {unit}: {why}")
    summary = found.summary()
    done = (output / FILE, output / TABLE)
    files = (
        text_file(output / "summary.txt", summary + "\n"),
        NewFile(output / "fleet.png", lambda path: found.plot(path=path), "drawing"),
    )
    return Outcome(
        command="fleet",
        document={**_document(found), "written": [*map(str, done), *file_names(files)]},
        text=summary,
        files=files,
        written=done,
        remarks=tuple(_trouble(found)),
    )


def _document(found: Fleet) -> dict[str, object]:
    """What --json prints, but for what was written."""
    return {
        "output": str(found.folder), "units": list(found.units), "done": found.done, "kept": found.kept,
        "failed": found.failed, "left_out": list(found.left_out), "statistics": found.statistics.to_dict(),
    }  # fmt: skip


def _trouble(found: Fleet) -> Iterator[Remark]:
    """Units and files that are not among the calibrated ones."""
    for unit, why in found.failed.items():
        yield Remark.of("not-calibrated", unit, reason=why.rstrip("."))
    if found.left_out:
        yield Remark.of("files-left-out", files=tuple(found.left_out))


@contextmanager
def _bar() -> Iterator[Progress]:
    """A progress bar of as many units as there are, which is known when they are found."""
    fine, moved = 1000, 0
    with progress("looking for recordings", fine) as advance:

        def show(done: int, units: int, text: str) -> None:
            nonlocal moved
            steps = done * fine // units - moved
            moved += steps
            advance(f"{done} of {units}: {text}", steps)

        yield show
