"""Fifty-digit Haar wavelet variances, each from the defining sums of its process; no formula of the package."""

from __future__ import annotations

from collections.abc import Callable

import mpmath as mp

from tests.oracles.arma import exponentials

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


def sinusoid(frequency: mp.mpf, rate: mp.mpf, level: int) -> mp.mpf:
    # The block sums of e^(iωt) are a geometric series, and one is e^(iωh) times the other.
    h = mp.mpf(2) ** (level - 1)
    one, block = mp.expjpi(2 * frequency / rate), mp.expjpi(2 * h * frequency / rate)
    return abs((block - 1) / (one - 1) * (block - 1) / (2 * h)) ** 2


def power(epsilon: mp.mpf, level: int) -> mp.mpf:
    """Running sum of variance proportional to −m^(2+ε) for ε < 0, to which any a m² may be added."""
    h = mp.mpf(2) ** (level - 1)
    unit = -1 / (mp.mpf(2) ** epsilon - 1)
    single, double = unit * h ** (2 + epsilon), unit * (2 * h) ** (2 + epsilon)
    return _from_block_sums(single, double / 2 - single, level)


def flicker(level: int) -> mp.mpf:
    h = mp.mpf(2) ** (level - 1)
    single, double = (-(m**2) * mp.ln(m) / mp.pi for m in (h, 2 * h))
    return _from_block_sums(single, double / 2 - single, level)


def arma(theta: list[mp.mpf], orders: tuple[int, int, int, int, int], level: int) -> mp.mpf:
    pairs, early = exponentials(tuple(theta), orders, DIGITS)
    h = mp.mpf(2) ** (level - 1)
    variance = covariance = mp.mpf(0)
    for weight, root in pairs:
        power = root ** int(h)
        variance += weight * (h * (1 + root) / (1 - root) - 2 * root * (1 - power) / (1 - root) ** 2)
        covariance += weight * root * (1 - power) ** 2 / (1 - root) ** 2
    for k, value in enumerate(early):
        variance += value * (h if k == 0 else 2 * max(h - k, 0))
        covariance += value * max(min(k, 2 * h - k), 0)
    return _from_block_sums(mp.re(variance), mp.re(covariance), level)


ARMA = {
    "AR(2)": (2, 0, 0, 0, 1),
    "MA(1)": (0, 1, 0, 0, 1),
    "ARMA(2,1)": (2, 1, 0, 0, 1),
    "SARMA(1,1,1,0,4)": (1, 1, 1, 0, 4),
}
"""Orders p, q, P, Q and the period of those that laws are tested on."""


def oscillator(frequency: mp.mpf, quality: mp.mpf, rate: mp.mpf, level: int) -> mp.mpf:
    """Damped oscillator: the real part of a sum over a complex exponential, with far more digits than cancel."""
    with mp.workdps(6 * DIGITS):
        natural, half = 2 * mp.pi * frequency / rate, mp.mpf(2) ** (level - 1)
        damping = natural / (2 * quality)
        turn = mp.sqrt(natural**2 - damping**2)
        decay = mp.mpc(damping, -turn)
        z, end = mp.exp(-decay), mp.exp(-decay * half)
        total = 2 * half * (1 + z) / (1 - z) - 2 * z * (1 - end) * (3 - end) / (1 - z) ** 2
        return mp.re((1 - 1j * damping / turn) * total) / (4 * half**2)


SHAPES: dict[str, Callable[[list[mp.mpf], mp.mpf, int], mp.mpf]] = {
    "WN": lambda theta, rate, level: white(level),
    "QN": lambda theta, rate, level: quantization(level),
    "RW": lambda theta, rate, level: walk(level),
    "DR": lambda theta, rate, level: drift(level),
    "AR1": lambda theta, rate, level: autoregression(theta[0], level),
    "GM": lambda theta, rate, level: gauss_markov(theta[0], rate, level),
    "OSC": lambda theta, rate, level: oscillator(theta[0], theta[1], rate, level),
    "FN": lambda theta, rate, level: flicker(level),
    "PL": lambda theta, rate, level: power(theta[0] - 1, level),
    "FGN": lambda theta, rate, level: (1 - mp.mpf(2) ** (2 * theta[0] - 2)) * power(2 * theta[0] - 2, level),
    "SIN": lambda theta, rate, level: sinusoid(theta[0], rate, level),
    **{name: lambda theta, rate, level, orders=orders: arma(theta, orders, level) for name, orders in ARMA.items()},
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
