"""The same work on several axes at once, with a progress bar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from gmwm._threads import in_threads
from gmwm.cli.output import progress
from gmwm.signals import Signal

T = TypeVar("T")


def over_axes(work: Callable[[Signal], T], signals: Mapping[str, Signal], what: str) -> dict[str, T]:
    """`work` done on every signal, by axis; an error names its axis."""
    with progress(what, len(signals)) as advance:
        return in_threads(
            lambda _, signal: work(signal), signals, done=lambda axis: advance(f"{what}: {axis}")
        )  # fmt: skip
