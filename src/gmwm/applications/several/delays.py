"""Find delays between signals that share noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gmwm.applications.several.pairs import Pairs, pairs_of
from gmwm.base.arrays import Vector
from gmwm.measuring.regression.least_squares import haar
from gmwm.recording.signals import Signal

LARGEST = 3
"""Largest delay (samples) that can be found."""
WINGS = 12
"""Largest lag (samples) at which correlations are computed. The correlation of delayed broadband noise is small at all
other lags; the correlation of a sinusoid that two signals share with a phase shift is not."""
LEVELS = 2
"""Number of finest levels in which a delay is searched. At coarser levels, a delay hardly changes the correlation."""
MOST = 1 << 20
"""Largest number of samples that are used."""
SURELY = 5.0
"""Smallest difference between the correlation with a delay and the correlation without it, in standard errors of a
correlation. tests/joint/test_cross.py pins all constants of this module."""
SMALL = 0.4
"""Limit for the correlation at lags far from the delay, and for the difference between the lags on both sides of it, as
a share of the correlation at the delay."""


def delays_of(signals: Mapping[str, Signal]) -> Pairs[int]:
    """Return the delay d (samples) of each pair (a, b) in which b lags behind a; pairs without a delay are left out.

    If one of two signals with shared noise is delayed, their correlation at fine scales is small or negative, and the
    correlation between samples that are d apart is larger."""
    longest = max(next(iter(signals.values())).segments, key=lambda ends: ends[1] - ends[0])
    first, last = longest[0], min(longest[1], longest[0] + MOST)
    found: dict[tuple[str, str], int] = {}
    for level in range(1, LEVELS + 1):
        count = last - first - (1 << level)
        if count < 64 * WINGS:
            break
        values = {name: signal.values[first:last] for name, signal in signals.items()}
        w = {name: haar(x - x.mean(), level) for name, x in values.items()}
        for pair in pairs_of(list(signals)):
            delay = _delay(
                np.array([_correlation(w[pair[0]], w[pair[1]], lag) for lag in range(-WINGS, WINGS + 1)]), count
            )
            if delay:
                found.setdefault(pair, delay)
    return Pairs(found)


def _delay(correlation: Vector, count: int) -> int:
    """Return the delay that correlations at the lags −WINGS … WINGS show, or 0 if they show none."""
    size = np.abs(correlation)
    near = size[WINGS - LARGEST : WINGS + LARGEST + 1]
    delay = int(np.argmax(near)) - LARGEST
    peak = WINGS + delay
    if size[peak] - size[WINGS] <= SURELY / np.sqrt(count):
        return 0
    beside = np.arange(1, LARGEST + 1)
    uneven = np.abs(correlation[peak + beside] - correlation[peak - beside]).max()
    far = np.concatenate([size[: peak - LARGEST - 2], size[peak + LARGEST + 3 :]]).max()
    return delay if max(uneven, far) <= SMALL * size[peak] else 0


def _correlation(a: Vector, b: Vector, lag: int) -> float:
    """Return the correlation between a at sample t and b at sample t + lag."""
    x, y = (a[: a.size - lag], b[lag:]) if lag >= 0 else (a[-lag:], b[: b.size + lag])
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / np.sqrt(power) if power > 0 else 0.0
