"""Stationarity, coordinates, roots and squared modulus of polynomials 1 − a₁z − … − a_n z^n, one per row."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes.parameter import Physical

WHITE_TIME_S = 1.0  # correlation time (s) below which noise is white at τ = 1 s, where IEEE Std 952 defines N
RESONANCE_RATIO = 2.0
"""Smallest ratio of a maximum of the density to the density at low frequencies for which it is a resonance."""
_POINTS = 2048
DIFFERENCE_STEP = 1e-5
"""Relative step and relative error of one-sided differences (tests/processes/test_band_limit.py)."""

Density = Callable[[NDArray[np.float64]], Vector]  # a power spectral density, as a function of frequencies (Hz)


def band_numbers(
    density: Density, rate: float, slopes: Mapping[str, float], *, free: Mapping[str, Density]
) -> tuple[Physical, ...]:
    """Return datasheet numbers of a short-memory process from its two-sided `density` (u²/Hz): `slopes` are ∂ ln N / ∂
    ln θ, `free` densities with θ times 1 + `DIFFERENCE_STEP`."""
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
    last = int(np.flatnonzero(values >= 0.5 * low)[-1])
    if last < _POINTS - 1:
        # Above the bandwidth, the density stays below half of its value at low frequencies.
        numbers["f_b"] = _crossing(density, 0.5 * low, grid[last], grid[last + 1])
    centre = _peak(density, grid, values)
    top = float(density(np.array([centre]))[0])
    if top >= RESONANCE_RATIO * low and centre < 0.4999 * rate:
        numbers["f_r"] = centre
        quality = _quality(density, rate, centre, top)
        if quality is not None:
            numbers["Q_r"] = quality
    return numbers


def _peak(density: Density, grid: Vector, values: Vector) -> float:
    """Return the frequency (Hz) of the highest maximum, by a parabola; finer grids would find rounding errors."""
    place = int(np.clip(np.argmax(values), 1, _POINTS - 2))
    fine = np.linspace(grid[place - 1], grid[place + 1], _POINTS)
    densities = density(fine)
    place = int(np.clip(np.argmax(densities), 1, _POINTS - 2))
    before, top, after = densities[place - 1 : place + 2]
    bend = before - 2 * top + after
    shift = np.clip((before - after) / (2 * bend), -1.0, 1.0) if bend < 0 else 0.0
    return float(fine[place] + shift * (fine[1] - fine[0]))


def _quality(density: Density, rate: float, centre: float, top: float) -> float | None:
    """Return the resonance over the width at half power; None if a side does not fall to half."""
    grid = np.linspace(0.0, 0.5 * rate, _POINTS * 4)
    below = grid[density(grid) < 0.5 * top]
    low, high = below[below < centre], below[below > centre]
    if not low.size or not high.size:
        return None
    low_end = _crossing(density, 0.5 * top, centre, low[-1])
    right = _crossing(density, 0.5 * top, centre, high[0])
    return centre / (right - low_end)


def _crossing(density: Density, level: float, inside: float, outside: float) -> float:
    """Return the frequency (Hz) between `inside`, with density above `level`, and `outside`, below it."""
    # Nine rounds of 64 parts make the last interval 2⁻⁵⁴ of the first.
    for _ in range(9):
        grid = np.linspace(inside, outside, 64 + 1)
        first = int(np.argmax(np.append(density(grid[1:-1]) < level, True))) + 1
        inside, outside = grid[first - 1], grid[first]
    return float((inside + outside) / 2)


def coordinates(rows: Matrix) -> Matrix:
    """Compute artanh of partial autocorrelations (rows, n), backward Durbin-Levinson; NaN for a zero with |z| ≤ 1.

    >>> coordinates(np.array([[0.5], [1.0]])).round(4).tolist()
    [[0.5493], [nan]]
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    out = np.empty(rows.shape)
    _core.arma_coordinates(rows, out)
    return out


def at_coordinates(z: NDArray[Any]) -> NDArray[Any]:
    """Compute the coefficients a (rows, n) from `coordinates` z. The function is analytic, so z can be complex."""
    partial = np.tanh(z)
    rows = np.empty_like(partial)
    for n in range(partial.shape[1]):
        k = partial[:, n : n + 1]
        rows[:, :n] = rows[:, :n] - k * rows[:, :n][:, ::-1]
        rows[:, n] = partial[:, n]
    return np.asarray(rows)


def roots(a: Vector) -> NDArray[np.complex128]:
    """Compute the n roots λ of λ^n = a₁λ^(n−1) + … + a_n. All |λ| < 1 if the autoregression is stationary."""
    return np.asarray(np.roots(np.concatenate(([1.0], -np.asarray(a)))), dtype=np.complex128)


def clearance(rows: Matrix) -> Vector:
    """Compute half the minimum modulus (rows,) of each polynomial on |z| = 1; 0 for a polynomial with a zero inside."""
    # Number of points on the half circle at which the modulus is evaluated, in addition to the angles of the roots.
    grid = 256
    rows = np.asarray(rows, dtype=np.float64)
    inside = np.all(np.isfinite(coordinates(rows)), axis=1)
    result = np.zeros(len(rows))
    if np.any(inside):
        good = rows[inside]
        companion = np.zeros((len(good), rows.shape[1], rows.shape[1]))
        companion[:, 0] = good
        companion[:, np.arange(1, rows.shape[1]), np.arange(rows.shape[1] - 1)] = 1.0
        near = np.angle(np.linalg.eigvals(companion)) / (2.0 * np.pi)
        cycles = np.concatenate([near, np.broadcast_to(np.linspace(0.0, 0.5, grid + 1), (len(good), grid + 1))], 1)
        result[inside] = 0.5 * np.sqrt(np.min(squared_size(good[:, None, :], cycles), axis=1))
    return result


def squared_size(rows: NDArray[np.float64], cycles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute |1 − Σ a_i z^i|² at z = exp(−2πi·cycles) for rows of coefficients, as 1 − Σ a_i c^i + Σ a_i (c^i − z^i)
    with the nearer c of ±1, which is accurate for zeros near c."""
    cycles = np.ascontiguousarray(cycles, dtype=np.float64)
    turns_of = _turns if cycles.size < 10_000 else _turns.__wrapped__  # the cache is for small grids
    behind, turns = turns_of(cycles.tobytes(), cycles.shape, rows.shape[-1])
    real = np.where(behind, _at_one(rows, -1.0), _at_one(rows, 1.0))
    imaginary = np.zeros(real.shape)
    for i, (sine, cosine) in enumerate(turns, 1):
        # c^i (1 − e^(−iδi)) = c^i (2 sin² + 2i sin cos) of δi/2
        weight = rows[..., i - 1] * np.where(behind, (-1.0) ** i, 1.0)
        real = real + 2.0 * weight * sine * sine
        imaginary = imaginary + 2.0 * weight * sine * cosine
    return np.asarray(real * real + imaginary * imaginary)


@lru_cache(maxsize=8)
def _turns(
    cycles: bytes, shape: tuple[int, ...], order: int
) -> tuple[NDArray[np.bool_], list[tuple[NDArray[np.float64], NDArray[np.float64]]]]:
    """Return whether −1 is nearer to z than 1, and sin, cos of δi/2, δ from the nearer: shared by moved parameters."""
    turned = np.frombuffer(cycles).reshape(shape)
    turned = turned - np.round(turned)
    behind = np.abs(turned) > 0.25
    angle = 2.0 * np.pi * (turned - np.where(behind, np.copysign(0.5, turned), 0.0))
    return behind, [(np.sin(0.5 * i * angle), np.cos(0.5 * i * angle)) for i in range(1, order + 1)]


def _at_one(rows: NDArray[np.float64], c: float) -> NDArray[np.float64]:
    """Compute 1 − Σ a_i c^i by compensated summation, which is accurate even if the result is tiny."""
    total, error = np.ones(rows.shape[:-1]), np.zeros(rows.shape[:-1])
    for i in range(rows.shape[-1]):
        term = -rows[..., i] * c ** (i + 1)
        added = total + term
        back = added - total
        error = error + ((total - (added - back)) + (term - back))
        total = added
    return np.asarray(total + error)


@lru_cache(maxsize=64)
def odd_lags(filter: WaveletFilter) -> Vector:
    """Return the autocorrelations of the scaling filter at the lags 1, 3, 5, …; those at the lags 2, 4, … are zero."""
    if filter is HAAR:
        return freeze(np.empty(0))
    both = np.correlate(filter.scaling, filter.scaling, "full")
    return freeze(np.ascontiguousarray(both[filter.length :: 2]))
