"""Covariances of Haar wavelet coefficients, at full accuracy at any level and lag.

With K(m) the generalised covariance of the running sum of a process, h_j = 2^(j−1) and weights c = (1, −2, 1) at
offsets (0, h, 2h),

    2^(j+k) Cov(W_{j,t}, W_{k,t+u}) = Σ_a Σ_b c_a c_b K(u − b + a).

The nine terms cancel to nothing in double precision. Differenced over the finer level first,
D(m) = Σ_a c_a K(m + a) is a short closed form in y = |m + h_j|, and the sum is D(u) − 2 D(u − h_k) + D(u − 2 h_k).
Lags may be real numbers: the sums over them are done by Gauss rules between the kinks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import factorial

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector


@dataclass(frozen=True, eq=False)
class LagGrid:
    """Half-scales h_j ≤ h_k of pairs of levels and lags u between their coefficients, all (n,).

    `odd` says of a node between integers that it stands for odd lags (of an alternating covariance).
    """

    fine: Vector
    coarse: Vector
    lag: Vector
    odd: NDArray[np.bool_]

    @property
    def beyond(self) -> NDArray[np.bool_]:
        """Where the filters do not overlap: all nine differences of offsets and lag have one sign."""
        return (self.lag >= 2 * self.coarse) | (self.lag <= -2 * self.fine)

    @property
    def distance(self) -> Vector:
        """How far the filters are apart, where they do not overlap; the smallest of the nine lags."""
        return np.where(self.lag > 0, self.lag - 2 * self.coarse, -2 * self.fine - self.lag)


_WHITE = 40.0
"""From this λ on e^(−λ) is nothing next to 1."""


def white(at: LagGrid) -> Vector:
    """σ² = 1, K(m) = −|m|/2."""
    return _within_reach(at, lambda h, y: np.minimum(y - h, 0.0))


def walk(at: LagGrid) -> Vector:
    """γ² = 1, K(m) = (|m|³ − |m|)/12."""

    def difference(h: Vector, y: Vector) -> Vector:
        inside = (2 * y**3 - (h + y) ** 3 - (h - y) ** 3 - 2 * (y - h)) / 12
        return np.where(y >= h, h * h * y / 2, -inside)

    return _within_reach(at, difference)


def quantization(at: LagGrid) -> Vector:
    """Q² = 1, K(m) = 1 at m = 0 and 0 elsewhere: spikes at the kinks."""
    return _second_difference(at, lambda h, m: 1.0 * (m == 0) - 2.0 * (m == -h) + 1.0 * (m == -2 * h))


def exponential(at: LagGrid, decay: float) -> Vector:
    """Autocovariance e^(−λ|k|), λ = `decay`."""
    if decay > _WHITE:
        return white(at)
    half = np.sinh(0.5 * decay)
    # Where the reach ends, the coefficients are those of two blocks, one of which decays into the other.
    near, far = ~at.beyond, at.beyond
    result = np.empty_like(at.lag)
    gain = 0.25 / half**2
    result[far] = (
        -gain
        * np.expm1(-decay * at.fine[far]) ** 2
        * np.expm1(-decay * at.coarse[far]) ** 2
        * np.exp(-decay * at.distance[far])
    )
    inside = LagGrid(at.fine[near], at.coarse[near], at.lag[near], at.odd[near])
    result[near] = gain * _second_difference(inside, lambda h, m: _exponential_difference(h, np.abs(m + h), decay))
    return result


def alternating(at: LagGrid, decay: float) -> Vector:
    """Autocovariance (−1)^k e^(−λ|k|), λ = `decay`: nothing cancels, so the nine terms stand as they are."""
    phi = -np.exp(-decay)
    total = np.zeros_like(at.lag)
    for a, weight_a in ((0, 1.0), (1, -2.0), (2, 1.0)):
        for b, weight_b in ((0, 1.0), (1, -2.0), (2, 1.0)):
            m = at.lag - b * at.coarse + a * at.fine
            flips = (at.odd + a * at.fine.astype(np.int64) + b * at.coarse.astype(np.int64)) % 2
            total += weight_a * weight_b * np.where(flips, -1.0, 1.0) * np.exp(-decay * np.abs(m))
    share = (1 + phi) / (1 - phi) if decay > 0.5 else np.tanh(decay / 2)
    return np.asarray(share * white(at) - phi / (1 - phi) ** 2 * total)


def _second_difference(at: LagGrid, difference: Callable[[Vector, Vector], Vector]) -> Vector:
    first = difference(at.fine, at.lag)
    middle = difference(at.fine, at.lag - at.coarse)
    return np.asarray(first - 2 * middle + difference(at.fine, at.lag - 2 * at.coarse))


def _within_reach(at: LagGrid, difference: Callable[[Vector, Vector], Vector]) -> Vector:
    """The second difference of D(h, |m + h|); exactly zero where the filters do not overlap."""
    value = _second_difference(at, lambda h, m: difference(h, np.abs(m + h)))
    return np.where(at.beyond, 0.0, value)


_E3 = [(-1.0) ** n / factorial(n) for n in range(22, 2, -1)]


def _third_remainder(x: Vector) -> Vector:
    """e^(−x) − 1 + x − x²/2, accurate where x is small."""
    result = np.exp(-x) - 1 + x - 0.5 * x * x
    small = x < 1.0
    result[small] = np.polyval(_E3, x[small]) * x[small] ** 3
    return np.asarray(result)


def _exponential_difference(h: Vector, y: Vector, decay: float) -> Vector:
    """4 sinh²(λ/2) D as a function of y = |m + h|, up to a constant."""
    result = np.empty_like(y)
    far = y >= h
    result[far] = -(np.expm1(-decay * h[far]) ** 2) * np.expm1(-decay * (y[far] - h[far]))
    excess = _sinh_excess(decay)
    for cells, remainder in ((~far & (decay * h <= 1), True), (~far & (decay * h > 1), False)):
        if not cells.any():
            continue
        hc, yc = h[cells], y[cells]

        def term(q: Vector, remainder: bool = remainder) -> Vector:
            if remainder:
                return _third_remainder(decay * q) + q * excess
            return np.asarray(np.exp(-decay * q) + q * np.sinh(decay))

        ends = 2 * term(hc) - term(2 * hc) - term(np.zeros(1))
        result[cells] = 2 * term(yc) - term(hc + yc) - term(hc - yc) - ends
    return result


def _sinh_excess(x: float) -> float:
    """sinh x − x, accurate where x is small."""
    if x > 1:
        return float(np.sinh(x) - x)
    return float(sum(x**n / factorial(n) for n in range(21, 2, -2)))
