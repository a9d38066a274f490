"""Calibrate the units of a fleet: one after the other in this process, or by the workers of a Dask cluster."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from gmwm._text import counted
from gmwm.errors import GmwmError
from gmwm.fleets.unit_job import Job, Outcome, calibrate_unit

if TYPE_CHECKING:
    from distributed import Future

WINDOW = 4
"""Jobs under way for each thread of the cluster: enough that none waits, few enough for thousands of units."""
_GONE = "the scheduler no longer answers; what is done is kept, and not done again when the fleet is run again"


def in_process(jobs: Iterable[Job], retries: int) -> Iterator[Outcome]:
    """The outcome of each job, done in this process one after the other; retries come at the end."""
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


def on_cluster(jobs: Iterable[Job], client: Any, retries: int) -> Generator[Outcome, None, None]:
    """The outcome of each job, done by the workers of a cluster, as they end.

    What a lost worker had is done again by another one. Dask gives up on a job after some lost workers, and cannot tell
    the job that kills them from those beside it: these are tried once more in the end, each alone.
    """
    suspects: list[Job] = []

    def on_lost(job: Job, _: Exception) -> Outcome | None:
        suspects.append(job)
        return None

    yield from _through(
        client, jobs, retries=retries, on_lost=on_lost, window=lambda: WINDOW * sum(client.nthreads().values())
    )
    yield from _through(client, suspects, retries=retries, on_lost=_lost, window=lambda: 1)


def _lost(job: Job, error: Exception) -> Outcome:
    deaths = getattr(error, "allowed_failures", 0) + 1
    return Outcome(
        job.unit,
        reason=f"its worker process died {counted(deaths, 'time')} with nothing else under way; is there "
        "enough memory for it?",
    )


def _through(
    client: Any,
    jobs: Iterable[Job],
    retries: int,
    on_lost: Callable[[Job, Exception], Outcome | None],
    window: Callable[[], int],
) -> Iterator[Outcome]:
    """All jobs through the cluster, only so many at a time."""
    import distributed

    waiting = deque(jobs)
    tries: Counter[str] = Counter()
    running: dict[Future[Any], Job] = {}
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
    except Exception as error:  # the client's: what goes wrong in a unit is an outcome
        if client.status == "running" and not isinstance(error, OSError):
            raise
        raise GmwmError(_GONE) from error
    finally:
        # After an error or Ctrl-C: nothing new is begun. A scheduler that is gone needs no word.
        with suppress(Exception):
            client.cancel(list(running))


def _outcome(future: Future[Any], job: Job, on_lost: Callable[[Job, Exception], Outcome | None]) -> Outcome | None:
    """What a future brought; an error of the cluster itself ends the fleet."""
    from distributed import KilledWorker

    if future.status == "cancelled":
        raise GmwmError(_GONE)
    try:
        found: Outcome = future.result()
    except KilledWorker as error:
        return on_lost(job, error)
    except Exception as error:  # as calibrate_unit raises none: it could not be begun, or its result not be sent
        return Outcome(job.unit, reason=f"{type(error).__name__}: {error}")
    return found


@contextmanager
def allowing_lost_workers(retries: int) -> Iterator[None]:
    """Let a scheduler that starts in the block lose `retries` workers to a job before it gives the job up."""
    import dask

    with dask.config.set({"distributed.scheduler.allowed-failures": retries}):
        yield
