"""Run the jobs of a fleet: in this process, in processes on this machine, or on the workers of a Dask cluster.

`run_jobs` is the one loop with its retries. A `WorkPlace` says where a job runs, and which job has ended a process: an
executor of the standard library does not know it."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import TYPE_CHECKING, Any

from gmwm.applications.fleets.unit_job import UnitJob, UnitOutcome, calibrate_unit, lost_outcome
from gmwm.base.errors import GmwmError
from gmwm.base.helpers import Helper, new_helper
from gmwm.base.threads import INTERRUPT_CHECK

if TYPE_CHECKING:
    from distributed import Future
    from typing_extensions import Self

MODULES = ("gmwm.applications.fleets.unit_job",)
"""Modules that a process imports before its first job."""
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


def run_jobs(jobs: Iterable[UnitJob], place: WorkPlace, retries: int) -> Generator[UnitOutcome, None, None]:
    """Run jobs, and yield their outcomes in the order of completion. Retries come last. The job of a process that ends
    is repeated alone after all others, because another job may have used the memory."""
    waiting, alone = deque(jobs), deque[UnitJob]()
    tries, deaths = Counter[str](), Counter[str]()
    running = 0
    while waiting or alone or running:
        while waiting and running < place.room():
            place.begin(waiting.popleft())
            running += 1
        if alone and not running and place.room():
            place.begin(alone.popleft())
            running += 1
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
        self._ended: Any = distributed.as_completed([], loop=client.loop)  # type: ignore[no-untyped-call]

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
