"""Find delays between signals that share noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gmwm.applications.several.matrices import AxisPairs, pairs_of
from gmwm.base.arrays import Vector
from gmwm.measuring.regression.least_squares import haar
from gmwm.recording.signals import Signal

LARGEST_DELAY_SAMPLES = 3
"""Largest delay (samples) that can be found."""
LARGEST_LAG_SAMPLES = 12
"""Largest lag (samples) of the correlations. A sinusoid is correlated at all lags, delayed broadband noise is not."""
GAIN_IN_ERRORS = 5.0
"""Smallest gain of correlation by a delay, in standard errors. tests/joint/test_cross.py pins this module."""


def delays_of(signals: Mapping[str, Signal]) -> AxisPairs[int]:
    """Return the delay d (samples) of each pair (a, b) in which b lags behind a; pairs without a delay are left out. If
    one of two signals with shared noise is delayed, their correlation at fine scales is small or negative, and the
    correlation between samples that are d apart is larger."""
    longest = max(next(iter(signals.values())).segments, key=lambda ends: ends[1] - ends[0])
    first, last = longest[0], min(longest[1], longest[0] + (1 << 20))
    delays: dict[tuple[str, str], int] = {}
    for level in (1, 2):  # a delay hardly changes the correlation at coarser levels
        count = last - first - (1 << level)
        if count < 64 * LARGEST_LAG_SAMPLES:
            break
        values = {name: signal.values[first:last] for name, signal in signals.items()}
        w = {name: haar(x - x.mean(), level) for name, x in values.items()}
        for pair in pairs_of(list(signals)):
            delay = _delay(
                np.array(
                    [
                        _correlation(w[pair[0]], w[pair[1]], lag)
                        for lag in range(-LARGEST_LAG_SAMPLES, LARGEST_LAG_SAMPLES + 1)
                    ]
                ),
                count,
            )
            if delay:
                delays.setdefault(pair, delay)
    return AxisPairs(delays)


def _delay(correlation: Vector, count: int) -> int:
    """Return the delay that correlations at the lags −WINGS … WINGS show, or 0 if they show none."""
    size = np.abs(correlation)
    near = size[LARGEST_LAG_SAMPLES - LARGEST_DELAY_SAMPLES : LARGEST_LAG_SAMPLES + LARGEST_DELAY_SAMPLES + 1]
    delay = int(np.argmax(near)) - LARGEST_DELAY_SAMPLES
    peak = LARGEST_LAG_SAMPLES + delay
    if size[peak] - size[LARGEST_LAG_SAMPLES] <= GAIN_IN_ERRORS / np.sqrt(count):
        return 0
    offsets = np.arange(1, LARGEST_DELAY_SAMPLES + 1)
    uneven = np.abs(correlation[peak + offsets] - correlation[peak - offsets]).max()
    far = np.concatenate([size[: peak - LARGEST_DELAY_SAMPLES - 2], size[peak + LARGEST_DELAY_SAMPLES + 3 :]]).max()
    # Far from the delay, and in its asymmetry around it, the correlation is at most 0.4 of that at the delay.
    return delay if max(uneven, far) <= 0.4 * size[peak] else 0


def _correlation(a: Vector, b: Vector, lag: int) -> float:
    """Return the correlation between a at sample t and b at sample t + lag."""
    x, y = (a[: a.size - lag], b[lag:]) if lag >= 0 else (a[-lag:], b[: b.size + lag])
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / np.sqrt(power) if power > 0 else 0.0
