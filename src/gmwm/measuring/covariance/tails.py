"""Covariance of the wavelet variance that heavy tails or a varying variance add to the covariance of a Gaussian signal.

Outliers or a large variance make the squared coefficients of all levels large together: Cov(ν̂_j², ν̂_k²) = V_jk + E_jk
ν_j² ν_k², with V of a Gaussian signal and E = c l lᵀ with loadings l_j ≤ 1. N independent samples with excess kurtosis
κ have E_jk = κ / N; l_j < 1 if a part of the level comes from another process.

The relative covariance of mean squares in blocks of B samples, times B, is compared with the Gaussian covariance G = 2
∫ |H_j|² |H_k|² S² df / (ν_j² ν_k²), with filter gains H_j and spectral density S. λ is the ratio of both variances of a
weighted mean over levels, 1 without a common factor. l is 1 up to some level, and the share of white noise beyond. λ
increases with B only if the variance varies slowly; longer blocks are used if their λ is significantly larger."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.open_segments import LEAST_PANEL_SAMPLES, Panels
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal


@dataclass(frozen=True)
class TailLimits:
    """Limits of the measured covariance (tests/covariance/test_tails.py, docs/validation/tails.md)."""

    block: int = 128  # number of samples of the shortest blocks
    block_with_lags: int = 32
    """Number of samples of the shortest blocks if there are moments at lags, which are for short series."""
    least_block_in_scales: int = 8
    """Smallest block, in scales; coefficients of shorter neighbouring blocks are correlated."""
    most_levels: int = 12  # largest number of levels whose covariance is measured
    least_blocks: int = 24  # smallest number of blocks from which a covariance is measured
    chance: float = 3.5
    """Standard errors by which λ must exceed 1 (tests/covariance/test_tails.py, docs/validation/tails.md; all here)."""
    chance_with_lags: float = 2.5
    """The same for the shortest blocks if there are moments at lags (docs/validation/moments.md)."""
    change_by_ends: float = 0.05  # largest change of λ that the ends of blocks cause
    material: float = 0.05
    """Smallest relevant additional variance of a level, relative to the variance for a Gaussian signal. It changes a
    standard error by 2.5 %. Smaller values occur by chance if levels of a low-pass filtered signal are nearly equal."""
    agreement: float = 0.1
    """Largest relative difference between the variance of a used level and that of the spectral density."""
    tail: float = 0.006
    """Share of the largest differences that show the index of the tails: with 1 %, intervals of the variance cover a
    Pareto tail above a Gaussian middle in 89 %, with 0.6 % in 95 %."""
    least_in_tail: int = 50  # smallest number of these differences
    bent: float = 2.5  # standard errors by which the largest of them may show another index


LIMITS = TailLimits()

UNKNOWN = 2.0
"""Relative standard error of the variance if the tails may have an infinite one: its interval spans over a decade."""


class TailSums:
    """Sums from which E of the module docstring is estimated, for a signal in chunks: two matrices for each block
    length, a spectral density, and a few numbers for each 131 072 samples."""

    def __init__(self, block: int = LIMITS.block, chance: float = LIMITS.chance) -> None:
        self._panels = Panels(LEAST_PANEL_SAMPLES)
        self._block, self._chance = block, chance
        sizes = int(np.log2(LEAST_PANEL_SAMPLES // block)) + 1
        # For each block length: number of blocks that have a level, sums of mean squares, and sums of their products.
        self._number = np.zeros((sizes, LIMITS.most_levels))
        self._sum = np.zeros((sizes, LIMITS.most_levels))
        self._product = np.zeros((sizes, LIMITS.most_levels, LIMITS.most_levels))
        self._largest, self._pairs, self._powers = [np.zeros(1)], 0, np.zeros(2)
        self._power: dict[int, tuple[float, Vector]] = {}

    def update(self, values: Vector) -> None:
        """Add the next samples of the current segment."""
        for panel in self._panels.divide(values):
            self._add(panel)

    def gap(self) -> None:
        """End the current segment, because samples are missing."""
        for panel in self._panels.end():
            self._add(panel)

    def excess(self, wv: WaveletVariance) -> Matrix | None:
        """Return the matrix E (J, J) for the levels of `wv`, the classical curve of all samples; None if zero."""
        self.gap()
        if not self._power or not np.all(wv.variance**2 > np.finfo(float).tiny):
            return None  # a level without noise, or squares that underflow
        length = max(self._power, key=lambda key: self._power[key][0] * key)
        number, power = self._power[length]
        gaussian, curve = _gaussian(power / number, length, number)
        own = self._sum[0] / np.maximum(self._number[0], 1.0)
        # If the spectral density does not explain a level, leakage or a trend is larger than the noise.
        known = np.abs(curve / np.where(own > 0, own, np.inf)[: curve.size] - 1) <= LIMITS.agreement
        resolved = known.size if np.all(known) else int(np.argmin(known))
        shapes = _shapes(wv)
        best, common = 1.0, None
        for block, blocks, covariance in self._covariances():
            reach = int(np.log2(min(block, length) // LIMITS.least_block_in_scales))
            reach = min(reach, resolved, int(np.count_nonzero((own > 0) & (blocks >= LIMITS.least_blocks))), len(wv))
            if reach < 2:
                continue
            n = float(blocks[reach - 1])
            relative = block * covariance[:reach, :reach] / np.outer(own[:reach], own[:reach])
            factor, ratio = _common_factor(relative, gaussian[:reach, :reach], shapes[:reach])
            chance = self._chance if block == self._block else LIMITS.chance  # longer blocks are few
            edge = 1 + chance * np.sqrt(2 / n) + LIMITS.change_by_ends
            if ratio / edge > best and np.max(factor[:reach] ** 2 / np.diag(gaussian)[:reach]) > LIMITS.material:
                best, common = ratio, factor
        index, unseen = self._tail()
        if common is None and index < 4:  # a few samples hide the spectrum
            common = np.sqrt(wv.samples * self._powers[1]) / self._powers[0] * shapes[0]
        if common is None:
            return None
        more = max(unseen**2 * wv.samples / np.max(common) ** 2, 1.0)
        return np.asarray(more * np.outer(common, common) / wv.samples)

    def _tail(self) -> tuple[float, float]:
        """Return the upper limit of the tails' index by Hill's estimate, infinite if no power law describes them, and
        the relative standard error of the variance due to tails beyond those seen: half the logarithm of the variance
        with a Pareto tail of the lower limit (Peng 2001, Estimating the mean of a heavy tailed distribution)."""
        largest = -np.sort(-np.concatenate(self._largest[1:]))[: int(LIMITS.tail * self._pairs)]
        if largest.size < LIMITS.least_in_tail or largest[-1] == 0:
            return np.inf, 0.0
        number, logs = np.arange(1, largest.size + 1), np.log(largest)
        with np.errstate(divide="ignore"):
            indices = 1 / (np.cumsum(logs) / number - logs)
        errors, index = 1 / np.sqrt(number), float(indices[-1])
        first = max(largest.size // 16, LIMITS.least_in_tail - 1)
        # Equal extremes, as of a counter or at full scale, have no tail.
        if index == np.inf or np.any((indices * (1 - LIMITS.bent * errors))[first:] > index):
            return np.inf, 0.0
        least, most = index * (1 - 2 * errors[-1]), index * (1 + 2 * errors[-1])
        if least <= 2:
            return most, UNKNOWN
        added = largest.size * largest[-1] ** 2 * least / (least - 2) - float(largest @ largest)
        return most, float(np.clip(np.log1p(added / self._powers[0]) / 2, 0.0, UNKNOWN))

    def _add(self, panel: Vector) -> None:
        levels = min(LIMITS.most_levels, int(np.log2(max(panel.size // self._block, 1))))
        count = (panel.size - (1 << levels)) // self._block
        # Shorter panels do not resolve the spectral density.
        if levels < 1 or count < 1 or panel.size < 2 * LIMITS.block:
            return
        # All coefficients are used: those of rounding errors are uncorrelated even if they are one sample apart.
        y = np.empty((count, levels))
        _core.haar_block_squares(_core.running_sum(panel), self._block, y)
        for size in range(self._sum.shape[0]):
            self._number[size, :levels] += y.shape[0]
            self._sum[size, :levels] += y.sum(axis=0)
            self._product[size, :levels, :levels] += y.T @ y
            if y.shape[0] < 2:
                break
            y = 0.5 * (y[0 : y.shape[0] // 2 * 2 : 2] + y[1 : y.shape[0] // 2 * 2 : 2])
        # Differences of pairs have the tails of the samples, and hardly any slow noise.
        pairs = np.abs(panel[1::2] - panel[: panel.size // 2 * 2 : 2])
        most = int(2 * LIMITS.tail * pairs.size) + 1  # panels share them unequally
        # Hardly any pair is near the smallest of the panel before, unless this panel is quieter.
        high = pairs[pairs > 0.8 * self._largest[-1][0]]
        high = high if high.size >= most else pairs
        self._largest.append(np.partition(high, -most)[-most:].copy())  # a view would keep all pairs
        self._pairs += pairs.size
        pairs *= pairs
        self._powers += pairs.sum(), pairs @ pairs
        # Length (samples) of the longest segments from which the spectral density is estimated.
        length = min(8192, 1 << int(np.log2(panel.size // 16)))
        number, power = self._power.get(length, (0.0, np.zeros(length // 2 + 1)))
        more, part = _power(panel, length)
        self._power[length] = number + more, power + part

    def _covariances(self) -> list[tuple[int, Vector, Matrix]]:
        """Return the length, the numbers of blocks and the covariance of mean squares, from short to long blocks."""
        out = []
        number = np.maximum(self._number, 1.0)
        for size in range(self._sum.shape[0]):
            pairs = np.minimum.outer(number[size], number[size])
            own = self._sum[size] / number[size]
            covariance = self._product[size] / pairs - np.outer(own, own)
            out.append((self._block << size, self._number[size], covariance * pairs / np.maximum(pairs - 1, 1.0)))
        return out


def excess_covariance(x: Signal, wv: WaveletVariance) -> Matrix | None:
    """Estimate the relative covariance E (J, J) of heavy tails or a varying variance for a classical Haar `wv`, or None
    if Gaussian noise explains it. Moments at lags have the loading of level 1."""
    haar = wv if wv.without_lags is wv else wavelet_variance(x)
    sums = TailSums() if haar is wv else TailSums(LIMITS.block_with_lags, LIMITS.chance_with_lags)
    for segment in x.segment_values():
        sums.update(segment)
        sums.gap()
    excess, places = sums.excess(haar), np.searchsorted(haar.levels, np.maximum(wv.levels, 1))
    return None if excess is None else excess[np.ix_(places, places)]


def with_tails(wv: WaveletVariance, x: Signal) -> WaveletVariance:
    """Add the covariance of heavy tails to a curve with moments at lags; `calibrate` adds it to others."""
    return wv if wv.without_lags is wv else replace(wv, excess=excess_covariance(x, wv))


def _shapes(wv: WaveletVariance) -> Matrix:
    """Return J possible vectors of loadings (J, J). They are 1 up to a level, and then the share of white noise."""
    density = wv.variance * 2.0**wv.levels
    return np.where(wv.levels[:, None] >= wv.levels, 1.0, np.minimum(density[:, None] / density, 1.0))


def _common_factor(relative: Matrix, gaussian: Matrix, shapes: Matrix) -> tuple[Vector, float]:
    """Return the common factor √c l (J,), and the ratio λ of the two variances. If `relative` = G + c l lᵀ, weights u
    give λ = 1 + c (u·l)² / uᵀ G u. u_j = l_j / G_jj, as G⁻¹ l would contain differences of nearly equal levels."""
    reach = gaussian.shape[0]
    fine = shapes[:, :reach]
    weights = fine / np.diag(gaussian)
    expected = np.einsum("ij,jk,ik->i", weights, gaussian, weights)
    ratios = np.einsum("ij,jk,ik->i", weights, relative, weights) / expected
    # Sufficient share of the largest λ − 1; of such loadings, those with the fewest levels of loading 1 are used.
    best = int(np.argmax(ratios - 1 >= 0.98 * (np.max(ratios) - 1)))
    size = np.sqrt(max(ratios[best] - 1, 0.0) * expected[best]) / np.sum(weights[best] * fine[best])
    return np.asarray(size * shapes[best]), float(ratios[best])


def _power(panel: Vector, length: int) -> tuple[float, Vector]:
    """Return the number of half-overlapping Hann segments of a panel, and the sum of their periodograms."""
    from scipy.fft import rfft

    window = np.hanning(length + 1)[:-1]
    window /= np.sqrt(np.sum(window**2))
    windows = np.lib.stride_tricks.sliding_window_view(panel, length)[:: length // 2]
    total = np.zeros(length // 2 + 1)
    for first in range(0, windows.shape[0], 16):
        part = windows[first : first + 16]
        part = part - part.mean(axis=1, keepdims=True)
        part *= window
        both = rfft(part, axis=1, overwrite_x=True).view(np.float64)
        np.multiply(both, both, out=both)
        squares = both.sum(axis=0)
        total += squares[::2] + squares[1::2]
    return float(windows.shape[0]), total


def _gaussian(power: Vector, length: int, number: float) -> tuple[Matrix, Vector]:
    """Compute G = N Cov(ν̂_j², ν̂_k²) / (ν_j² ν_k²) of Gaussian noise and ν_j² at the levels that segments resolve."""
    levels = min(LIMITS.most_levels, int(np.log2(length // LIMITS.least_block_in_scales)))
    frequency = np.arange(1, power.size) / length
    half = np.ldexp(1.0, np.arange(levels))[:, None]
    sine = np.sin(np.pi * frequency * half)
    gain = (sine**2 / (np.sin(np.pi * frequency) * half)) ** 2
    weight = np.full(frequency.size, 2.0 / length)  # both signs of the frequency
    weight[-1] = 1.0 / length
    density = gain * power[1:]
    curve = density @ weight
    # The square of a mean of n periodograms is on average too large by 1 / n, and by 1.9 / n for overlapping segments.
    square = (density * weight) @ density.T / (1 + 1.9 / number)
    return np.asarray(2 * square / np.outer(curve, curve)), np.asarray(curve)


def with_common_tails(curves: Mapping[str, WaveletVariance]) -> dict[str, WaveletVariance]:
    """Return the curves of recordings of the same noise, all with a covariance E if one has it: a recording too short
    to show heavy tails gets the E of the longest one that shows them, scaled to its length."""
    known = [wv for wv in curves.values() if wv.excess is not None]
    if not known:
        return dict(curves)
    longest = max(known, key=lambda wv: wv.samples)
    assert longest.excess is not None
    completed = {}
    for name, wv in curves.items():
        if wv.excess is None and not wv.robust:
            reach, own = min(len(wv), len(longest)), np.zeros((len(wv), len(wv)))
            own[:reach, :reach] = longest.excess[:reach, :reach] * (longest.samples / wv.samples)
            wv = replace(wv, excess=own)
        completed[name] = wv
    return completed
