"""The same work on several things at once: the kernels leave Python's lock, so that threads suffice."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from typing import TypeVar

from gmwm.errors import GmwmError, OptionError

T = TypeVar("T")
Item = TypeVar("Item")

BREATH = 0.1
"""Seconds after which a wait looks up for Ctrl-C."""


def in_threads(
    work: Callable[[str, Item], T],
    items: Mapping[str, Item],
    *,
    threads: int | None = None,
    done: Callable[[str], None] | None = None,
) -> dict[str, T]:
    """`work` done on every name and item, by name in their order; as many at once as there are processors.

    An error names what it is about; of several that of the first item is raised, whichever thread was faster. After
    Ctrl-C nothing new is begun. `done` is called with each name as its work ends, in the calling thread.

    >>> in_threads(lambda name, number: number**2, {"two": 2, "three": 3})
    {'two': 4, 'three': 9}
    """
    pool = ThreadPoolExecutor(max(1, min(len(items), threads or processors())))
    try:
        futures = {pool.submit(_named, work, name, item): name for name, item in items.items()}
        pending = set(futures)
        while pending:
            # Polars has its own handler of Ctrl-C, after which a wait without an end goes on until something ends.
            ended, pending = wait(pending, timeout=BREATH, return_when=FIRST_COMPLETED)
            if done is not None:
                for future in ended:
                    done(futures[future])
        return {name: future.result() for future, name in futures.items()}
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def processors() -> int:
    """How many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _named(work: Callable[[str, Item], T], name: str, item: Item) -> T:
    try:
        return work(name, item)
    except OptionError:
        raise  # an option is that of all items
    except GmwmError as error:
        if name in str(error):
            raise
        raise type(error)(f"{name}: {error}") from None
