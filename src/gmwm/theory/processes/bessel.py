"""Matérn correlation, its complement and its derivatives, near machine precision at any distance.

The Matérn correlation of smoothness ν at the distance x is

    M(x) = 2^(1−ν)/Γ(ν) x^ν K_ν(x),

with the modified Bessel function K_ν. Near x = 0, M is close to 1, and the wavelet variance of a slow process depends
on 1 − M. There 1 − M is computed as the sum of a power series in y = x²/4 and of y^ν times another power series in y.
If ν is near an integer, the poles of both series cancel; the terms are combined in pairs and their differences are
computed analytically. For larger x, the integral K_ν(x) = ∫ e^(−x cosh t) cosh νt dt over t > 0 is computed by the
trapezoidal rule. Its error decreases exponentially with the number of nodes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Matrix, Vector

LARGEST_SMOOTHNESS = 50.0
"""Upper limit of ν; beyond it, the process is almost infinitely smooth."""
_PAIRS = 24
_POWERS = 52
"""Number of terms of a power series in ε with |ε| ≤ ½ and coefficients of at most 1."""

Numbers = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Matern:
    """Matérn correlation M and 1 − M (`lost`) at distances x, and derivatives of 1 − M with respect to ln x and to
    ν."""

    correlation: Vector
    lost: Vector
    by_distance: Vector
    by_smoothness: Vector


def matern(x: Vector, nu: float) -> Matern:
    """Compute the Matérn correlation and its derivatives at distances x ≥ 0 for a smoothness 0 < ν <
    `LARGEST_SMOOTHNESS`."""
    # Distance beyond which the correlation underflows, for any ν up to 50.
    underflow = 1200.0
    edge = 2.0 * math.sqrt(max(1.0, nu / 2.0))
    parts = [np.zeros_like(x) for _ in range(4)]
    parts[0][x == 0] = 1.0
    parts[1][x >= underflow] = 1.0
    for inside, form in (((x > 0) & (x < edge), _series), ((x >= edge) & (x < underflow), _integral)):
        if np.any(inside):
            for part, value in zip(parts, form(x[inside], nu), strict=True):
                part[inside] = value
    return Matern(*parts)


def _integral(x: Vector, nu: float) -> tuple[Vector, Vector, Vector, Vector]:
    from scipy.special import gammaln, psi

    nodes = 40
    # Upper limit of t: x (cosh t − 1) − νt reaches 40.
    end = 2.0 * np.arcsinh(np.sqrt(NEGLIGIBLE_EXPONENT / (2.0 * x)))
    for _ in range(6):
        end = 2.0 * np.arcsinh(np.sqrt((NEGLIGIBLE_EXPONENT + nu * end) / (2.0 * x)))
    t = np.arange(nodes + 1) * (end / nodes)[:, None]
    weight = np.exp(-2.0 * x[:, None] * np.sinh(0.5 * t) ** 2) * (end / nodes)[:, None]
    weight[:, 0] *= 0.5
    grown, lowered = np.exp(nu * t), np.exp((nu - 1.0) * t)
    bessel, odd = (0.5 * np.sum(weight * w, axis=1) for w in (grown + 1.0 / grown, t * (grown - 1.0 / grown)))
    lower = 0.5 * np.sum(weight * (lowered + 1.0 / lowered), axis=1)
    size = np.exp((1.0 - nu) * math.log(2.0) - float(gammaln(nu)) + nu * np.log(x) - x)
    correlation = size * bessel
    by_smoothness = size * odd + correlation * (np.log(0.5 * x) - float(psi(nu)))
    return correlation, 1.0 - correlation, size * x * lower, -by_smoothness


def _series(x: Vector, nu: float) -> tuple[Vector, Vector, Vector, Vector]:
    # Size of the steps of complex-step derivatives. At this size the truncation error is negligible.
    step = 1e-30
    log = 2.0 * np.log(0.5 * x)
    order, complex_nu = round(nu), complex(nu, step)
    epsilon = complex(nu - order, step)
    after, before = _log_gamma_slopes(epsilon), _log_gamma_slopes(-epsilon)
    lost, slope = _low_powers(log, complex_nu, order)
    front = (-1.0) ** order * _over_sine(epsilon)
    if order:
        front *= np.exp(-epsilon * after[order - 1]) / math.gamma(order)
    else:
        gamma = np.exp(epsilon * after[0])
        power = front / gamma**2 * np.exp(complex_nu * log)
        lost, slope = lost + power, slope + 2.0 * complex_nu * power
        front *= epsilon / gamma
    # Pairs y^k and y^(ν + i), k = n + i, with n the integer nearest ν; for n = 0 the first pair is 1 and y^ν.
    i = np.arange(0 if order else 1, _pairs(float(log.max())))[:, None]
    k = order + i
    size = front * np.exp(epsilon * before[i] - _LOG_FACTORIALS[k] - _LOG_FACTORIALS[i] + k * log)
    kappa = log - after[k] - before[i]
    pair = size * kappa * _relative_exponential(epsilon * kappa)
    lost = lost + np.sum(pair, axis=0)
    slope = slope + 2.0 * np.sum(k * pair + size * np.exp(epsilon * kappa), axis=0)
    return 1.0 - lost.real, lost.real, slope.real, lost.imag / step


def _low_powers(log: Vector, nu: complex, whole: int) -> tuple[Numbers, Numbers]:
    """Compute −Σ y^k / (k! (1 − ν)(2 − ν)…(k − ν)) over 1 ≤ k < `whole`, and its derivative by ln x; ln y = 2
    ln(x/2)."""
    total, slope = np.zeros(log.size, dtype=np.complex128), np.zeros(log.size, dtype=np.complex128)
    term = complex(1.0)
    for k in range(1, whole):
        term /= k * (k - nu)
        power = term * np.exp(k * log)
        total -= power
        slope -= 2.0 * k * power
    return total, slope


def _pairs(log: float) -> int:
    """Return the number of terms y^i / i!² that are not negligible for the largest y, whose logarithm is `log`."""
    size = np.arange(_PAIRS) * max(log, 0.0) - 2.0 * _LOG_FACTORIALS[:_PAIRS]
    return int(np.count_nonzero(size > -NEGLIGIBLE_EXPONENT))


def _relative_exponential(z: Numbers) -> Numbers:
    """Compute (e^z − 1)/z."""
    near = np.abs(z) < 1.0
    small = np.polyval(_INVERSE_FACTORIALS, np.where(near, z, 0.0))
    far = np.where(near, 1.0, z)
    return np.asarray(np.where(near, small, np.expm1(far) / far))


_LOG_FACTORIALS = np.array([math.lgamma(k + 1.0) for k in range(int(LARGEST_SMOOTHNESS) + _PAIRS + 1)])
_INVERSE_FACTORIALS = np.array([1.0 / math.factorial(k + 1) for k in range(20, -1, -1)])


def _over_sine(epsilon: complex) -> complex:
    """Compute πε / sin πε for |ε| ≤ ½."""
    return complex(np.polyval(_sine_powers(), epsilon * epsilon))


@lru_cache(maxsize=1)
def _sine_powers() -> Vector:
    from scipy.special import zeta

    k = np.arange(_POWERS // 2, 0, -1)
    return np.append(2.0 * (1.0 - 2.0 ** (1.0 - 2.0 * k)) * zeta(2.0 * k), 1.0)


def _log_gamma_slopes(epsilon: complex) -> Numbers:
    """Compute [ln Γ(a + ε) − ln Γ(a)]/ε for a = 1, 2, …, |ε| ≤ ½."""
    return np.asarray(_gamma_powers() @ epsilon ** np.arange(_POWERS, -1, -1))


@lru_cache(maxsize=1)
def _gamma_powers() -> Matrix:
    """Return the Taylor coefficients of ln Γ about 1, 2, …, highest order first."""
    from scipy.special import psi, zeta

    a, m = np.arange(1.0, LARGEST_SMOOTHNESS + _PAIRS + 2)[:, None], np.arange(_POWERS, 0, -1.0)
    return np.concatenate([(-1.0) ** (m + 1) * zeta(m + 1, a) / (m + 1), psi(a)], axis=1)
