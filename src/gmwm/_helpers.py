"""Helper processes of a command: they run functions that hold Python's global interpreter lock for most of their time.

They are forked from a process that has one thread, which is safe, and only by the command line: a library must not fork
the process of its user. Without helpers, the same functions run in threads, with the same results.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable
from concurrent import futures
from contextlib import suppress
from functools import cache, partial
from importlib import import_module
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any, TypeVar

from gmwm._threads import INTERRUPT_CHECK, processors

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

T = TypeVar("T")

MOST = 5
"""Largest number of helpers: with this process, one for each of six axes."""


class Helpers:
    """Helper processes; without any, all calls run in this process.

    Parameters
    ----------
    count : int
        Number of processes to fork.
    modules : tuple of str
        Modules that each helper imports while it has no work.

    Examples
    --------
    >>> Helpers().run(max, 1, 2)
    2
    """

    def __init__(self, count: int = 0, modules: tuple[str, ...] = ()) -> None:
        self._idle: list[Connection] = []
        self._lock = Lock()
        with suppress(OSError):  # the system allows no further process
            for _ in range(count):
                self._idle.append(_forked(modules))

    def run(self, function: Callable[..., T], *args: Any) -> T:
        """Call a function in a helper if one is idle, otherwise here; both must be able to pickle the function, the
        arguments and the result. Raises the errors of the function."""
        helper = self._taken()
        if helper is None:
            return function(*args)
        self._sent(helper, function, *args)
        return self._received(helper, function, *args)

    def begin(self, function: Callable[..., T], *args: Any) -> Callable[[], T]:
        """Begin a call in a helper if one is idle. Return a function that returns the result; without a helper, this
        function makes the call."""
        helper = self._taken()
        if helper is None:
            return cache(partial(function, *args))
        self._sent(helper, function, *args)  # now, because the caller may change the arguments from here on
        future: futures.Future[T] = futures.Future()

        def wait() -> None:
            try:
                future.set_result(self._received(helper, function, *args))
            except BaseException as error:
                future.set_exception(error)

        Thread(target=wait, daemon=True).start()

        def result() -> T:
            while not future.done():
                futures.wait((future,), INTERRUPT_CHECK)  # see in_threads
            return future.result()

        return result

    def _taken(self) -> Connection | None:
        with self._lock:
            return self._idle.pop() if self._idle else None

    def _sent(self, helper: Connection, function: Callable[..., T], *args: Any) -> None:
        with suppress(OSError):  # the helper has ended; `_received` notices it too
            helper.send((function, args))

    def _received(self, helper: Connection, function: Callable[..., T], *args: Any) -> T:
        try:
            done, found, warned = helper.recv()
        except (EOFError, OSError):  # the system has ended the helper, for example because memory is short
            return function(*args)
        with self._lock:
            self._idle.append(helper)
        for message in warned:
            warnings.warn(message, stacklevel=2)
        if done:
            result: T = found
            return result
        raise found


def helpers(*modules: str) -> Helpers:
    """Fork a helper for each further processor, if the system can fork and this process has one thread."""
    alone = sys.platform == "linux" and len(os.listdir("/proc/self/task")) == 1
    return Helpers(min(processors() - 1, MOST) if alone else 0, modules)


def end_helpers() -> None:
    """End all helpers at once."""
    if "multiprocessing" in sys.modules:
        from multiprocessing import active_children

        for child in active_children():
            child.kill()


def _forked(modules: tuple[str, ...]) -> Connection:
    from multiprocessing import get_context

    context = get_context("fork")
    ours, theirs = context.Pipe()
    context.Process(target=_serve, args=(theirs, ours, modules), daemon=True).start()
    theirs.close()
    return ours


def _serve(connection: Connection, ours: Connection, modules: tuple[str, ...]) -> None:
    """Run calls until the other end of the connection is closed."""
    ours.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the first process, which ends this one
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    for module in modules:
        import_module(module)
    # A call that cannot be received, or a result that cannot be sent, ends the helper; the call is then made there.
    with suppress(Exception):
        while True:
            function, args = connection.recv()
            with warnings.catch_warnings(record=True) as warned:
                try:
                    done, found = True, function(*args)
                except Exception as error:
                    done, found = False, error
            connection.send((done, found, [each.message for each in warned]))
