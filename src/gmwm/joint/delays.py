"""Delays between signals that share noise."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gmwm._arrays import Vector
from gmwm.joint.pairs import Pairs, pairs_of
from gmwm.regression.least_squares import haar
from gmwm.signals import Signal

LARGEST = 3
"""Largest delay (samples) that is looked for."""
WINGS = 12
"""Lags (samples) up to which correlations are computed, to tell a delay from a line that two signals share with a
phase: away from a delay, the correlation of their broad noise is small."""
LEVELS = 2
"""Finest levels where it is looked for. At coarser ones, a delay hardly changes the correlation."""
MOST = 1 << 20
"""Samples that are used at most."""
SURELY = 5.0
"""How much larger the correlation with a delay must be than the one without, in standard errors of a correlation, as
all constants here pinned by tests/joint/test_cross.py."""
SMALL = 0.4
"""Largest share of the correlation at the delay that may remain far from it, or differ between both sides of it."""


def delays_of(signals: Mapping[str, Signal]) -> Pairs[int]:
    """Return the delay d (samples) of each pair (a, b) in which b lags behind a; pairs without a delay are left out.

    If two signals share noise, but one is delayed, the correlation at fine scales is small or negative, and larger
    between samples d apart.
    """
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
    """The delay from correlations at lags −WINGS … WINGS; 0 if there is none."""
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
    """Correlation of a at t with b at t + lag."""
    x, y = (a[: a.size - lag], b[lag:]) if lag >= 0 else (a[-lag:], b[: b.size + lag])
    power = float(x @ x) * float(y @ y)
    return float(x @ y) / np.sqrt(power) if power > 0 else 0.0
