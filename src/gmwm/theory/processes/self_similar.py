"""Theory of self-similar noise, whose running sum has a covariance that is a power of the lag.

Noise with spectrum |f|^(−α), averaged over each interval, has the running sum's generalised covariance

    K(m) = ½ ν_1² κ q(m),   q(m) = m² (|m|^ε − 1)/ε,   κ = ε/(2^ε − 1),   ε = α − 1 between −2 and 2,

up to a + b m², with the Haar variance ν_1² at level 1; q(m) = m² ln|m|, κ = 1/ln 2 for ε = 0. A lag times h multiplies
K by h^(ε+2), so q determines all. Closed forms near 0, and series in 1/m² at longer lags, avoid cancellation."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.filtered import without_zero

Numbers = NDArray[Any]  # real, or complex for complex-step derivatives

_NEAR = 4.0  # lag, as a multiple of the step of the difference, from which the series is used instead of the definition
_TERMS = 15  # number of terms of the series in (step/lag)² ≤ 1/16
_REACH = 4  # number of lags that are stored individually, as a multiple of the filter length


def over_exponent(epsilon: Numbers, x: Numbers) -> Numbers:
    """Compute (e^(εx) − 1)/ε, which is x for ε = 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.where(epsilon == 0, x, np.expm1(epsilon * x) / epsilon))


def unit_factor(epsilon: Numbers) -> Numbers:
    """Compute κ = ε/(2^ε − 1), which is positive."""
    return np.asarray(1.0 / over_exponent(epsilon, np.asarray(math.log(2.0))))


def sum_covariance(lags: Vector, epsilon: float) -> Vector:
    """Compute q(m) = m² (|m|^ε − 1)/ε at real lags; m² ln|m| for ε = 0."""
    m = np.abs(np.asarray(lags, dtype=np.float64))
    log = np.log(m, where=m > 0, out=np.zeros_like(m))
    return np.asarray(m * m * over_exponent(np.asarray(epsilon), log))


def falling(epsilon: Numbers, terms: int) -> list[Numbers]:
    """Compute the binomial coefficients C(2 + ε, 2k) without their factor ε, for k = 2, 3, …, `terms` + 1."""
    coefficients, product = [], (2 + epsilon) * (1 + epsilon) / 2
    for k in range(2, terms + 2):
        product = product * (epsilon - (2 * k - 3)) / ((2 * k - 1) * 2 * k)
        if k > 2:  # omit the factor ε
            product = product * (epsilon - (2 * k - 4))
        coefficients.append(product)
    return coefficients


def bend(lags: Vector, epsilon: float) -> Vector:
    """Compute the second difference q(m+1) − 2q(m) + q(m−1) at real lags m, accurate to rounding."""
    t = np.abs(np.asarray(lags, dtype=np.float64))
    out = np.empty_like(t)
    near = t < _NEAR
    x = t[near]
    out[near] = sum_covariance(x + 1, epsilon) - 2 * sum_covariance(x, epsilon) + sum_covariance(x - 1, epsilon)
    x = t[~near]
    log = np.log(x)
    power = np.exp(epsilon * log)
    out[~near] = 2 * over_exponent(np.asarray(epsilon), log) + power * (3 + epsilon + 2 * _tail(x, epsilon))
    return out


def binomials(epsilon: float) -> Vector:
    """Compute the numbers (15,) of `falling` that differences of the running sum need."""
    return np.array(falling(np.asarray(epsilon), _TERMS), dtype=np.float64)


def _tail(t: Vector, epsilon: float) -> Vector:
    """Compute Σ_{k ≥ 2} C(2 + ε, 2k)/ε t^(2 − 2k)."""
    y = 1.0 / (t * t)
    return np.asarray(y * np.polyval(binomials(epsilon)[::-1], y))


def power_bend(lags: Vector, epsilon: float) -> Vector:
    """Compute |m+1|^p − 2|m|^p + |m−1|^p with p = 2 + ε at real lags m; small results have full relative accuracy."""
    t = np.abs(np.asarray(lags, dtype=np.float64))
    p = 2.0 + epsilon
    out = np.empty_like(t)
    near = t < _NEAR
    x = t[near]
    out[near] = (x + 1) ** p - 2 * x**p + np.abs(x - 1) ** p
    x = t[~near]
    out[~near] = np.exp(epsilon * np.log(x)) * (p * (1 + epsilon) + 2 * epsilon * _tail(x, epsilon))
    return out


def spectrum(frequencies: Vector, epsilon: float) -> Vector:
    """Compute the density of the sampled noise with ν_1² = 1, C (sin(πf)/π)² Σ_k |f + k|^(−α−2) with C = Γ(3+ε)
    sin(πε/2) (2π)^(−α)/(2^ε − 1), at |f| ≤ ½ (cycles per sample). The terms |k| > 1 are a series in f²."""
    f, alpha = np.abs(frequencies), epsilon + 1.0
    half, power = 0.5 * math.pi, -2.0 - alpha
    sine = half * float(np.sinc(0.5 * epsilon)) * float(unit_factor(np.asarray(epsilon)))
    constant = math.gamma(3.0 + epsilon) * sine * (2.0 * math.pi) ** -alpha
    around = (1.0 + f) ** power + (1.0 - f) ** power + np.polyval(_distant_aliases(-power), f * f)
    with np.errstate(divide="ignore"):
        return np.asarray(constant * (np.sinc(f) ** 2 * f**-alpha + (np.sin(math.pi * f) / math.pi) ** 2 * around))


@lru_cache(maxsize=32)
def _distant_aliases(power: float) -> Vector:
    """Return the coefficients of f^(2k), highest power first, of Σ_{|k| ≥ 2} |f + k|^(−power) at |f| ≤ ½: binomial
    coefficients times ζ(power + 2k) − 1. Terms fall by a factor of 16."""
    from scipy.special import binom, zetac

    terms = 2.0 * np.arange(15, -1, -1)
    return np.asarray(2.0 * binom(power + terms - 1.0, terms) * zetac(power + terms))


def powers_of_two(epsilon: Numbers, levels: NDArray[np.int64]) -> Numbers:
    """Compute 2^((j−1)ε) (n, J). The exponent is split into two parts to avoid rounding errors."""
    coarse = np.round(np.real(epsilon) * 2.0**20) / 2.0**20
    steps = (levels - 1).astype(np.float64)
    ratio = np.exp(math.log(2.0) * np.outer(epsilon - coarse, steps))
    return np.asarray(np.exp2(np.outer(coarse, steps)) * ratio)


def filtered_shape(epsilon: Numbers, filter: WaveletFilter, levels: NDArray[np.int64]) -> Numbers:
    """Compute the wavelet variances ν_j² (n, J) under any filter, for noise whose Haar variance at level 1 is 1; for ε
    < −1, from the running sum and the differenced filter, because the spectrum vanishes at f = 0."""
    eps = np.asarray(epsilon)
    out = np.empty((eps.size, int(levels[-1])), dtype=eps.dtype)
    summed = np.real(eps) < -1
    if np.any(~summed):
        e = eps[~summed, None]
        tail = np.concatenate([(2 + e) * (1 + e), *(2 * c for c in falling(e, _TERMS - 1))], axis=1)
        near = _bend_rows(e, _REACH * filter.length) - (3 + e)
        out[~summed] = (
            -0.5 * unit_factor(e) * _carry(e, near, tail=tail, filter=filter, count=int(levels[-1]), summed=False)
        )
    if np.any(summed):
        e = eps[summed, None] + 2
        tail = np.concatenate([e, np.zeros((len(e), _TERMS - 1))], axis=1)
        near = e * over_exponent(e, np.log(np.arange(1.0, _REACH * filter.length + 1)))
        near = np.concatenate([np.full((len(e), 1), -1.0), near], axis=1)
        out[summed] = (
            0.5
            * unit_factor(e - 2)
            / (e - 2)
            * _carry(e, near, tail=tail, filter=filter, count=int(levels[-1]), summed=True)
        )
    return np.asarray(out[:, levels - 1] * powers_of_two(eps, levels))


def _carry(eps: Numbers, near: Numbers, tail: Numbers, filter: WaveletFilter, count: int, *, summed: bool) -> Numbers:
    """Compute Σ_k d(k) c_j(k) / 2^((j−1)ε) (n, J) at `count` levels, d of the wavelet filter, c_j of the level's input.

    The smoothing filter maps c_j to c_{j+1}: single values at short lags (`near` for c_1), then a_0 (k^ε − 1)/ε + Σ_s
    a_s k^(ε−2s) (`tail`), kept by even moments of its autocorrelation. The division keeps values bounded."""
    length, reach = filter.length, _REACH * filter.length
    detail, step, moments = _tables(filter, reach, summed)
    passed = _passages(eps, moments)
    log = np.log(np.arange(reach + 1.0, 2 * reach + length))
    first, inverse = over_exponent(eps, log), np.exp(-2.0 * np.outer(np.arange(1, _TERMS), log))
    power, halved = np.exp(eps * log), np.exp(-eps * math.log(2.0))
    shift = over_exponent(eps, np.asarray(math.log(2.0)))
    values = np.empty((len(eps), count), dtype=near.dtype)
    for j in range(count):
        values[:, j] = near[:, : detail.size] @ detail
        far = tail[:, :1] * first + power * (tail[:, 1:] @ inverse)
        near = halved * (np.concatenate([near, far], axis=1) @ step - tail[:, :1] * shift)
        tail = np.einsum("ns,nst->nt", tail, passed)
    return values


def _bend_rows(eps: Numbers, reach: int) -> Numbers:
    """Compute the second differences of q at the lags 0 … `reach`, with one row for each exponent ε."""
    m = np.arange(reach + 1.0)
    log = np.log(np.maximum(np.arange(_NEAR + 1), 1.0))
    q = np.arange(_NEAR + 1) ** 2 * over_exponent(eps, log)
    k = np.arange(int(_NEAR))
    near = q[:, k + 1] - 2 * q[:, k] + q[:, np.abs(k - 1)]
    log = np.log(m[int(_NEAR) :])
    tail = sum(2 * c * np.exp(-2.0 * i * log) for i, c in enumerate(falling(eps, _TERMS), 1))
    far = 2 * over_exponent(eps, log) + np.exp(eps * log) * (3 + eps + tail)
    return np.concatenate([near, far], axis=1)


def _passages(eps: Numbers, moments: Vector) -> Numbers:
    """Return the factors (n, S, S) by which a_s contributes to a_t at the next level, t ≥ s: 4^(−t) C(ε − 2s, 2(t − s))
    μ_(2(t−s)), with moments μ of the autocorrelation of the smoothing filter; for a_0 divided by ε."""
    out = np.zeros((len(eps), _TERMS, _TERMS), dtype=eps.dtype)
    for s in range(_TERMS):
        top, coefficient = eps[:, 0] - 2 * s, np.ones(len(eps), dtype=eps.dtype)
        for t in range(s, _TERMS):
            i = 2 * (t - s)
            if i == 2:
                coefficient = (top - 1) / 2 * (1 if s == 0 else top)
            elif i > 2:
                coefficient = coefficient * (top - i + 2) * (top - i + 1) / ((i - 1) * i)
            out[:, s, t] = np.ldexp(1.0, -2 * t) * coefficient * moments[t - s]
    return out


@lru_cache(maxsize=64)
def _tables(filter: WaveletFilter, reach: int, summed: bool) -> tuple[Vector, Matrix, Vector]:
    """Return `_carry`'s tables: autocorrelation of h at lags ≥ 0, the step's matrix, and even moments for g; if
    `summed`, for (1 − z) h(z) and 2g(z)/(1 + z), of the running sum."""
    smooth, detail = filter.scaling / math.sqrt(2.0), filter.wavelet / math.sqrt(2.0)
    if summed:
        smooth, detail = 2.0 * without_zero(filter), np.convolve(detail, [1.0, -1.0])
    folded = [
        np.correlate(f, f, "full")[f.size - 1 :] * np.where(np.arange(f.size) > 0, 2.0, 1.0) for f in (smooth, detail)
    ]
    step = np.zeros((2 * reach + filter.length, reach + 1))
    places = np.arange(reach + 1)
    for n, weight in enumerate(folded[0]):
        for lag in (2 * places - n, 2 * places + n):
            np.add.at(step, (np.abs(lag), places), weight / 2)
    lags = np.arange(folded[0].size, dtype=np.float64)
    return folded[1], step, np.array([folded[0] @ lags ** (2 * i) for i in range(_TERMS)])


_STEP = 0.35
"""Distance of nodes in ln τ: trapezoidal error of V below 1e-10 (tests/covariance/test_lag_sums.py)."""
STEEPEST = 1.2  # largest ε of a mixture. Beyond it, a random walk and slow exponentials cancel by more than five digits


def mixture(epsilon: float, samples: int) -> ExponentialSum:
    """Return the running sum of noise with ν_1² = 1 as exponentials, for lags up to `samples`: m^(−s) Γ(s) = ∫ τ^(s−1)
    e^(−mτ) dτ, s = −2 − ε, in ln τ. Terms in m (white) and m³ (walk) continue it analytically at τ = 0."""
    from scipy.special import rgamma

    # Relative contribution to wavelet coefficients, of the order (τN)^(2 − ε), below which an exponential is left out.
    low = math.floor((-math.log(4.0 * samples) + math.log(1e-10) / (2.0 - epsilon)) / _STEP)
    # Decay beyond which an exponential is below the rounding error at a lag of one sample.
    high = math.ceil(math.log(37.0) / _STEP)
    split = math.floor(math.log(0.9) / _STEP)
    tau = np.exp(_STEP * np.arange(low, high + 1))
    # 1/(ε Γ(−2 − ε)), as 1/Γ(3 − ε) times the factors that vanish at ε = −1 and ε = 1.
    size = -0.5 * float(unit_factor(np.asarray(epsilon))) * (2.0 + epsilon) * _STEP
    common = size * (1.0 + epsilon) * float(rgamma(1.0 - epsilon))
    weights = common * tau ** (-2.0 - epsilon)
    slow = np.arange(low, high + 1) <= split
    # Terms in m of the white noise beside all slow exponentials, and in m³ of the walk below the slowest one.
    linear = size * float(rgamma(1.0 - epsilon)) * _continued(-1.0 - epsilon, split)
    cubic = size * (1.0 + epsilon) * float(rgamma(2.0 - epsilon)) * _continued(1.0 - epsilon, low - 1) / -6.0
    # Those beyond the fastest one contribute at lag 0 only, as one exponential that is negligible after one step.
    tau = np.append(tau, 40.0)
    weights = np.append(weights, -common * _geometric(-2.0 - epsilon, high))
    slow = np.append(slow, False)
    series = np.where(tau < 0.1, tau**3 / 6.0 * (1.0 + tau**2 / 20.0 * (1.0 + tau**2 / 42.0)), np.sinh(tau) - tau)
    return ExponentialSum(
        white=-2.0 * (linear - float((weights * series)[slow].sum()) + cubic), walk=12.0 * cubic,
        amplitudes=(-4.0 * weights * np.sinh(0.5 * tau) ** 2).astype(np.complex128), decays=tau.astype(np.complex128),
        bare=~slow,
    )  # fmt: skip


def _geometric(power: float, last: int) -> float:
    """Compute Σ τ^power over all nodes up to number `last`, continued analytically."""
    return math.exp(power * _STEP * last) / -math.expm1(-power * _STEP)


def _continued(power: float, last: int) -> float:
    """Compute `_geometric` times `power`, which has a limit at 0."""
    grown = 1.0 / _STEP if power == 0 else power / -math.expm1(-power * _STEP)
    return math.exp(power * _STEP * last) * grown
