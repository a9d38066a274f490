"""Slow and obvious twin of the robust variance: the full median, mean ρ as written, its root by bisection."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

QUARTILE = 0.6744897501960817


def mean_rho(w: NDArray[np.float64], sigma2: float, c: float) -> float:
    """Mean of r² (1 − r²/c²)⁴ over |r| ≤ c, r = w / σ, zeros beyond."""
    square = np.asarray(w, dtype=np.float64) ** 2 / sigma2
    down = (1 - np.minimum(square / c**2, 1.0)) ** 2
    return float(np.mean(square * down * down))


def falling_roots(w: NDArray[np.float64], start: float, c: float, a: float) -> list[float]:
    """All σ² from start / 20 to 20 start at which mean ρ falls through a, ascending."""
    grid = start * np.exp(np.linspace(-np.log(20), np.log(20), 241))
    above = np.array([mean_rho(w, s, c) > a for s in grid])
    roots = []
    for k in np.flatnonzero(above[:-1] & ~above[1:]):
        low, high = grid[k], grid[k + 1]
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if mean_rho(w, middle, c) > a else (low, middle)
        roots.append((low + high) / 2)
    return roots


def variance(w: NDArray[np.float64], c: float, a: float) -> float:
    """The root that σ² ← σ² mean ρ / a leads to from (MAD / 0.67449)², or that itself; more than two w, MAD > 0."""
    start = float(np.median(np.abs(w)) / QUARTILE) ** 2
    roots = falling_roots(w, start, c, a)
    if not roots:
        return start
    below, above = [r for r in roots if r < start], [r for r in roots if r >= start]
    if above and (mean_rho(w, start, c) > a or not below):
        return above[0]
    return below[-1]
