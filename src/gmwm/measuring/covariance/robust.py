"""Hermite expansion of the robust estimate for correlated Gaussian coefficients."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Vector, freeze
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.biweight import biweight
from gmwm.theory.processes.model import Model


def hermite_weights(efficiency: float) -> Vector:
    """Return the weights c_2, c_4, …, c_16 of the Hermite expansion of the robust estimate.

    For a Gaussian signal, the covariance of the robust estimates is

        Cov(ν̃_j², ν̃_k²) = ν_j² ν_k² Σ_q c_q Σ_u n(u) ρ_jk(u)^q / (M_j M_k),

    with the correlation ρ_jk(u) of W_{j,t} and W_{k,t+u}, the number n(u) of pairs at lag u, and the number M_j of
    coefficients. The weights are c_q = q! b_q² / b_2², where b_q = E[ρ(r) He_q(r)] / q! are the Hermite coefficients of
    the biweight ρ(r). For the classical estimate c_2 = 2 is the only weight; for the robust estimate
    Σ c_q = 2 / efficiency. The sum of the weights beyond q = 16 is added to the last weight, so that the efficiency is
    exact for uncorrelated coefficients.

    >>> hermite_weights(0.6).round(5)[:4]
    array([2.     , 1.0747 , 0.22872, 0.02811])
    """
    return _weights(float(efficiency))


@lru_cache(maxsize=64)
def _weights(efficiency: float) -> Vector:
    c = biweight(efficiency).c
    nodes, gauss = np.polynomial.legendre.leggauss(128)
    r = c * (1 + nodes) / 2
    # ρ is even, and 0 beyond c. The Gauss rule covers 0 to c and counts both signs of r.
    rho = c * gauss / math.sqrt(2 * math.pi) * np.exp(-(r**2) / 2) * r**2 * (1 - (r / c) ** 2) ** 4
    before, here, moments = np.ones_like(r), r, []
    # Order of the last Hermite polynomial; tests/covariance/test_sums.py pins the weights.
    for q in range(1, 16 + 1):
        if q % 2 == 0:
            moments.append(float(rho @ here) ** 2 / math.factorial(q))
        before, here = here, r * here - q * before
    weights = 2 * np.array(moments) / moments[0]
    weights[-1] += max(2 / efficiency - weights.sum(), 0.0)
    return np.asarray(freeze(weights))


def rounding_bias(model: Model, design: Design) -> Vector:
    """Compute the relative error (J,) of robust Haar wavelet variances by uniform rounding errors, which have lighter
    tails than Gaussian ones: −√(c_4/24) κ_j to first order in the excess kurtosis κ_j of the coefficients, of which
    (1, −2, 1)/2^j multiply the errors. c_4 is the second of the `hermite_weights`."""
    cumulant = sum(process.error_cumulant for process in model.processes if process.scale > 0)
    if not cumulant or design.efficiency is None or not design.running_sum:
        return np.zeros(design.levels.size)
    curve = model.wavelet_variance(design.levels, design.rate, design.filter)
    kurtosis = 18.0 * cumulant / (4.0**design.levels * curve) ** 2
    return np.asarray(-math.sqrt(hermite_weights(design.efficiency)[1] / 24) * kurtosis)


@lru_cache(maxsize=64)
def ratio_skewness(efficiency: float) -> float:
    """Compute the skewness of log(ν̂²/ν̃²) for uncorrelated Gaussian coefficients, divided by its standard deviation.

    ν̂² is the classical and ν̃² the robust estimate from M coefficients with r = W/ν. To second order,

        log(ν̂²/ν²) = A − A²/2,  log(ν̃²/ν²) = G − G K + L G²/2.

    A, G and K are the means of r² − 1, (ρ − a)/b and k = rρ′/(2b) − 1, and L is the expectation of r(rρ′)′/(4b), with
    the biweight ρ, its expectation a, and b = b_2 of `hermite_weights`. Because h = r² − 1 − (ρ − a)/b is uncorrelated
    with r² − 1, the third cumulant is [E h³ − 6 E h² E(hk) − 3 L (E h²)²] / M².

    >>> round(ratio_skewness(0.6), 2), round(ratio_skewness(0.9), 1)
    (8.86, 22.7)
    """
    # Number of standard deviations beyond the cut-off at which a Gaussian density is negligible: e^(−72).
    tail = 12.0
    law = biweight(efficiency)
    nodes, gauss = np.polynomial.legendre.leggauss(128)
    # ρ and its derivatives have a kink at c, so there is one Gauss rule on each side.
    r = np.concatenate([law.c * (1 + nodes) / 2, law.c + tail * (1 + nodes) / 2])
    step = np.concatenate([law.c * gauss, tail * gauss])
    density = step * np.exp(-(r**2) / 2) / math.sqrt(2 * math.pi)
    v = np.minimum((r / law.c) ** 2, 1.0)
    q, square = 1 - v, law.c**2
    rho, first = square * v * q**4, 2 * square * v * q**3 * (1 - 5 * v)
    second = 4 * square * v * q**2 * (1 - 14 * v + 25 * v**2)
    b = float(density @ (rho * (r**2 - 1))) / 2
    h, k = r**2 - 1 - (rho - law.a) / b, first / (2 * b) - 1
    power, cubed, mixed = (float(density @ values) for values in (h**2, h**3, h * k))
    return cubed / power**2 - 6 * mixed / power - 3 * float(density @ second) / (4 * b)
