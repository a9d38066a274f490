"""Statistics that several rooms use: p-values of several tests, means with random effects, and autocorrelations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.lazy import scipy

_NODES = 48  # nodes of the integral over τ; t distributions from 7 degrees of freedom are accurate to four digits


@dataclass(frozen=True, eq=False)
class Effects:
    """Estimates μ̂ = Σ w_i x_i / Σ w_i, w_i = 1/(τ̂² + s_i²), of samples of `count` values: `error` 1/√Σ w_i, `spread2`
    τ̂², Var τ̂² ≈ 2(n − 1)/(Σw − Σw²/Σw)², and `error2_slope` ∂error²/∂τ² = Σw²/(Σw)²."""

    mean: Vector
    error: Vector
    spread2: Vector
    spread2_variance: Vector
    error2_slope: Vector
    count: Vector


def between_units(x: Matrix, s2: Matrix, target: Vector | None = None, start: Vector | None = None) -> Vector:
    """Solve Q(τ²) = Σ (x_i − μ̂)²/(τ² + s_i²) = `target` for τ² ≥ 0; NaN in `x` (…, n) is missing.

    The target n − 1 estimates τ² (Paule and Mandel 1982, J. Res. NBS 87, 377-385), quantiles of χ²_{n−1} give Q-profile
    limits (Viechtbauer 2007, Statistics in Medicine 26, 37-52). 1/Q is concave (Q is a sum of z²/(d + τ²)), so Newton's
    method for 1/Q = 1/target converges from below."""
    finite = np.isfinite(x)
    x, s2 = np.where(finite, x, 0.0), np.where(finite, s2, 1.0)
    statistic = finite.sum(axis=-1) - 1.0 if target is None else np.asarray(target, dtype=np.float64)
    open_ = statistic > 0
    safe = np.where(open_, statistic, 1.0)
    spread2 = np.zeros(x.shape[:-1]) if start is None else np.array(start, dtype=np.float64)
    least = np.min(np.where(finite, s2, np.inf), axis=-1)
    for _ in range(100):  # the slowest sequence of tests/fleets/test_statistics.py takes 12 Newton steps
        w = finite / (spread2[..., None] + s2)
        off = x - (np.sum(w * x, axis=-1) / np.maximum(np.sum(w, axis=-1), np.finfo(float).tiny))[..., None]
        pull = w * off * off
        q, slope = np.sum(pull, axis=-1), np.sum(w * pull, axis=-1)
        step = np.where(open_ & (slope > 0), (q / safe - 1) * q / np.where(slope > 0, slope, 1.0), 0.0)
        step = np.maximum(step, -spread2)
        spread2 = spread2 + step
        if np.all(np.abs(step) <= 1e-9 * (spread2 + least)):
            break
    return np.where(open_, spread2, 0.0)


def effects(x: Matrix, s2: Matrix, spread2: Vector | None = None, start: Vector | None = None) -> Effects:
    """Estimate the mean and the spread of each sample (…, n). If `spread2` is given, it is the known value of τ²."""
    between2 = between_units(x, s2, start=start) if spread2 is None else spread2
    finite = np.isfinite(x)
    w = np.where(finite, 1.0 / (between2[..., None] + np.where(finite, s2, 1.0)), 0.0)
    count, total = finite.sum(axis=-1).astype(np.float64), np.sum(w, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(w * np.where(finite, x, 0.0), axis=-1) / total
        share = np.sum(w * w, axis=-1) / total**2
        variance = np.where(count > 1, 2 * (count - 1) / (total * (1 - share)) ** 2, np.inf)
        return Effects(
            mean=mean, error=1 / np.sqrt(total), spread2=between2, spread2_variance=variance, error2_slope=share,
            count=count,
        )  # fmt: skip


def spread_limits(x: Matrix, s2: Matrix, confidence: float, freedom: Vector | None = None) -> tuple[Vector, Vector]:
    """Return the Q-profile limits of τ²; `freedom` is that of dependent numbers, such as axes of a unit."""
    many, free = _freedom(x, freedom)
    ends = (
        2 * scipy.special.gammaincinv(free / 2, p) * many / free for p in ((1 + confidence) / 2, (1 - confidence) / 2)
    )
    low, high = (between_units(x, s2, target=end) for end in ends)
    return low, high


def prediction_limits(
    x: Matrix, s2: Matrix, confidence: float, freedom: Vector | None = None, widened: Vector | None = None
) -> tuple[Vector, Vector]:
    """Return prediction limits for a further unit's true number: normal N(μ̂(τ²), τ² + Var μ̂), mixed over the
    confidence distribution of τ² by Q(τ²) ~ χ²_{n−1} (Nagashima, Noma and Furukawa 2019, Statistical Methods in Medical
    Research 28, 1689-1702). Without errors it is μ̂ ± t_{n−1} τ̂ √(1 + 1/n). `freedom` replaces n − 1, and `widened`
    multiplies Var μ̂ of dependent numbers."""
    means, sizes, weights = [], [], _SHARES
    for at in _over_spreads(x, s2, freedom):
        means.append(at.mean)
        sizes.append(np.sqrt(at.spread2 + at.error**2 * (1.0 if widened is None else widened)))
    shares = (1 - confidence) / 2, (1 + confidence) / 2
    low, high = (_mixture_cdf(np.array(means), np.array(sizes), weights, share) for share in shares)
    return low, high


def confidence_of_mean(
    x: Matrix, s2: Matrix, confidence: float, freedom: Vector | None = None
) -> tuple[Vector, Vector]:
    """Return confidence limits of μ in the same way; for zero errors, they are the t interval μ̂ ± t_{n−1} τ̂ / √n."""
    candidates = [(at.mean, at.error) for at in _over_spreads(x, s2, freedom)]
    means, sizes = (np.array(each) for each in zip(*candidates, strict=True))
    low, high = (_mixture_cdf(means, sizes, _SHARES, share) for share in ((1 - confidence) / 2, (1 + confidence) / 2))
    return low, high


_LEGENDRE = np.polynomial.legendre.leggauss(_NODES)
_SHARES = _LEGENDRE[1][::-1] / 2


def _over_spreads(x: Matrix, s2: Matrix, freedom: Vector | None) -> Iterator[Effects]:
    """Yield mean and spread at each node of the confidence distribution of τ², with weights `_SHARES`."""
    many, free = _freedom(x, freedom)
    start = None
    # The quantiles of χ² decrease from node to node, so τ² increases, and each search starts at the last solution.
    for node in (1 + _LEGENDRE[0][::-1]) / 2:
        start = between_units(x, s2, target=2 * scipy.special.gammaincinv(free / 2, node) * many / free, start=start)
        yield effects(x, s2, spread2=start)


def _freedom(x: Matrix, freedom: Vector | None) -> tuple[Vector, Vector]:
    """Return n − 1, and the number of degrees of freedom; both are at least 1."""
    many = np.maximum(np.isfinite(x).sum(axis=-1) - 1.0, 1.0)
    return many, many if freedom is None else np.maximum(freedom, 1.0)


def _mixture_cdf(means: Matrix, sizes: Matrix, weights: Vector, share: float) -> Vector:
    """Return a quantile of a mixture of k normal distributions, given in arrays (k, …), by bisection."""
    low, high = np.min(means - 12 * sizes, axis=0), np.max(means + 12 * sizes, axis=0)
    for _ in range(60):
        middle = (low + high) / 2
        below = np.tensordot(weights, scipy.special.ndtr((middle - means) / sizes), axes=1) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2)


def holm(pvalues: ArrayLike) -> Vector:
    """Adjust p-values (n,) by Holm's method (1979, Scandinavian Journal of Statistics 6, 65-70); NaN is no test."""
    p = np.asarray(pvalues, dtype=np.float64)
    count = np.count_nonzero(~np.isnan(p))
    order = np.argsort(p, kind="stable")[:count]  # NaN is last
    adjusted = np.full_like(p, np.nan)
    adjusted[order] = np.maximum.accumulate(np.minimum((count - np.arange(count)) * p[order], 1.0))
    return adjusted


def autocorrelation(values: Vector, lags: int) -> Vector:
    """Return the autocorrelation (L + 1,) at lags 0 … L; pairs with a missing sample (NaN) are left out."""
    finite = np.isfinite(values)
    products = _products(np.where(finite, values - np.mean(values, where=finite), 0.0), lags)
    return np.asarray(products / products[0])


def observed_pairs(values: Vector, lags: int) -> Vector:
    """Return the number of pairs of observed samples (L,) at lags 1 … L."""
    finite = np.isfinite(values)
    if np.all(finite):
        return values.size - np.arange(1.0, lags + 1)
    return np.round(_products(finite.astype(np.float64), lags)[1:])


def _products(z: Vector, lags: int) -> Vector:
    """Return Σ_t z_t z_{t+k} at the lags k = 0 … L, an (L + 1,) array, by the Fourier transform."""
    size = 1 << int(2 * z.size - 1).bit_length()
    transform = np.fft.rfft(z, size)
    return np.asarray(np.fft.irfft(transform * np.conj(transform), size)[: lags + 1])
