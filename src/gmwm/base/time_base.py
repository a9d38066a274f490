"""Times of the samples of a recording, and properties of its time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector

__all__ = ["TimeBase", "begins_of", "times_of"]


@dataclass(frozen=True)
class TimeBase:
    """Sampling of a recording, from its time stamps.

    Parameters
    ----------
    rate : float
        Samples per second (Hz): the declared rate if there is one, otherwise 1 / mean sampling interval.
    stamped : bool
        Whether the recording has time stamps.
    start : float
        First time stamp (s).
    jitter : float
        Root mean square deviation of the intervals within segments from the sampling interval (s).
    gaps : tuple of (index, duration)
        For each gap, the index of the first sample after it and the time from the sample before it (s),
        a whole number of sampling intervals.
    duplicates : int
        Number of time stamps that are equal to the previous one.
    backward : int
        Number of time stamps that are earlier than the previous one.
    lost : int
        Number of rows without a usable sample: a value is missing or infinite, or the line could not be read. Each of
        these rows is a gap.
    left : float
        Time (s) from the start of the recording to the first kept sample. The times `start`, `stop` and `skip` of
        `read` count from the start of the recording.
    """

    rate: float
    stamped: bool = False
    start: float = 0.0
    jitter: float = 0.0
    gaps: tuple[tuple[int, float], ...] = ()
    duplicates: int = 0
    backward: int = 0
    lost: int = 0
    left: float = 0.0


def times_of(indices: ArrayLike, rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> Vector:
    """Return the times (s) of the samples with these indices, from the segments and their start times (s)."""
    index, firsts = np.asarray(indices, dtype=np.int64), np.array([first for first, _ in segments])
    segment = np.searchsorted(firsts, index, side="right") - 1
    return np.asarray(np.array(starts)[segment] + (index - firsts[segment]) / rate)


def begins_of(rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> list[float]:
    """Return the start time of each segment in seconds from the first sample, never before the end of the previous one.

    If the clock was set back, the segment starts one interval after the last sample before it.

    >>> begins_of(10.0, [(0, 30), (30, 70), (70, 80)], [1000.0, 1005.0, 2.0])
    [0.0, 5.0, 9.0]
    """
    begins: list[float] = []
    ahead, end = 0.0, 0.0
    for (first, last), time in zip(segments, starts, strict=True):
        begin = time - starts[0] + ahead
        if begin < end:
            ahead, begin = ahead + end - begin, end
        begins.append(begin)
        end = begin + (last - first) / rate
    return begins
