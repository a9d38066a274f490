"""Warm-up: a level that settles in the beginning of a recording, as it does nowhere later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Vector
from gmwm.inspection.knocks import level_length
from gmwm.inspection.time_grid import Extent

_PARTS = (32, 16, 8)  # of the recording, whose beginnings are compared with what follows
_FEWEST = 6  # blocks in such a part: fewer show no shape
_RATIO = 6.0  # times what the same part shows elsewhere (root mean square)
_STEP = 3  # blocks before a step: one that is earlier is cut off as a warm-up is
_REST = 0.02  # of the change, which may be left
_TIMES = 40  # time constants that are tried


@dataclass(frozen=True, kw_only=True)
class WarmUp:
    """The level of an axis that settles.

    Parameters
    ----------
    axis : str
        The axis that shows it.
    size : float
        Level at the first sample less that at which it settles, in the axis' unit.
    duration : float
        Time (s) after which what is left is within what the level wanders by in any case, or below 2 % of the size.
    times : float
        How far the beginning differs from what follows, in root mean squares of the same over all that follows.
    """

    axis: str
    size: float
    duration: float
    times: float


def warm_up_of(axis: str, levels: Sequence[tuple[int, Vector]], extent: Extent, resolution: float) -> WarmUp | None:
    """The warm-up that an axis shows, or None.

    The medians m_i of some 256 blocks show the level and no knock. A sum Σ w_i m_{k+i} over a part of the recording,
    with w_i = exp(−3i/s) less its mean, s = 1/32, 1/16 and 1/8 of all blocks, is blind to the level and large where it
    settles. Of noise with stationary increments, a random walk or a Gauss-Markov process say, on a ramp or none, the
    first such sum is one like all others: their spread is found from the record itself, and no model is assumed. A
    warm-up is a first sum that is 6 root mean squares of all later ones, which share no block with it, from their
    median. Size and time constant are those of the exponential, on a level, that is nearest in the beginning; where a
    step after the first three blocks is nearer, it is no warm-up. Of 11 200 simulated axes of eight models, from 7000
    to 100 000 samples, one had one.

    Parameters
    ----------
    axis : str
    levels : sequence of (first, (m,) array)
        Of each segment of five blocks or more, its first sample and the medians m_i.
    extent : Extent
        Of the recording.
    resolution : float
        Quantisation step: half of it is the least that a level is taken to change by.
    """
    length = level_length(extent.samples)
    m = _beginning(levels, extent, length)
    best: tuple[float, int] | None = None
    for parts in _PARTS:
        s = m.size // parts
        if s < _FEWEST:
            continue
        w = np.exp(-3 * np.arange(s) / s)
        w -= np.mean(w)
        sums = np.correlate(m, w, "valid")
        later = sums[s:]
        usual = float(np.median(later))
        spread = max(float(np.sqrt(np.mean((later - usual) ** 2))), 0.5 * resolution * float(np.linalg.norm(w)))
        away = abs(float(sums[0]) - usual)
        if away > _RATIO * spread and (best is None or away / spread > best[0]):
            best = (away / spread if spread else math.inf, s)
    if best is None:
        return None
    part = m[: 2 * best[1]]
    size, time, rest = _exponential(part)
    if rest >= _beside_a_step(part):
        return None
    lasts = time * max(math.log(abs(size) / max(rest, _REST * abs(size))), 1.0) if size else time
    return WarmUp(axis=axis, size=size, duration=lasts * length / extent.rate, times=best[0])


def _beginning(levels: Sequence[tuple[int, Vector]], extent: Extent, length: int) -> Vector:
    """The levels from the first sample on, to the first gap that is longer than a block."""
    taken: list[Vector] = []
    ends = 0.0
    by_first = {first: (last, start) for (first, last), start in zip(extent.segments, extent.starts, strict=True)}
    for first, level in levels:
        last, start = by_first[first]
        if (first != 0) if not taken else (start - ends > length / extent.rate):
            break
        taken.append(level)
        ends = start + (last - first) / extent.rate
    return np.concatenate(taken) if taken else np.empty(0)


def _exponential(m: Vector) -> tuple[float, float, float]:
    """Size at the first sample, time constant in blocks, and standard deviation beside it, of a e^{−t/T} + c."""
    t = np.arange(m.size) + 0.5
    best = (math.inf, 0.0, 1.0)
    for time in np.geomspace(0.5, m.size / 2, _TIMES):
        shape = np.exp(-t / time)
        flat = shape - np.mean(shape)
        size = float(flat @ m) / float(flat @ flat)
        left = float(np.sum((m - np.mean(m) - size * flat) ** 2))
        if left < best[0]:
            best = (left, size, float(time))
    return best[1], best[2], math.sqrt(best[0] / m.size)


def _beside_a_step(m: Vector) -> float:
    """Standard deviation beside the nearest step, which may be within a block."""
    least = min(
        float(np.sum((m[:k] - np.mean(m[:k])) ** 2) + np.sum((m[k + 1 :] - np.mean(m[k + 1 :])) ** 2))
        for k in range(_STEP, m.size - 1)
    )
    return math.sqrt(least / m.size)
