"""Processes with short memory: an autocovariance that is negligible beyond some lags, apart from a few exponentials.

The running sum of such a process has the covariance K(m) = −½S|m| + const + ρ(m), S = Σ_k r(k). It is the sum of
the covariance of white noise of density S and ρ(m) = −Σ_{k>m} (k − m) r(k), which is zero where r is. Haar coefficients
therefore have the same covariance as for white noise, except within L lags of the kinks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Vector, freeze
from gmwm.processes import haar_covariance
from gmwm.processes.haar_covariance import LagGrid

LONGEST = 2048
"""Largest number of lags L. With 19 levels, the covariance V has 3 million nodes and takes 0.1 s and 150 MB; see
benchmarks."""
NEGLIGIBLE = 1e-11
"""Size of the tail ρ(m), relative to the largest tail or to r(0), below which further lags are left out; the error of V
is then below 1e-10."""


@dataclass(frozen=True, eq=False)
class ShortMemory:
    """Autocovariance of a process at unit scale: r(0), …, r(L), plus Σ a e^(−λ|k|).

    Attributes
    ----------
    autocovariance : (L + 1,) array
    amplitudes : tuple of float
    decays : tuple of float
        λ per sample; negative for (−1)^k e^(−|λ|k).
    """

    autocovariance: Vector
    amplitudes: tuple[float, ...] = ()
    decays: tuple[float, ...] = ()

    @property
    def lags(self) -> int:
        """Largest lag L."""
        return self.autocovariance.size - 1

    def coefficient_covariance(self, at: LagGrid) -> Vector:
        """Covariance of Haar wavelet coefficients; see `Process.coefficient_covariance`."""
        total = haar_covariance.short_memory(at, self.autocovariance)
        for amplitude, decay in zip(self.amplitudes, self.decays, strict=True):
            shape = haar_covariance.exponential if decay > 0 else haar_covariance.alternating
            total += amplitude * shape(at, abs(decay))
        return total


def trimmed(autocovariance: Vector) -> Vector | None:
    """Truncate the autocovariance at the lag from which it is negligible; return None if this lag is too large.

    `autocovariance` must reach beyond this lag itself.
    """
    tails = np.cumsum(np.cumsum(autocovariance[:0:-1]))[::-1]
    least = NEGLIGIBLE * max(abs(float(autocovariance[0])), float(np.abs(tails).max(initial=0.0)))
    # tails[m] is −ρ(m), and r(m + 1) is a part of it.
    felt = (np.abs(tails) > least) | (np.abs(autocovariance[1:]) > least)
    lags = int(np.flatnonzero(felt)[-1]) + 1 if felt.any() else 0
    return freeze(autocovariance[: lags + 1].copy()) if lags <= LONGEST else None
