"""Welch's method: windowed periodograms of overlapping blocks, and the degrees of freedom of their mean."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gmwm.base.arrays import Integers, Vector, freeze
from gmwm.base.lazy import scipy

Detrend = Literal["constant", "linear"]  # trend that is subtracted from each block: the mean, or the least-squares line
ENERGY_WIDTH = 1.5
"""Equivalent noise bandwidth of the Hann window, L Σ w² / (Σ w)², in bins (Harris 1978, table 1)."""
HALF_POWER_WIDTH = 1.44
"""Width of a line at half its power with a Hann window, in bins (Harris 1978, table 1)."""


@lru_cache(maxsize=16)
def hann(length: int) -> Vector:
    """Return the periodic Hann window (length,), which equals `scipy.signal.get_window("hann", length)`."""
    return freeze(0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length))


class Periodograms(NamedTuple):
    """Sums over Hann periodograms of one length. `total` is over blocks; `levels` and `squares` sum bands' geometric
    means and their squares, which show changing power and hardly react to lines."""

    total: Vector
    levels: Vector
    squares: Vector
    blocks: int

    @classmethod
    def none(cls, length: int) -> Periodograms:
        """Return the sums over no blocks of this length."""
        bands = len(band_edges(length))
        return cls(np.zeros(length // 2 + 1), np.zeros(bands), np.zeros(bands), 0)

    def plus(self, other: Periodograms) -> Periodograms:
        """Return the sums over the blocks of `self` and `other`."""
        return Periodograms(
            total=self.total + other.total, levels=self.levels + other.levels, squares=self.squares + other.squares,
            blocks=self.blocks + other.blocks,
        )  # fmt: skip


@lru_cache(maxsize=16)
def band_edges(length: int) -> Integers:
    """Return the first bin of each band: bins 2 to 31, then octaves; 0 and 1 contain a part of the mean."""
    octaves = [1 << power for power in range(5, 40) if 1 << power < length // 2]
    return np.array([min(2, length // 2), *octaves], dtype=np.int64)


def periodograms(values: Vector, length: int, detrend: Detrend) -> Periodograms:
    """Return the sums over all blocks of `values` that begin at multiples of length / 2."""
    sums = Periodograms.none(length)
    if values.size < length:
        return sums
    blocks, window = sliding_window_view(values, length)[:: length // 2], hann(length)
    edges = band_edges(length)
    sizes = np.diff(np.append(edges, length // 2 + 1))
    total, levels, squares = sums[:3]
    # Number of samples that are transformed at once: 1 MB, which stays in the cache of the processor.
    step = max(1, (1 << 17) // length)
    for first in range(0, len(blocks), step):
        batch = blocks[first : first + step]
        mean = batch.mean(axis=1, keepdims=True)
        batch = batch - mean
        # For a constant block, only the rounding error of the mean remains. It is set to zero.
        batch[np.abs(batch).max(axis=1) <= 8 * float(np.finfo(np.float64).eps) * np.abs(mean[:, 0])] = 0.0
        if detrend == "linear":
            line = _centred_time(length)
            batch -= (batch @ line)[:, None] * line
        batch *= window
        parts = scipy.fft.rfft(batch, axis=1, overwrite_x=True).view(np.float64)
        np.multiply(parts, parts, out=parts)
        power = parts[:, ::2] + parts[:, 1::2]
        total += power.sum(axis=0)
        logs = np.log(np.maximum(power, 1e-300, out=power), out=power)
        means = np.exp(np.add.reduceat(logs, edges, axis=1) / sizes)
        levels += means.sum(axis=0)
        squares += (means**2).sum(axis=0)
    return Periodograms(total, levels, squares, len(blocks))


@lru_cache(maxsize=4)
def _centred_time(length: int) -> Vector:
    """Return equidistant times (length,), shifted and scaled to mean 0 and norm 1."""
    time = np.arange(length) - (length - 1) / 2
    return freeze(time / np.linalg.norm(time))


def one_sided_density(sums: Periodograms, length: int, rate: float) -> Vector:
    """Compute the one-sided power spectral density (u²/Hz) from the sums over all blocks."""
    density = sums.total / (sums.blocks * rate * float(np.sum(hann(length) ** 2)))
    density[1:-1] *= 2
    return density


def nominal_freedom(blocks: int, pairs: int) -> float:
    """Return the edf 2 K² / (K + 2 P r) of K periodograms with P overlaps of correlation r (Welch 1967)."""
    return 2 * blocks**2 / (blocks + 2 * pairs * (1 / 6) ** 2)


def degrees_of_freedom(sums: Periodograms, pairs: int, length: int) -> Vector:
    """Return the edf (length/2 + 1,) of the mean periodogram, half at both ends, whose Fourier coefficients are real.
    Varying power divides them by 1 + c²: squared coefficient of variation of blocks minus that of stationary noise."""
    blocks, edges = sums.blocks, band_edges(length)
    sizes = np.diff(np.append(edges, length // 2 + 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        variation = np.nan_to_num(blocks * sums.squares / sums.levels**2 - 1)
    # Log periodograms have the variance π²/6, and means over m bins 1.94/m of it (Hann correlation). Three standard
    # errors √(2/K) of the variance of K values are allowed.
    stationary = np.expm1(np.pi**2 / 6 * 1.94 / sizes) * (1 + 3 * math.sqrt(2 / blocks))
    reduction = 1 + np.maximum(variation - stationary, 0.0)
    freedom = np.empty(length // 2 + 1)
    for first, size, factor in zip(edges, sizes, reduction, strict=True):
        freedom[first : first + size] = nominal_freedom(blocks, pairs) / factor
    freedom[: edges[0]] = freedom[edges[0]]
    freedom[[0, -1]] /= 2
    return np.maximum(freedom, 1.0)
