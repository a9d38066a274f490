"""gmwm fleet: calibrate thousands of recordings, and compare the units."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gmwm.applications.fleets.result import FILE, TABLE
from gmwm.base.errors import DataError, OptionError
from gmwm.base.extras import is_installed
from gmwm.base.remarks import Dialect, Remark
from gmwm.base.threads import processors
from gmwm.calibration.options import SEARCHED
from gmwm.cli.calibrate import calibration_helpers, calibration_options
from gmwm.cli.command import command
from gmwm.cli.options import Criterion, Weighting, joined_against
from gmwm.cli.output import NewFile, Outcome, file_names, optional_plots, progress, text_file
from gmwm.measuring.regression.against import AUTO
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.applications.fleets import Fleet
    from gmwm.base.reporting import Progress

EXAMPLES = (
    "gmwm fleet recordings --output results",
    'gmwm fleet recordings --pattern "*.csv" --units gyro=deg/s --output results',
    "gmwm fleet /shared/lot7 --scheduler tcp://10.0.0.5:8786 --output results",
)


@command
def fleet(
    folder: Path,
    output: Path,
    reading: ReadOptions,
    pattern: str | None = None,
    axis: list[str] | None = None,
    within: str = SEARCHED,
    against: list[str] | None = None,
    robust: Literal["auto", "yes", "no"] = "auto",
    efficiency: float | None = None,
    weighting: Weighting = "optimal",
    criterion: Criterion = "asymptotic",
    confidence: float = 0.95,
    seed: int = 0,
    scheduler: str | None = None,
    workers: int | None = None,
    retries: int = 2,
) -> Outcome:
    """Calibrate every recording in a folder, and find the units that differ from the others.

    Each calibration is written as soon as it is done. If the command runs again, it processes only units that have no
    result yet, that failed, or whose recording has changed. A unit that cannot be calibrated does not stop the run; a
    warning gives the reason. The exit code is 0 if at least one unit is calibrated, otherwise 2.

    fleet.parquet has a row for each unit and axis. In Python, Fleet.load reads the output directory.

    Arguments:
        folder (DIR): Folder with one recording of each unit; subfolders are searched too. Each IMU topic of a file
            counts as a unit.
    Input:
        pattern (PATTERN): Pattern of the files to read, such as '*.csv' for names or 'lot 7/*.csv' for paths in the
            folder. Default: all recordings.
    Estimation:
        robust: Axes with the robust wavelet variance: auto, those where a test finds knocks or motion (5 % level for
            all axes together; none if --within has a sinusoid); yes, all axes; no, none.
    Parallel work:
        scheduler (ADDRESS): Address of a Dask scheduler, such as tcp://10.0.0.5:8786. Its workers need the files at the
            same paths. Default: this machine.
        workers (≥ 0): Number of worker processes on this machine; 0 uses only the main process. Default: one for each
            processor.
        retries (≥ 0): Number of further attempts for a unit after an error of the file system or the loss of a worker.
    Result:
        output (--output, -o): Write units/<unit>.json, fleet.json, fleet.parquet, summary.txt and fleet.png to this
            directory. Units whose results are already in this directory are skipped."""
    from gmwm.applications.fleets.engine import calibrate_fleet

    _check(folder, scheduler=scheduler, workers=workers)
    options = calibration_options(
        within=within, robust=robust, efficiency=efficiency, weighting=weighting, criterion=criterion,
        confidence=confidence, seed=seed, against=joined_against(against, AUTO),
        axes=[part.strip() for text in axis or () for part in text.split(",")] or None,
    )  # fmt: skip
    count = processors() if workers is None else workers
    forked = count if scheduler is None and count > (workers is None) else 0
    processes = calibration_helpers(before="gmwm.applications.fleets.unit_job", count=forked)
    with _bar() as advance:
        result = calibrate_fleet(
            folder, output, options, reading, pattern=pattern, scheduler=scheduler, workers=workers, retries=retries,
            progress=advance, helpers=processes, meanwhile=_load_drawing,
        )  # fmt: skip
    if not len(result):
        unit, reason = next(iter(result.failed.items()))
        raise DataError(
            f"none of {len(result.units)} units can be calibrated; the first one is {unit}: {reason}",
            advice="Check its recording with {gmwm info}.",
        )
    summary = result.summary(Dialect.SHELL)
    done = (output / FILE, output / TABLE)
    files = (
        text_file(output / "summary.txt", summary + "\n"),
        *optional_plots(NewFile(output / "fleet.png", lambda path: result.plot(path=path), "plotting")),
    )
    return Outcome(
        command="fleet", document={**_document(result), "written": [*map(str, done), *file_names(files)]},
        text=summary, files=files, written=done, remarks=tuple(_trouble(result)),
    )  # fmt: skip


def _load_drawing() -> None:
    """Import what draws the picture, which takes 0.4 s, while workers calibrate."""
    if is_installed("matplotlib"):
        import_module("gmwm.showing.plots.matplotlib")


def _check(folder: Path, *, scheduler: str | None, workers: int | None) -> None:
    """Raise an OptionError if options exclude each other, or if `folder` is a file."""
    if workers is not None and scheduler is not None:
        raise OptionError(
            "--workers starts processes on this machine, but a scheduler has its own workers", argument="workers",
            got=workers, advice="Leave {--workers} or {--scheduler} out.",
        )  # fmt: skip
    if folder.is_file():
        raise OptionError(
            f"{folder} is a file, not a folder of recordings", argument="folder", got=str(folder),
            advice="Use {gmwm calibrate} for one recording.",
        )  # fmt: skip


def _document(found: Fleet) -> dict[str, object]:
    """Return the result for --json, without the written files."""
    return {
        "output": str(found.folder), "units": list(found.units), "done": found.done, "kept": found.kept,
        "failed": found.failed, "left_out": list(found.left_out), "statistics": found.statistics.to_dict(),
    }  # fmt: skip


def _trouble(found: Fleet) -> Iterator[Remark]:
    """Yield remarks about units that could not be calibrated, and about files that were left out."""
    for unit, reason in found.failed.items():
        yield Remark.of("not-calibrated", unit, case="calibration", reason=reason)
    if found.left_out:
        yield Remark.of("left-out", case="files", files=tuple(found.left_out))


@contextmanager
def _bar() -> Iterator[Progress]:
    """Show a progress bar of 1000 steps, because the number of units is not known at the start."""
    fine, moved = 1000, 0
    with progress("searching recordings", fine) as advance:

        def show(done: int, units: int, text: str) -> None:
            nonlocal moved
            steps = done * fine // units - moved
            moved += steps
            advance(f"{done} of {units}: {text}", steps)

        yield show
