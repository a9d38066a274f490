"""Tukey's biweight M-estimator of scale: its constants for any efficiency, and the root of its estimating equation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TypeVar

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError

EFFICIENCY = 0.6  # default efficiency of a robust estimate
LEAST_EFFICIENCY, LARGEST_EFFICIENCY = 0.3, 0.99
NORMAL_QUARTILE = 0.6744897501960817  # Φ⁻¹(3/4): the median of |r| under N(0, 1), so that MAD / 0.67449 estimates σ
REACH = math.log(20.0)  # largest accepted distance of a root from the starting value, in log σ²

Number = TypeVar("Number", float, Vector)

Criterion = Callable[[float], tuple[float, float]]
"""Function of log σ² that returns the mean of ρ(W / σ) − a and its derivative with respect to log σ²."""


@dataclass(frozen=True)
class Biweight:
    """Tukey's biweight ρ(r) = r² (1 − r²/c²)⁴ for |r| ≤ c, else 0: mean ρ(W/σ) = a = E ρ under N(0, 1) determines σ."""

    c: float
    a: float

    def criterion(self, cubed: Number, fourth: Number, count: Number) -> tuple[Number, Number]:
        """Compute mean ρ − a and its derivative by log σ², from Σ v q³ and Σ v q⁴, v = min(r²/c², 1), q = 1 − v."""
        square = self.c**2
        return square * fourth / count - self.a, square * (4 * cubed - 5 * fourth) / count


def biweight(efficiency: float) -> Biweight:
    """Return the biweight of efficiency e (0.3 to 0.99): e = (E r ρ′(r))² / (2 Var ρ(r)) increases for c > 2.6.

    >>> round(biweight(0.6).c, 6), round(biweight(0.6).a, 7)
    (4.400278, 0.5691689)
    """
    number = isinstance(efficiency, int | float | np.floating)
    if not number or not LEAST_EFFICIENCY <= efficiency <= LARGEST_EFFICIENCY:
        raise OptionError(
            argument="efficiency", expected=f"a number from {LEAST_EFFICIENCY} to {LARGEST_EFFICIENCY}", got=efficiency
        )
    return _biweight(float(efficiency))


def require_robust(robust: bool, efficiency: float | None) -> None:
    """Raise OptionError if an efficiency other than the default is given for a classical estimate."""
    if not robust and efficiency not in (None, EFFICIENCY):
        raise unused_efficiency(efficiency)


def unused_efficiency(efficiency: float | None) -> OptionError:
    """Return the error for an efficiency that is given for a classical estimate."""
    return OptionError(
        f"the efficiency {efficiency!r} applies to the robust wavelet variance only", argument="efficiency",
        got=efficiency, advice="Pass {--robust=yes} too, or leave {--efficiency} out.",
    )  # fmt: skip


@lru_cache(maxsize=64)
def _biweight(efficiency: float) -> Biweight:
    low, high = 2.6, 20.0
    for _ in range(200):
        middle = (low + high) / 2
        if middle in (low, high):
            break
        low, high = (middle, high) if _moments(middle)[1] < efficiency else (low, middle)
    return Biweight(low, _moments(low)[0])


_legendre = lru_cache(maxsize=1)(np.polynomial.legendre.leggauss)


def _moments(c: float) -> tuple[float, float]:
    """Compute a and the efficiency e for a cut-off c by Gauss quadrature, because the integrands are smooth up to c."""
    nodes, weights = _legendre(96)
    r = c * (1 + nodes) / 2
    # Twice the density of N(0, 1), for both signs of r.
    density = c / 2 * weights * math.sqrt(2 / math.pi) * np.exp(-(r**2) / 2)
    v = (r / c) ** 2
    rho = r**2 * (1 - v) ** 4
    a = float(density @ rho)
    rising = float(density @ (2 * r**2 * (1 - v) ** 3 * (1 - 5 * v)))
    return a, rising**2 / (2 * (float(density @ rho**2) - a**2))


def newton(criterion: Criterion, tolerance: float) -> tuple[float | None, int]:
    """Find Newton's root in log σ² from 0, and count evaluations; None if the criterion rises or it leaves the range,
    against the spurious root at 0.07 σ² without outliers."""
    place = 0.0
    for count in range(1, 41):
        value, slope = criterion(place)
        if not slope < 0:
            return None, count
        step = min(max(-value / slope, -1.0), 1.0)
        place += step
        if abs(place) > REACH:
            return None, count
        if abs(step) <= tolerance:
            return place, count
    return None, 40


@dataclass(frozen=True)
class Scan:
    """Result of a scan: the root or None, position and value of each local maximum, and the number of evaluations."""

    root: float | None
    peaks: tuple[tuple[float, float], ...]
    evaluations: int


def scan(criterion: Criterion, tolerance: float) -> Scan:
    """Find a falling root, from log σ² = 0, and all local maxima: above if positive at 0, otherwise below, as by σ² ←
    σ² mean ρ / a, or the nearest in the other direction."""
    grid = np.linspace(-REACH, REACH, 61)
    values = np.array([criterion(float(place))[0] for place in grid])
    inside = np.flatnonzero((values[1:-1] >= values[:-2]) & (values[1:-1] > values[2:])) + 1
    peaks = tuple((float(grid[k]), float(values[k])) for k in inside)
    falling = np.flatnonzero((values[:-1] > 0) & (values[1:] <= 0))
    if falling.size == 0:
        return Scan(None, peaks, grid.size)
    centre = grid.size // 2
    above, below = falling[falling >= centre], falling[falling < centre]
    k = int(above[0] if above.size and (values[centre] > 0 or not below.size) else below[-1])
    root, count = _between(criterion, float(grid[k]), float(grid[k + 1]), tolerance)
    return Scan(root, peaks, grid.size + count)


def root_beyond(criterion: Criterion, peak: float, tolerance: float) -> tuple[float | None, int]:
    """Find the root above the local maximum near `peak` if it is positive, and count evaluations."""
    low, high = peak - 0.2, peak + 0.2
    value, place, count = -1.0, peak, 0
    while value <= 0:
        if count == 8:
            return None, count
        value, slope = criterion(place)
        count += 1
        if value <= 0:
            low, high = (place, high) if slope > 0 else (low, place)
            place = (low + high) / 2
    low, step = place, 0.1
    while value > 0:
        low, place, step = place, place + step, 2 * step
        value, _ = criterion(place)
        count += 1
    root, more = _between(criterion, low, place, tolerance)
    return root, count + more


def _between(criterion: Criterion, low: float, high: float, tolerance: float) -> tuple[float, int]:
    """Find the root between criteria > 0 at `low` and < 0 at `high` by Newton's method, and count evaluations."""
    place, count = (low + high) / 2, 0
    for count in range(1, 101):  # noqa: B007
        value, slope = criterion(place)
        low, high = (place, high) if value > 0 else (low, place)
        after = place - value / slope if slope < 0 else low
        if not low < after < high:
            after = (low + high) / 2
        moved, place = abs(after - place), after
        if moved <= tolerance:
            break
    return place, count
