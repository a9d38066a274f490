"""The same work on several axes at once: the kernels leave Python's lock, so that threads suffice."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import TypeVar

from gmwm.cli.output import progress
from gmwm.errors import GmwmError
from gmwm.signals import Signal

T = TypeVar("T")


def over_axes(work: Callable[[Signal], T], signals: Mapping[str, Signal], what: str) -> dict[str, T]:
    """`work` done on every signal, by axis, with a progress bar; an error names its axis."""
    pool = ThreadPoolExecutor(min(len(signals), os.cpu_count() or 1))
    try:
        with progress(what, len(signals)) as advance:
            futures = {pool.submit(_named, work, axis, signal): axis for axis, signal in signals.items()}
            for future in as_completed(futures):
                advance(f"{what}: {futures[future]}")
        # Of several errors the first axis' is raised, whichever thread was faster.
        return {axis: future.result() for future, axis in futures.items()}
    finally:
        # After Ctrl-C or an error nothing new is begun.
        pool.shutdown(wait=False, cancel_futures=True)


def _named(work: Callable[[Signal], T], axis: str, signal: Signal) -> T:
    try:
        return work(signal)
    except GmwmError as error:
        if axis in str(error):
            raise
        raise type(error)(f"{axis}: {error}") from None
