"""Helper processes: they run functions that hold Python's global interpreter lock for most of their time.

The command line forks them from a single thread, which is safe and shares imports; a library starts new processes, as
it must not fork its user's. Without helpers, functions run in threads, with the same results."""

from __future__ import annotations

import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable
from concurrent import futures
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, TypeVar

from gmwm.base.threads import INTERRUPT_CHECK, processors

if TYPE_CHECKING:
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess

T = TypeVar("T")

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "POLARS_MAX_THREADS": "1"}
"""Variables of the environment with which the libraries use one thread in each process."""


@dataclass(frozen=True, eq=False)
class Helper:
    """A helper process, and the connection over which it gets functions with their arguments and returns results."""

    connection: Connection
    process: BaseProcess

    def begin(self, function: Callable[..., object], *args: Any) -> None:
        """Send a call. If the process has ended, `connection.recv` raises EOFError or OSError afterwards."""
        with suppress(OSError):
            self.connection.send((function, args))

    def end(self) -> None:
        """End the process at once."""
        self.process.kill()
        self.process.join()
        self.connection.close()


class Helpers:
    """Helper processes (`count`), which import `modules` while they have no work; without any, calls run here.

    >>> Helpers().run(max, 1, 2)
    2
    """

    def __init__(self, count: int = 0, modules: tuple[str, ...] = ()) -> None:
        self._idle: list[Helper] = []
        self._lock = Lock()
        with suppress(OSError):  # the system allows no further process
            for _ in range(count):
                self._idle.append(_start_helper("fork", modules))

    def run(self, function: Callable[..., T], *args: Any) -> T:
        """Call a function in an idle helper, or here, and raise its errors; all data can be pickled."""
        helper = self._take()
        if helper is None:
            return function(*args)
        helper.begin(function, *args)
        return self._receive(helper, function, *args)

    def begin(self, function: Callable[..., T], *args: Any) -> Callable[[], T]:
        """Begin a call in an idle helper, and return a function that returns the result, or makes the call."""
        helper = self._take()
        if helper is None:
            return cache(partial(function, *args))
        helper.begin(function, *args)  # now, because the caller may change the arguments from here on
        future: futures.Future[T] = futures.Future()

        def wait() -> None:
            try:
                future.set_result(self._receive(helper, function, *args))
            except BaseException as error:
                future.set_exception(error)

        Thread(target=wait, daemon=True).start()

        def result() -> T:
            while not future.done():
                futures.wait((future,), INTERRUPT_CHECK)  # see in_threads
            return future.result()

        return result

    def take_idle(self) -> list[Helper]:
        """Take all idle helpers away; calls are made in this process from here on."""
        with self._lock:
            idle, self._idle = self._idle, []
        return idle

    def _take(self) -> Helper | None:
        with self._lock:
            return self._idle.pop() if self._idle else None

    def _receive(self, helper: Helper, function: Callable[..., T], *args: Any) -> T:
        try:
            done, answer, warned = helper.connection.recv()
        except (EOFError, OSError):  # the system has ended the helper, for example because memory is short
            return function(*args)
        with self._lock:
            self._idle.append(helper)
        for message in warned:
            warnings.warn(message, stacklevel=2)
        if done:
            result: T = answer
            return result
        raise answer


def helpers(*modules: str, count: int | None = None) -> Helpers:
    """Fork helpers, one for each further processor, if the system can fork and this process has one thread."""
    alone = sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1
    # Largest number of helpers: with this process, one for each of six axes.
    number = min(processors() - 1, 5) if count is None else count
    return Helpers(number if alone else 0, modules)


def new_helper(*modules: str) -> Helper:
    """Start a helper with one thread; it imports the main script, which needs `if __name__ == "__main__":`."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        return _start_helper("spawn", modules)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def end_helpers() -> None:
    """End all helpers at once."""
    if "multiprocessing" in sys.modules:
        from multiprocessing import active_children

        for child in active_children():
            child.kill()


def spare_garbage_collector() -> None:
    """Collect garbage seldom: at 700 objects, it takes 7 % of the time of `gmwm calibrate`, and at 50 000 still 1 %."""
    gc.set_threshold(500_000, 20, 50)


def _start_helper(method: str, modules: tuple[str, ...]) -> Helper:
    from multiprocessing import get_context

    context: Any = get_context(method)
    ours, theirs = context.Pipe()
    # A forked process has a copy of our end, too, and would otherwise never see that it is closed.
    process = context.Process(target=_serve, args=(theirs, ours if method == "fork" else None, modules), daemon=True)
    process.start()
    theirs.close()
    return Helper(ours, process)


def _serve(connection: Connection, ours: Connection | None, modules: tuple[str, ...]) -> None:
    """Run calls until the other end of the connection is closed."""
    if ours is not None:
        ours.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the first process, which ends this one
    if hasattr(signal, "pthread_sigmask"):  # Polars sets its own handler while it reads; Windows has no masks
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    for name in ("SIGTERM", "SIGHUP"):
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_DFL)
    os.environ.update(ONE_THREAD)  # Polars reads it at its first use
    spare_garbage_collector()
    for module in modules:
        import_module(module)
    # A call that cannot be received, or a result that cannot be sent, ends the helper; the call is then made there.
    with suppress(Exception):
        while True:
            function, args = connection.recv()
            with warnings.catch_warnings(record=True) as warned:
                try:
                    done, answer = True, function(*args)
                except Exception as error:
                    done, answer = False, error
            connection.send((done, answer, [each.message for each in warned]))
