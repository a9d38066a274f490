"""Thousands of recordings, each calibrated: on this machine or many, kept as it goes, taken up where it ended."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm._text import counted
from gmwm._threads import processors
from gmwm.calibration.options import WITHIN, CalibrationOptions
from gmwm.errors import GmwmWarning, OptionError
from gmwm.fleets.discovery import FleetUnits, Recordings, find_units
from gmwm.fleets.result import Fleet
from gmwm.fleets.rows import Row, failed_row
from gmwm.fleets.storage import TABLE, finished_rows, foreign_units, remove_unit, write_facts, write_unit
from gmwm.fleets.table import as_table, write_table
from gmwm.fleets.unit_job import Job, Outcome, UnitOptions
from gmwm.fleets.workers import allowing_lost_workers, in_process, on_cluster
from gmwm.options import ReadOptions
from gmwm.processes.model import ModelLike
from gmwm.processes.validation import as_seed
from gmwm.readers import find_reader
from gmwm.signals import AXES
from gmwm.units import SI_UNIT

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int, str], None]
"""Called with the number of units done, that of all, and the last one."""


def fleet(
    recordings: Recordings,
    output: str | os.PathLike[str],
    *,
    within: ModelLike = WITHIN,
    robust: Literal["auto"] | bool = "auto",
    weighting: Literal["diagonal", "optimal"] = "optimal",
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95,
    efficiency: float = 0.6,
    draws: int = 1000,
    rng: int | np.random.Generator = 0,
    axes: str | Sequence[str] | None = None,
    reading: Mapping[str, Any] | ReadOptions | None = None,
    pattern: str | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    retries: int = 2,
    progress: Progress | None = None,
) -> Fleet:
    """Calibrate every recording of a fleet, and make one table of all.

    Each unit's calibration is written as soon as it is there. Whoever runs the same again does only what is missing:
    units that failed, that are new, whose recording or whose settings are others. A unit that fails is a row with its
    reason and ends nothing. What a network file system or a lost worker interrupts is tried again.

    Parameters
    ----------
    recordings : folder, sequence of paths, or mapping of unit to path
        Of a folder all files beneath that a reader knows by name or content, but hidden ones; a unit is called by its
        path in the folder.
    output : path
        Folder for fleet.json, fleet.parquet, and units/<unit>.json as `Calibration.load` reads them.
    within, robust, weighting, criterion, confidence, efficiency, draws, rng, axes
        As for `calibrate`, of every unit. An integer is drawn from a Generator once and serves all units; a later run
        with another integer calibrates all of them again.
    reading : mapping or ReadOptions, optional
        Arguments of `read`, for every recording: {"rate": 100.0, "units": {"gyro": "deg/s"}}.
    pattern : str, optional
        Which files of the folder instead: "*.csv" is of their names, "lot 7/*.csv" of their paths.
    scheduler : str or distributed.Client, optional
        Address of a Dask scheduler whose workers do the work, or a client of it. All have gmwm, and the workers find
        the recordings under the same paths; how many lost workers a unit may cost is the scheduler's own setting.
    workers : int, optional
        Processes to begin on this machine instead, one for each processor by default if Dask is installed; a script
        must then hold its work under `if __name__ == "__main__":`. 0 works in this process.
    retries : int
        How often a unit is tried again that the system interrupted.
    progress : function of (done, all, text), optional
        Called after each unit, in the calling thread.

    Returns
    -------
    Fleet
        Its `table`, `failed`, `statistics` and `outliers`; `fleet["unit"]` is the Calibration of one.

    Raises
    ------
    OptionError, UnitError, ModelError
        If an option is not one of those it may be; before any work begins.
    MissingDependencyError
        If a cluster or workers are asked for and Dask is not installed.

    Warns
    -----
    GmwmWarning
        If results of units that are not of this fleet stand in the output.

    Examples
    --------
    >>> import pathlib, tempfile, gmwm
    >>> folder = tempfile.TemporaryDirectory()
    >>> for k in range(3):
    ...     path = pathlib.Path(folder.name, f"unit{k}.parquet")
    ...     gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=5_000, rng=k).write(path)
    >>> found = fleet(folder.name, pathlib.Path(folder.name, "results"), within="WN + RW", workers=0)
    >>> found
    Fleet(3 of 3 units calibrated)
    >>> found.table.select("unit", "axis", "model").row(0)
    ('unit0.parquet', 'gyro_x', 'WN')
    >>> folder.cleanup()
    """
    options = CalibrationOptions(
        within=within, robust=robust, weighting=weighting, criterion=criterion, confidence=confidence,
        efficiency=efficiency, draws=draws, seed=as_seed(rng), axes=axes,
    )  # fmt: skip
    return calibrate_fleet(
        recordings, output, options, _read_options(reading), pattern=pattern, scheduler=scheduler, workers=workers,
        retries=retries, progress=progress,
    )  # fmt: skip


def calibrate_fleet(
    recordings: Recordings,
    output: str | os.PathLike[str],
    options: CalibrationOptions,
    reading: ReadOptions,
    *,
    pattern: str | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    retries: int = 2,
    progress: Progress | None = None,
) -> Fleet:
    """The calibrations of a fleet, as `fleet` gives them, by options that are checked."""
    _check_axes(options.wanted)
    if reading.format is not None:
        find_reader(Path(), reading.format)
    unit_options = UnitOptions(options, reading)
    _check_places(scheduler, workers, retries)
    folder = Path(output).absolute()
    found = find_units(recordings, folder, pattern)
    if folder.exists() and not folder.is_dir():
        raise OptionError(f"output must be a folder, {folder} is a file; name another one")
    run = _Run(folder, found, progress)
    jobs = run.jobs(unit_options)
    # Nothing is written before there is somebody to do the work.
    with _outcomes(jobs, scheduler, workers, retries) as outcomes:
        folder.mkdir(parents=True, exist_ok=True)
        if others := foreign_units(folder, found.paths):
            warnings.warn(
                f"{counted(len(others), 'result')} of units that are not of this fleet "
                f"{'stays' if len(others) == 1 else 'stay'} in {folder / 'units'}: {', '.join(others[:3])}"
                f"{' …' if len(others) > 3 else ''}; remove them, or name another output",
                GmwmWarning,
                stacklevel=2,
            )
        write_facts(folder, found, unit_options)
        with run.telling():
            for outcome in outcomes:
                run.take(outcome)
    paths = {unit: str(path) for unit, path in found.paths.items()}
    return Fleet(
        folder=folder,
        paths=paths,
        table=run.table(),
        settings=options,
        left_out=found.left_out,
        kept=run.kept,
        done=run.done,
        reading=reading.to_dict(),
    )


class _Run:
    """One run of a fleet: what is kept of earlier ones, and what comes."""

    def __init__(self, folder: Path, found: FleetUnits, progress: Progress | None) -> None:
        self.folder, self.paths, self.progress = folder, found.paths, progress
        self.rows: dict[str, list[Row]] = {}
        self.kept = self.done = 0

    def jobs(self, options: UnitOptions) -> list[Job]:
        """What is to be done; the rest is kept."""
        jobs = []
        for unit, path in self.paths.items():
            rows = finished_rows(self.folder, unit, path, options)
            if rows is None:
                jobs.append(Job(unit, str(path), options))
            else:
                self.rows[unit] = rows
                self.kept += 1
                self._tell(f"{unit}: kept")
        return jobs

    def take(self, outcome: Outcome) -> None:
        """Keep what became of a unit."""
        unit = outcome.unit
        if outcome.document is None:
            remove_unit(self.folder, unit)
            self.rows[unit] = [failed_row(unit, str(self.paths[unit]), outcome.reason)]
        else:
            write_unit(self.folder, unit, outcome.document)
            self.rows[unit] = list(outcome.rows)
            self.done += 1
        self._tell(unit if outcome.document is not None else f"{unit}: failed")

    def table(self) -> Any:
        """The table of all units, in their order; of those that were not come to, too."""
        missing = "not come to: the run was ended before; run the same again"
        return as_table(
            row
            for unit, path in self.paths.items()
            for row in self.rows.get(unit) or [failed_row(unit, str(path), missing)]
        )

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Write the table in the end, and after an error or Ctrl-C too."""
        try:
            yield
        finally:
            write_table(self.table(), self.folder / TABLE)

    def _tell(self, text: str) -> None:
        if self.progress is not None:
            self.progress(len(self.rows), len(self.paths), text)


@contextmanager
def _outcomes(
    jobs: Sequence[Job], scheduler: str | Client | None, workers: int | None, retries: int
) -> Iterator[Iterable[Outcome]]:
    """What becomes of the jobs, wherever they are done."""
    alone = (
        scheduler is None and workers is None and (len(jobs) < 2 or processors() == 1 or not find_spec("distributed"))
    )
    if not jobs or workers == 0 or alone:
        yield in_process(jobs, retries)
        return
    from gmwm.streaming.scheduling import connected, library

    library()
    with ExitStack() as stack:
        stack.enter_context(allowing_lost_workers(retries))
        client = stack.enter_context(connected(scheduler, workers))
        # A worker has one job for each of its threads: the axes of a unit follow one another there.
        outcomes = on_cluster([Job(job.unit, job.path, job.options, threads=1) for job in jobs], client, retries)
        # Closed first, whatever happens: what has not begun is cancelled while there is a client.
        stack.callback(outcomes.close)
        yield outcomes


def _read_options(reading: Mapping[str, Any] | ReadOptions | None) -> ReadOptions:
    """The options of `read` in a mapping; None stands for a default."""
    if isinstance(reading, ReadOptions):
        return reading
    if reading is not None and not isinstance(reading, Mapping):
        raise OptionError(f"reading must map arguments of gmwm.read to values, got {type(reading).__name__}")
    known = [field.name for field in fields(ReadOptions)]
    if unknown := [name for name in reading or {} if name not in known]:
        raise OptionError(f"reading must hold arguments of gmwm.read, some of {', '.join(known)}; got {unknown[0]!r}")
    return ReadOptions(**{name: value for name, value in (reading or {}).items() if value is not None})


def _check_axes(names: tuple[str, ...] | None) -> None:
    """Axes and sensors by name; recordings have no others."""
    known = (*AXES, *SI_UNIT)
    if unknown := [name for name in names or () if name not in known]:
        raise OptionError(f"axes must be some of {', '.join(known)}; got {unknown[0]!r}")


def _check_places(scheduler: str | Client | None, workers: int | None, retries: int) -> None:
    for name, number in (("workers", workers), ("retries", retries)):
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < 0):
            raise OptionError(f"{name} must be a whole number from 0, got {number!r}")
    if scheduler is not None and workers is not None:
        raise OptionError(
            f"workers={workers} are those begun on this machine, a scheduler has its own: leave one of them out"
        )
