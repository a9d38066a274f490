"""The time base of a recording, lost samples in its gaps, and durations as text."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError

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
    """Return the number of samples lost in gaps of known length (`find_losses` in `files.clock` counts from stamps).

    `late` (s) is from the last sample's interval to the next sample, negative as is the result if the clock was set
    back.

    >>> lost_samples([0.02, -3.0], 100.0).tolist()
    [2, -300]
    """
    return np.rint(np.asarray(late, dtype=np.float64) * rate).astype(np.int64)


def gap_duration(lost: int, rate: float) -> float:
    """Return the time (s) from the sample before a gap to the sample after it, from the number of lost samples."""
    return (lost + 1) / rate


def lost_before(rate: float, segments: ArrayLike, starts: ArrayLike) -> NDArray[np.int64]:
    """Return the number of samples lost before each segment but the first; negative if the clock was set back."""
    times, ranges = np.asarray(starts, dtype=np.float64), np.asarray(segments)
    ends = times + (ranges[:, 1] - ranges[:, 0]) / rate
    return lost_samples(times[1:] - ends[:-1], rate)


def begins_of(rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> list[float]:
    """Return segments' starts (s) from the first sample, one interval after the previous one if the clock was set back.

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


_UNITS = {
    "ms": 1e-3, "s": 1.0, "sec": 1.0, "second": 1.0, "m": 60.0, "min": 60.0, "minute": 60.0,
    "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "d": 86400.0, "day": 86400.0,
    "y": 31557600.0, "yr": 31557600.0, "year": 31557600.0,  # Julian year of 365.25 days
}  # fmt: skip
_SECONDS = _UNITS | {f"{unit}s": seconds for unit, seconds in _UNITS.items() if len(unit) > 2 or unit == "hr"}
_NUMBER = r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?"
_TERM = re.compile(rf"\s*({_NUMBER})\s*([a-z]+)", re.IGNORECASE)
_PLAIN = re.compile(rf"\s*({_NUMBER})\s*(%?)\s*", re.IGNORECASE)


def parse_length(text: str, argument: str = "duration") -> float:
    """Parse a duration (s): a number with a unit, a sum of these, or a number of seconds. `argument` is for errors."""
    plain = _PLAIN.fullmatch(text)
    terms, remainder = _TERM.findall(f"{plain[1]}s" if plain and not plain[2] else text), _TERM.sub("", text)
    terms = [] if remainder.strip() and not plain else terms
    length = float(sum(float(number) * _SECONDS.get(unit.lower(), math.inf) for number, unit in terms))
    if not terms or not math.isfinite(length):
        raise OptionError(argument=argument, expected="a duration such as 90s, 30min, 1h30m, 2h or 1d", got=text)
    return length


def parse_share(text: str) -> float:
    """Parse a share, as a number or a percentage.

    >>> parse_share("0.1"), parse_share("10%"), parse_share("2.5 %")
    (0.1, 0.1, 0.025)
    """
    match = _PLAIN.fullmatch(text)
    if match is None:
        raise OptionError(argument="accuracy", expected="a share such as 0.1 or 10%", got=text)
    return float(match[1]) / (100.0 if match[2] else 1.0)
