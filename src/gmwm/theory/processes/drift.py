"""Deterministic drift."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import filtered
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.parameter import Occasion, Parameter, Physical, Value
from gmwm.theory.processes.validation import as_clusters, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace


@dataclass(frozen=True, repr=False)
class DR(Process):
    """Drift (rate ramp), which is a deterministic mean X_t = ωt.

    ν_j² = ω²τ_j²/16, with τ_j = 2^j samples. The wavelet variance does not depend on the sign of ω.

    Parameters
    ----------
    omega : float, fixed or None
        Slope ω (u per sample).

    Examples
    --------
    >>> DR(omega=-2.0).wavelet_variance(2, rate=100.0)
    array([1., 4.])
    """

    name = "DR"
    title = "Drift"
    parameters = (Parameter("omega", "ω", "slope", domain="real", signal_power=1, per_sample=True, scale_power=2),)
    stationary = False
    elementary = "drift"

    omega: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variance for ω² = 1, which is τ²/16 for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.drift_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        return np.tile(np.ldexp(1.0, 2 * as_levels(levels) - 4), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw ω uniformly from R/100 to R/2, with R = (max x − min x)/N, and return ω² (draws, 1)."""
        return np.square(rng.uniform(0.01 * occasion.spread, 0.5 * occasion.spread, (draws, 1)))

    def mean(self, t: ArrayLike) -> Vector:
        """Return the mean ωt (u) at sample numbers t."""
        return np.asarray(self.value("omega") * np.asarray(t, dtype=np.float64))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Return zeros, because a drift is deterministic."""
        return np.zeros(np.shape(as_lags(lags)))

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Return zeros (n,), because the wavelet coefficients of a drift have no random error."""
        return np.zeros_like(at.lag)

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return an empty sum, because a drift has no random error."""
        return ExponentialSum()

    def state_space(self, rate: float) -> StateSpace:
        """Return a state space with the states (value, slope), without process noise, that are known at t = 0."""
        slope = self.value("omega")
        return StateSpace(F=[[1.0, 1.0], [0.0, 1.0]], Q=np.zeros((2, 2)), H=[1.0, 0.0], m0=[0.0, slope])

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> NDArray[np.float64]:
        """Return the ramp as an array (n,), or (paths, n) with the same ramp in every path."""
        as_paths(n, paths), as_rate(rate), as_rng(rng)
        return np.broadcast_to(self.mean(np.arange(n)), shape_of_paths(n, paths)).copy()

    def correlation_time(self, rate: float) -> float:
        """Return inf, because a drift is not stationary."""
        return math.inf

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance ω²n²/2 (u²) of clusters of n samples."""
        return np.asarray(0.5 * self.scale * np.square(as_clusters(clusters), dtype=np.float64))

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the ramp coefficient R = ω/Δt, with the sign of ω."""
        return (Physical("R", "ramp", self.value("omega") * as_rate(rate), -1.0, slopes={"omega": 1.0}),)
