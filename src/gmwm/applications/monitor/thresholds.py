"""Compute the thresholds of the charts for a given average run length between false alarms."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Vector

DESIGN_SHIFT = 1.0
"""Shift of a block mean, in standard deviations of block means, for which the level charts have the shortest delay."""
SOLVED_RUN_BLOCKS = 1e5
"""Run length (blocks) of the integral equation. For others, the threshold is extrapolated in its logarithm, with an
error below 4 % from 10⁴ to 10⁸ blocks (tests/monitor/test_charts.py)."""


def level_threshold(run_length: float) -> float:
    """Return the threshold h of the chart S ← max(0, S + z − SHIFT/2) for independent standard normal z. The average
    run length in blocks is (e^{2κb} − 2κb − 1)/(2κ²) with κ = SHIFT/2 and b = h + 1.166, Siegmund's correction for
    discrete time (Siegmund 1985, Sequential Analysis, section 2.6)."""
    kappa = DESIGN_SHIFT / 2.0
    low, high = 0.0, math.log(run_length + 10.0) / (2.0 * kappa) + 10.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        b = middle + 1.166
        length = (math.exp(2.0 * kappa * b) - 2.0 * kappa * b - 1.0) / (2.0 * kappa**2)
        low, high = (middle, high) if length < run_length else (low, middle)
    return high


def noise_threshold(run_length: float, shape: float, ratio: float) -> float:
    """Return the threshold h of the chart S ← max(0, S + l) with the increments l = k[y(1 − 1/R) − ln R]. The values y
    are independent, with a Gamma distribution of shape k and mean 1. R is the ratio of variances for which the chart
    has the shortest delay. The average run length is at least e^h (Lorden 1971, Annals of Mathematical Statistics 42,
    1897-1908), and C e^h for large h. Page's integral equation, solved for 10⁵ blocks, gives C (Brook and Evans 1972,
    Biometrika 59, 539-549)."""
    return max(math.log(run_length) - _advantage(round(shape, 2), ratio), 0.5)


@lru_cache(maxsize=4096)
def _advantage(shape: float, ratio: float) -> float:
    """Return ln C = ln(run length) − h at a run length of 10⁵ blocks."""
    low, high = 0.05, math.log(SOLVED_RUN_BLOCKS) + 1.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if noise_run_length(middle, shape, ratio) < SOLVED_RUN_BLOCKS else (low, middle)
    return math.log(SOLVED_RUN_BLOCKS) - high


@lru_cache(maxsize=64)
def shape_factor(sums: int, ratio: float) -> float:
    """Return the factor for the shape k of a noise chart that corrects for correlated coefficients of `sums` block sums
    each. Mean squares of overlapping coefficients have a longer tail than a Gamma distribution with shape k = 1/Var y:
    at R = 2, up to 1.4 times as many false alarms in 500 blocks. With the factor, E e^l = 1 holds in a long run of
    blocks, for white normal innovations. Consecutive coefficients of m block sums have the spectral density g(ω) = |Σ ±
    e^{ikω}|²/m. By Szegő's theorem, the shape q per coefficient follows from −½ mean ln(1 − 2q(1 − 1/R)g(ω)) = q ln R,
    over all ω."""
    from scipy.optimize import brentq

    omega = (np.arange(4096) + 0.5) * np.pi / 4096
    signs = np.repeat([-1.0, 1.0], sums // 2)
    density = np.square(np.abs(np.exp(1j * np.outer(omega, np.arange(sums))) @ signs)) / sums
    usual = 0.5 / float(np.mean(density**2))
    slope = 1.0 - 1.0 / ratio

    def excess(factor: float) -> float:
        q = factor * usual
        return float(-0.5 * np.mean(np.log1p(-2.0 * q * slope * density))) - q * math.log(ratio)

    largest = 0.5 / (usual * slope * float(density.max())) if slope > 0 else 10.0
    return float(brentq(excess, 1e-3, min(largest * (1.0 - 1e-9), 10.0)))


def noise_run_length(threshold: float, shape: float, ratio: float, cells: int = 120) -> float:
    """Return the average run length (blocks) of a noise chart that starts at 0, from Page's equation on cells."""
    width = threshold / cells
    states = np.concatenate([[0.0], (np.arange(cells) + 0.5) * width])
    # All rows are values of one function: the probability of an increment below each multiple of half a cell.
    places = np.asarray(0.5 * width * np.arange(-2.0 * cells, 2 * cells + 1), dtype=np.float64)
    below = _increment_cdf(places, shape, ratio)
    twice = np.rint(2.0 * states / width).astype(np.int64)
    edges = 2 * np.arange(cells + 1) + 2 * cells
    cumulative = below[edges[None, :] - twice[:, None]]
    moves = np.empty((cells + 1, cells + 1))
    moves[:, 1:] = np.diff(cumulative, axis=1)
    moves[:, 0] = cumulative[:, 0]
    return float(np.linalg.solve(np.eye(cells + 1) - moves, np.ones(cells + 1))[0])


def _increment_cdf(values: Vector, shape: float, ratio: float) -> Vector:
    """Return the probability that an increment l is at most `values`."""
    from scipy.special import gammainc, gammaincc

    slope = 1.0 - 1.0 / ratio
    y = np.maximum((values / shape + math.log(ratio)) / slope, 0.0)
    probability = gammainc(shape, y * shape) if slope > 0 else gammaincc(shape, y * shape)
    return np.asarray(probability, dtype=np.float64)


def spike_limit(run_length: float) -> float:
    """Return the limit that |e| exceeds on average once in `run_length` samples, for standard normal e."""
    from scipy.special import ndtri

    return float(-ndtri(0.5 / run_length))
