"""Covariances of Haar wavelet coefficients of a process, in the forms that sums over lags need."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.theory.processes import haar_covariance
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process


class HaarTheory:
    """Part of the theory of a `Process`: covariances of Haar wavelet coefficients."""

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute the covariances 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) (n,) of Haar wavelet coefficients, in u². Each of the
        n entries of `at` has a pair of levels j ≤ k, given by the half-scales `fine` = 2^(j−1) and `coarse` = 2^(k−1),
        and a `lag` u. The default uses the autocovariance at the lags up to `memory`."""
        process = cast("Process", self)
        lags = self.memory(rate) if process._gives("memory") else None
        if lags is None:
            raise process.missing("coefficient_covariance")
        return haar_covariance.short_memory(at, process.autocovariance(np.arange(lags + 1), rate))

    def exponential_sum(self, rate: float) -> ExponentialSum | None:
        """Return the covariance of the running sum as a sum of exponentials, if it has this form: covariances of
        wavelet variances are then in closed form. The class that defines the covariance must define it. The default
        uses the autocovariance up to `memory`."""
        process = cast("Process", self)
        lags = self.memory(rate) if process._gives("memory") and not process._gives("coefficient_covariance") else None
        return None if lags is None else ExponentialSum.of_table(process.autocovariance(np.arange(lags + 1), rate))

    def exponential_mixture(self, rate: float, samples: int) -> ExponentialSum | None:
        """Return a sum of exponentials that approximates a process without `exponential_sum`, if any, to 1e-9 of the
        covariances of Haar coefficients for up to `samples` samples."""
        return None

    def memory(self, rate: float) -> int | None:
        """Return the lag L beyond which the autocovariance is negligible, apart from exponentials with rates `decays`.
        It is 0 if `coefficient_covariance` is a closed form, and None if L is unknown or exceeds
        `short_memory.LONGEST_LAGS`. For None, the covariance of wavelet variances takes seconds at 10^6 samples."""
        return 0 if cast("Process", self)._gives("coefficient_covariance") else None

    def decays(self, rate: float) -> tuple[float, ...]:
        """Return the decay rates (per sample) of exponentials in `coefficient_covariance`; < 0 for alternating
        signs."""
        return ()
