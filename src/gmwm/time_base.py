"""The clock of a recording: when its samples were taken, and what its time stamps say about its sampling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector

__all__ = ["TimeBase", "begins_of", "times_of"]


@dataclass(frozen=True)
class TimeBase:
    """What the time stamps of a recording say about its sampling.

    Parameters
    ----------
    rate : float
        1 / median interval (Hz); 1 / mean interval between gaps where rounded stamps make the median drift
        away from them; the declared rate where there is one.
    stamped : bool
        Whether the recording has time stamps at all.
    start : float
        First stamp (s).
    jitter : float
        Root mean square deviation of the intervals within segments from their median (s).
    gaps : tuple of (index, duration)
        For each gap, the index of the first sample after it and the time from the sample before (s).
    duplicates : int
        Number of stamps equal to the one before.
    backward : int
        Number of stamps earlier than the one before.
    left : float
        Time (s) of the recording before its first sample here, where a beginning was cut off: the first sample was
        taken so long after that of the whole recording, from which `start`, `stop` and `skip` of `read` count.
    """

    rate: float
    stamped: bool = False
    start: float = 0.0
    jitter: float = 0.0
    gaps: tuple[tuple[int, float], ...] = ()
    duplicates: int = 0
    backward: int = 0
    left: float = 0.0


def times_of(indices: ArrayLike, rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> Vector:
    """When the samples with these indices were taken (s), by the segments they lie in and when those begin (s)."""
    index, firsts = np.asarray(indices, dtype=np.int64), np.array([first for first, _ in segments])
    segment = np.searchsorted(firsts, index, side="right") - 1
    return np.asarray(np.array(starts)[segment] + (index - firsts[segment]) / rate)


def begins_of(rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> list[float]:
    """When each segment begins, in seconds from the first sample; never before the one before it has ended.

    Where the clock was set back, it is as if one sample had followed the other.

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
