"""Run the jobs of a fleet in processes on this machine. Each process runs one job at a time."""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Generator, Iterable, Iterator, Sequence
from types import TracebackType

from gmwm.applications.fleets.unit_job import UnitJob, UnitOutcome, calibrate_unit, lost_outcome
from gmwm.base.errors import GmwmError
from gmwm.base.helpers import Helper, new_helper
from gmwm.base.threads import INTERRUPT_CHECK

MODULES = ("gmwm.applications.fleets.unit_job",)
"""Modules that a process imports before its first job."""


class Processes:
    """Processes on this machine, which end with a `with` block. New ones import the script that runs."""

    def __init__(self, count: int, helpers: Sequence[Helper] = ()) -> None:
        self._idle = list(helpers)
        # The process, and its job; None while it starts.
        self._busy: dict[Helper, UnitJob | None] = {}
        for _ in range(count - len(self._idle)):
            self._start()

    def __enter__(self) -> Processes:
        """Wait until all processes have started. Raises GmwmError if one does not start."""
        try:
            while None in self._busy.values():
                list(self._answers())
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end()

    def outcomes(self, jobs: Iterable[UnitJob], retries: int) -> Generator[UnitOutcome, None, None]:
        """Run jobs, and yield their outcomes in the order of completion.

        The job of a process that ends, for example because memory is short, is repeated alone after all others."""
        waiting, alone = deque(jobs), deque[UnitJob]()
        tries, deaths = Counter[str](), Counter[str]()
        while waiting or alone or any(self._busy.values()):
            while waiting and self._idle:
                self._begin(waiting.popleft())
            if alone and self._idle and not any(self._busy.values()):
                self._begin(alone.popleft())
            for job, outcome in self._answers():
                if outcome is None and deaths[job.unit] <= retries:
                    deaths[job.unit] += 1
                    alone.append(job)
                elif outcome is None:
                    yield lost_outcome(job, deaths[job.unit])
                elif outcome.passing and tries[job.unit] < retries:
                    tries[job.unit] += 1
                    waiting.append(job)
                else:
                    yield outcome

    def _end(self) -> None:
        for helper in (*self._idle, *self._busy):
            helper.end()

    def _start(self) -> None:
        helper = new_helper(*MODULES)
        helper.begin(os.getpid)  # the answer shows that the process has started
        self._busy[helper] = None

    def _begin(self, job: UnitJob) -> None:
        helper = self._idle.pop()
        helper.begin(calibrate_unit, job)
        self._busy[helper] = job

    def _answers(self) -> Iterator[tuple[UnitJob, UnitOutcome | None]]:
        """Wait for answers, and yield the jobs that have ended with their outcomes; None if the process has ended."""
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
                yield job, answer if done else UnitOutcome(job.unit, reason=f"{type(answer).__name__}: {answer}")
