"""Raise an error if Polars is used in a process that was forked after an earlier use of Polars. The threads of Polars
do not exist in the forked process, so a call would never return."""

from __future__ import annotations

import os
import re
import sys
from contextlib import suppress
from pathlib import Path

from gmwm.base.errors import ReadError

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
