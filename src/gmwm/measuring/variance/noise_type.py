"""Dominant power-law noise at a cluster size, by the lag 1 autocorrelation, B1 and R(n), and degrees of freedom."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Integers, Vector
from gmwm.measuring.variance.phase import inner_product

LARGEST_FINITE = 100  # largest cluster size times d + 1 with the sampled covariance; beyond, that of continuous time


def degrees_of_freedom(
    exponents: Integers, clusters: Integers, points: int, *, order: int, overlapping: bool,
    modified: bool = False,
) -> Vector:  # fmt: skip
    """Compute the edf, 2 E(V)²/Var(V) ≥ 1, of variances V that average squared phase differences of order d.

    With the covariance s_z(t) of differences t clusters apart, S per cluster, M in all, and J = min(M, (d + 1) S),

        1/edf = [s_z(0)² + (1 − J/M) s_z(J/S)² + 2 Σ_{0<j<J} (1 − j/M) s_z(j/S)²] / (M s_z(0)²).

    Beyond 240 terms, a trapezoidal rule with 240 nodes is used; small clusters of white and random-walk FM are in
    discrete time. Source: Greenhall and Riley (2003), 35th PTTI Meeting, 267-280, who average the phase and use tables;
    NIST SP 1065 (2008), section 5.4. The exponents α have 2 − 2d < α <= 2 and α > 1 − 2d; d (`order`) is 2 (Allan) or 3
    (Hadamard). S = m if `overlapping`, else 1; if `modified`, differences are averaged over a cluster."""
    result = np.empty(clusters.size)
    # Averaging over a cluster of one sample has no effect.
    averaged = (clusters > 1) & modified
    # White FM is the same for sampled and continuous processes, so it needs no second group.
    endless = ~averaged & (clusters * (order + 1) > LARGEST_FINITE) & (exponents != 0)
    kinds = {*zip(exponents.tolist(), averaged.tolist(), endless.tolist(), strict=True)}
    for alpha, mean, without_end in kinds:
        where = np.flatnonzero((exponents == alpha) & (averaged == mean) & (endless == without_end))
        # Cluster sizes are processed in parts, to bound the memory.
        for start in range(0, where.size, 2048):
            part = where[start : start + 2048]
            result[part] = _of_one_noise(
                alpha, clusters[part], points=points, d=order, overlapping=overlapping, modified=mean
            )
    return np.maximum(result, 1.0)


def _of_one_noise(alpha: int, m: Integers, points: int, d: int, overlapping: bool, modified: bool) -> Vector:
    # Largest number of terms of the sum over lags; a longer sum is replaced by a quadrature rule with this many nodes.
    most_terms = 240
    stride = m.astype(np.float64) if overlapping else np.ones(m.size)
    length = m * (d + 1) if modified else m * d + 1
    estimates = 1.0 + np.floor(stride * (points - length) / m)
    clusters = estimates / stride
    if alpha == 2 and not modified:
        # The edf for white PM, whose differences k clusters apart have the correlation C(2d, d − k)/C(2d, d).
        square = np.ones(estimates.size)
        for k in range(1, d + 1):
            rho = comb(2 * d, d - k) / comb(2 * d, d)
            square += 2 * rho**2 * np.maximum(1 - k / clusters, 0.0)
        return np.asarray(estimates / square)

    # Nodes 0 … terms of the sum, with `density` nodes per cluster.
    terms = np.minimum(estimates, (d + 1) * stride)
    coarse = terms > most_terms
    density = np.where(coarse, most_terms / np.minimum(clusters, d + 1), stride)
    terms = np.where(coarse, most_terms, terms)
    total = clusters * density
    finite = np.ones(m.size) if modified else np.where(m * (d + 1) <= LARGEST_FINITE, m, np.inf)
    if alpha == 1 and not modified:
        # The variance of flicker PM at lag 0 depends on ln n for any n; its covariance at other lags does not.
        finite = np.where(coarse, density, m)
        at_zero = _covariance(
            np.zeros((m.size, 1)), np.asarray(m, dtype=np.float64)[:, None], alpha=alpha, d=d, modified=modified
        )[:, 0]
    else:
        at_zero = _covariance(np.zeros((m.size, 1)), finite[:, None], alpha=alpha, d=d, modified=modified)[:, 0]

    node = np.arange(int(terms.max()) + 1)
    s = _covariance(node / density[:, None], finite[:, None], alpha=alpha, d=d, modified=modified)
    weight = 2 * (1 - node / total[:, None])
    weight[:, 0] = 1
    weight = np.where(node < terms[:, None], weight, 0.0)
    last = terms.astype(np.int64)
    weight[np.arange(m.size), last] = 1 - terms / total
    total_square = np.einsum("ij,ij->i", weight, s * s)
    return np.asarray(total * at_zero**2 / total_square)


def _covariance(t: Vector, filter_factor: Vector, alpha: int, d: int, modified: bool) -> Vector:
    """Compute s_z(t) up to a factor, as the difference of order 2d of s_x with a step of one cluster."""
    result = np.zeros(np.broadcast_shapes(t.shape, filter_factor.shape))
    for k in range(-d, d + 1):
        result += (-1) ** k * comb(2 * d, d + k) * _phase_covariance(t + k, filter_factor, alpha, modified)
    return result


def _phase_covariance(t: Vector, filter_factor: Vector, alpha: int, modified: bool) -> Vector:
    """Compute s_x(t), the generalised autocovariance of the phase at t clusters: −F² times the second difference, step
    1/F, of the kernel for α (for α + 2 if F → ∞). Sums of white and random-walk samples have |t| and |t|³ − |t|/n²."""
    endless = np.isinf(filter_factor)
    f = np.where(endless, 1.0, filter_factor)
    if alpha == 1:
        # S_x for α = 1 at t = u/F: 2 ln F minus the second difference of u² ln|u|; by its series far from 0.
        u = t * f
        far = np.abs(u) > 1000
        near = np.where(far, 0.0, u)
        difference = _square_log(near - 1) + _square_log(near + 1) - 2 * _square_log(near)
        size = np.where(far, np.abs(u), 1.0)
        return np.asarray(2 * np.log(f) - np.where(far, 2 * np.log(size) + 3 - 1 / (6 * size**2), difference))
    if not modified and alpha == 0:
        return -np.abs(t)
    if not modified and alpha == -2:
        return _kernel(t, 0) - np.where(endless, 0.0, np.abs(t) / f**2)
    if endless.all():
        return _kernel(t, alpha + 2)
    return np.asarray(f**2 * (2 * _kernel(t, alpha) - _kernel(t - 1 / f, alpha) - _kernel(t + 1 / f, alpha)))


def _kernel(t: Vector, alpha: int) -> Vector:
    """Compute the generalised autocovariance s_w(t): ±|t|^(3−α), multiplied by ln |t| if 3 − α is even."""
    size = np.abs(t)
    power = size
    for _ in range(2 - alpha):
        power = power * size
    if alpha % 2:
        power = power * np.log(np.where(size > 0, size, 1.0))
    return np.asarray(power if (alpha // 2) % 2 == 0 else -power)


def _square_log(u: Vector) -> Vector:
    size = np.abs(u)
    return np.asarray(size**2 * np.log(np.where(size > 0, size, 1.0)))


@dataclass(frozen=True)
class NoiseType:
    """Power-law noise by its name in time keeping, α of the density f^α of the rate, `slope` of the Allan deviation
    (Hadamard for α ≤ −3), and `term` in inertial sensing or ""."""

    name: str
    exponent: int
    slope: float
    term: str = ""


NOISE_TYPES = (
    NoiseType("white PM", 2, -1.0, "quantization noise"), NoiseType("flicker PM", 1, -1.0),
    NoiseType("white FM", 0, -0.5, "angle or velocity random walk"),
    NoiseType("flicker FM", -1, 0.0, "bias instability"), NoiseType("random walk FM", -2, 0.5, "rate random walk"),
    NoiseType("flicker walk FM", -3, 1.0), NoiseType("random run FM", -4, 1.5),
)  # fmt: skip
"""The noise types in descending order of α."""
DRIFT = NoiseType("drift", -2, 1.0, "rate ramp")
"""A linear change of the rate. Its limits are computed for α = −2, the smallest α with a finite Allan variance."""
UNDETERMINED = NoiseType("undetermined", 0, -0.5)
"""The type of a constant recording. Confidence limits are computed as for white FM."""

AUTOCORRELATION = {
    2: {2: -0.6667, 0: -0.5, -1: -0.2169, -2: 0.25},
    3: {2: -0.75, 0: -0.6667, -1: -0.5348, -2: -0.3333, -3: -0.0354, -4: 0.3939},
}
"""Lag 1 autocorrelation of the phase differences of order d for large clusters, by d and then by α."""

_BY_EXPONENT = {noise.exponent: noise for noise in NOISE_TYPES}
_BY_NAME = {noise.name: noise for noise in (*NOISE_TYPES, DRIFT, UNDETERMINED)}


def noise_type(name: str) -> NoiseType:
    """Return the noise type with this name."""
    return _BY_NAME[name]


def exponents(noise: Sequence[NoiseType]) -> Integers:
    """Return the exponents α of noise types."""
    return np.array([kind.exponent for kind in noise], dtype=np.int64)


def noise_types(phase: Vector, clusters: Integers, variance: Vector, *, reddest: int) -> tuple[NoiseType, ...]:
    """Identify the dominant noise at each cluster size, from every n-th (at most the middle 1024) detrended phase.

    - From 30 values: lag 1 autocorrelation r₁ of differences of order d, which grows until δ = r₁/(1 + r₁) < 1/4. Then
      α = 2 − 2d − round(2δ); for d, n ≥ 2, cluster means are smoother, so the α with the nearest theoretical r₁ is it.
    - From 10 cluster means: B1, the ratio of their variance to their Allan variance. Fewer: the smaller size's type.

    R(n), modified over overlapping Allan variance, distinguishes white and flicker PM (n ≥ 8) or rejects PM (n ≥ 64). A
    mean rise of the rate that causes over half of an Allan variance is drift. `reddest`: smallest α with finite
    variance.

    Source: Riley and Greenhall (2004), Power law noise identification using the lag 1 autocorrelation, 18th EFTF. B1
    and R(n): NIST Special Publication 1065 (2008), section 5.5."""
    types = []
    last = UNDETERMINED
    for n, measured in zip(clusters.tolist(), variance.tolist(), strict=True):
        taken = phase[::n]
        means = taken.size - 1
        # The middle 1024 values are enough to estimate r₁ to about 0.03.
        first = max(taken.size - 1024, 0) // 2
        taken = np.ascontiguousarray(taken[first : first + 1024])
        # With fewer than 16 clusters, a drift cannot be distinguished from a random walk.
        if reddest == DRIFT.exponent and means >= 16 and _drift_variance(phase, n) > measured / 2:
            last = DRIFT
        elif taken.size >= 30:
            last = _by_autocorrelation(taken, n, reddest) or last
        elif means >= 10 and last is not DRIFT:
            last = _by_ratio(taken, reddest) or last
        if last.exponent > 0 and n >= 8 and means >= 10:
            last = _by_modified_ratio(modified_ratio(phase, n), n)
        types.append(last)
    return tuple(types)


def _drift_variance(phase: Vector, n: int) -> float:
    """Compute the Allan variance of the mean linear rise, which is half the squared change of the rate per cluster."""
    # The mean of the second differences at every n-th sample telescopes to the differences at both ends.
    last = (phase.size - 1) // n * n
    change = (phase[last] - phase[last - n] - phase[n] + phase[0]) / (last // n - 1)
    return float(change / n) ** 2 / 2


def _by_autocorrelation(phase: Vector, n: int, reddest: int) -> NoiseType | None:
    z = phase
    for d in range(4):
        z = z - np.add.reduce(z) / z.size
        # BLAS uses threads only for longer vectors.
        squares = float(z @ z)
        if not squares > 0:
            return None
        r1 = float(z[:-1] @ z[1:]) / squares
        delta = r1 / (1 + r1)
        if delta < 0.25 or d == 3:
            break
        z = z[1:] - z[:-1]
    if d in AUTOCORRELATION and n > 1:
        expected = AUTOCORRELATION[d]
        alpha = min(expected, key=lambda exponent: abs(expected[exponent] - r1))
    else:
        alpha = min(2, 2 - 2 * d - round(2 * delta))
    return _BY_EXPONENT[max(reddest, alpha)]


def b1_ratio(means: int, mu: int) -> float:
    """Compute B1(N, μ), the ratio of the variance of N cluster means to their Allan variance, which is ∝ τ^μ."""
    if mu == 0:
        return means * math.log(means) / (2 * (means - 1) * math.log(2))
    return means * (1 - float(means) ** mu) / (2 * (means - 1) * (1 - 2.0**mu))


def _by_ratio(phase: Vector, reddest: int) -> NoiseType | None:
    rates = np.diff(phase)
    steps = np.diff(rates)
    allan = inner_product(steps, steps) / (2 * steps.size)
    if not allan > 0:
        return None
    ratio = float(rates.var(ddof=1)) / allan
    # The threshold between two types is the geometric mean of their ratios. Exponents −μ − 1, starting from PM noise.
    mu = -2
    while mu < 2 and ratio > math.sqrt(b1_ratio(rates.size, mu) * b1_ratio(rates.size, mu + 1)):
        mu += 1
    return _BY_EXPONENT[2 if mu == -2 else max(reddest, -mu - 1)]


def modified_ratio(phase: Vector, n: int) -> float:
    """Return the ratio of the modified to the overlapping Allan variance; 1 if the phase is too short for it."""
    if 3 * n > phase.size:
        return 1.0
    modified = _core.moving_second_differences(phase, n) / (phase.size - 3 * n + 1) / n**2
    plain = _core.second_differences(phase, n) / (phase.size - 2 * n)
    return modified / plain if plain > 0 else 1.0


def _by_modified_ratio(ratio: float, n: int) -> NoiseType:
    """Return the noise type for R(n): 1/n for white PM, 3.37/(1.04 + 3 ln n) for flicker PM, ½ for white FM."""
    white, flicker, frequency = 1 / n, 3.37 / (1.04 + 3 * math.log(n)), 0.5
    if n >= 64 and ratio > math.sqrt(flicker * frequency):
        return _BY_EXPONENT[0]
    return _BY_EXPONENT[2 if ratio <= math.sqrt(white * flicker) else 1]
