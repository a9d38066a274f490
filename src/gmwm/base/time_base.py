"""Times of the samples of a recording, and properties of its time stamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Vector

__all__ = ["TimeBase", "begins_of", "gap_duration", "lost_before", "lost_samples", "times_of"]


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


def lost_samples(late: ArrayLike, rate: float) -> NDArray[np.int64]:
    """Return the number of samples lost in gaps. All parts of gmwm count them with this function.

    Parameters
    ----------
    late : array of float
        For each gap, the time (s) from the end of the last sample's interval to the sample after the gap. It is
        negative if the clock was set back; then no sample is lost, and the result is negative too.
    rate : float
        Samples per second (Hz).

    >>> lost_samples([0.02, -3.0], 100.0).tolist()
    [2, -300]
    """
    return np.rint(np.asarray(late, dtype=np.float64) * rate).astype(np.int64)


def gap_duration(lost: int, rate: float) -> float:
    """Return the time (s) from the sample before a gap to the sample after it, from the number of lost samples."""
    return (lost + 1) / rate


def lost_before(rate: float, segments: ArrayLike, starts: ArrayLike) -> NDArray[np.int64]:
    """Return the number of samples lost before each segment but the first; negative if the clock was set back.

    >>> lost_before(10.0, [(0, 30), (30, 70), (70, 80)], [1000.0, 1005.0, 2.0]).tolist()
    [20, -10070]
    """
    times, ranges = np.asarray(starts, dtype=np.float64), np.asarray(segments)
    ends = times + (ranges[:, 1] - ranges[:, 0]) / rate
    return lost_samples(times[1:] - ends[:-1], rate)


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
