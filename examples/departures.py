"""Noise that is not stationary, and its Allan variance: `python examples/departures.py`.

Three departures from a stationary model, for studies of robustness: a bias that jumps at regular times (bias
instability), white noise whose variance grows, and blocks of independent AR1 processes. The expectation of the
overlapping and of the non-overlapping Allan variance follows from the covariance matrix of the samples. The wavelet
variance has the same expectation, so a sum of stationary processes fits it although no sample has that law.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, toeplitz

import gmwm

Array = NDArray[np.float64]


def bias_instability(samples: int, length: int, sigma2: float) -> Array:
    """Return the covariance (N, N) of a bias with the variance `sigma2` that changes every `length` samples."""
    block = np.arange(samples) // length
    return sigma2 * np.equal.outer(block, block).astype(np.float64)


def growing_white_noise(samples: int, first: float, last: float) -> Array:
    """Return the covariance (N, N) of white noise whose variance grows linearly from `first` to `last`."""
    return np.diag(np.linspace(first, last, samples))


def ar1_blocks(samples: int, length: int, phi: float, sigma2: float) -> Array:
    """Return the covariance (N, N) of independent AR1 processes of `length` samples, with innovation variance
    `sigma2`."""
    one = sigma2 / (1 - phi**2) * toeplitz(phi ** np.arange(length))
    return np.asarray(block_diag(*[one] * -(-samples // length)))[:samples, :samples]


def draw(covariance: Array, rng: np.random.Generator) -> Array:
    """Draw a sample path (N,) with a covariance matrix (N, N), which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors @ (np.sqrt(np.maximum(values, 0.0)) * rng.standard_normal(values.size)))


def expected_allan_variance(covariance: Array, clusters: Array, overlapping: bool = True) -> Array:
    """Return the expectation of the Allan variance (J,) at cluster sizes n (J,), from the covariance (N, N) of the
    samples. It is the mean of aᵀ Σ a / 2 over the differences a of the means of neighbouring clusters."""
    sums = np.zeros(tuple(size + 1 for size in covariance.shape))
    sums[1:, 1:] = covariance.cumsum(axis=0).cumsum(axis=1)
    expected = []
    for n in clusters:
        first = np.arange(0, covariance.shape[0] - 2 * n + 1, 1 if overlapping else n)
        corners, weights = [first, first + n, first + 2 * n], np.array([1.0, -2.0, 1.0]) / n
        pairs = product(zip(weights, corners, strict=True), repeat=2)
        expected.append(np.mean(sum(a * b * sums[p, q] for (a, p), (b, q) in pairs)) / 2)
    return np.array(expected)


def main() -> None:
    """Print the expected and the measured Allan variance of one path of each departure, and a stationary fit."""
    samples = 1024
    departures = {
        "bias that jumps": np.eye(samples) + bias_instability(samples, 100, 0.5),
        "growing white noise": growing_white_noise(samples, 1.0, 3.0),
        "blocks of AR1": ar1_blocks(samples, 128, 0.9, 0.2),
    }
    for name, covariance in departures.items():
        x = draw(covariance, np.random.default_rng(1))
        measured = gmwm.allan_variance(x)
        expected = expected_allan_variance(covariance, measured.clusters)
        fit = gmwm.fit("GM + WN", x)
        print(f"{name}: p = {fit.goodness_of_fit().pvalue:.2f} of GM + WN")
        for n, seen, mean in zip(measured.clusters, measured.variance, expected, strict=True):
            print(f"  {n:5d} {seen:8.4f} {mean:8.4f}")


if __name__ == "__main__":
    main()
