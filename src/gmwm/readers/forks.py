"""Raise an error if Polars is used in a process that was forked after an earlier use of Polars. The threads of Polars
do not exist in the forked process, so a call would never return."""

from __future__ import annotations

import os

from gmwm.errors import ReadError

_used = _lost = False


def _after_fork() -> None:
    global _lost
    _lost = _lost or _used


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def require_threads(path: object) -> None:
    """Require that Polars has its threads in this process, and note that it is used.

    Raises
    ------
    ReadError
        If the process was forked after Polars was used.
    """
    global _used
    _used = True
    if _lost:
        raise ReadError(
            f"{path} cannot be read in a process that was forked after a file was read: Polars, which reads text and "
            "Parquet, would never end",
            code="unsupported",
            advice="Start the processes with `multiprocessing.get_context('spawn')`, or read before the fork.",
        )
