"""Run the jobs of a fleet, in this process or on the workers of a Dask cluster."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from gmwm.applications.fleets.unit_job import UnitJob, UnitOutcome, calibrate_unit, lost_outcome
from gmwm.base.errors import GmwmError

if TYPE_CHECKING:
    from distributed import Future

_GONE = "the scheduler no longer answers"
_AGAIN = "Run the fleet again: finished units are kept."


def in_process(jobs: Iterable[UnitJob], retries: int) -> Iterator[UnitOutcome]:
    """Run the jobs in this process one after the other, and yield their outcomes. Retries come last."""
    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    while waiting:
        job = waiting.popleft()
        outcome = calibrate_unit(job)
        tries[job.unit] += 1
        if outcome.passing and tries[job.unit] <= retries:
            waiting.append(job)
        else:
            yield outcome


def on_cluster(jobs: Iterable[UnitJob], client: Any, retries: int) -> Generator[UnitOutcome, None, None]:
    """Run the jobs on the workers of a cluster, and yield their outcomes in the order of completion.

    Dask repeats the jobs of a lost worker elsewhere, and gives them up after several lost workers, without knowing
    which job caused the loss. The given-up jobs are therefore repeated at the end, one at a time."""
    suspects: list[UnitJob] = []

    def on_lost(job: UnitJob, _: Exception) -> UnitOutcome | None:
        suspects.append(job)
        return None

    yield from _through(
        # No thread waits, and the scheduler does not store all jobs.
        client,
        jobs,
        retries=retries,
        on_lost=on_lost,
        window=lambda: 4 * sum(client.nthreads().values()),
    )
    yield from _through(
        client, suspects, retries=retries, window=lambda: 1,
        on_lost=lambda job, error: lost_outcome(job, getattr(error, "allowed_failures", 0) + 1),
    )  # fmt: skip


def _through(
    client: Any, jobs: Iterable[UnitJob], retries: int, on_lost: Callable[[UnitJob, Exception], UnitOutcome | None],
    window: Callable[[], int],
) -> Iterator[UnitOutcome]:  # fmt: skip
    """Run jobs on the cluster, with a limited number at a time, and yield their outcomes."""
    import distributed

    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    running: dict[Future[Any], UnitJob] = {}
    ended: Any = distributed.as_completed([], loop=client.loop)  # type: ignore[no-untyped-call]

    def fill() -> None:
        for _ in range(min(len(waiting), max(1, window()) - len(running))):
            job = waiting.popleft()
            future = client.submit(calibrate_unit, job, pure=False)
            running[future] = job
            ended.add(future)

    try:
        fill()
        for future in ended:
            job = running.pop(future)
            outcome = _outcome(future, job, on_lost)
            tries[job.unit] += 1
            if outcome is not None and outcome.passing and tries[job.unit] <= retries:
                waiting.append(job)
            elif outcome is not None:
                yield outcome
            fill()
    except Exception as error:  # an error of the client; errors of units are outcomes
        if client.status == "running" and not isinstance(error, OSError):
            raise
        raise GmwmError(_GONE, advice=_AGAIN) from error
    finally:
        # After an error or Ctrl-C, cancel the submitted jobs. The scheduler may no longer exist.
        with suppress(Exception):
            client.cancel(list(running))


def _outcome(
    future: Future[Any], job: UnitJob, on_lost: Callable[[UnitJob, Exception], UnitOutcome | None]
) -> UnitOutcome | None:
    """Return the outcome of a finished job. An error of the cluster itself is raised and stops the run."""
    from distributed import KilledWorker

    if future.status == "cancelled":
        raise GmwmError(_GONE, advice=_AGAIN)
    try:
        outcome: UnitOutcome = future.result()
    except KilledWorker as error:
        return on_lost(job, error)
    except Exception as error:  # not from calibrate_unit: the job could not be started, or its result could not be sent
        return UnitOutcome(job.unit, reason=f"{type(error).__name__}: {error}")
    return outcome


@contextmanager
def allowing_lost_workers(retries: int) -> Iterator[None]:
    """Make a scheduler that starts inside the block give up a job after more than `retries` lost workers."""
    import dask

    with dask.config.set({"distributed.scheduler.allowed-failures": retries}):
        yield
