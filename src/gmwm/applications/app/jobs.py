"""Long computations in threads, with progress and cancellation. The last results are kept and found by a key."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Literal

from gmwm.base.threads import stoppable

State = Literal["running", "done", "failed", "cancelled"]
SILENT_S = 0.3
"""Time (s) to wait for a result before the progress of a job is shown, so that short jobs show none."""


class Cancelled(BaseException):
    """Exception that stops a cancelled job. It is not an `Exception`, so that no handler of errors catches it."""


class Job:
    """A computation that runs in its own thread.

    Attributes
    ----------
    title : str
        Title of the job that the user sees.
    state : "running", "done", "failed" or "cancelled"
    text : str
        Description of the last step.
    share : float or None
        Finished fraction of the work, from 0 to 1; None if unknown.
    value : object
        The result, if the state is "done".
    error : Exception or None
        The error, if the state is "failed".
    """

    def __init__(self, title: str, work: Callable[[Job], Any], finished: Callable[[], None]) -> None:
        self.title, self._work, self._finished = title, work, finished
        self.state: State = "running"
        self.text = ""
        self.share: float | None = None
        self.value: Any = None
        self.error: Exception | None = None
        self._stop, self._ended = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._begun = time.monotonic()
        self._thread = threading.Thread(target=self._run, name=title, daemon=True)
        self._thread.start()

    def step(self, text: str, done: float = 0, total: float = 0) -> None:
        """Report progress: a description of the step, and the finished and total amounts of work if known."""
        self.check()
        self.text, self.share = text, min(done / total, 1.0) if total > 0 else None

    @property
    def progress(self) -> str:
        """Title, last step and running time, such as "Calibrating gyro_y, 4 s"."""
        return f"{f'{self.title} {self.text}'.rstrip()}, {time.monotonic() - self._begun:.0f} s"

    def check(self) -> None:
        """Raise `Cancelled` if the job was cancelled."""
        if self._stop.is_set():
            raise Cancelled

    def cancel(self) -> None:
        """Stop the job at its next call of `step` or `check`. Its result is not used, even if it ends before."""
        self._stop.set()
        self._end("cancelled")

    def join(self, seconds: float) -> bool:
        """Wait at most this time (s) for the end of the job, and return whether it has ended."""
        return self._ended.wait(seconds)

    def result_for(self, other: Job) -> Any:
        """Wait for the result of this job in another job, and return it. The other job shows its progress."""
        while not self.join(0.05):  # check for a cancellation every 0.05 s
            other.step(f"{self.title}: {self.text}" if self.text else self.title)
        if self.state == "cancelled":
            raise Cancelled
        if self.error is not None:
            raise self.error
        return self.value

    def _run(self) -> None:
        try:
            with stoppable(self.check):
                value = self._work(self)
        except Cancelled:
            self._end("cancelled")
        except Exception as error:
            self._end("failed", error=error)
        else:
            self._end("done", value=value)

    def _end(self, state: State, value: Any = None, error: Exception | None = None) -> None:
        with self._lock:
            if self.state != "running":
                return
            self.value, self.error, self.state = value, error, state
        self._finished()
        self._ended.set()


class Jobs:
    """The jobs of one page. The last jobs of each kind are kept, and older jobs are cancelled.

    Attributes
    ----------
    revision : int
        Number that increases whenever a job ends.
    """

    def __init__(self) -> None:
        self.revision = 0
        self._jobs: dict[str, OrderedDict[Hashable, Job]] = {}
        self._lock = threading.RLock()

    def ask(
        self, kind: str, key: Hashable, title: str, work: Callable[[Job], Any], *, kept: int = 2, alone: bool = True
    ) -> Job:
        """Return the job with a key, and start it if there is none."""
        with self._lock:
            of_kind = self._jobs.setdefault(kind, OrderedDict())
            job = of_kind.get(key)
            if job is not None:
                of_kind.move_to_end(key)
                return job
            for other in of_kind.values() if alone else ():
                other.cancel()
            while len(of_kind) >= kept:
                of_kind.popitem(last=False)[1].cancel()
            job = of_kind[key] = Job(title, work, self._count_end)
            return job

    def running(self) -> list[Job]:
        """Return the jobs that are still running."""
        with self._lock:
            return [job for of_kind in self._jobs.values() for job in of_kind.values() if job.state == "running"]

    def cancel(self) -> None:
        """Cancel all running jobs."""
        for job in self.running():
            job.cancel()

    def again(self) -> None:
        """Remove the jobs that failed or were cancelled, so that the next call of `ask` starts them again."""
        with self._lock:
            for of_kind in self._jobs.values():
                for key in [key for key, job in of_kind.items() if job.state in ("failed", "cancelled")]:
                    del of_kind[key]
        self._count_end()

    def _count_end(self) -> None:
        with self._lock:
            self.revision += 1
