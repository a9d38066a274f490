"""Exact Gaussian paths for any stationary autocovariance, by circulant embedding, in O(N log N).

r(0), …, r(M), …, r(1) is the first row of a circulant matrix. Its Fourier transform gives the eigenvalues; if none is
negative, white noise times their roots has the autocovariance (Davies and Harte 1987, Dietrich and Newsam 1997)."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import MissingTheoryError

LARGEST_EMBEDDING = 1 << 21  # Largest M. The circulant matrix has 2M rows.


def half_period(n: int) -> int:
    """Return M for paths of n samples, which is the smallest power of two that is at least n and at least 2."""
    return 1 << max(n - 1, 1).bit_length()


def amplitudes(autocovariance: Callable[[Vector], Vector], half: int) -> Vector:
    """Compute the roots (M + 1,) of circulant eigenvalues; negative ones, rounding for all callers, become zero."""
    return np.asarray(np.sqrt(np.maximum(_eigenvalues(autocovariance, half), 0.0)))


def _eigenvalues(autocovariance: Callable[[Vector], Vector], half: int) -> Vector:
    r = autocovariance(np.arange(half + 1.0))
    return np.asarray(np.fft.rfft(np.concatenate([r, r[-2:0:-1]])).real)


def safe_amplitudes(autocovariance: Callable[[Vector], Vector], n: int) -> Vector:
    """Compute `amplitudes` for n samples of any autocovariance, with M doubled until no eigenvalue is negative. Raises
    MissingTheoryError at 2^22 rows: it is no autocovariance, or it decays too slowly."""
    half = half_period(n)
    while half <= LARGEST_EMBEDDING:
        eigenvalues = _eigenvalues(autocovariance, half)
        # Relative size of negative eigenvalues that are rounding errors.
        if eigenvalues.min() >= -1e-9 * eigenvalues.max():
            return np.asarray(np.sqrt(np.maximum(eigenvalues, 0.0)))
        half *= 2
    raise MissingTheoryError(
        f"paths cannot be simulated: no circulant embedding of up to {2 * LARGEST_EMBEDDING} samples has this "
        "autocovariance",
        largest=2 * LARGEST_EMBEDDING,
        advice="Check that the autocovariance is positive definite, or define `state_space` or `simulate`.",
    )


def paths(roots: Vector, n: int, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    """Draw Gaussian paths (count, n) from the square roots (M + 1,) of the eigenvalues; n is at most M + 1."""
    half = roots.size - 1
    out = np.empty((count, n))
    weight = roots * math.sqrt(half)
    weight[[0, -1]] *= math.sqrt(2.0)
    for path in out:
        spectrum = rng.standard_normal(half + 1) + 0j
        spectrum[1:-1] += 1j * rng.standard_normal(half - 1)
        path[:] = np.fft.irfft(weight * spectrum, 2 * half)[:n]
    return out
