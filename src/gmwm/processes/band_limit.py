"""What a datasheet says of noise with a short memory: its density at low frequencies, its bandwidth, its resonance."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.processes.physical import Physical

SHORT = 1.0
"""Correlation time (s) below which the density at low frequencies is N: the standard defines N at τ = 1 s."""
HALF = 0.5
PEAK = 2.0
"""Ratio of the highest density to that at low frequencies from which a maximum counts as a resonance."""
_POINTS = 2048
_BISECTIONS = 50
STEP = 1e-5
"""Relative step of one-sided differences, and the order of their error (tests/processes/test_band_limit.py)."""

Density = Callable[[NDArray[np.float64]], Vector]
"""A power spectral density, as a function of frequencies (Hz)."""


def band_numbers(
    density: Density, rate: float, slopes: Mapping[str, float], *, free: Mapping[str, Density]
) -> tuple[Physical, ...]:
    """The numbers of a stationary process with a short memory.

    Parameters
    ----------
    density : function of frequencies (Hz)
        Two-sided power spectral density (u²/Hz).
    rate : float
        Sampling rate (Hz).
    slopes : mapping of parameter name to float
        ∂ ln N / ∂ ln θ.
    free : mapping of parameter name to function
        The density with one shape parameter θ larger by a factor of 1 + 1e-5.
    """
    level = float(density(np.zeros(1))[0])
    numbers = [Physical("N", "white noise density", math.sqrt(level), 0.5, slopes=slopes)]
    for symbol, title, of in (
        ("f_b", "bandwidth at half the power", _bandwidth),
        ("f_r", "resonance frequency", _resonance),
        ("Q_r", "quality factor of the resonance", _quality),
    ):
        value = of(density, rate)
        if value is None:
            continue
        moved = {name: of(other, rate) for name, other in free.items()}
        changes = {name: math.log(at / value) / STEP for name, at in moved.items() if at is not None and at > 0}
        power = 0.0 if symbol == "Q_r" else -1.0
        numbers.append(Physical(symbol, title, value, power, signal_power=0, slopes=changes))
    return tuple(numbers)


def _bandwidth(density: Density, rate: float) -> float | None:
    """The frequency above which the density stays below half of that at low frequencies; None up to half the rate."""
    half = HALF * float(density(np.zeros(1))[0])
    grid = np.linspace(0.0, 0.5 * rate, _POINTS)
    above = np.flatnonzero(density(grid) >= half)
    if above[-1] == _POINTS - 1:
        return None
    return _crossing(density, half, grid[above[-1]], grid[above[-1] + 1])


def _peak(density: Density, rate: float) -> tuple[float, float] | None:
    """Frequency and density of the highest maximum, if it is a resonance."""
    low, high = 0.0, 0.5 * rate
    for _ in range(4):
        grid = np.linspace(low, high, _POINTS)
        values = density(grid)
        place = int(np.argmax(values))
        low, high = grid[max(place - 1, 0)], grid[min(place + 1, _POINTS - 1)]
    top = float(values[place])
    return (float(grid[place]), top) if top >= PEAK * float(density(np.zeros(1))[0]) else None


def _resonance(density: Density, rate: float) -> float | None:
    found = _peak(density, rate)
    return None if found is None or found[0] >= 0.4999 * rate else found[0]


def _quality(density: Density, rate: float) -> float | None:
    """Frequency over width at half the power of the highest maximum."""
    found = _peak(density, rate)
    if found is None or _resonance(density, rate) is None:
        return None
    centre, top = found
    grid = np.linspace(0.0, 0.5 * rate, _POINTS * 4)
    low = grid[(density(grid) < HALF * top) & (grid < centre)]
    high = grid[(density(grid) < HALF * top) & (grid > centre)]
    if not low.size or not high.size:
        return None
    left = _crossing(density, HALF * top, centre, low[-1])
    right = _crossing(density, HALF * top, centre, high[0])
    return centre / (right - left)


def _crossing(density: Density, level: float, inside: float, outside: float) -> float:
    """The frequency between two, of which the first has a density above a level, where the density equals it."""
    for _ in range(_BISECTIONS):
        middle = (inside + outside) / 2
        inside, outside = (middle, outside) if density(np.array([middle]))[0] >= level else (inside, middle)
    return float((inside + outside) / 2)
