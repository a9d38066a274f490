"""Sums over all lags of covariances of Haar coefficients, lag by lag in many digits: the twin of `_core.lag_sums`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import mpmath

from tests.oracles.arma import multiplied

DIGITS = 60


@dataclass(frozen=True)
class Terms:
    """Process whose running sum has the covariance K(m) of `running_sum`; see `gmwm/lag_sums.hpp`."""

    white: Any = 0.0
    walk: Any = 0.0
    spikes: Sequence[Any] = ()
    amplitudes: Sequence[Any] = ()
    decays: Sequence[Any] = ()
    bare: Sequence[bool] = field(default=())

    def running_sum(self, last: int) -> list[Any]:
        """Compute K(0) … K(last)."""
        out = []
        powers = [mpmath.mpc(1)] * len(self.decays)
        decays = [mpmath.mpc(decay) for decay in self.decays]
        factors = [mpmath.mpc(a) for a in self.amplitudes]
        steps = [mpmath.exp(-decay) for decay in decays]
        slopes = [-mpmath.coth(decay / 2) / 2 for decay in decays]
        weights = [-1 / (4 * mpmath.sinh(decay / 2) ** 2) for decay in decays]
        bare = self.bare or [False] * len(decays)
        for m in range(last + 1):
            value = -mpmath.mpf(self.white) * m / 2 + mpmath.mpf(self.walk) * (m**3 - m) / 12
            if m < len(self.spikes):
                value += mpmath.mpf(self.spikes[m])
            for p, factor in enumerate(factors):
                linear = 0 if bare[p] else slopes[p] * m
                value += mpmath.re(factor * (linear + weights[p] * powers[p]))
                powers[p] *= steps[p]
            out.append(value)
        return out


def lag_sums(levels: Sequence[int], samples: int, left: Terms, right: Terms) -> tuple[list[Any], list[Any]]:
    """Compute Σ n C and Σ n C D for each pair of levels, sorted by the coarser level, then the finer."""
    with mpmath.workdps(DIGITS):
        k_left = left.running_sum(2 * samples)
        k_right = k_left if right is left else right.running_sum(2 * samples)
        first, second = [], []
        for coarse_level in levels:
            for fine_level in (level for level in levels if level <= coarse_level):
                h, g = 2 ** (fine_level - 1), 2 ** (coarse_level - 1)
                one, two = mpmath.mpf(0), mpmath.mpf(0)
                for u in range(2 * g - samples, samples - 2 * h + 1):
                    n = samples - max(u, 0) - max(2 * h - 1, 2 * g - 1 - u)
                    c = _coefficients(k_left, u, h, g)
                    d = c if right is left else _coefficients(k_right, u, h, g)
                    one += n * c
                    two += n * c * d
                first.append(one)
                second.append(two)
        return first, second


def _coefficients(k: list[Any], u: int, h: int, g: int) -> Any:
    """Compute Σ_a Σ_b c_a c_b K(u − b + a) for a = 0, h, 2h and b = 0, g, 2g, with c = (1, −2, 1)."""
    total = mpmath.mpf(0)
    for a, weight_a in ((0, 1), (h, -2), (2 * h, 1)):
        for b, weight_b in ((0, 1), (g, -2), (2 * g, 1)):
            total = total + weight_a * weight_b * k[abs(u - b + a)]
    return total


def closed_sums(levels: Sequence[int], samples: int, terms: Terms) -> list[Any]:
    """Compute Σ n C² for each pair of levels as geometric sums in many digits, for any number of samples.

    Nothing is done about terms that cancel: there are enough digits. Spikes and `bare` are not supported.
    """
    with mpmath.workdps(2 * DIGITS):
        decays = [mpmath.mpc(decay) for decay in terms.decays]
        factors = [mpmath.mpc(a) / 2 for a in terms.amplitudes]
        # The real part is half of the sum with the complex conjugate.
        decays += [mpmath.conj(decay) for decay in decays]
        factors += [mpmath.conj(factor) for factor in factors]
        poles = [mpmath.exp(-decay) for decay in decays]
        weights = [-a / (4 * mpmath.sinh(d / 2) ** 2) for a, d in zip(factors, decays, strict=True)]
        slope = -mpmath.mpf(terms.white) / 2 - mpmath.mpf(terms.walk) / 12
        slope -= mpmath.re(sum(a * mpmath.coth(d / 2) for a, d in zip(factors, decays, strict=True))) / 2
        cubic = mpmath.mpf(terms.walk) / 12
        out = []
        for coarse_level in levels:
            for fine_level in (level for level in levels if level <= coarse_level):
                sizes = 2 ** (fine_level - 1), 2 ** (coarse_level - 1)
                out.append(_closed_pair(sizes, samples, (slope, cubic), poles, weights=weights))
        return out


def _closed_pair(
    sizes: tuple[int, int], samples: int, line: tuple[Any, Any], poles: list[Any], *, weights: list[Any]
) -> Any:
    h, g = sizes
    kinks = [(b * g - a * h, (-2 if a == 1 else 1) * (-2 if b == 1 else 1)) for a in range(3) for b in range(3)]
    low, high = 2 * g - samples, samples - 2 * h
    cuts = sorted({u for u in (*(d for d, _ in kinks), 0, 2 * g - 2 * h, low, high + 1) if low <= u <= high + 1})
    total = mpmath.mpf(0)
    for left, right in pairwise(cuts):
        n = right - left
        count = [samples - max(u, 0) - max(2 * h - 1, 2 * g - 1 - u) for u in (left, right - 1)]
        step = mpmath.mpf(count[1] - count[0]) / (n - 1) if n > 1 else mpmath.mpf(0)
        polynomial = [mpmath.mpf(0)] * 4
        for d, c in kinks:
            sign, at = (1 if d <= left else -1), mpmath.mpf(left - d)
            polynomial[0] += c * sign * (line[0] * at + line[1] * at**3)
            polynomial[1] += c * sign * (line[0] + 3 * line[1] * at**2)
            polynomial[2] += c * sign * 3 * line[1] * at
            polynomial[3] += c * sign * line[1]
        ahead = [
            w * sum(c * z ** (left - d) for d, c in kinks if d <= left) for w, z in zip(weights, poles, strict=True)
        ]
        behind = [
            w * sum(c * z ** (d - right + 1) for d, c in kinks if d > left) for w, z in zip(weights, poles, strict=True)
        ]
        # Powers z^i and z^(n-1-i) are powers of z and 1/z.
        bases = [*poles, *(1 / z for z in poles)]
        sizes_of = [*ahead, *(f * z ** (n - 1) for f, z in zip(behind, poles, strict=True))]
        counted = multiplied(polynomial, [mpmath.mpf(count[0]), step])
        total += _power_sums(multiplied(counted, polynomial), mpmath.mpf(1), n)
        for k, z in enumerate(bases):
            if sizes_of[k] == 0:
                continue
            total += mpmath.re(2 * sizes_of[k] * _power_sums(counted, z, n))
            for other in range(k, len(bases)):
                size = sizes_of[k] * sizes_of[other] * (1 if other == k else 2)
                total += mpmath.re(size * _power_sums([mpmath.mpf(count[0]), step], z * bases[other], n))
    return total


def _power_sums(polynomial: list[Any], z: Any, n: int) -> Any:
    """Compute Σ P(i) z^i for 0 ≤ i < n by summation by parts."""
    highest = len(polynomial) - 1
    if abs(z - 1) < mpmath.mpf(10) ** (-1.5 * DIGITS):
        sums = [(mpmath.bernpoly(r + 1, n) - mpmath.bernpoly(r + 1, 0)) / (r + 1) for r in range(highest + 1)]
    else:
        end = z**n
        sums = [(end - 1) / (z - 1)]
        for r in range(1, highest + 1):
            rest = sum(mpmath.binomial(r, s) * sums[s] for s in range(r))
            sums.append((mpmath.mpf(n) ** r * end - z * rest) / (z - 1))
    return sum(a * b for a, b in zip(polynomial, sums, strict=True))
