"""Covariances of Haar wavelet coefficients, at full accuracy for any level and lag.

With the generalised covariance K(m) of the running sum, and half-scales h_j = 2^(j−1):

    2^(j+k) Cov(W_{j,t}, W_{k,t+u}) = Σ_a Σ_b c_a c_b K(u − b + a),

a in 0, h_j, 2h_j and b in 0, h_k, 2h_k with weights c = (1, −2, 1). The nine terms nearly cancel, so D(m) = Σ_a c_a K(m
+ a) has a closed form in y = |m + h_j| (`cpp/src/differences.cpp`), and the sum is D(u) − 2 D(u − h_k) + D(u − 2 h_k).
Lags can be real, for Gauss rules between kinks, lags without smoothness."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Vector
from gmwm.theory.processes import haar_covariance, self_similar
from gmwm.theory.processes.exponential_sum import ExponentialSum

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process


class HaarTheory:
    """Part of the theory of a `Process`: covariances of Haar wavelet coefficients."""

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) (n,), in u², for the entries of `at`: half-scales `fine` = 2^(j−1)
        and `coarse` = 2^(k−1), j ≤ k, and lag u. The default uses the autocovariance up to `memory`."""
        process = cast("Process", self)
        lags = self.memory(rate) if process._gives("memory") else None
        if lags is None:
            raise process.missing("coefficient_covariance")
        return haar_covariance.short_memory(at, process.autocovariance(np.arange(lags + 1), rate))

    def exponential_sum(self, rate: float) -> ExponentialSum | None:
        """Return the running sum's covariance as exponentials, for closed forms, if the class itself defines the
        covariance; by default from the autocovariance up to `memory`."""
        process = cast("Process", self)
        lags = self.memory(rate) if process._gives("memory") and not process._gives("coefficient_covariance") else None
        return None if lags is None else ExponentialSum.of_table(process.autocovariance(np.arange(lags + 1), rate))

    def exponential_mixture(self, rate: float, samples: int) -> ExponentialSum | None:
        """Return exponentials for a process without `exponential_sum`, if any, to 1e-9 of covariances for `samples`."""
        return None

    def memory(self, rate: float) -> int | None:
        """Return the lag L beyond which the autocovariance is negligible, but for `decays`; 0 for closed forms, None
        above `short_memory.LONGEST_LAGS` or if unknown: covariances then take seconds at 10^6 samples."""
        return 0 if cast("Process", self)._gives("coefficient_covariance") else None

    def decays(self, rate: float) -> tuple[float, ...]:
        """Return the decay rates (per sample) of exponentials in `coefficient_covariance`; < 0 if alternating."""
        return ()


Indices = NDArray[np.int64]
Pieces = tuple[Indices, Indices, Indices, Vector]


@dataclass(frozen=True, eq=False)
class LagGrid:
    """Pairs of levels j ≤ k and lags u (samples) at which covariances of wavelet coefficients are computed.

    `fine` and `coarse` (n,) are h_j and h_k; `odd` nodes are odd lags of alternating covariances. `known` and `recent`
    cache covariances of fixed and of last shapes (None after one use). `whole` is the grid that begins with these
    nodes. `pieces` are groups of nodes without a kink: first nodes, patterns, their begins, all offsets."""

    fine: Vector
    coarse: Vector
    lag: Vector
    odd: NDArray[np.uint8] | None = None
    known: dict[Any, Vector] = field(default_factory=dict)
    recent: dict[Any, Vector | None] = field(default_factory=dict)
    pieces: Pieces | None = None
    whole: LagGrid | None = None

    def first(self, count: int) -> LagGrid:
        """Return the grid of the first `count` nodes, which must end with a group."""
        pieces = None
        if self.pieces is not None:
            firsts, patterns, begins, offsets = self.pieces
            end = int(np.searchsorted(firsts, count))
            pieces = (firsts[:end], patterns[:end], begins, offsets)
        odd = None if self.odd is None else self.odd[:count]
        return LagGrid(self.fine[:count], self.coarse[:count], self.lag[:count], odd, pieces=pieces, whole=self)


WANDERING = 1e-40
"""λ below which the process is treated as a random walk with innovation variance 2λ, because 1/λ² would overflow."""


def white(at: LagGrid) -> Vector:
    """Compute the covariances (n,) for white noise with σ² = 1, for which K(m) = −|m|/2."""
    return _core.white_differences(at.fine, at.coarse, at.lag)


def walk(at: LagGrid) -> Vector:
    """Compute the covariances (n,) for a random walk with γ² = 1, for which K(m) = (|m|³ − |m|)/12."""
    return _core.walk_differences(at.fine, at.coarse, at.lag)


def quantization(at: LagGrid) -> Vector:
    """Compute the covariances (n,) for quantization noise with Q² = 1, for which K(0) = 1 and K is 0 elsewhere."""
    return _core.spike_differences(at.fine, at.coarse, at.lag)


def short_memory(at: LagGrid, autocovariance: Vector) -> Vector:
    """Compute covariances (n,) of a short r(0), …, r(L): white noise of equal density, or near kinks a table."""
    return _core.short_memory_differences(at.fine, at.coarse, at.lag, autocovariance)


def power(at: LagGrid, exponent: float) -> Vector:
    """Compute the covariances (n,) for power-law noise with ν_1² = 1 and ε = `exponent`. K(m) = m² (|m|^ε − 1)/(2(2^ε −
    1)), and K(m) = m² ln|m|/(2 ln 2) for ε = 0."""
    scale = 0.5 * float(self_similar.unit_factor(np.asarray(exponent)))
    return scale * _core.power_differences(at.fine, at.coarse, at.lag, exponent, self_similar.binomials(exponent))


def exponential(at: LagGrid, decay: float) -> Vector:
    """Compute the covariances (n,) for the autocovariance e^(−λ|k|) with λ = `decay`."""
    if decay > NEGLIGIBLE_EXPONENT:
        return white(at)
    if decay < WANDERING:
        return 2 * decay * walk(at)
    if at.pieces is not None:
        return _core.piecewise_exponential_differences(at.fine, at.coarse, at.lag, at.pieces, decay)
    return _core.exponential_differences(at.fine, at.coarse, at.lag, decay)


def alternating(at: LagGrid, decay: float) -> Vector:
    """Compute covariances (n,) of (−1)^k e^(−λ|k|), nine terms without the constants that cancel."""
    phi = -np.exp(-decay)
    fine, coarse = at.fine.astype(np.int64), at.coarse.astype(np.int64)
    # If the grid does not mark odd lags, all nodes are integers.
    odd = at.lag.astype(np.int64) & 1 if at.odd is None else at.odd
    # Even offsets keep the sign and the weights sum to 0, so the constants remain only at h_j = h_k = 1.
    total = np.where((fine == 1) & (coarse == 1), 16.0 * np.where(odd, -1.0, 1.0), 0.0)
    for a, weight_a in ((0, 1.0), (1, -2.0), (2, 1.0)):
        for b, weight_b in ((0, 1.0), (1, -2.0), (2, 1.0)):
            m = at.lag - b * at.coarse + a * at.fine
            flips = (odd + a * fine + b * coarse) % 2
            total += weight_a * weight_b * np.where(flips, -1.0, 1.0) * np.expm1(-decay * np.abs(m))
    share = (1 + phi) / (1 - phi) if decay > 0.5 else np.tanh(decay / 2)
    return np.asarray(share * white(at) - phi / (1 - phi) ** 2 * total)
