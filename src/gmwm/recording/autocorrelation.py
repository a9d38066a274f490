"""Compute the autocorrelation of a series in which samples can be missing."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Vector


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
