"""Wavelet variances from autocovariances that are smooth functions of the lag, for any filter and level.

Level i has A_i(m) = Σ_n r_g(n) A_{i−1}(2m − n) and ν_j² = Σ_n r_h(n) A_{j−1}(n), with autocorrelations of the smoothing
and the wavelet filter. Beyond a few filter lengths, A_i is a polynomial per octave, at Chebyshev points, so a step is a
small matrix per octave. One adjoint recursion (all is linear in A_0) sums about twenty lags per level for ν_j²."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Integers, Matrix, Vector, freeze
from gmwm.base.lazy import scipy
from gmwm.theory.filters import WaveletFilter

LARGEST_SMOOTHNESS = 50.0  # upper limit of ν; beyond it, the process is almost infinitely smooth
_PAIRS = 24
_POWERS = 52  # number of terms of a power series in ε with |ε| ≤ ½ and coefficients of at most 1

Numbers = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Matern:
    """Matérn correlation M and 1 − M (`lost`) at x, and derivatives of 1 − M by ln x and ν."""

    correlation: Vector
    lost: Vector
    by_distance: Vector
    by_smoothness: Vector


def matern(x: Vector, nu: float) -> Matern:
    """Compute the Matérn correlation and derivatives at x ≥ 0 for 0 < ν < `LARGEST_SMOOTHNESS`."""
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
    size = np.exp((1.0 - nu) * math.log(2.0) - float(scipy.special.gammaln(nu)) + nu * np.log(x) - x)
    correlation = size * bessel
    by_smoothness = size * odd + correlation * (np.log(0.5 * x) - float(scipy.special.psi(nu)))
    return correlation, 1.0 - correlation, size * x * lower, -by_smoothness


def _series(x: Vector, nu: float) -> tuple[Vector, Vector, Vector, Vector]:
    # Size of the steps of complex-step derivatives. At this size the truncation error is negligible.
    step = 1e-30
    log = 2.0 * np.log(0.5 * x)
    order, complex_nu = round(nu), complex(nu, step)
    epsilon = complex(nu - order, step)
    after, before = _log_gamma_slopes(epsilon), _log_gamma_slopes(-epsilon)
    lost, slope = _low_powers(log, complex_nu, order)
    front = (-1.0) ** order * complex(np.polyval(_sine_powers(), epsilon * epsilon))
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
    """Compute −Σ y^k / (k! (1 − ν)(2 − ν)…(k − ν)), 1 ≤ k < `whole`, and its derivative by ln x; ln y = 2 ln(x/2)."""
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


@lru_cache(maxsize=1)
def _sine_powers() -> Vector:
    k = np.arange(_POWERS // 2, 0, -1)
    return np.append(2.0 * (1.0 - 2.0 ** (1.0 - 2.0 * k)) * scipy.special.zeta(2.0 * k), 1.0)


def _log_gamma_slopes(epsilon: complex) -> Numbers:
    """Compute [ln Γ(a + ε) − ln Γ(a)]/ε for a = 1, 2, …, |ε| ≤ ½."""
    return np.asarray(_gamma_powers() @ epsilon ** np.arange(_POWERS, -1, -1))


@lru_cache(maxsize=1)
def _gamma_powers() -> Matrix:
    """Return the Taylor coefficients of ln Γ about 1, 2, …, highest order first."""
    a, m = np.arange(1.0, LARGEST_SMOOTHNESS + _PAIRS + 2)[:, None], np.arange(_POWERS, 0, -1.0)
    return np.concatenate([(-1.0) ** (m + 1) * scipy.special.zeta(m + 1, a) / (m + 1), scipy.special.psi(a)], axis=1)


NODES_OF_OCTAVE = 20  # Chebyshev points per octave [a, 2a] of lags; the interpolation error is about 5.8^−20
_SPILL = 8  # Octave from which the polynomial of the next octave is extrapolated to lags slightly outside it
_SHORT = 64  # number of lags that are summed individually

Levels = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LagSums:
    """Weights (J, P) of A at `places` (lags, also between integers) that give the wavelet variances."""

    places: Vector
    weights: Matrix

    def variance(self, known: Matrix, levels: Levels) -> tuple[Matrix, Matrix]:
        """Compute variances (n, J) from A at `places` (n, P), and sums of absolute terms, which show cancellation."""
        weights = self.weights[levels - 1]
        return np.asarray(known @ weights.T), np.asarray(np.abs(known) @ np.abs(weights).T)


@lru_cache(maxsize=64)
def sums(filter: WaveletFilter, level: int) -> LagSums:
    """Return the sums for levels 1 … `level` of a filter."""
    reach, octaves = max(64, 1 << (4 * filter.length - 1).bit_length()), level + _SPILL
    near_step, far_step = _near_step(filter, reach), _far_step(filter, reach, octaves)
    detail = np.correlate(filter.wavelet, filter.wavelet, "full")[filter.length - 1 :] / 2.0
    near, far = np.zeros(reach + 1), np.zeros((octaves + 2, NODES_OF_OCTAVE))
    near[: filter.length] = detail * np.where(np.arange(filter.length) > 0, 2.0, 1.0)
    rows = np.empty((level, reach + 1 + octaves * NODES_OF_OCTAVE))
    for j in range(level):
        rows[j] = np.concatenate([near, far[:octaves].ravel()])
        from_near, spread = near @ near_step, np.zeros_like(far)
        parts = (far[:octaves, None] @ far_step)[:, 0]
        for k in range(3):
            spread[k : k + octaves] += parts[:, k * NODES_OF_OCTAVE : (k + 1) * NODES_OF_OCTAVE]
        near = from_near[: reach + 1]
        spread[:2] += from_near[reach + 1 :].reshape(2, NODES_OF_OCTAVE)
        far = spread
    return LagSums(freeze(spread_places(reach, octaves)), freeze(rows))


@lru_cache(maxsize=64)
def _near_step(filter: WaveletFilter, reach: int) -> Matrix:
    """Return the matrix (T + 1, T + 1 + 2 NODES) of A_{i+1} at lags 0 … T from A_i and its first two octaves."""
    lags = np.arange(2 * reach + filter.length)
    takes = np.eye(lags.size, reach + 1 + 2 * NODES_OF_OCTAVE)
    for octave, here in enumerate(((lags > reach) & (lags <= 2 * reach), lags > 2 * reach)):
        start = reach + 1 + octave * NODES_OF_OCTAVE
        takes[here] = 0.0
        takes[here, start : start + NODES_OF_OCTAVE] = _polynomials(lags[here] / (reach << octave))
    twice, table = 2 * np.arange(reach + 1), np.zeros((reach + 1, takes.shape[1]))
    for n, weight in enumerate(np.correlate(filter.scaling, filter.scaling, "full") / 2.0, 1 - filter.length):
        table += weight * takes[np.abs(twice - n)]
    return freeze(table)


@lru_cache(maxsize=64)
def _far_step(filter: WaveletFilter, reach: int, octaves: int) -> NDArray[np.float64]:
    """Return matrices (octaves, NODES, 3 NODES) of A_{i+1} in each octave from A_i in it and the next two."""
    smooth = np.correlate(filter.scaling, filter.scaling, "full") / 2.0
    n = np.arange(1 - filter.length, filter.length)
    table = np.zeros((octaves, NODES_OF_OCTAVE, 3 * NODES_OF_OCTAVE))
    for p in range(octaves):
        # In units of the start of the octave.
        lags = 2.0 * (1.5 + 0.5 * _points())[:, None] - np.ldexp(n / reach, -p)
        octave = np.clip(np.floor(np.log2(lags)).astype(np.int64), 0, 2) if p < _SPILL else np.ones(lags.shape, int)
        rows = (
            _polynomials(np.ldexp(lags, -octave).ravel()).reshape(NODES_OF_OCTAVE, n.size, NODES_OF_OCTAVE)
            * smooth[:, None]
        )
        for k in range(3):
            table[p, :, k * NODES_OF_OCTAVE : (k + 1) * NODES_OF_OCTAVE] = np.sum(
                np.where((octave == k)[:, :, None], rows, 0.0), axis=1
            )
    return freeze(table)


def partial_sums(known: Callable[[Vector], Matrix], ends: NDArray[np.int64]) -> tuple[Matrix, Matrix]:
    """Compute Σ f(k) and Σ k f(k) over 1 … m, m in `ends`, for f (functions, n) smooth in octaves (Gauss rules)."""
    first = known(np.arange(1.0, _SHORT + 1))
    moments = np.stack([first, first * np.arange(1.0, _SHORT + 1)])
    near = np.concatenate([np.zeros_like(moments[:, :, :1]), np.cumsum(moments, axis=2)], axis=2)
    octave = np.where(ends <= _SHORT, 0, np.frexp((ends - 0.5) / _SHORT)[1] - 1)
    starts = _SHORT << np.arange(int(octave.max(initial=0)))
    totals = np.concatenate([np.zeros((2, len(first), 1)), np.cumsum(_pieces(known, starts, starts), axis=2)], axis=2)
    start = _SHORT << octave
    total = near[:, :, np.minimum(ends, _SHORT)] + totals[:, :, octave]
    beyond = ends > _SHORT
    total[:, :, beyond] += _pieces(known, start[beyond], (ends - start)[beyond])
    return total[0], total[1]


def _pieces(known: Callable[[Vector], Matrix], starts: Integers, counts: Integers) -> Vector:
    """Compute the sums (2, functions, pieces) of f(k) and k f(k) over the `counts` integers after each of `starts`."""
    nodes, weights = _rules(counts.astype(np.float64))
    lags = starts[:, None] + 0.5 * (counts[:, None] + 1.0) + nodes
    values = known(lags.ravel())
    values = values.reshape(len(values), *lags.shape) * weights
    return np.stack([np.sum(values, axis=2), np.sum(values * lags, axis=2)])


def _rules(counts: Vector) -> tuple[Matrix, Matrix]:
    """Compute Gauss rules for sums over M consecutive integers, M from `counts` (n,): nodes about the centre and
    weights (n, NODES). Their Jacobi matrices have b_i = i² (M² − i²)/(4(4i² − 1)); b_M = 0 removes surplus nodes."""
    i = np.arange(1.0, NODES_OF_OCTAVE)
    b = np.maximum(i**2 * (counts[:, None] ** 2 - i**2) / (4.0 * (4.0 * i**2 - 1.0)), 0.0)
    matrices = np.zeros((counts.size, NODES_OF_OCTAVE, NODES_OF_OCTAVE))
    matrices[:, np.arange(1, NODES_OF_OCTAVE), np.arange(NODES_OF_OCTAVE - 1)] = np.sqrt(b)
    nodes, vectors = np.linalg.eigh(matrices)
    return np.asarray(nodes), np.asarray(counts[:, None] * vectors[:, 0, :] ** 2)


def spread(known: Vector, lags: NDArray[np.int64], reach: int) -> Vector:
    """Interpolate a function at integer lags ≥ 0 from its values at the lags of `spread_places`."""
    # Number of lags that are interpolated at once, so that they fit into the cache.
    batch = 2**14
    out, coefficients = np.empty(lags.size), known[reach + 1 :].reshape(-1, NODES_OF_OCTAVE) @ _coefficients().T
    for start in range(0, lags.size, batch):
        part, target = lags[start : start + batch], out[start : start + batch]
        where = np.where(part <= reach, -1, np.frexp((part - 0.5) / reach)[1] - 1)
        target[where < 0] = known[part[where < 0]]
        for p in np.unique(where[where >= 0]).tolist():
            here = where == p
            target[here] = chebyshev.chebval(2.0 * np.ldexp(part[here] / reach, -p) - 3.0, coefficients[p])
    return out


def spread_places(reach: int, octaves: int) -> Vector:
    """Return the lags 0 … T, with T = `reach`, and the Chebyshev points of the next `octaves` octaves."""
    starts = np.ldexp(float(reach), np.arange(octaves))
    return np.concatenate([np.arange(reach + 1.0), (starts[:, None] * (1.5 + 0.5 * _points())).ravel()])


def _points() -> Vector:
    return np.asarray(chebyshev.chebpts1(NODES_OF_OCTAVE))


@lru_cache(maxsize=1)
def _coefficients() -> Matrix:
    """Return the matrix that maps values at the Chebyshev points to the coefficients of Chebyshev polynomials."""
    table = chebyshev.chebvander(_points(), NODES_OF_OCTAVE - 1).T
    return np.asarray(table * np.where(np.arange(NODES_OF_OCTAVE) > 0, 2.0, 1.0)[:, None] / NODES_OF_OCTAVE)


def _polynomials(x: Vector) -> Matrix:
    """Return the matrix that maps values at the Chebyshev points of the octave [1, 2] to values at x."""
    return np.asarray(chebyshev.chebvander(2.0 * x - 3.0, NODES_OF_OCTAVE - 1) @ _coefficients())
