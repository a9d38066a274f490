"""Units that differ and are measured with error: where they lie, how far apart, and where the next one will lie.

x_i ~ N(μ, τ² + s_i²), with s_i known. Every function takes many such samples at once: arrays (…, n), NaN where a unit
has no number.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Matrix, Vector

_STEPS = 100
"""More than the slowest of Newton's sequences was seen to take (12)."""
_NODES = 48
"""Of the integral over what τ may be; a t distribution of 7 degrees of freedom comes out to four digits."""


@dataclass(frozen=True, eq=False)
class Effects:
    """Location and spread of each sample.

    Attributes
    ----------
    mean, error : (…) arrays
        μ̂ = Σ w_i x_i / Σ w_i with w_i = 1/(τ̂² + s_i²), and its standard error 1/√Σ w_i.
    spread2 : (…) array
        τ̂².
    spread2_variance : (…) array
        Var τ̂² ≈ 2(n − 1)/(Σw − Σw²/Σw)².
    error2_slope : (…) array
        By how much the square of `error` grows with τ²: Σw²/(Σw)².
    count : (…) array
        n.
    """

    mean: Vector
    error: Vector
    spread2: Vector
    spread2_variance: Vector
    error2_slope: Vector
    count: Vector


def between_units(x: Matrix, s2: Matrix, target: Vector | None = None, start: Vector | None = None) -> Vector:
    """τ² ≥ 0 at which Q(τ²) = Σ (x_i − μ̂)²/(τ² + s_i²) comes down to `target`; 0 where it begins below.

    With the target n − 1 this is the estimate of Paule and Mandel, with quantiles of χ² of n − 1 degrees of freedom
    the limits of the Q-profile interval. 1/Q is concave in τ² (with the data turned so that their covariance is
    diagonal, Q is a sum of z²/(d + τ²)), so Newton's sequence for 1/Q = 1/target comes from below and cannot miss.

    Parameters
    ----------
    x, s2 : (…, n) arrays
        Numbers, and the squares of their standard errors, above zero; NaN in `x` where there is none.
    target : (…) array, optional
        n − 1 by default.
    start : (…) array, optional
        Where to begin; 0 by default.

    References
    ----------
    Paule and Mandel (1982), Consensus values and weighting factors, J. Res. NBS 87, 377-385. Viechtbauer (2007),
    Confidence intervals for the amount of heterogeneity in meta-analysis, Statistics in Medicine 26, 37-52.
    """
    there = np.isfinite(x)
    x, s2 = np.where(there, x, 0.0), np.where(there, s2, 1.0)
    wanted = there.sum(axis=-1) - 1.0 if target is None else np.asarray(target, dtype=np.float64)
    open_ = wanted > 0
    safe = np.where(open_, wanted, 1.0)
    found = np.zeros(x.shape[:-1]) if start is None else np.array(start, dtype=np.float64)
    least = np.min(np.where(there, s2, np.inf), axis=-1)
    for _ in range(_STEPS):
        w = there / (found[..., None] + s2)
        off = x - (np.sum(w * x, axis=-1) / np.maximum(np.sum(w, axis=-1), np.finfo(float).tiny))[..., None]
        pull = w * off * off
        q, slope = np.sum(pull, axis=-1), np.sum(w * pull, axis=-1)
        step = np.where(open_ & (slope > 0), (q / safe - 1) * q / np.where(slope > 0, slope, 1.0), 0.0)
        step = np.maximum(step, -found)
        found = found + step
        if np.all(np.abs(step) <= 1e-9 * (found + least)):
            break
    return np.where(open_, found, 0.0)


def effects(x: Matrix, s2: Matrix, spread2: Vector | None = None, start: Vector | None = None) -> Effects:
    """Location and spread of each sample (…, n); with `spread2` given, as if τ² were known to be that."""
    known = between_units(x, s2, start=start) if spread2 is None else spread2
    there = np.isfinite(x)
    w = np.where(there, 1.0 / (known[..., None] + np.where(there, s2, 1.0)), 0.0)
    count, total = there.sum(axis=-1).astype(np.float64), np.sum(w, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.sum(w * np.where(there, x, 0.0), axis=-1) / total
        share = np.sum(w * w, axis=-1) / total**2
        variance = np.where(count > 1, 2 * (count - 1) / (total * (1 - share)) ** 2, np.inf)
        return Effects(
            mean=mean,
            error=1 / np.sqrt(total),
            spread2=known,
            spread2_variance=variance,
            error2_slope=share,
            count=count,
        )


def spread_limits(x: Matrix, s2: Matrix, confidence: float, freedom: Vector | None = None) -> tuple[Vector, Vector]:
    """Confidence limits of τ² by the Q-profile; `freedom` where numbers are not independent, as of axes of a unit."""
    from scipy.stats import chi2

    many, free = _freedom(x, freedom)
    ends = (chi2.ppf(p, free) * many / free for p in ((1 + confidence) / 2, (1 - confidence) / 2))
    low, high = (between_units(x, s2, target=end) for end in ends)
    return low, high


def predicted(
    x: Matrix, s2: Matrix, confidence: float, freedom: Vector | None = None, widened: Vector | None = None
) -> tuple[Vector, Vector]:
    """Limits between which the true number of a further unit lies.

    τ² is not known, but Q(τ²) at the true one is χ² of n − 1 degrees of freedom: this is its confidence distribution.
    Over it, μ̂(τ²) ± √(τ² + Var μ̂) is mixed. Where the errors s_i are nothing this is the t interval μ̂ ± t_{n−1} τ̂
    √(1 + 1/n), exactly; where they are large, it knows that τ may be other than τ̂.

    Parameters
    ----------
    x, s2 : (…, n) arrays
        As for `between_units`.
    confidence : float
        Probability that the further unit lies there.
    freedom : (…) array, optional
        Degrees of freedom in place of n − 1.
    widened : (…) array, optional
        Factor of Var μ̂, where numbers are not independent.

    References
    ----------
    Nagashima, Noma and Furukawa (2019), Prediction intervals for random-effects meta-analysis: a confidence
    distribution approach, Statistical Methods in Medical Research 28, 1689-1702.
    """
    from scipy.stats import chi2

    many, free = _freedom(x, freedom)
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    nodes, weights = (1 + nodes) / 2, weights / 2
    means, sizes = [], []
    start = None
    # From the largest χ² down τ² only grows: each sequence begins where the last one ended.
    for node in nodes[::-1]:
        start = between_units(x, s2, target=chi2.ppf(node, free) * many / free, start=start)
        at = effects(x, s2, spread2=start)
        means.append(at.mean)
        sizes.append(np.sqrt(start + at.error**2 * (1.0 if widened is None else widened)))
    shares = (1 - confidence) / 2, (1 + confidence) / 2
    low, high = (_mixed(np.array(means), np.array(sizes), weights[::-1], share) for share in shares)
    return low, high


def _freedom(x: Matrix, freedom: Vector | None) -> tuple[Vector, Vector]:
    """n − 1, and the degrees of freedom, one at least."""
    many = np.maximum(np.isfinite(x).sum(axis=-1) - 1.0, 1.0)
    return many, many if freedom is None else np.maximum(freedom, 1.0)


def _mixed(means: Matrix, sizes: Matrix, weights: Vector, share: float) -> Vector:
    """Quantile of a mixture of normal distributions (k, …), by bisection."""
    from scipy.special import ndtr

    low, high = np.min(means - 12 * sizes, axis=0), np.max(means + 12 * sizes, axis=0)
    for _ in range(60):
        middle = (low + high) / 2
        below = np.tensordot(weights, ndtr((middle - means) / sizes), axes=1) < share
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return np.asarray((low + high) / 2)
