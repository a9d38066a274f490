"""Slow and obvious twins of the Haar kernel: the definition, in extended precision and in exact arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

Extended = np.longdouble
"""80-bit on x86-64, the double elsewhere: check `extended_precision` before asking for 1e-12."""

extended_precision = np.finfo(Extended).eps < 2e-19


def coefficients(x: NDArray[np.float64], level: int) -> NDArray[np.longdouble]:
    """W_{j,t} = 2^-j (Σ_{l<h} x_{t-l} - Σ_{h<=l<2h} x_{t-l}) for t = 2^j - 1 … N - 1, by doubling block means."""
    means = x.astype(Extended)
    width = 1
    for _ in range(level - 1):
        means = (means[width:] + means[:-width]) / 2
        width *= 2
    return (means[width:] - means[:-width]) / 2


def sums_of_squares(x: NDArray[np.float64], levels: int, begin: int, end: int) -> NDArray[np.longdouble]:
    """Sum of W_{j,t}² over begin <= t < end, for j = 1 … levels."""
    sums = np.zeros(levels, dtype=Extended)
    for j in range(1, levels + 1):
        first = 2**j - 1
        sums[j - 1] = np.sum(coefficients(x, j)[max(begin - first, 0) : max(end - first, 0)] ** 2)
    return sums


def variance(x: NDArray[np.float64], levels: int) -> NDArray[np.longdouble]:
    """ν̂_j² = mean of W_{j,t}², j = 1 … levels."""
    counts = x.size - 2 ** np.arange(1, levels + 1) + 1
    return sums_of_squares(x, levels, 0, x.size) / counts


def exact_variance(x: list[int], level: int) -> Fraction:
    """ν̂_j² of integers without any rounding."""
    h = 2 ** (level - 1)
    sums = [0]
    for value in x:
        sums.append(sums[-1] + value)
    squares = [(sums[i] - 2 * sums[i - h] + sums[i - 2 * h]) ** 2 for i in range(2 * h, len(sums))]
    return Fraction(sum(squares), 4**level * len(squares))
