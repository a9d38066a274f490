"""Estimators that the field uses beside the wavelet moments: slopes of the Allan deviation, and Vaccaro and Zaki's.

The maximum of the likelihood of a logarithmically sampled record has a file of its own (`validation/log_sampled.py`).
Only the ideas are those of the papers: formulas were derived anew and nothing here is anybody's program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import gmwm

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

FULL_STEPS = 10
"""Iterations after which the weights move half of the way only."""


FEWEST = 16
"""Clusters in the record at the longest averaging time at which a slope is read."""

NEARLY_ALL = 0.9
"""Share of the Allan variance from which on the curve counts as that of one term."""


def slopes(x: Vector, rate: float, model: gmwm.Model, *, told: bool = False) -> dict[str, float]:
    """Parameters of a model by regression on the slopes of the Allan deviation; 0 where no slope was found.

    `gmwm.avlr` reads N, K and Q; σ² = N² f, γ² = K² / f and Q² f² are the parameters. Gauss-Markov processes have no
    slope of their own, and are not in the answer.

    Parameters
    ----------
    x : (N,) array
        The record.
    rate : float
        Samples per second (Hz).
    model : Model
        Which terms to look for.
    told : bool
        Whether to select the averaging times with the values of `model`, which are then the truth: the octaves where a
        term has nine tenths of the Allan variance, or the one where it has most. A user does not know these times.
    """
    factors = {"WN": ("WN.sigma2", "N", rate), "RW": ("RW.gamma2", "K", 1 / rate), "QN": ("QN.q2", "Q", rate**2)}
    wanted = {term: factors[term] for term in model.terms if term in factors}
    ranges = _dominated(model, x.size, rate) if told else {}
    places = {wanted[term][1]: ranges[term] for term in wanted if told}
    letters = [letter for _, letter, _ in wanted.values()]
    read = gmwm.avlr(x, rate, terms=letters, ranges=places).coefficients  # type: ignore[arg-type]
    return {name: read.get(letter, 0.0) ** 2 * factor for name, letter, factor in wanted.values()}


def _dominated(model: gmwm.Model, samples: int, rate: float) -> dict[str, tuple[float, float]]:
    """Averaging times (s) between which each term of a model has nearly all of its Allan variance."""
    levels = np.arange(1, (samples // FEWEST).bit_length() + 1)
    parts = model.decomposition(levels, rate)
    total = np.sum(list(parts.values()), axis=0)
    ranges = {}
    for term, part in parts.items():
        share = part / total
        tau = 2.0 ** (levels[share >= min(NEARLY_ALL, float(share.max()))] - 1) / rate
        ranges[term] = (0.99 * float(tau.min()), 1.01 * float(tau.max()))
    return ranges


@dataclass(frozen=True)
class WhiteAndWalk:
    """White noise R = σ² and increments Q = γ² of a random walk, both per sample, with their covariance (2, 2)."""

    noise: float
    walk: float
    covariance: Matrix
    iterations: int


def vaccaro_zaki(x: Vector, *, tolerance: float = 1e-9, most: int = 200) -> WhiteAndWalk:
    """R and Q of white noise and a random walk: the best linear unbiased estimate from Allan variances.

    With a (J,) the Allan variances of n = 1, 2, 4 … samples, E a = H (R, Q) and C = Cov a,

        (R, Q) = (Hᵀ C⁻¹ H)⁻¹ Hᵀ C⁻¹ a.

    Theirs is the idea: the line through all points of the curve, weighted by the exact covariance between the points,
    which is quadratic in R and Q. That covariance was derived anew here (`allan_covariance`), for clusters side by
    side. Ours is also what to do about C depending on what is sought: it starts at R from first differences and Q = 0
    and is taken at the estimate until that stands still; in C, a Q below 0 counts as 0. The estimate itself may be
    negative.

    Parameters
    ----------
    x : (N,) array
        The record, of at least 8 samples.
    tolerance : float
        Relative change at which the iteration ends.
    most : int
        Iterations after which it is taken as it is.

    References
    ----------
    Vaccaro, R. J. and Zaki, A. S. (2012), Statistical modeling of rate gyros, IEEE Transactions on Instrumentation
    and Measurement 61(3), 673-684.

    Examples
    --------
    >>> truth = gmwm.Model.parse("WN(sigma2=4e-6) + RW(gamma2=1e-10)")
    >>> found = vaccaro_zaki(truth.simulate(100_000, 100.0, np.random.default_rng(1)))
    >>> print(f"{found.noise:.2e} ± {found.covariance[0, 0] ** 0.5:.0e}")
    4.01e-06 ± 2e-08
    """
    allan = allan_points(x)
    clusters = 2.0 ** np.arange(allan.size)
    design = np.column_stack([1 / clusters, (2 * clusters**2 + 1) / (6 * clusters)])
    noise, walk, iterations = float(np.mean(np.diff(x) ** 2)) / 2, 0.0, 0
    while True:
        weighted = np.linalg.solve(allan_covariance(noise, max(walk, 0.0), x.size), design)
        covariance = np.linalg.inv(design.T @ weighted)
        found = covariance @ weighted.T @ allan
        iterations += 1
        if np.all(np.abs(found - (noise, walk)) <= tolerance * np.abs(found)) or iterations == most:
            return WhiteAndWalk(*found.tolist(), covariance, iterations)
        # Where there is hardly any random walk, full steps go back and forth.
        share = 1.0 if iterations < FULL_STEPS else 0.5
        noise, walk = ((1 - share) * np.array([noise, walk]) + share * found).tolist()


def allan_points(x: Vector) -> Vector:
    """Allan variances (J,) of clusters of n = 1, 2, 4 … samples side by side: half the mean squared difference."""
    points, sums, size = [], x - x.mean(), 1
    while sums.size >= 2:
        points.append(float(np.mean(np.diff(sums) ** 2)) / (2 * size**2))
        even = sums.size // 2 * 2
        sums, size = sums[0:even:2] + sums[1:even:2], 2 * size
    return np.array(points)


def allan_covariance(noise: float, walk: float, samples: int) -> Matrix:
    """Cov a (J, J) of the Allan variances of `allan_points` of white noise R and a random walk Q.

    The difference D of two neighbouring clusters of n samples weighs the increments of a random walk by a triangle of
    height 1 over 2 n samples, and white noise by ∓1/n. Let a coarser difference have clusters of m samples, and let
    the middle of the finer one lie at v samples from its beginning, v = 0, n, 2n … 2m: a corner of the coarse triangle
    g is then in the middle of the fine one or outside it. With d = (1, −2, 1)/m the bends of g at v = 0, m, 2m and 0
    elsewhere,

        Cov(D_n, D_m) = Q n g(v) + d(v) [Q (n² − 1)/6 − R],   Cov(a_n, a_m) = Σ Σ Cov(D_n, D_m)² / (2 M_n M_m)

    over all pairs in the record, M_n = ⌊N/n⌋ − 1. All that is summed over v is g² = Σ (2m² + n²)/(3mn) and three
    bends; a fine difference at v = 0 or 2m is missing where the record begins or ends there.
    """
    levels = samples.bit_length() - 1
    sizes = [2**j for j in range(levels)]
    counts = [samples // n - 1 for n in sizes]
    result = np.empty((levels, levels))
    for j, n in enumerate(sizes):
        bend = walk * (n * n - 1) / 6 - noise
        for k in range(j, levels):
            m, coarse = sizes[k], counts[k]
            # At the middle, and at the ends of all differences, but those at which the record stops.
            ends = 2 * coarse - 1 - (coarse * m + m + n > samples)
            squares = walk**2 * n * (2 * m * m + n * n) / (3 * m) * coarse
            squares += (ends + 4 * coarse) * (bend / m) ** 2 - 4 * coarse * walk * n * bend / m
            result[j, k] = result[k, j] = squares / (2 * counts[j] * coarse)
    return result
