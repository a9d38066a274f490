"""Flicker noise, power-law noise and fractional Gaussian noise, with the spectrum |f|^(−α)."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate
from gmwm.base.errors import MissingTheoryError
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import circulant_embedding, haar_covariance, self_similar
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.circulant_embedding import amplitudes, half_period
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.ladder import power_law
from gmwm.theory.processes.parameter import Parameter, Physical, Value
from gmwm.theory.processes.self_similar import Numbers
from gmwm.theory.processes.validation import as_clusters, as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace

# Step of complex-step derivatives. Their relative error, the square of the step, is far below the rounding error.
_LOG2 = math.log(2.0)
_mixture = lru_cache(maxsize=128)(self_similar.mixture)  # for each length of a segment


class PowerLaw(Process, abstract=True):
    """Continuous noise with spectrum |f|^(−α), −1 < α < 3, averaged over intervals: ν_j² = ν_1² (τ_j/2)^(α−1), K(m) =
    ½ν_1² m² (|m|^(α−1) − 1)/(2^(α−1) − 1) of the running sum, up to a + b m²."""

    stationary = False
    approximate = True

    @classmethod
    @abstractmethod
    def exponents(cls, nonlinear: NDArray[np.float64]) -> tuple[Numbers, Numbers]:
        """Return ε = α − 1 (n,) and ν_1² (n,) for scale coefficient 1, by analytic functions for complex steps."""

    @property
    def law(self) -> tuple[float, float]:
        """ε = α − 1, and ν_1² in u²."""
        epsilon, first = self.exponents(self.nonlinear.reshape(1, -1))
        return float(epsilon[0]), self.scale * float(first[0])

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J), which are ν_1² (τ/2)^(α−1) for the Haar filter."""
        return np.asarray(cls._shape(nonlinear, as_levels(levels), filter))

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives ∂ν²/∂θ (n, J, q) by complex steps."""
        step = 1e-30
        moved = np.asarray(nonlinear, dtype=np.complex128) + 1j * step
        if not cls.nonlinear_parameters():
            return np.zeros((len(moved), as_levels(levels).size, 0))
        return np.asarray(cls._shape(moved, as_levels(levels), filter).imag[:, :, None] / step)

    @classmethod
    def _shape(cls, nonlinear: Numbers, levels: NDArray[np.int64], filter: WaveletFilter) -> Numbers:
        epsilon, first = cls.exponents(nonlinear)
        if filter is HAAR:
            return np.asarray(first[:, None] * self_similar.powers_of_two(epsilon, levels))
        return np.asarray(first[:, None] * self_similar.filtered_shape(epsilon, filter, levels))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the covariance of the running sum, K(m) = ½ν_1² m² (|m|^(α−1) − 1)/(2^(α−1) − 1), up to a + b m²."""
        epsilon, first = self.law
        kappa = float(self_similar.unit_factor(np.asarray(epsilon)))
        return 0.5 * first * kappa * self_similar.sum_covariance(as_lags(lags).astype(np.float64), epsilon)

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance A(m) = −K(m+1) + 2K(m) − K(m−1) (u²), up to a constant."""
        epsilon, first = self.law
        kappa = float(self_similar.unit_factor(np.asarray(epsilon)))
        return -0.5 * first * kappa * self_similar.bend(as_lags(lags).astype(np.float64), epsilon)

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance σ²(n) = 2ν_1² n^(α−1) of clusters of n samples."""
        epsilon, first = self.law
        return np.asarray(2.0 * first * as_clusters(clusters).astype(np.float64) ** epsilon)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute the covariances (n,) of Haar wavelet coefficients (u²), from second differences of K."""
        epsilon, first = self.law
        return first * haar_covariance.power(at, epsilon)

    def exponential_mixture(self, rate: float, samples: int) -> ExponentialSum | None:
        """Return a sum of exponentials for the lags up to `samples`; None for α > 2.2."""
        epsilon, first = self.law
        return None if epsilon > self_similar.STEEPEST else _mixture(epsilon, samples).scaled(first)

    def decays(self, rate: float) -> tuple[float, ...]:
        """Return a very large and a very small rate: a power of the lag mixes all exponentials between."""
        return (2.0, 1e-290)

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute S(f) = C Σ_k |f + k/Δt|^(−α) sinc²((f + k/Δt)Δt) (u²/Hz), with the limit at f = 0. If the process is
        not stationary, S is a pseudo-spectrum, valid for filters whose coefficients sum to 0."""
        f = as_frequencies(frequencies, as_rate(rate))
        epsilon, first = self.law
        return np.asarray(first * self_similar.spectrum(np.abs(f) / rate, epsilon) / rate)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate exact Gaussian sample paths (n,) or (paths, n); for α ≥ 1 by stationary increments."""
        n, count = as_paths(n, paths)
        as_rate(rate)
        epsilon, first = self.law
        series = circulant_embedding.paths(_roots(epsilon, half_period(n)), n, as_rng(rng), count)
        series *= math.sqrt(first)
        return (series if epsilon < 0 else np.cumsum(series, axis=1)).reshape(shape_of_paths(n, paths))

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space of eleven averaged Gauss-Markov processes, with an Allan deviation within 1 % from 1
        to 2^22 samples; see the module `ladder`. Raises MissingTheoryError unless α is between 0 and 2."""
        as_rate(rate)
        space, _ = self._ladder()
        first = self.law[1]
        return StateSpace(F=space.F, Q=first * space.Q, H=space.H, R=first * space.R, P0=first * space.P0)

    def continuous(self, rate: float) -> ContinuousStateSpace:
        """Return `state_space`'s slow Gauss-Markov processes without averaging, and white noise for fast ones."""
        _, smooth = self._ladder()
        size, rate = self.law[1], as_rate(rate)
        return ContinuousStateSpace(
            A=rate * smooth.A, Qc=size * rate * smooth.Qc, H=smooth.H, Rc=size * smooth.Rc / rate, P0=size * smooth.P0
        )

    def _ladder(self) -> tuple[StateSpace, ContinuousStateSpace]:
        epsilon = self.law[0]
        if not -1.0 <= epsilon <= 1.0:
            raise MissingTheoryError(
                f"{self.name} has a state space for exponents α from 0 to 2 only; got {1.0 + epsilon:g}",
                advice="Use a random walk and a drift instead of a larger α, white noise instead of a smaller one.",
                theory="state_space",
                process=self.name,
            )
        return power_law(epsilon)


@lru_cache(maxsize=2)
def _roots(epsilon: float, half: int) -> Vector:
    """Return the cached amplitudes for circulant embedding of paths with ν_1² = 1, or of their increments if ε ≥ 0."""
    if epsilon < 0:
        variance = -1.0 / math.expm1(epsilon * _LOG2)  # of a sample
        return amplitudes(lambda k: variance * 0.5 * self_similar.power_bend(k, epsilon), half)
    ones = np.ones(half + 1)
    return amplitudes(lambda k: haar_covariance.power(LagGrid(ones, ones, k), epsilon), half)


@dataclass(frozen=True, repr=False)
class FN(PowerLaw):
    """Flicker noise, the bias instability of IEEE Std 952, with the two-sided spectral density B²/(2π|f|).

    Each sample is the mean over a sampling interval. ν_j² = B² ln 2/π at every level, so that the Allan deviation has
    the constant value B √(2 ln 2/π) = 0.664 B.

    Parameters
    ----------
    b2 : float, fixed or None
        Square of the bias instability coefficient, B² (u²).

    Examples
    --------
    >>> FN(b2=1.0).wavelet_variance(3, rate=100.0).round(4)
    array([0.2206, 0.2206, 0.2206])
    """

    name = "FN"
    title = "Flicker noise"
    parameters = (Parameter("b2", "B²", "square of the flicker coefficient", signal_power=2, scale_power=1),)

    b2: Value = None

    @classmethod
    def exponents(cls, nonlinear: Numbers) -> tuple[Numbers, Numbers]:
        """Return ε = 0 and ν_1² = ln 2/π."""
        return np.zeros(len(nonlinear)), np.full(len(nonlinear), _LOG2 / math.pi)

    def correlation_time(self, rate: float) -> float:
        """Return inf, because flicker noise is not stationary."""
        return math.inf

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the bias instability coefficient B, as IEEE Std 952 defines it."""
        return (Physical("B_f", "flicker noise", math.sqrt(self.scale), 0.0, slopes={"b2": 0.5}),)


@dataclass(frozen=True, repr=False)
class PL(PowerLaw):
    """Power-law noise with the spectrum |f|^(−α), averaged over each sampling interval.

    ν_j² = ν_1² (τ_j/2)^(α−1), with τ_j = 2^j samples. Special cases are white noise (α = 0, ν_1² = σ²/2), flicker noise
    (α = 1, ν_1² = B² ln 2/π) and a continuous random walk (α = 2, ν_1² = γ²/6 for the variance γ² of its increments
    over a sampling interval). For α < 1 it is fractional Gaussian noise with H = (α + 1)/2 and the variance
    ν_1²/(1 − 2^(α−1)).

    Parameters
    ----------
    alpha : float, fixed or None
        Exponent α, between −1 and 3.
    nu2 : float, fixed or None
        Haar wavelet variance at the first level ν_1² (u²), half the Allan variance of successive samples.

    Examples
    --------
    >>> PL(alpha=1.5, nu2=1.0).wavelet_variance(3, rate=100.0).round(4)
    array([1.    , 1.4142, 2.    ])
    """

    name = "PL"
    title = "Power-law noise"
    parametrises = "power law"
    parameters = (
        Parameter("alpha", "α", "exponent of the spectrum", domain="between", limits=(-1.0, 3.0)),
        Parameter("nu2", "ν₁²", "wavelet variance at the first level", signal_power=2, scale_power=1),
    )

    alpha: Value = None
    nu2: Value = None

    @classmethod
    def exponents(cls, nonlinear: Numbers) -> tuple[Numbers, Numbers]:
        """Return ε = α − 1 and ν_1² = 1."""
        return nonlinear[:, 0] - 1.0, np.ones(len(nonlinear))


@dataclass(frozen=True, repr=False)
class FGN(PowerLaw):
    """Fractional Gaussian noise, the increments of a fractional Brownian motion with Hurst exponent H.

    r(k) = ½σ² (|k+1|^(2H) − 2|k|^(2H) + |k−1|^(2H)),  ν_j² = σ² (1 − 2^(2H−2)) (τ_j/2)^(2H−2).

    It has long memory for H > ½, and equals power-law noise with α = 2H − 1.

    Parameters
    ----------
    hurst : float, fixed or None
        Hurst exponent H, between 0 and 1; H = ½ is white noise.
    sigma2 : float, fixed or None
        Variance of a sample σ² (u²).

    Examples
    --------
    >>> FGN(hurst=0.5, sigma2=4.0).wavelet_variance(3, rate=100.0)
    array([2. , 1. , 0.5])
    """

    name = "FGN"
    title = "Fractional Gaussian noise"
    parametrises = "power law"
    stationary = True
    parameters = (
        Parameter("hurst", "H", "Hurst exponent", domain="between", limits=(0.0, 1.0)),
        Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1),
    )

    hurst: Value = None
    sigma2: Value = None

    @classmethod
    def exponents(cls, nonlinear: Numbers) -> tuple[Numbers, Numbers]:
        """Return ε = 2H − 2 and ν_1² = 1 − 2^(2H−2)."""
        epsilon = 2.0 * nonlinear[:, 0] - 2.0
        return epsilon, -np.expm1(epsilon * _LOG2)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum, K(m) = −½σ²|m|^(2H)."""
        m = np.abs(as_lags(lags)).astype(np.float64)
        return np.asarray(-0.5 * self.scale * m ** (2.0 * self.value("hurst")))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k) = ½σ² (|k+1|^(2H) − 2|k|^(2H) + |k−1|^(2H))."""
        return 0.5 * self.scale * self_similar.power_bend(as_lags(lags).astype(np.float64), self.law[0])

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance (u²), which is the autocovariance because the process is stationary."""
        return self.autocovariance(lags, rate)
