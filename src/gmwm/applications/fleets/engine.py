"""Calibrate many recordings on one machine or on a cluster. An interrupted run can be continued."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import fields, replace
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm.applications.fleets.result import (
    TABLE,
    UNITS,
    Fleet,
    FleetUnits,
    Recordings,
    find_units,
    finished_rows,
    foreign_units,
    remove_unit,
    write_facts,
    write_unit,
)
from gmwm.applications.fleets.unit_job import (
    RUN_AGAIN,
    Row,
    UnitJob,
    UnitOptions,
    UnitOutcome,
    as_table,
    calibrate_unit,
    failed_row,
    lost_outcome,
    write_table,
)
from gmwm.base.errors import GmwmError, GmwmWarning, OptionError
from gmwm.base.helpers import Helper, Helpers, new_helper
from gmwm.base.remarks import Remark
from gmwm.base.reporting import Progress, reported, warn
from gmwm.base.threads import INTERRUPT_CHECK, processors
from gmwm.base.units import AXES, SI_UNIT
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.files.readers import find_reader
from gmwm.measuring.regression.against import AUTO
from gmwm.recording.options import ReadOptions
from gmwm.theory.processes.model import ModelLike
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    from distributed import Client, Future
    from typing_extensions import Self


MODULES = ("gmwm.applications.fleets.unit_job",)  # modules that a process imports before its first job
_GONE = "the scheduler no longer answers"
_AGAIN = "Run the fleet again: finished units are kept."

Answer = tuple[UnitJob, UnitOutcome | None]
"""A job that has ended with its outcome; None if its process has ended, for example because memory is short."""


class WorkPlace(ABC):
    """Where jobs run. A `with` block ends the jobs and the processes that it has started."""

    lost = 1  # number of processes that a job has ended if its outcome is None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()

    @abstractmethod
    def room(self) -> int:
        """Return the number of jobs that may run at the same time now."""

    @abstractmethod
    def begin(self, job: UnitJob) -> None:
        """Begin a job."""

    @abstractmethod
    def answers(self) -> Iterable[Answer]:
        """Wait, for a short time, for jobs to end, and yield them."""

    @abstractmethod
    def end(self) -> None:
        """End all jobs at once."""


def run_jobs(
    jobs: Iterable[UnitJob], place: WorkPlace, retries: int, meanwhile: Callable[[], object] = lambda: None
) -> Generator[UnitOutcome, None, None]:
    """Run jobs, and yield their outcomes in the order of completion. Retries come last. The job of a process that ends
    is repeated alone after all others, because another job may have used the memory. `meanwhile` is called once."""
    waiting, alone = deque(jobs), deque[UnitJob]()
    tries, deaths = Counter[str](), Counter[str]()
    running, began = 0, False
    while waiting or alone or running:
        while waiting and running < place.room():
            place.begin(waiting.popleft())
            running += 1
        if alone and not running and place.room():
            place.begin(alone.popleft())
            running += 1
        if not began:
            meanwhile()
        began = True
        for job, outcome in place.answers():
            running -= 1
            if outcome is None and deaths[job.unit] * place.lost <= retries:
                deaths[job.unit] += 1
                alone.append(job)
            elif outcome is None:
                yield lost_outcome(job, deaths[job.unit] * place.lost)
            elif outcome.passing and tries[job.unit] < retries:
                tries[job.unit] += 1
                waiting.append(job)
            else:
                yield outcome


class Here(WorkPlace):
    """This process, which runs one job at a time."""

    def room(self) -> int:
        """Return 1."""
        return 1

    def begin(self, job: UnitJob) -> None:
        """Keep the job."""
        self._job = job

    def answers(self) -> Iterable[Answer]:
        """Run the job."""
        return [(self._job, calibrate_unit(self._job))]

    def end(self) -> None:
        """Do nothing: no job runs between two answers."""


class Processes(WorkPlace):
    """Processes on this machine, each of which runs one job at a time. New ones import the script that runs."""

    def __init__(self, count: int, helpers: Sequence[Helper] = ()) -> None:
        self._idle = list(helpers)
        # The process, and its job; None while it starts.
        self._busy: dict[Helper, UnitJob | None] = {}
        for _ in range(count - len(self._idle)):
            self._start()

    def __enter__(self) -> Self:
        """Wait until all processes have started. Raises GmwmError if one does not start."""
        try:
            while None in self._busy.values():
                list(self.answers())
        except BaseException:
            self.end()
            raise
        return self

    def room(self) -> int:
        """Return the number of processes that have started."""
        return len(self._idle) + len(self._busy) - list(self._busy.values()).count(None)

    def begin(self, job: UnitJob) -> None:
        """Send the job to an idle process."""
        helper = self._idle.pop()
        helper.begin(calibrate_unit, job)
        self._busy[helper] = job

    def answers(self) -> Iterator[Answer]:
        """Wait at most 0.1 s, and replace each process that has ended."""
        from multiprocessing.connection import wait

        ready = wait([helper.connection for helper in self._busy], INTERRUPT_CHECK)  # see `in_threads`
        for helper in [helper for helper in self._busy if helper.connection in ready]:
            job = self._busy.pop(helper)
            try:
                done, answer, _ = helper.connection.recv()
            except (EOFError, OSError):
                helper.end()
                if job is None:
                    raise GmwmError(
                        "worker processes did not start",
                        advice='They import the script that runs: put its work under `if __name__ == "__main__":`.',
                    ) from None
                self._start()
                yield job, None
                continue
            self._idle.append(helper)
            if job is not None:
                yield job, answer if done else _failure(job, answer)

    def end(self) -> None:
        """End all processes."""
        for helper in (*self._idle, *self._busy):
            helper.end()

    def _start(self) -> None:
        helper = new_helper(*MODULES)
        helper.begin(os.getpid)  # the answer shows that the process has started
        self._busy[helper] = None


class Cluster(WorkPlace):
    """The workers of a Dask cluster. Dask repeats the jobs of a lost worker elsewhere, and gives them up after several
    lost workers, without knowing which job caused the loss. Alone, a job is therefore repeated once."""

    def __init__(self, client: Any) -> None:
        import distributed

        self._client = client
        self._running: dict[Future[Any], UnitJob] = {}
        self._ended: Any = distributed.as_completed([], loop=client.loop)

    def room(self) -> int:
        """Return four times the number of threads: none waits, and the scheduler does not store all jobs."""
        return max(1, 4 * int(sum(self._client.nthreads().values())))

    def begin(self, job: UnitJob) -> None:
        """Submit the job."""
        with self._errors():
            future = self._client.submit(calibrate_unit, job, pure=False)
            self._running[future] = job
            self._ended.add(future)

    def answers(self) -> Iterator[Answer]:
        """Wait for one job."""
        from distributed import KilledWorker

        with self._errors():
            future = next(self._ended)
            job = self._running.pop(future)
            if future.status == "cancelled":
                raise GmwmError(_GONE, advice=_AGAIN)
            try:
                outcome: UnitOutcome | None = future.result()
            except KilledWorker as error:
                self.lost, outcome = getattr(error, "allowed_failures", 0) + 1, None
            except Exception as error:  # not of the job: it could not be started, or its result could not be sent
                outcome = _failure(job, error)
        yield job, outcome

    def end(self) -> None:
        """Cancel the submitted jobs, after an error or Ctrl-C. The scheduler may no longer exist."""
        with suppress(Exception):
            self._client.cancel(list(self._running))

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Raise errors of the client as the loss of the scheduler; errors of units are outcomes."""
        try:
            yield
        except Exception as error:
            if self._client.status == "running" and not isinstance(error, OSError):
                raise
            raise GmwmError(_GONE, advice=_AGAIN) from error


def _failure(job: UnitJob, error: BaseException) -> UnitOutcome:
    return UnitOutcome(job.unit, reason=f"{type(error).__name__}: {error}")


@contextmanager
def allowing_lost_workers(retries: int) -> Iterator[None]:
    """Make a scheduler that starts inside the block give up a job after more than `retries` lost workers."""
    import dask

    with dask.config.set({"distributed.scheduler.allowed-failures": retries}):
        yield


def fleet(
    recordings: Recordings, output: str | os.PathLike[str], *, within: ModelLike = SEARCHED,
    robust: Literal["auto"] | bool = "auto", weighting: Literal["diagonal", "optimal"] = "optimal",
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic", confidence: float = 0.95, efficiency: float = 0.6,
    draws: int = 1000, rng: int | np.random.Generator = 0, against: str = AUTO, axes: str | Sequence[str] | None = None,
    reading: Mapping[str, Any] | ReadOptions | None = None, pattern: str | None = None,
    scheduler: str | Client | None = None, workers: int | None = None, retries: int = 2,
    progress: Progress | Literal[True] | None = None,
) -> Fleet:  # fmt: skip
    """Calibrate the recordings of many units, and collect the estimated noise parameters in one table.

    The calibration of each unit is written as soon as it is finished. A second run with the same output folder
    calibrates only units that failed, new units, and units whose recording or options changed. If a unit fails, its row
    in the table states the reason, and the other units are still calibrated. After an error of a network file system or
    the loss of a worker, the unit is tried again.

    Parameters
    ----------
    recordings : folder, sequence of paths, or mapping of unit to path
        For a folder, all files below it that a reader recognizes by name or content, except hidden files. The name of a
        unit is its path in the folder. If a file contains several inertial recordings, each one is a unit with a name
        such as "log.bin/IMU_1". If some of them have all six axes, only these are used.
    output : path
        Folder for fleet.json, fleet.parquet, and a file units/<unit>.json for each unit, which `Calibration.load` can
        read.
    within, robust, weighting, criterion, confidence, efficiency, draws, rng, against, axes
        As for `calibrate`; they apply to every unit. If `rng` is a Generator, one seed for all units is drawn from it.
        A later run with another seed calibrates all units again. `against` must be text, because arrays would have to
        fit the length of every recording.
    reading : mapping or ReadOptions, optional
        Arguments of `read` for every recording, such as {"rate": 100.0, "units": {"gyro": "deg/s"}}.
    pattern : str, optional
        Pattern of the files in the folder to use, in place of all recognized files. "*.csv" is compared with the file
        names, "lot 7/*.csv" with the paths.
    scheduler : str or distributed.Client, optional
        Address of a Dask scheduler, or a client. The workers need gmwm and access to the recordings under the same
        paths. The settings of the scheduler decide after how many lost workers a unit fails.
    workers : int, optional
        Number of processes to start on this machine; by default one for each processor. A script must then call this
        function under `if __name__ == "__main__":`. With 0, all units are calibrated in the present process.
    retries : int
        Number of retries after an error of the operating system.
    progress : True, or function of (done, all, text), optional
        True shows a progress bar. A function is called after each unit, in the calling thread.

    Returns
    -------
    Fleet
        The fleet, with the table and the statistics of all units. `fleet["unit"]` is the Calibration of one unit.

    Raises
    ------
    OptionError, UnitError, ModelError
        If an option has an invalid value. The error is raised before any calibration.
    MissingDependencyError
        If a scheduler is given and Dask is not installed.

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
    ...     gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=5_000, rng=k).write(path)
    >>> found = fleet(folder.name, pathlib.Path(folder.name, "results"), within="WN + RW", workers=0)
    >>> found
    Fleet(3 of 3 units calibrated)
    >>> found.table.select("unit", "axis", "model").row(0)
    ('unit0.parquet', 'gyro_x', 'WN')
    >>> folder.cleanup()
    """
    if not isinstance(against, str):
        raise OptionError(argument="against", expected="text such as 'temperature:2' for a fleet", got=against)
    options = CalibrationOptions(
        within=within, robust=robust, weighting=weighting, criterion=criterion, confidence=confidence,
        efficiency=efficiency, draws=draws, seed=as_seed(rng), against=against, axes=axes,
    )  # fmt: skip
    with reported(progress, "calibrating units") as show:
        return calibrate_fleet(
            recordings, output, options, _read_options(reading), pattern=pattern, scheduler=scheduler, workers=workers,
            retries=retries, progress=show,
        )  # fmt: skip


def calibrate_fleet(
    recordings: Recordings, output: str | os.PathLike[str], options: CalibrationOptions, reading: ReadOptions, *,
    pattern: str | None = None, scheduler: str | Client | None = None, workers: int | None = None, retries: int = 2,
    progress: Progress | None = None, helpers: Helpers | None = None, meanwhile: Callable[[], object] = lambda: None,
) -> Fleet:  # fmt: skip
    """Calibrate a fleet; see `fleet`. The options are already checked. Helpers that are idle calibrate units, and this
    process, which waits for them, calls `meanwhile` once."""
    allowed = (*AXES, *SI_UNIT)
    if unknown := [name for name in options.wanted or () if name not in allowed]:
        raise OptionError(argument="axes", expected=f"some of {', '.join(allowed)}", got=unknown[0])
    if reading.format is not None:
        find_reader(Path(), reading.format)
    unit_options = UnitOptions(options, reading)
    _check_places(scheduler, workers, retries)
    folder = Path(output).absolute()
    units = find_units(recordings, folder, pattern).by_topic(reading)
    if folder.exists() and not folder.is_dir():
        raise OptionError(argument="output", expected="a folder", got=str(output))
    run = _FleetRun(folder, units, progress)
    jobs = run.jobs(unit_options)
    # Nothing is written before the connection to the scheduler is established.
    with _outcomes(jobs, scheduler, workers, retries, helpers=helpers, meanwhile=meanwhile) as outcomes:
        folder.mkdir(parents=True, exist_ok=True)
        if others := foreign_units(folder, units.paths):
            where = str(folder / UNITS)
            remark = Remark.of("other-results", case="units", folder=where, count=len(others), units=tuple(others))
            warn(GmwmWarning(remark), stacklevel=2)
        write_facts(folder, units, unit_options)
        with run.telling():
            for outcome in outcomes:
                run.take(outcome)
    paths = {unit: str(path) for unit, path in units.paths.items()}
    return Fleet(
        folder=folder, paths=paths, table=run.table(), settings=options, left_out=units.left_out, kept=run.kept,
        done=run.done, reading=reading.to_dict(),
    )  # fmt: skip


class _FleetRun:
    """One run of a fleet, which collects the table rows of units from earlier runs and of new calibrations."""

    def __init__(self, folder: Path, found: FleetUnits, progress: Progress | None) -> None:
        self.folder, self.paths, self.progress, self.topics = folder, found.paths, progress, found.topics
        self.rows: dict[str, list[Row]] = {}
        self.kept = self.done = 0

    def jobs(self, options: UnitOptions) -> list[UnitJob]:
        """Return a job for each unit that is not finished, and keep the rows of finished units."""
        jobs = []
        for unit, path in self.paths.items():
            unit_options = options.with_topic(self.topics.get(unit))
            rows = finished_rows(self.folder, unit, path, unit_options)
            if rows is None:
                jobs.append(UnitJob(unit, str(path), unit_options))
            else:
                self.rows[unit] = rows
                self.kept += 1
                self._tell(f"{unit}: kept")
        return jobs

    def take(self, outcome: UnitOutcome) -> None:
        """Store the outcome of a unit in the output folder and in the table."""
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
        """Return the table of all units in their order. Units that this run did not reach have the status "failed"."""
        missing = f"the run ended before this unit. {RUN_AGAIN}"
        return as_table(
            row
            for unit, path in self.paths.items()
            for row in self.rows.get(unit) or [failed_row(unit, str(path), missing)]
        )

    @contextmanager
    def telling(self) -> Iterator[None]:
        """Write the table when the block ends, also after an error or Ctrl-C."""
        try:
            yield
        finally:
            write_table(self.table(), self.folder / TABLE)

    def _tell(self, text: str) -> None:
        if self.progress is not None:
            self.progress(len(self.rows), len(self.paths), text)


@contextmanager
def _outcomes(
    jobs: Sequence[UnitJob], scheduler: str | Client | None, workers: int | None, retries: int, *,
    helpers: Helpers | None, meanwhile: Callable[[], object],
) -> Iterator[Iterable[UnitOutcome]]:  # fmt: skip
    """Provide an iterator over the outcomes of the jobs, which run in this process, in others, or on a cluster."""
    count = min(processors() if workers is None else workers, len(jobs))
    here = scheduler is None and (count == 0 or (count == 1 and workers is None))
    if not here and jobs:
        # A worker runs one job per thread, so each job calibrates the axes of its unit one after the other.
        jobs = [replace(job, threads=1) for job in jobs]
    with ExitStack() as stack:
        if here or not jobs:
            place: WorkPlace = Here()
        elif scheduler is None:
            place = Processes(count, () if helpers is None else helpers.take_idle())
        else:
            from gmwm.base.extras import library
            from gmwm.measuring.streaming.scheduling import connect

            library("distributed")
            stack.enter_context(allowing_lost_workers(retries))
            place = Cluster(stack.enter_context(connect(scheduler)))
        yield run_jobs(jobs, stack.enter_context(place), retries, meanwhile)


def _read_options(reading: Mapping[str, Any] | ReadOptions | None) -> ReadOptions:
    """Convert a mapping to the options of `read`. None stands for the defaults."""
    if isinstance(reading, ReadOptions):
        return reading
    if reading is not None and not isinstance(reading, Mapping):
        raise OptionError(argument="reading", expected="a mapping of arguments of gmwm.read to values", got=reading)
    names = [field.name for field in fields(ReadOptions)]
    if unknown := [name for name in reading or {} if name not in names]:
        expected = f"a mapping with the keys {', '.join(names)}"
        raise OptionError(argument="reading", expected=expected, got=unknown[0])
    return ReadOptions(**{name: value for name, value in (reading or {}).items() if value is not None})


def _check_places(scheduler: str | Client | None, workers: int | None, retries: int) -> None:
    for name, number in (("workers", workers), ("retries", retries)):
        if number is not None and (isinstance(number, bool) or not isinstance(number, int) or number < 0):
            raise OptionError(argument=name, expected="zero or a positive integer", got=number)
    if scheduler is not None and workers is not None:
        expected = "left out if there is a scheduler, which has its own workers"
        raise OptionError(argument="workers", expected=expected, got=workers)
