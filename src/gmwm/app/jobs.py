"""Long work in threads, with progress and cancellation. Every result has a key and is kept for some time."""

from __future__ import annotations

import sys
import threading
import traceback
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, Literal

from gmwm._threads import stoppable

State = Literal["running", "done", "failed", "cancelled"]
QUICK = 0.3
"""Time (s) that `Jobs.ask` waits for a result, so that short work needs no progress."""
CHECK = 0.05
"""Time (s) between two checks for a cancellation while a job waits for another one."""


class Cancelled(BaseException):
    """Ends a job that the user cancelled. It passes every handler of errors."""


class Job:
    """One piece of work.

    Attributes
    ----------
    title : str
        What it does, for the user.
    state : "running", "done", "failed" or "cancelled"
    text : str
        The last step.
    share : float or None
        The finished part, from 0 to 1; None if unknown.
    value : object
        The result, if it is done.
    error : Exception or None
        The error, if it failed.
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
        self._thread = threading.Thread(target=self._run, name=title, daemon=True)
        self._thread.start()

    def step(self, text: str, done: float = 0, total: float = 0) -> None:
        """Report progress.

        Raises
        ------
        Cancelled
            If the job was cancelled.
        """
        self.check()
        self.text, self.share = text, min(done / total, 1.0) if total > 0 else None

    def check(self) -> None:
        """Raise `Cancelled` if the job was cancelled."""
        if self._stop.is_set():
            raise Cancelled

    def cancel(self) -> None:
        """End the job at its next step or check. Its result is not used, even if it is found before."""
        self._stop.set()
        self._end("cancelled")

    def join(self, seconds: float) -> bool:
        """Wait for the end, and return whether the job has ended."""
        return self._ended.wait(seconds)

    def result_for(self, other: Job) -> Any:
        """Return the result to another job that needs it.

        Raises
        ------
        Cancelled
            If either job is cancelled.
        """
        while not self.join(CHECK):
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
    """The jobs of one page. The last jobs of each kind are kept, and older ones are cancelled.

    Attributes
    ----------
    revision : int
        Increases whenever a job ends.
    """

    def __init__(self) -> None:
        self.revision = 0
        self._jobs: dict[str, OrderedDict[Hashable, Job]] = {}
        self._lock = threading.RLock()

    def ask(
        self, kind: str, key: Hashable, title: str, work: Callable[[Job], Any], *, kept: int = 2, alone: bool = True
    ) -> Job:
        """Return the job of a key; start it if there is none.

        Parameters
        ----------
        kind : str
            Jobs of one kind replace each other.
        key : hashable
            What decides the result.
        title : str
            What the job does, for the user.
        work : function of the job
            Returns the result.
        kept : int
            Number of jobs of this kind that are kept.
        alone : bool
            Whether a new job cancels the running ones of its kind.
        """
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
            job = of_kind[key] = Job(title, work, self._ended)
            return job

    def running(self) -> list[Job]:
        """Return the jobs that have not ended."""
        with self._lock:
            return [job for of_kind in self._jobs.values() for job in of_kind.values() if job.state == "running"]

    def cancel(self) -> None:
        """Cancel all running jobs."""
        for job in self.running():
            job.cancel()

    def again(self) -> None:
        """Forget the jobs that failed or were cancelled, so that the next `ask` starts them again."""
        with self._lock:
            for of_kind in self._jobs.values():
                for key in [key for key, job in of_kind.items() if job.state in ("failed", "cancelled")]:
                    del of_kind[key]
        self._ended()

    def _ended(self) -> None:
        with self._lock:
            self.revision += 1


def report_bug(error: Exception) -> None:
    """Print the traceback of an error that is not one of gmwm's messages."""
    traceback.print_exception(error, file=sys.stderr)
