"""Processes whose autocovariance is negligible beyond a lag L, apart from a few exponentials.

The running sum of such a process has the covariance K(m) = −½S|m| + const + ρ(m), S = Σ_k r(k). The first term is the
covariance for white noise with the spectral density S. The last term, ρ(m) = −Σ_{k>m} (k − m) r(k), is zero beyond the
lag L. Haar wavelet coefficients therefore have the same covariance as for white noise, except within L lags of the lags
at which that covariance changes its slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector, freeze
from gmwm.theory.processes import haar_covariance
from gmwm.theory.processes.haar_covariance import LagGrid

LONGEST_LAGS = 2048
"""Largest number of lags L: with 19 levels, 3 million terms, 0.1 s and 150 MB; see benchmarks."""
NEGLIGIBLE_CORRELATION = 1e-11
"""Relative size of ρ(m) that is left out; the error of the covariance is then below 1e-10."""


@dataclass(frozen=True, eq=False)
class ShortMemory:
    """Autocovariance for scale coefficient 1: a table r(0), …, r(L), and exponentials Σ a e^(−λ|k|), or (−1)^k
    e^(−|λ|k) for λ < 0."""

    autocovariance: Vector
    amplitudes: tuple[float, ...] = ()
    decays: tuple[float, ...] = ()

    @property
    def lags(self) -> int:
        """Largest lag L."""
        return self.autocovariance.size - 1

    def coefficient_covariance(self, at: LagGrid) -> Vector:
        """Compute the covariances (n,) of Haar wavelet coefficients; see `Process.coefficient_covariance`."""
        total = haar_covariance.short_memory(at, self.autocovariance)
        for amplitude, decay in zip(self.amplitudes, self.decays, strict=True):
            shape = haar_covariance.exponential if decay > 0 else haar_covariance.alternating
            total += amplitude * shape(at, abs(decay))
        return total


def trim(autocovariance: Vector) -> Vector | None:
    """Truncate an autocovariance, given at enough lags, where it becomes negligible; None if this lag is too large."""
    tails = np.cumsum(np.cumsum(autocovariance[:0:-1]))[::-1]
    least = NEGLIGIBLE_CORRELATION * max(abs(float(autocovariance[0])), float(np.abs(tails).max(initial=0.0)))
    # tails[m] is −ρ(m), and r(m + 1) is a part of it.
    felt = (np.abs(tails) > least) | (np.abs(autocovariance[1:]) > least)
    lags = int(np.flatnonzero(felt)[-1]) + 1 if felt.any() else 0
    return freeze(autocovariance[: lags + 1].copy()) if lags <= LONGEST_LAGS else None
