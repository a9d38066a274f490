"""Density at low frequencies, bandwidth and resonance of noise with a short correlation time, as in datasheets."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.theory.processes.parameter import Physical

WHITE_TIME_S = 1.0
"""Correlation time (s) below which noise is white at τ = 1 s, where IEEE Std 952 defines N."""
HALF_POWER = 0.5
"""Share of the power that defines the bandwidth and the width of a peak."""
RESONANCE_RATIO = 2.0
"""Smallest ratio of a maximum of the density to the density at low frequencies for which it is a resonance."""
_POINTS = 2048
DIFFERENCE_STEP = 1e-5
"""Relative step and relative error of one-sided differences (tests/processes/test_band_limit.py)."""

Density = Callable[[NDArray[np.float64]], Vector]
"""A power spectral density, as a function of frequencies (Hz)."""


def band_numbers(
    density: Density, rate: float, slopes: Mapping[str, float], *, free: Mapping[str, Density]
) -> tuple[Physical, ...]:
    """Return the datasheet numbers of a stationary process with a short correlation time from its two-sided `density`
    (u²/Hz). `slopes` are ∂ ln N / ∂ ln θ, and `free` the densities with each free shape parameter θ multiplied by 1 +
    `DIFFERENCE_STEP`."""
    values = _band(density, rate)
    moved = {name: _band(other, rate) for name, other in free.items()}
    numbers = [Physical("N", "white noise density", math.sqrt(_at_zero(density)), 0.5, slopes=slopes)]
    for symbol, title in _TITLES.items():
        if symbol not in values:
            continue
        value = values[symbol]
        changes = {
            name: math.log(other[symbol] / value) / DIFFERENCE_STEP for name, other in moved.items() if symbol in other
        }
        power = 0.0 if symbol == "Q_r" else -1.0
        numbers.append(Physical(symbol, title, value, power, signal_power=0, slopes=changes))
    return tuple(numbers)


_TITLES = {"f_b": "bandwidth at half the power", "f_r": "resonance frequency", "Q_r": "quality factor of the resonance"}


def _at_zero(density: Density) -> float:
    return float(density(np.zeros(1))[0])


def _band(density: Density, rate: float) -> dict[str, float]:
    """Return the bandwidth f_b (Hz), the resonance frequency f_r (Hz) and the quality factor Q_r, where they exist."""
    numbers = {}
    grid = np.linspace(0.0, 0.5 * rate, _POINTS)
    values, low = density(grid), _at_zero(density)
    last = int(np.flatnonzero(values >= HALF_POWER * low)[-1])
    if last < _POINTS - 1:
        # Above the bandwidth, the density stays below half of its value at low frequencies.
        numbers["f_b"] = _crossing(density, HALF_POWER * low, grid[last], grid[last + 1])
    centre = _peak(density, grid, values)
    top = float(density(np.array([centre]))[0])
    if top >= RESONANCE_RATIO * low and centre < 0.4999 * rate:
        numbers["f_r"] = centre
        quality = _quality(density, rate, centre, top)
        if quality is not None:
            numbers["Q_r"] = quality
    return numbers


def _peak(density: Density, grid: Vector, values: Vector) -> float:
    """Return the frequency (Hz) of the highest maximum of a density, by a parabola on a finer grid. A still finer grid
    would find rounding errors."""
    place = int(np.clip(np.argmax(values), 1, _POINTS - 2))
    fine = np.linspace(grid[place - 1], grid[place + 1], _POINTS)
    densities = density(fine)
    place = int(np.clip(np.argmax(densities), 1, _POINTS - 2))
    before, top, after = densities[place - 1 : place + 2]
    bend = before - 2 * top + after
    shift = np.clip((before - after) / (2 * bend), -1.0, 1.0) if bend < 0 else 0.0
    return float(fine[place] + shift * (fine[1] - fine[0]))


def _quality(density: Density, rate: float, centre: float, top: float) -> float | None:
    """Return the resonance frequency divided by the width of the peak at half its power; None if a side does not fall
    to half."""
    grid = np.linspace(0.0, 0.5 * rate, _POINTS * 4)
    below = grid[density(grid) < HALF_POWER * top]
    low, high = below[below < centre], below[below > centre]
    if not low.size or not high.size:
        return None
    low_end = _crossing(density, HALF_POWER * top, centre, low[-1])
    right = _crossing(density, HALF_POWER * top, centre, high[0])
    return centre / (right - low_end)


def _crossing(density: Density, level: float, inside: float, outside: float) -> float:
    """Return the frequency (Hz) between `inside`, where the density is above `level`, and `outside`, where it is
    below."""
    # Number of rounds in the search for a crossing. Each round divides the interval by 64, so the last interval is 2⁻⁵⁴
    # times as long as the first.
    for _ in range(9):
        grid = np.linspace(inside, outside, 64 + 1)
        first = int(np.argmax(np.append(density(grid[1:-1]) < level, True))) + 1
        inside, outside = grid[first - 1], grid[first]
    return float((inside + outside) / 2)
