"""Process several axes in parallel, with a progress bar."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeVar

from gmwm.base.threads import in_threads
from gmwm.cli.output import progress
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal

T = TypeVar("T")
Item = TypeVar("Item", bound=Signal | WaveletVariance)


def over_axes(work: Callable[[Item], T], signals: Mapping[str, Item], what: str) -> dict[str, T]:
    """Call a function with the signal or wavelet variance of each axis, in parallel threads. If a call raises an error,
    the message names the axis. `what` is the label of the progress bar."""
    with progress(what, len(signals)) as advance:
        return in_threads(
            lambda _, signal: work(signal), signals, done=lambda axis: advance(f"{what}: {axis}")
        )  # fmt: skip
