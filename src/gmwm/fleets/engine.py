"""Calibrate many recordings on one machine or a cluster, and continue an interrupted run."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from gmwm._arrays import as_rate
from gmwm._threads import processors
from gmwm.calibration.api import WITHIN, check_settings
from gmwm.calibration.result import Settings
from gmwm.errors import GmwmWarning, OptionError
from gmwm.fleets.discovery import Found, Recordings, find_units
from gmwm.fleets.result import Fleet
from gmwm.fleets.rows import Row, failed_row
from gmwm.fleets.storage import TABLE, UNITS, drop, foreign_units, keep, kept_rows, write_facts
from gmwm.fleets.table import RUN_AGAIN, as_table, write_table
from gmwm.fleets.unit_job import Asked, Job, Outcome
from gmwm.fleets.workers import here, patient, spread
from gmwm.processes.model import ModelLike, as_model
from gmwm.readers import find_reader, read
from gmwm.readers.axis_units import checked_units
from gmwm.readers.scale_factors import checked_increments, checked_scale
from gmwm.remarks import Remark
from gmwm.signals import AXES

if TYPE_CHECKING:
    from distributed import Client

Progress = Callable[[int, int, str], None]
"""A function that is called with the number of units done, the number of all units, and the last unit."""


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
    seed: int = 0,
    axes: str | Sequence[str] | None = None,
    reading: Mapping[str, Any] | None = None,
    pattern: str | None = None,
    scheduler: str | Client | None = None,
    workers: int | None = None,
    retries: int = 2,
    progress: Progress | None = None,
) -> Fleet:
    """Calibrate the recordings of many units, and collect their numbers in one table.

    The calibration of each unit is written as soon as it is finished. A second run with the same output calibrates only
    units that failed, that are new, or whose recording or options changed. A unit that fails has a row with the reason
    and does not stop the others. Errors of a network file system or a lost worker are retried.

    Parameters
    ----------
    recordings : folder, sequence of paths, or mapping of unit to path
        For a folder, all files below it that a reader recognizes by name or content, without hidden files. The name of
        a unit is its path in the folder.
    output : path
        Folder for fleet.json, fleet.parquet, and units/<unit>.json as `Calibration.load` reads them.
    within, robust, weighting, criterion, confidence, efficiency, draws, seed, axes
        As for `calibrate`, for every unit.
    reading : mapping, optional
        Arguments of `read` for every recording: {"rate": 100.0, "units": {"gyro": "deg/s"}}.
    pattern : str, optional
        Files of the folder to use instead: "*.csv" is matched with the names, "lot 7/*.csv" with the paths.
    scheduler : str or distributed.Client, optional
        Address of a Dask scheduler, or a client. The workers need gmwm and access to the recordings under the same
        paths. The scheduler decides how many lost workers end a job.
    workers : int, optional
        Number of processes to start on this machine; by default one for each processor if Dask is installed. A script
        must then start its work under `if __name__ == "__main__":`. 0 uses only this process.
    retries : int
        Number of retries after an error of the operating system.
    progress : function of (done, all, text), optional
        Called after each unit in the calling thread.

    Returns
    -------
    Fleet
        With `table`, `failed`, `statistics`, `outliers` and `remarks`; `fleet["unit"]` is the Calibration of one unit.

    Raises
    ------
    OptionError, UnitError, ModelError
        If an option has an invalid value; raised before any calibration.
    MissingDependencyError
        If a scheduler or workers are given and Dask is not installed.

    Warns
    -----
    GmwmWarning
        If the output contains results of units that are not in this fleet.

    Examples
    --------
    >>> import pathlib, tempfile, gmwm
    >>> folder = tempfile.TemporaryDirectory()
    >>> for k in range(3):
    ...     path = pathlib.Path(folder.name, f"unit{k}.parquet")
    ...     gmwm.write(gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=5_000, seed=k), path)
    >>> found = fleet(folder.name, pathlib.Path(folder.name, "results"), within="WN + RW", workers=0)
    >>> found
    Fleet(3 of 3 units calibrated)
    >>> found.table.select("unit", "axis", "model").row(0)
    ('unit0.parquet', 'gyro_x', 'WN')
    >>> folder.cleanup()
    """
    general = as_model(within, "within")
    settings = Settings(str(general), robust, weighting, criterion, confidence, efficiency, draws, seed)
    check_settings(settings)
    arguments, plain = _checked_reading(reading)
    asked = Asked(general, settings, _checked_axes(axes), arguments, plain)
    _check_places(scheduler, workers, retries)
    folder = Path(output).absolute()
    found = find_units(recordings, folder, pattern)
    if folder.exists() and not folder.is_dir():
        raise OptionError(argument="output", expected="a folder", got=str(folder))
    run = _Run(folder, found, progress)
    jobs = run.jobs(asked)
    # Nothing is written before the scheduler answers.
    with _outcomes(jobs, scheduler, workers, retries) as outcomes:
        folder.mkdir(parents=True, exist_ok=True)
        if others := foreign_units(folder, found.paths):
            where = str(folder / UNITS)
            remark = Remark.of("foreign-results", folder=where, count=len(others), units=tuple(others))
            warnings.warn(GmwmWarning(remark), stacklevel=2)
        write_facts(folder, found, asked)
        with run.telling():
            for outcome in outcomes:
                run.take(outcome)
    paths = {unit: str(path) for unit, path in found.paths.items()}
    return Fleet(folder, paths, run.table(), settings, found.left_out, run.kept, run.done, plain)


class _Run:
    """One run of a fleet: the rows kept from earlier runs, and the new ones."""

    def __init__(self, folder: Path, found: Found, progress: Progress | None) -> None:
        self.folder, self.paths, self.progress = folder, found.paths, progress
        self.rows: dict[str, list[Row]] = {}
        self.kept = self.done = 0

    def jobs(self, asked: Asked) -> list[Job]:
        """The jobs of units that are not finished."""
        jobs = []
        for unit, path in self.paths.items():
            rows = kept_rows(self.folder, unit, path, asked)
            if rows is None:
                jobs.append(Job(unit, str(path), asked))
            else:
                self.rows[unit] = rows
                self.kept += 1
                self._tell(f"{unit}: kept")
        return jobs

    def take(self, outcome: Outcome) -> None:
        """Store the outcome of a unit."""
        unit = outcome.unit
        if outcome.document is None:
            drop(self.folder, unit)
            self.rows[unit] = [failed_row(unit, str(self.paths[unit]), outcome.reason)]
        else:
            keep(self.folder, unit, outcome.document)
            self.rows[unit] = list(outcome.rows)
            self.done += 1
        self._tell(unit if outcome.document is not None else f"{unit}: failed")

    def table(self) -> Any:
        """The table of all units in their order, with those that the run did not reach."""
        missing = f"the run ended before this unit. {RUN_AGAIN}"
        return as_table(
            row
            for unit, path in self.paths.items()
            for row in self.rows.get(unit) or [failed_row(unit, str(path), missing)]
        )

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Write the table at the end, also after an error or Ctrl-C."""
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
    """The outcomes of the jobs, from this process or a cluster."""
    alone = (
        scheduler is None and workers is None and (len(jobs) < 2 or processors() == 1 or not find_spec("distributed"))
    )
    if not jobs or workers == 0 or alone:
        yield here(jobs, retries)
        return
    from gmwm.streaming.scheduling import connected, library

    library()
    with ExitStack() as stack:
        stack.enter_context(patient(retries))
        client = stack.enter_context(connected(scheduler, workers))
        # A worker runs one job for each of its threads, so the axes of a unit are calibrated one after the other.
        outcomes = spread([Job(job.unit, job.path, job.asked, threads=1) for job in jobs], client, retries)
        # Closed before the client, so that jobs that have not started are cancelled.
        stack.callback(outcomes.close)
        yield outcomes


def _checked_reading(reading: Mapping[str, Any] | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """The arguments of `read` that differ from its defaults, and the same after a round trip through JSON."""
    if reading is not None and not isinstance(reading, Mapping):
        raise OptionError(argument="reading", expected="a mapping of arguments of gmwm.read to values", got=reading)
    defaults = {name: one.default for name, one in signature(read).parameters.items() if name != "path"}
    given = dict(reading or {})
    if unknown := [name for name in given if name not in defaults]:
        expected = f"a mapping with the keys {', '.join(defaults)}"
        raise OptionError(argument="reading", expected=expected, got=unknown[0])
    given = {name: value for name, value in given.items() if not _is_default(value, defaults[name])}
    if given.get("gaps", "keep") not in ("keep", "longest"):
        raise OptionError(argument="gaps", expected="'keep' or 'longest'", got=given["gaps"])
    if "rate" in given:
        as_rate(given["rate"])
    if "format" in given:
        find_reader(Path(), given["format"])
    checked_units(given.get("units"))
    checked_scale(given.get("scale"))
    checked_increments(given.get("increments", ()))
    try:
        plain = json.loads(json.dumps(given, allow_nan=False, default=lambda value: value.tolist()))
    except (TypeError, ValueError, AttributeError) as error:
        expected = "a mapping to finite numbers, strings, lists and mappings of them"
        raise OptionError(argument="reading", expected=expected, got=given) from error
    return given, plain


def _is_default(value: Any, default: Any) -> bool:
    return value is None or value is False or value in (default, [], {})


def _checked_axes(axes: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Check the names of axes and sensors."""
    if axes is None:
        return None
    names = (axes,) if isinstance(axes, str) else tuple(axes)
    known = (*AXES, *dict.fromkeys(axis.rpartition("_")[0] for axis in AXES))
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise OptionError(argument="axes", expected=f"some of {', '.join(known)}", got=axes)
    return names


def _check_places(scheduler: str | Client | None, workers: int | None, retries: int) -> None:
    for name, number in (("workers", workers), ("retries", retries)):
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < 0):
            raise OptionError(argument=name, expected="zero or a positive integer", got=number)
    if scheduler is not None and workers is not None:
        raise OptionError(
            argument="workers", expected="left out if there is a scheduler, which has its own workers", got=workers
        )
