"""Fifty-digit Haar wavelet variances, each from the defining sums of its process; no formula of the package."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp

DIGITS = 160  # enough that λ = 1e-12 at level 30 keeps fifty digits after all cancellation


def _from_block_sums(variance: mp.mpf, covariance: mp.mpf, level: int) -> mp.mpf:
    """[S(h) − C(h)]/(2h²) with S the variance of a block sum and C the covariance of adjacent ones."""
    h = mp.mpf(2) ** (level - 1)
    return (variance - covariance) / (2 * h * h)


def white(level: int) -> mp.mpf:
    h = mp.mpf(2) ** (level - 1)
    return _from_block_sums(h, mp.mpf(0), level)


def quantization(level: int) -> mp.mpf:
    # A block sum telescopes to e_end − e_before; adjacent blocks share one e with opposite signs.
    return _from_block_sums(mp.mpf(2), mp.mpf(-1), level)


def walk(level: int) -> mp.mpf:
    # Innovations enter the difference of two block sums with weights 1 … h … 1.
    h = mp.mpf(2) ** (level - 1)
    return (2 * h**3 + h) / 3 / (2 * h) ** 2


def drift(level: int) -> mp.mpf:
    h = mp.mpf(2) ** (level - 1)
    return (h * h / (2 * h)) ** 2


def autoregression(phi: mp.mpf, level: int) -> mp.mpf:
    h = 2 ** (level - 1)
    power = abs(phi) ** h * (-1 if phi < 0 and h == 1 else 1)
    variance = h * (1 + phi) / (1 - phi) - 2 * phi * (1 - power) / (1 - phi) ** 2
    covariance = phi * (1 - power) ** 2 / (1 - phi) ** 2
    return _from_block_sums(variance, covariance, level) / (1 - phi * phi)


def gauss_markov(beta: mp.mpf, rate: mp.mpf, level: int) -> mp.mpf:
    phi = mp.exp(-beta / rate)
    return autoregression(phi, level) * (1 - phi * phi)


SHAPES: dict[str, Callable[[list[mp.mpf], mp.mpf, int], mp.mpf]] = {
    "WN": lambda theta, rate, level: white(level),
    "QN": lambda theta, rate, level: quantization(level),
    "RW": lambda theta, rate, level: walk(level),
    "DR": lambda theta, rate, level: drift(level),
    "AR1": lambda theta, rate, level: autoregression(theta[0], level),
    "GM": lambda theta, rate, level: gauss_markov(theta[0], rate, level),
}
"""Wavelet variance at scale coefficient 1 of each process that gives a closed form."""


def shape(name: str, nonlinear: list[float], rate: float, level: int) -> mp.mpf:
    with mp.workdps(DIGITS):
        return +SHAPES[name]([mp.mpf(v) for v in nonlinear], mp.mpf(rate), level)


def slope(name: str, nonlinear: list[float], rate: float, level: int, by: int) -> mp.mpf:
    """Derivative of `shape` by one nonlinear parameter."""
    with mp.workdps(DIGITS):
        theta = [mp.mpf(v) for v in nonlinear]
        step = abs(theta[by]) * mp.mpf(10) ** -40 or mp.mpf(10) ** -40
        sides = []
        for sign in (1, -1):
            moved = list(theta)
            moved[by] += sign * step
            sides.append(SHAPES[name](moved, mp.mpf(rate), level))
        return (sides[0] - sides[1]) / (2 * step)
