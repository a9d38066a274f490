"""Threads, cancellation, locks and left memory. Threads suffice, as kernels release Python's global interpreter lock.

The threads of Polars do not exist in a forked process, where a call would hang, so an error is raised instead."""

from __future__ import annotations

import ctypes
import os
import re
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from contextvars import ContextVar, copy_context
from functools import lru_cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar, cast

from gmwm.base.errors import GmwmError, OptionError, ReadError

if TYPE_CHECKING:
    from typing_extensions import Self


T = TypeVar("T")
Item = TypeVar("Item")

INTERRUPT_CHECK = 0.1
"""Longest time (s) until Ctrl-C is noticed (tests/test_threads.py)."""

_check: ContextVar[Callable[[], None]] = ContextVar("_check", default=lambda: None)


@contextmanager
def stoppable(check: Callable[[], None]) -> Iterator[None]:
    """Call `check` often in this block and its threads; an exception ends the work, as `gmwm app` cancels fits."""
    token = _check.set(check)
    try:
        yield
    finally:
        _check.reset(token)


def check_stop() -> None:
    """Call the function passed to `stoppable`, in long loops at least every 0.1 s (tests/app/test_workspace.py)."""
    _check.get()()


def in_threads(
    work: Callable[[str, Item], T], items: Mapping[str, Item], *, threads: int | None = None,
    done: Callable[[str], None] | None = None, more: Callable[[str, T], Mapping[str, Item]] | None = None,
) -> dict[str, T]:  # fmt: skip
    """Call a function for each entry in parallel threads (one per processor by default), and `done` here after each.
    `more` returns further entries, for which the function is called too; the last result of a name counts.

    >>> in_threads(lambda name, number: number**2, {"two": 2, "three": 3})
    {'two': 4, 'three': 9}
    """
    pool = ThreadPoolExecutor(max(1, min(len(items), threads or processors())))
    futures: dict[Future[T], str] = {}

    def begin(new: Mapping[str, Item]) -> set[Future[T]]:
        begun = {pool.submit(copy_context().run, _call_by_name, work, name, item): name for name, item in new.items()}
        futures.update(begun)
        return set(begun)

    try:
        pending = begin(items)
        while pending:
            # After Polars has installed its handler of Ctrl-C, a wait without a timeout ignores Ctrl-C.
            ended, pending = wait(pending, timeout=INTERRUPT_CHECK, return_when=FIRST_COMPLETED)
            for future in ended:
                if done is not None:
                    done(futures[future])
                if more is not None:
                    pending |= begin(more(futures[future], future.result()))
        return {name: future.result() for future, name in futures.items()}
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def processors() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _call_by_name(work: Callable[[str, Item], T], name: str, item: Item) -> T:
    try:
        check_stop()
        return work(name, item)
    except OptionError:
        raise  # options are the same for all items
    except GmwmError as error:
        error.about(name)
        raise


def return_memory() -> None:
    """Return freed arrays below 32 MB that the GNU C library keeps: 160 MB for six axes of 6 million samples."""
    _call_allocator("malloc_trim", 0)


def share_memory() -> None:
    """Let the threads to come share two pools of freed arrays: of one pool for each thread, 70 MB are never used. Of
    arrays below 16 MB, the memory is used again, not returned: half as many page faults, 4 % of the CPU time."""
    for option, value in ((-8, 2), (-3, 1 << 24), (-1, 1 << 26)):  # M_ARENA_MAX, M_MMAP_THRESHOLD, M_TRIM_THRESHOLD
        _call_allocator("mallopt", option, value)


def _call_allocator(name: str, *numbers: int) -> None:
    """Call a function of the allocator of the GNU C library, if there is one."""
    with suppress(AttributeError, OSError, TypeError):
        getattr(ctypes.CDLL(None), name)(*numbers)


P = ParamSpec("P")
R = TypeVar("R")


class OneAtATime:
    """Base of classes with methods marked by `one_at_a_time`; each object has its own lock, which is not pickled."""

    _lock: threading.RLock

    def __new__(cls, *_args: Any, **_options: Any) -> Self:
        """Make an object with a lock, also when it is restored from a pickle."""
        instance = super().__new__(cls)
        instance._lock = threading.RLock()
        return instance

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_lock"}


S = TypeVar("S", bound=OneAtATime)


def one_at_a_time(method: Callable[Concatenate[S, P], R]) -> Callable[Concatenate[S, P], R]:
    """Decorate a method so that a call waits until the calls of other threads on the same object have ended."""

    @wraps(method)
    def call(self: S, /, *args: P.args, **options: P.kwargs) -> R:
        with self._lock:
            return method(self, *args, **options)

    return call


def computed_once(size: int) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a function to keep its last `size` results; threads that ask for the same one do not all compute it."""

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        lock, kept = threading.Lock(), cast(Callable[P, R], lru_cache(size)(function))

        @wraps(function)
        def call(*args: P.args, **options: P.kwargs) -> R:
            with lock:
                return kept(*args, **options)

        return call

    return decorate


_used = _lost = False


def _before_fork() -> None:
    global _used
    _used = _used or _pool_runs()


def _after_fork() -> None:
    global _lost
    _lost = _lost or _used


def _pool_runs() -> bool:
    """Return whether this process has a thread of the pool of Polars, started by other code; known on Linux only."""
    if "polars" in sys.modules:
        for task in Path("/proc/self/task").glob("*/comm"):
            with suppress(OSError):  # the thread has ended
                if re.match(r"polars-\d", task.read_text(errors="replace")):
                    return True
    return False


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=_before_fork, after_in_child=_after_fork)


def require_threads(path: object) -> None:
    """Require that Polars has its threads in this process, and note that it is used."""
    global _used
    _used = True
    if _lost:
        raise ReadError(
            f"{path} cannot be read or written in a process that was forked after Polars was used: Polars, which reads "
            "and writes text and Parquet, would never end",
            code="unsupported",
            advice="Start the processes with `multiprocessing.get_context('spawn')`, or use the file before the fork.",
        )
