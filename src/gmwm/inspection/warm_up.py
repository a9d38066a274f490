"""Warm-up: a mean that settles at the beginning of a recording and changes much less later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Vector
from gmwm.inspection.knocks import level_length
from gmwm.inspection.time_grid import Extent

# The values are those of the simulations that `warm_up_of` describes; tests/test_inspection_settling.py pins them.
_PARTS = (32, 16, 8)
"""The first 1/32, 1/16 and 1/8 of the recording are compared with the rest."""
_FEWEST = 6
"""Fewest blocks of such a part."""
_RATIO = 6.0
"""Contrast of a warm-up, as a multiple of the root mean square of the same contrast later in the recording."""
_STEP = 3
"""First block in which a jump is distinguished from a warm-up; an earlier jump is cut off like a warm-up."""
_REST = 0.02
"""Share of the change that may remain after the warm-up."""
_TIMES = 40
"""Number of time constants on the grid; the duration is then accurate to 10 %."""


@dataclass(frozen=True, kw_only=True)
class WarmUp:
    """A warm-up of an axis.

    Parameters
    ----------
    axis : str
        The axis.
    size : float
        Mean at the first sample minus the mean after the warm-up, in the unit of the axis.
    duration : float
        Time (s) after which the remaining change is smaller than the usual changes of the mean, or below 2 % of `size`.
    times : float
        Contrast of the beginning over the root mean square of the same contrast in the rest of the recording.
    """

    axis: str
    size: float
    duration: float
    times: float


def warm_up_of(axis: str, levels: Sequence[tuple[int, Vector]], extent: Extent, resolution: float) -> WarmUp | None:
    """Find the warm-up of an axis; None if there is none.

    The medians m_i of about 256 blocks follow the mean and are not affected by knocks. The contrast Σ w_i m_{k+i} over
    s blocks, with w_i = exp(−3i/s) minus its mean, does not depend on the mean and is large where the mean settles; s
    is 1/32, 1/16 and 1/8 of all blocks. For noise with stationary increments, with or without a ramp, the first
    contrast has the same distribution as all others. Their standard deviation is estimated from the recording itself,
    without a model. A warm-up is a first contrast that differs from the median of all later ones, which share no block
    with it, by more than 6 of their root mean squares. Size and time constant are those of the exponential plus
    constant that is nearest to the beginning in least squares. If a jump after the first three blocks is nearer, there
    is no warm-up. One warm-up was found in 11 200 simulated axes of eight models with 7000 to 100 000 samples;
    tests/test_inspection_settling.py repeats a part of them.

    Parameters
    ----------
    axis : str
        Name of the axis.
    levels : sequence of (first, (m,) array)
        First sample and medians m_i of each segment with at least five blocks.
    extent : Extent
        Segments and times of the recording.
    resolution : float
        Quantization step; half of it is the smallest standard deviation that is used.
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
    """Medians from the first sample to the first gap that is longer than a block."""
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
    """Fit a e^{−t/T} + c in least squares: a, T in blocks, and the standard deviation of the residuals."""
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
    """Standard deviation of the residuals of the nearest jump, which may lie within a block."""
    least = min(
        float(np.sum((m[:k] - np.mean(m[:k])) ** 2) + np.sum((m[k + 1 :] - np.mean(m[k + 1 :])) ** 2))
        for k in range(_STEP, m.size - 1)
    )
    return math.sqrt(least / m.size)
