"""White and quantization noise, random walk and drift. docs/contributing/add-a-process.md explains how to add one."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import filtered, haar_covariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.parameter import Occasion, Parameter, Physical, Value
from gmwm.theory.processes.validation import as_clusters, as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace


@dataclass(frozen=True, repr=False)
class WN(Process):
    """White noise, uncorrelated samples of variance σ² whose integral is an angular or velocity random walk.

    ν_j² = σ²/τ_j, with τ_j = 2^j samples.

    Parameters
    ----------
    sigma2 : float, fixed or None
        Variance per sample σ² (u²).

    Examples
    --------
    >>> WN(sigma2=4.0).wavelet_variance(3, rate=100.0)
    array([2. , 1. , 0.5])
    """

    name = "WN"
    title = "White noise"
    parameters = (Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1),)
    elementary = "white"

    sigma2: Value = None

    def state_space(self, rate: float) -> StateSpace:
        """Return a state space without states, with observation noise of variance σ²."""
        return StateSpace(F=[], Q=[], H=[], R=self.scale)

    def correlation_time(self, rate: float) -> float:
        """Return 0 s, because different samples are uncorrelated."""
        return 0.0

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the white noise density N = √(σ²Δt), with the sampling interval Δt."""
        density = math.sqrt(self.scale / as_rate(rate))
        return (Physical("N", "white noise density", density, 0.5, slopes={"sigma2": 0.5}),)

    # The process is complete here. The closed forms below are more accurate or faster than the defaults.

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variance for σ² = 1, which is 1/τ for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.white_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        return np.tile(np.ldexp(1.0, -as_levels(levels)), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw σ² uniformly from ½ to 1 σ̂_T² (`total`) if white noise dominates, else from σ̂_T²/10⁵ to σ̂_T²/10."""
        low, high = (0.5, 1.0) if occasion.dominant == "white" else (1e-5, 0.1)
        return rng.uniform(low * occasion.total, high * occasion.total, (draws, 1))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum, K(m) = −σ²|m|/2."""
        return np.asarray(-0.5 * self.scale * np.abs(as_lags(lags)))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance, which is σ² at lag 0 and 0 at other lags."""
        return np.where(as_lags(lags) == 0, self.scale, 0.0)

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the power spectral density S(f) = σ² Δt."""
        return np.full(as_frequencies(frequencies, as_rate(rate)).shape, self.scale / rate)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute covariances (n,) of Haar coefficients (u²): piecewise linear in the lag, 0 without common samples."""
        return self.scale * haar_covariance.white(at)

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return the density σ² of the white noise."""
        return ExponentialSum(white=self.scale)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths, an array (n,) or (paths, n)."""
        as_paths(n, paths), as_rate(rate)
        draws = as_rng(rng).standard_normal(shape_of_paths(n, paths))
        draws *= math.sqrt(self.scale)
        return draws


@dataclass(frozen=True, repr=False)
class QN(Process):
    """Quantization noise of a sensor that rounds the integrated signal: X_t = e_t − e_{t−1}, Var e = Q².

    ν_j² = 6Q²/τ_j², with τ_j = 2^j samples. The rounding errors e_t = √12·Q·(U − ½) are uniform.

    Parameters
    ----------
    q2 : float, fixed or None
        Variance of the rounding error Q² (u²).

    Examples
    --------
    >>> QN(q2=2.0).wavelet_variance(3, rate=100.0)
    array([3. , 0.75 , 0.1875])
    """

    name = "QN"
    title = "Quantization noise"
    parameters = (Parameter("q2", "Q²", "variance of the rounding error", signal_power=2, scale_power=1),)
    elementary = "spike"

    q2: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variance for Q² = 1, which is 6/τ² for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.quantization_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        return np.tile(np.ldexp(6.0, -2 * as_levels(levels)), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw Q² uniformly from σ̂_T²/8 to σ̂_T²/3 (`total`) if it dominates, else from σ̂_T²/(2·10⁵) to σ̂_T²/100."""
        low, high = (1 / 8, 1 / 3) if occasion.dominant == "quantization" else (5e-6, 0.01)
        return rng.uniform(low * occasion.total, high * occasion.total, (draws, 1))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum e_t + const: Q² at lag 0, and 0 at other lags."""
        return np.where(as_lags(lags) == 0, self.scale, 0.0)

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance, which is 2Q² at lag 0, −Q² at lags ±1 and 0 at other lags."""
        k = np.abs(as_lags(lags))
        return self.scale * (np.where(k == 0, 2.0, 0.0) - np.where(k == 1, 1.0, 0.0))

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute covariances (n,) of Haar coefficients (u²), nonzero at nine lags at most for a pair of levels."""
        return self.scale * haar_covariance.quantization(at)

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return the running sum, which has the variance Q² and is uncorrelated."""
        return ExponentialSum(spikes=np.array([self.scale]))

    @property
    def error_cumulant(self) -> float:
        """Fourth cumulant −1.2 Q⁴ (u⁴) of the uniform rounding errors."""
        return -1.2 * self.scale**2

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the power spectral density S(f) = 4Q² sin²(πfΔt) Δt."""
        f = as_frequencies(frequencies, as_rate(rate))
        return np.asarray(4.0 * self.scale * np.sin(np.pi * f / rate) ** 2 / rate)

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space with the states e_t and e_{t−1}, in which e_t is treated as Gaussian."""
        q2 = self.scale
        return StateSpace(
            F=[[0.0, 0.0], [1.0, 0.0]], Q=[[q2, 0.0], [0.0, 0.0]], H=[1.0, -1.0], P0=[[q2, 0.0], [0.0, q2]]
        )

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate sample paths with uniform rounding errors, an array (n,) or (paths, n)."""
        as_paths(n, paths), as_rate(rate)
        errors = as_rng(rng).random(shape_of_paths(n + 1, paths))
        differences = np.diff(errors, axis=-1)
        differences *= math.sqrt(12.0 * self.scale)
        return differences

    def correlation_time(self, rate: float) -> float:
        """Return 0 s, because samples that are more than one sampling interval apart are uncorrelated."""
        return 0.0

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the quantization noise coefficient Q·Δt of IEEE Std 952, in the unit of the integrated signal."""
        error = math.sqrt(self.scale) / as_rate(rate)
        return (Physical("Q", "quantization noise", error, 1.0, slopes={"q2": 0.5}),)


@dataclass(frozen=True, repr=False)
class RW(Process):
    """Random walk (rate or acceleration random walk): X_t = X_{t−1} + ε_t, Var ε = γ², X_0 = ε_0.

    ν_j² = γ²(τ_j² + 2)/(12τ_j), with τ_j = 2^j samples.

    Parameters
    ----------
    gamma2 : float, fixed or None
        Variance of the innovations γ² (u² per sample).

    Examples
    --------
    >>> RW(gamma2=2.0).wavelet_variance(2, rate=100.0)
    array([0.5 , 0.75])
    """

    name = "RW"
    title = "Random walk"
    parameters = (
        Parameter("gamma2", "γ²", "variance of the innovations", signal_power=2, per_sample=True, scale_power=1),
    )
    stationary = False
    elementary = "walk"

    gamma2: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variance for γ² = 1, which is (τ² + 2)/(12τ) for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.walk_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        tau = np.ldexp(1.0, as_levels(levels))
        return np.tile(tau / 12.0 + 1.0 / (6.0 * tau), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw γ² uniformly from σ̂_T²/(10⁵ N) to σ̂_T²/N, where σ̂_T² is the `total` of `Occasion`."""
        largest = occasion.total / occasion.samples
        return rng.uniform(1e-5 * largest, largest, (draws, 1))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum, K(m) = γ²(|m|³ − |m|)/12."""
        m = np.abs(as_lags(lags)).astype(np.float64)
        return self.scale * (m**3 - m) / 12.0

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance A(m) = −γ²|m|/2 (u²)."""
        return np.asarray(-0.5 * self.scale * np.abs(as_lags(lags)))

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute covariances (n,) of Haar coefficients (u²): second differences of K(m) = γ²(|m|³ − |m|)/12 over both
        half-scales, piecewise cubic in the lag, 0 without common samples."""
        return self.scale * haar_covariance.walk(at)

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return the innovation variance γ² of the random walk."""
        return ExponentialSum(walk=self.scale)

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the pseudo-spectrum γ²Δt/(4 sin²(πfΔt)), infinite at 0, for filters whose coefficients sum to 0."""
        f = as_frequencies(frequencies, as_rate(rate))
        with np.errstate(divide="ignore"):
            density = 1.0 / (4.0 * rate * np.sin(np.pi * f / rate) ** 2)
        return np.asarray(self.scale * density if self.scale > 0 else np.zeros_like(density))

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space with one diffuse state; a simulation starts at X_0 = ε_0."""
        gamma2 = self.scale
        return StateSpace(F=1.0, Q=gamma2, H=1.0, P0=gamma2, diffuse=[True])

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths, an array (n,) or (paths, n)."""
        as_paths(n, paths), as_rate(rate)
        steps = as_rng(rng).standard_normal(shape_of_paths(n, paths))
        _core.accumulate(steps.reshape(-1, n), math.sqrt(self.scale))
        return steps

    def correlation_time(self, rate: float) -> float:
        """Return inf, because a random walk is not stationary."""
        return math.inf

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the random walk coefficient K = √(γ²/Δt), with the sampling interval Δt."""
        walk = math.sqrt(self.scale * as_rate(rate))
        return (Physical("K", "random walk", walk, -0.5, slopes={"gamma2": 0.5}),)


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

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
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
