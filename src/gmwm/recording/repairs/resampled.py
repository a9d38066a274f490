"""Recognise a log that a program resampled by straight lines from a slower one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector

_MOST, _FEWEST = 1 << 17, 4096
"""Largest and smallest number of samples that are used."""
_LINE, _PEAKS = 30.0, 4
"""Height of a line in the periodogram of the squares, relative to its mean nearby, which noise exceeds in fewer than
1 of 10⁸ periodograms; and number of lines that are examined."""
_BLOCK, _PHASES, _EXACT = 256, 32, 0.05
"""Length of the blocks to which straight lines are fitted, number of phases, and largest variance of the residual at
the best phase, relative to that at the median phase and to the noise (tests/recording/test_resampled.py)."""
_RATES = (0.05, 0.95)
"""Smallest and largest relative rate that is recognised."""


def slower_rate(values: Vector) -> float:
    """Return the rate of the slower log relative to the rate of this one; 0 if the values were not resampled.

    Straight lines between samples at the rate q < 1 make the variance of second differences periodic, with the
    frequency q. If so, straight lines with this rate and one phase describe the values without a residual.

    >>> x = np.random.default_rng(0).normal(size=10_000)
    >>> round(slower_rate(np.interp(np.arange(16_000) * 0.625, np.arange(10_000), x)), 4), slower_rate(x)
    (0.625, 0.0)
    """
    x = values[:_MOST]
    if x.size < _FEWEST:
        return 0.0
    squares = np.diff(x, 2) ** 2
    squares = np.minimum(squares, 20 * np.mean(squares))
    power = np.abs(np.fft.rfft(squares - np.mean(squares))) ** 2
    size = power.size // 64
    # The mean nearby without the line is the median over ln 2.
    nearby = np.repeat(np.median(power[: 64 * size].reshape(size, 64), axis=1), 64) / np.log(2)
    height = np.divide(power[: nearby.size], nearby, out=np.zeros(nearby.size), where=nearby > 0)
    height[:4] = 0.0
    lines = [k / squares.size for k in np.argsort(-height)[:_PEAKS].tolist() if height[k] > _LINE]
    shares = sorted(share for line in lines for share in (line, 1 - line) if _RATES[0] < share < _RATES[1])
    return next((share for share in shares if _is_straight(x, share)), 0.0)


def _is_straight(x: Vector, share: float) -> bool:
    """Return whether straight lines between samples at the rate `share` describe two blocks."""
    window = np.hanning(_BLOCK)
    for first in (0, x.size // 2):
        block = x[first : first + _BLOCK] - x[first]
        residuals = np.array([_residual(block, share, phase / _PHASES) for phase in range(_PHASES)])
        # A line does not change a quantile of the density, and the slower log has the lower part of the frequencies.
        density = np.abs(np.fft.rfft(block * window)) ** 2 / float(window @ window)
        noise = float(np.quantile(density, 0.8)) / np.log(5)
        if not np.min(residuals) < _EXACT * min(noise, float(np.median(residuals))):
            return False
    return True


def _residual(block: Vector, share: float, phase: float) -> float:
    """Return the variance that straight lines with corners at (k − phase) / share leave."""
    at = np.arange(block.size) * share + phase
    corner = at.astype(np.int64)
    lines: NDArray[np.float64] = np.zeros((block.size, int(corner[-1]) + 2))
    rows = np.arange(block.size)
    lines[rows, corner], lines[rows, corner + 1] = 1 - (at - corner), at - corner
    residual = block - lines @ np.linalg.lstsq(lines, block, rcond=None)[0]
    return float(residual @ residual / max(block.size - lines.shape[1], 1))
