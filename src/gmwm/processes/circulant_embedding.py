"""Gaussian paths of any stationary autocovariance, exact, by Fourier transform.

The autocovariance r(0), …, r(M), mirrored, is the first row of a circulant matrix, whose eigenvalues are its Fourier
transform; where none is negative, white noise through their roots has that matrix for its covariance (Davies and Harte
1987, Dietrich and Newsam 1997). O(N log N) for N samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.errors import MissingTheoryError

ROUNDING = 1e-9
"""Share of the largest eigenvalue up to which negative ones are rounding, or too small to be seen in a path."""
LARGEST = 1 << 21
"""Half of the longest circle that an autocovariance is looked for on."""


def half_period(n: int) -> int:
    """The power of two M ≥ n that paths of n samples are embedded by."""
    return 1 << max(n - 1, 1).bit_length()


def amplitudes(autocovariance: Callable[[Vector], Vector], half: int) -> Vector:
    """Roots of the eigenvalues (M + 1,) of the circulant matrix of r(0) … r(M), M = `half`.

    Eigenvalues below zero are rounding for every autocovariance that this is used for, and count as zero.
    """
    return np.asarray(np.sqrt(np.maximum(_eigenvalues(autocovariance, half), 0.0)))


def _eigenvalues(autocovariance: Callable[[Vector], Vector], half: int) -> Vector:
    r = autocovariance(np.arange(half + 1.0))
    return np.asarray(np.fft.rfft(np.concatenate([r, r[-2:0:-1]])).real)


def safe_amplitudes(autocovariance: Callable[[Vector], Vector], n: int) -> Vector:
    """`amplitudes` for paths of n samples of any autocovariance: the circle is doubled until it has that covariance.

    Raises
    ------
    MissingTheoryError
        If no circle of up to 2^22 samples has it: the autocovariance is none, or does not die away before.
    """
    half = half_period(n)
    while half <= LARGEST:
        eigenvalues = _eigenvalues(autocovariance, half)
        if eigenvalues.min() >= -ROUNDING * eigenvalues.max():
            return np.asarray(np.sqrt(np.maximum(eigenvalues, 0.0)))
        half *= 2
    raise MissingTheoryError(
        f"paths cannot be simulated: no circulant embedding of up to {2 * LARGEST} samples has this autocovariance",
        largest=2 * LARGEST,
        advice="Check that the autocovariance is positive definite, or define `state_space` or `simulate`.",
    )


def paths(roots: Vector, n: int, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Gaussian paths (count, n) of the circulant matrix with these roots of its eigenvalues, n ≤ M + 1."""
    half = roots.size - 1
    out = np.empty((count, n))
    weight = roots * math.sqrt(half)
    weight[[0, -1]] *= math.sqrt(2.0)
    for path in out:
        spectrum = rng.standard_normal(half + 1) + 0j
        spectrum[1:-1] += 1j * rng.standard_normal(half - 1)
        path[:] = np.fft.irfft(weight * spectrum, 2 * half)[:n]
    return out
