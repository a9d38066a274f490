"""Equivalent degrees of freedom of variances of finite differences, for chi-square confidence limits."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector

LARGEST_FINITE = 100
"""Largest product of the cluster size and d + 1 for which the covariance of the sampled process is used; for larger
products, that of the process in continuous time."""


def degrees_of_freedom(
    exponents: NDArray[np.int64], clusters: NDArray[np.int64], points: int, *, order: int, overlapping: bool,
    modified: bool = False,
) -> Vector:  # fmt: skip
    """Compute the equivalent degrees of freedom (edf) of variances that average squared phase differences of order d.

    The edf of a variance V are 2 E(V)²/Var(V), and at least 1. Let s_z(t) be the covariance of two differences that are
    t clusters apart, S the number of differences per cluster, M the total number of differences, and
    J = min(M, (d + 1) S). Then

        1/edf = [s_z(0)² + (1 − J/M) s_z(J/S)² + 2 Σ_{0<j<J} (1 − j/M) s_z(j/S)²] / (M s_z(0)²).

    A sum of more than 240 terms is replaced by the trapezoidal rule with 240 nodes. For small clusters, white and
    random walk FM are discrete-time processes. Source: Greenhall and Riley (2003), 35th PTTI Meeting, 267-280, who
    average the phase over a sample and use tabulated limits; NIST SP 1065 (2008), section 5.4.

    `exponents` are the noise exponents α (2 − 2d < α <= 2 and α > 1 − 2d) of clusters of m samples, `points` the number
    of values of the phase, and `order` is d (2: Allan, 3: Hadamard). If `overlapping`, a difference starts at every
    sample (S = m, else S = 1); if `modified`, differences are averaged over a cluster.

    >>> degrees_of_freedom(np.array([0, 0]), np.array([1, 10]), 1001, order=2, overlapping=True).round(1)
    array([666.2, 146.1])
    """
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


def _of_one_noise(alpha: int, m: NDArray[np.int64], points: int, d: int, overlapping: bool, modified: bool) -> Vector:
    # Largest number of terms of the sum over lags; a longer sum is replaced by a quadrature rule with this many nodes.
    most_terms = 240
    stride = m.astype(np.float64) if overlapping else np.ones(m.size)
    length = m * (d + 1) if modified else m * d + 1
    estimates = 1.0 + np.floor(stride * (points - length) / m)
    clusters = estimates / stride
    if alpha == 2 and not modified:
        return _white_phase(estimates, clusters, d)

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


def _white_phase(estimates: Vector, clusters: Vector, d: int) -> Vector:
    """Compute the edf for white PM, whose differences k clusters apart have the correlation C(2d, d − k)/C(2d, d)."""
    square = np.ones(estimates.size)
    for k in range(1, d + 1):
        rho = comb(2 * d, d - k) / comb(2 * d, d)
        square += 2 * rho**2 * np.maximum(1 - k / clusters, 0.0)
    return np.asarray(estimates / square)


def _covariance(t: Vector, filter_factor: Vector, alpha: int, d: int, modified: bool) -> Vector:
    """Compute s_z(t) up to a factor, as the difference of order 2d of s_x with a step of one cluster."""
    result = np.zeros(np.broadcast_shapes(t.shape, filter_factor.shape))
    for k in range(-d, d + 1):
        result += (-1) ** k * comb(2 * d, d + k) * _phase_covariance(t + k, filter_factor, alpha, modified)
    return result


def _phase_covariance(t: Vector, filter_factor: Vector, alpha: int, modified: bool) -> Vector:
    """Compute s_x(t), the generalised autocovariance of the phase, at a lag of t clusters. s_x is −F² times the second
    difference, with a step of 1/F, of the kernel s_w for α, with F = `filter_factor`. For F → ∞ it is the kernel for α
    + 2. For running sums of white and random-walk samples it is |t| and |t|³ − |t|/n²."""
    endless = np.isinf(filter_factor)
    f = np.where(endless, 1.0, filter_factor)
    if alpha == 1:
        return _flicker_phase(t * f, f)
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


def _flicker_phase(u: Vector, f: Vector) -> Vector:
    """Compute s_x for α = 1 at t = u/F: 2 ln F minus the second difference of u² ln|u|, far from 0 by its series 2
    ln|u| + 3 − 1/(6u²) without cancellation."""
    far = np.abs(u) > 1000
    near = np.where(far, 0.0, u)
    difference = _square_log(near - 1) + _square_log(near + 1) - 2 * _square_log(near)
    size = np.where(far, np.abs(u), 1.0)
    return np.asarray(2 * np.log(f) - np.where(far, 2 * np.log(size) + 3 - 1 / (6 * size**2), difference))


def _square_log(u: Vector) -> Vector:
    size = np.abs(u)
    return np.asarray(size**2 * np.log(np.where(size > 0, size, 1.0)))
