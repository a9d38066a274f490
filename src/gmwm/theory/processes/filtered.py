"""Wavelet variance of processes under any wavelet filter, at full accuracy at all levels.

Filters satisfy h_j(z) = g(z) h_{j−1}(z²) with the smoothing filter g. 1/(1 − φz) makes white noise a Markov process (φ
= 1: walk, φ = 0: white). As 1 − φz = (1 − φ²z²)/(1 + φz), the same recursion holds:

    h_j(z)/(1 − φz) = g(z)(1 + φz) · [h_{j−1}(w)/(1 − φ²w)],   w = z².

For quantization noise, (1 − z) h_j(z) = g(z)/(1 + z) · [(1 − w) h_{j−1}(w)]. The sum of squared coefficients is
computed from short autocorrelations, u_{j+1}(m) = Σ_k u_j(k) t(k − 2m) and ν_j² = Σ_m u_j(m) a_j(m), with t of the
front factor and a_j of the bracket at level 1. No large numbers are subtracted, for any length and φ."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.exponential_sum import WHITE, log_decay
from gmwm.theory.statespace import StateSpace

Levels = NDArray[np.int64]


def white_shape(filter: WaveletFilter, levels: Levels) -> Vector:
    """Compute the wavelet variances ν_j² = 2^−j (J,) of white noise of variance 1, for any filter."""
    return np.asarray(np.ldexp(1.0, -levels))


def quantization_shape(filter: WaveletFilter, levels: Levels) -> Vector:
    """Compute 2[r_j(0) − r_j(1)] (J,), the variances of e_t − e_{t−1}, Var e = 1, with filter autocorrelation r_j."""
    step = _transition(_autocorrelation(without_zero(filter)), filter.length)
    base = _fold(_autocorrelation(np.convolve(filter.wavelet / np.sqrt(2.0), [1.0, -1.0])), filter.length)
    u = np.zeros(base.size)
    u[0] = 1.0
    values = np.empty(int(levels[-1]))
    for j in range(values.size):
        values[j] = base @ u
        u = step @ u
    return values[levels - 1]


def error_filters(filter: WaveletFilter, level: int, most: int) -> list[tuple[Levels, Vector]]:
    """Return the positions and taps of the filters (1 − z) h_j(z), from errors e_t to wavelet coefficients of e_t −
    e_{t−1}, at levels 1 … `level`, up to the first with more than `most` taps. Haar filters have three."""
    taps = np.convolve(filter.wavelet / np.sqrt(2.0), [1.0, -1.0])
    places, factor = np.flatnonzero(taps), without_zero(filter)
    taps = np.asarray(taps[places], dtype=np.float64)
    filters: list[tuple[Levels, Vector]] = []
    while len(filters) < level and taps.size <= most:
        filters.append((places, taps))
        spread = (2 * places[:, None] + np.arange(factor.size)).ravel()
        places, where = np.unique(spread, return_inverse=True)
        taps = np.asarray(np.bincount(where, np.outer(taps, factor).ravel()), dtype=np.float64)
    return filters


def drift_shape(filter: WaveletFilter, levels: Levels) -> Vector:
    """Compute 4^(j−1) (Σ_l l h_{1,l})² (J,) for a drift of slope 1; 0 with two or more vanishing moments."""
    return np.asarray(np.ldexp(filter.first_moment**2 / 2.0, 2 * (levels - 1)))


def without_zero(filter: WaveletFilter) -> Vector:
    """Return the taps of g(z)/(1 + z), where g is the smoothing filter, which has a zero at z = −1."""
    sign = (-1.0) ** np.arange(filter.length)
    return np.asarray((np.cumsum(filter.scaling / np.sqrt(2.0) * sign) * sign)[:-1])


def walk_shape(filter: WaveletFilter, levels: Levels) -> Vector:
    """Compute the wavelet variances (J,) of a random walk with innovation variance 1."""
    return np.asarray(_driven(np.zeros(1), np.ones(1), filter, levels, slopes=False)[0][0])


def gm_shape(lam: Vector, filter: WaveletFilter, levels: Levels) -> Matrix:
    """Compute the wavelet variances (n, J) for the autocovariances e^(−λ|k|) with λ (n,)."""
    lam = np.minimum(lam, WHITE)
    return -np.expm1(-2.0 * lam)[:, None] * _driven(lam, np.ones_like(lam), filter, levels, slopes=False)[0]


def gm_slope(lam: Vector, filter: WaveletFilter, levels: Levels) -> Matrix:
    """Compute the derivatives with respect to λ (n, J) of the wavelet variances of `gm_shape`."""
    lam = np.minimum(lam, WHITE)
    values, slopes = _driven(lam, np.ones_like(lam), filter, levels, slopes=True)
    return 2.0 * np.exp(-2.0 * lam)[:, None] * values - np.expm1(-2.0 * lam)[:, None] * slopes


def ar1_shape(phi: Vector, filter: WaveletFilter, levels: Levels) -> Matrix:
    """Compute the wavelet variances (n, J) of AR1 processes with φ (n,) and innovation variance 1."""
    lam = log_decay(phi)
    # Both methods are accurate at this λ for φ = −e^(−λ).
    near = (phi < 0) & (lam < 0.1)
    values = np.empty((phi.size, levels.size))
    values[near] = _near_minus_one(lam[near], filter, levels)
    values[~near] = _driven(lam[~near], np.where(phi[~near] < 0, -1.0, 1.0), filter, levels, slopes=False)[0]
    return values


def _driven(lam: Vector, sign: Vector, filter: WaveletFilter, levels: Levels, *, slopes: bool) -> tuple[Matrix, Matrix]:
    """Compute the variances (n, J) of unit white noise filtered by h_j(z)/(1 − φz), φ = ±e^(−λ), and, if `slopes`,
    their derivatives with respect to λ for φ > 0. The recursion propagates u_j (K, n), with one column for each φ."""
    even, odd, spread = _markov_steps(filter)
    # Largest number of multiplications per matrix product: larger products start BLAS threads, which is slower here.
    most = 2**18 // spread.size
    if lam.size > most:
        parts = [slice(k, k + most) for k in range(0, lam.size, most)]
        done = [_driven(lam[part], sign[part], filter, levels, slopes=slopes) for part in parts]
        return np.concatenate([v for v, _ in done]), np.concatenate([d for _, d in done])
    u = np.zeros((even.shape[0], lam.size))
    u[0] = 1.0
    du = np.zeros_like(u)
    values = np.empty((lam.size, int(levels[-1])))
    derivatives = np.zeros_like(values)
    for j in range(values.shape[1]):
        decay = np.ldexp(lam, j)
        phi, below = np.exp(-decay), -np.expm1(-decay)
        above = 1.0 + phi
        if j == 0:
            phi, below, above = sign * phi, np.where(sign < 0, above, below), np.where(sign < 0, below, above)
        values[:, j], by_phi = _against_ratio(spread @ u, phi, below, above)
        u_even, u_odd = even @ u, odd @ u
        if slopes:
            dphi = -np.ldexp(phi, j)
            derivatives[:, j] = _against_ratio(spread @ du, phi, below, above)[0] + by_phi * dphi
            du = (1.0 + phi * phi) * (even @ du) + phi * (odd @ du) + dphi * (2.0 * phi * u_even + u_odd)
        u = (1.0 + phi * phi) * u_even + phi * u_odd
    return values[:, levels - 1], derivatives[:, levels - 1]


def _against_ratio(v: Matrix, phi: Vector, below: Vector, above: Vector) -> tuple[Vector, Vector]:
    """Compute Σ_k v_k s(k) (n,) and its derivative by φ, for the autocovariance s(0) = 2/(1 + φ), s(k) = −φ^(k−1) (1 −
    φ)/(1 + φ) of (1 − z)/(1 − φz): applied analytically, 1 − z does not cancel for φ → 1."""
    polynomial, slope = np.zeros_like(phi), np.zeros_like(phi)
    for k in range(len(v) - 1, 0, -1):
        slope = slope * phi + polynomial
        polynomial = polynomial * phi + v[k]
    value = (2.0 * v[0] - below * polynomial) / above
    return value, (2.0 * (polynomial - v[0]) / above - below * slope) / above


@lru_cache(maxsize=64)
def _markov_steps(filter: WaveletFilter) -> tuple[Matrix, Matrix, Matrix]:
    """Return E and O of the step u → [(1 + φ²) E + φ O] u by g(z)(1 + φz), and C, which maps u to Σ_m u(m) r_q(m − l),
    q(z) = h(z)/(1 − z)."""
    reach = filter.length
    plain = _autocorrelation(filter.scaling / np.sqrt(2.0))
    shifted = np.convolve(plain, [1.0, 0.0, 1.0])
    quotient = _autocorrelation(np.cumsum(filter.wavelet / np.sqrt(2.0))[:-1])
    return _transition(plain, reach), _transition(shifted, reach), _convolution(quotient, reach)


@lru_cache(maxsize=64)
def _folded_autocorrelations(filter: WaveletFilter, levels: int) -> Matrix:
    """Compute r_j(0), 2r_j(1), …, 2r_j(L) (J, L + 1) of the autocorrelation r_j of the wavelet filter of level j."""
    k, m = np.arange(filter.length + 1)[:, None], np.arange(filter.length + 1)
    plain = _autocorrelation(filter.scaling / np.sqrt(2.0))
    step = _at(plain, k - 2 * m) + np.where(m > 0, _at(plain, k + 2 * m), 0.0)
    rows = [_at(_autocorrelation(filter.wavelet / np.sqrt(2.0)), m)]
    for _ in range(levels - 1):
        rows.append(step @ rows[-1])
    return np.array(rows) * np.where(m > 0, 2.0, 1.0)


def _near_minus_one(lam: Vector, filter: WaveletFilter, levels: Levels) -> Matrix:
    """Compute wavelet variances (n, J) of AR1 with φ = −ψ = −e^(−λ), innovation variance 1 and small λ. From level 2
    on, the smoothing filter's zero at −1 cancels the pole of 1/(1 + ψz): (1 + z)/(1 + ψz) has s(0) = 2/(1 + ψ), s(k) =
    (−ψ)^(k−1) ρ, ρ = (1 − ψ)/(1 + ψ). Scaling coefficients then have a moving average's autocovariance minus κ
    ψ^(2|k|)."""
    psi, below, size = np.exp(-lam), -np.expm1(-lam), filter.length
    above = 1.0 + psi
    values = np.empty((lam.size, int(levels[-1])))
    r = _fold(_autocorrelation(filter.wavelet / np.sqrt(2.0)), size)
    k = np.arange(size + 1)
    values[:, 0] = (np.exp(-np.outer(lam, k)) * (-1.0) ** k) @ r / (below * above)

    def continued(lag: NDArray[np.int64]) -> Matrix:
        return np.asarray((-1.0) ** (lag - 1) * np.exp(-np.outer(lam, lag - 1)) * (below / above)[:, None])

    # c(k) = Σ_n r(n) s(2k − n), minus its form at lags beyond the support of r, continued to k = 0.
    r = _autocorrelation(without_zero(filter))
    n = np.arange(2 - size, size - 1)
    near = np.zeros((size + 1, lam.size))
    for place in range(size // 2):
        lag = 2 * place - n
        covariances = np.where(lag == 0, (2.0 / above)[:, None], continued(np.abs(lag)))
        near[place] = (covariances - continued(lag)) @ r
    kappa = -continued(-n) @ r
    below_these = np.arange(1, values.shape[1])
    if below_these.size:
        table = _folded_autocorrelations(filter, below_these.size)
        values[:, 1:] = (table @ near).T - kappa[:, None] * gm_shape(2.0 * lam, filter, below_these)
    return values[:, levels - 1]


def state_space_variances(spaces: Sequence[StateSpace], filter: WaveletFilter, levels: Levels) -> Matrix:
    """Compute ν_j² (n, J) of n stationary processes from their state spaces, at O(J(L² + L p²)) for p states.

    The recursion propagates −½E(V_{t+k} − V_t)² of scaling coefficients V: values up to the filter length L, then the
    last component of −(A^k d), with the transition A over 2^j samples and, against cancellation, the accumulated
    difference. Rounding grows to 2^j only if the spectrum vanishes at f = 0 (quantization noise has its own form)."""
    n, p, reach = len(spaces), spaces[0].states, filter.length
    seen, errors = np.array([s.H[0] for s in spaces]), np.array([s.R[0, 0] for s in spaces])
    a, tail = np.zeros((n, p + 1, p + 1)), np.zeros((n, p + 1, 1))
    a[:, :p, :p], a[:, p, p] = [s.F for s in spaces], 1.0
    a[:, p, :p] = seen - np.einsum("ni,nij->nj", seen, a[:, :p, :p])
    tail[:, :p, 0] = [s.P0 @ s.H[0] for s in spaces]
    near = np.zeros((n, reach + 1))
    near[:, 1:] = -_last(a, a @ tail, reach) - errors[:, None]
    tail[:, p, 0] += errors
    offset = 0
    smooth, detail = (_autocorrelation(f / np.sqrt(2.0)) for f in (filter.scaling, filter.wavelet))
    lags = np.arange(1 - reach, reach)
    values = np.empty((n, int(levels[-1])))
    for j in range(values.shape[1]):
        far = np.linalg.matrix_power(a, reach + 1 - offset) @ tail
        sequence = np.concatenate([near, -_last(a, far, 2 * reach)], axis=1)
        values[:, j] = sequence[:, np.abs(lags)] @ detail
        # A constant does not change ν², but it would lose digits after the covariance has decayed.
        shift = sequence[:, reach]
        tail[:, p, 0] += shift
        near = (sequence - shift[:, None])[:, np.abs(2 * np.arange(reach + 1)[:, None] - lags)] @ smooth
        moved = (reach + offset) // 2
        x = np.linalg.matrix_power(a, 2 * moved - (reach - 1) - offset) @ tail
        total = np.zeros_like(tail)
        for weight in smooth:
            total += weight * x
            x = a @ x
        tail, offset, a = total, moved, a @ a
    return values[:, levels - 1]


def _last(a: NDArray[np.float64], x: NDArray[np.float64], count: int) -> Matrix:
    """Compute the last components (n, count) of the vectors x, Ax, …, A^(count−1)x, for n transitions A."""
    out = np.empty((len(x), count))
    for k in range(count):
        out[:, k] = x[:, -1, 0]
        x = a @ x
    return out


def autocovariance_variance(covariance: Vector, filter: WaveletFilter, levels: Levels) -> Vector:
    """Compute Σ_k r_j(k) c(k) (J,) from c, up to a constant, at lags 0 … `lags_needed` − 1."""
    smooth, detail = (_autocorrelation(f / np.sqrt(2.0)) for f in (filter.scaling, filter.wavelet))
    reach = filter.length - 1
    values = np.empty(int(levels[-1]))
    for j in range(values.size):
        covariance = covariance - covariance[0]
        values[j] = covariance[np.abs(np.arange(-reach, reach + 1))] @ detail
        both = np.concatenate([covariance[reach:0:-1], covariance])
        covariance = np.convolve(both, smooth, "valid")[::2]
    return values[levels - 1]


def lags_needed(filter: WaveletFilter, level: int) -> int:
    """Return the number of lags 0, 1, … at which the autocovariance determines the wavelet variance at `level`."""
    return filter.width(level)


def _autocorrelation(filter: Vector) -> Vector:
    """Return the autocorrelation r(−K) … r(K) of a short filter of K + 1 taps."""
    return np.correlate(filter, filter, "full")


def _fold(even: Vector, reach: int) -> Vector:
    """Fold an even sequence a(−K) … a(K) into weights (a(0), 2a(1), …, 2a(reach))."""
    middle = even.size // 2
    half = np.zeros(reach + 1)
    half[: middle + 1] = even[middle:]
    half[1:] *= 2.0
    return half


def _transition(even: Vector, reach: int) -> Matrix:
    """Return T with (T u)(m) = Σ_k u(k) t(k − 2m) for even sequences u, given at 0 … reach."""
    k, m = np.arange(reach + 1), np.arange(reach + 1)[:, None]
    return _at(even, k - 2 * m) + np.where(k > 0, _at(even, k + 2 * m), 0.0)


def _convolution(even: Vector, reach: int) -> Matrix:
    """Return C with (C u)(l) = Σ_m u(m) t(m − l), plus the result at −l for l > 0, for even u given at 0 … reach."""
    l, m = np.arange(reach + even.size // 2 + 1)[:, None], np.arange(reach + 1)  # noqa: E741
    once = _at(even, m - l) + np.where(m > 0, _at(even, m + l), 0.0)
    return np.where(l > 0, 2.0, 1.0) * once


def _at(even: Vector, lags: NDArray[np.int64]) -> Matrix:
    """Return t(k) of an even sequence given as t(−K) … t(K); 0 outside this range."""
    middle = even.size // 2
    inside = np.abs(lags) <= middle
    return np.asarray(np.where(inside, even[np.where(inside, lags + middle, 0)], 0.0))
