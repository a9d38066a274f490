"""Flicker noise, power-law noise and fractional Gaussian noise: spectra |f|^(−α)."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Matrix, Vector, as_levels, as_rate
from gmwm.errors import MissingTheoryError
from gmwm.filters import HAAR, WaveletFilter
from gmwm.processes import haar_covariance, self_similar
from gmwm.processes.base import Process
from gmwm.processes.circulant_embedding import amplitudes, half_period, paths
from gmwm.processes.haar_covariance import LagGrid
from gmwm.processes.parameter import Parameter, Value
from gmwm.processes.physical import Physical
from gmwm.processes.self_similar import Numbers
from gmwm.processes.validation import as_clusters, as_frequencies, as_lags, as_paths, as_rng, shape_of_paths

_STEP = 1e-30
_LOG2 = math.log(2.0)


class PowerLaw(Process, abstract=True):
    """The mean of a continuous-time noise of spectrum |f|^(−α), −1 < α < 3, over each sampling interval.

    Its Haar wavelet variance is a power of the scale at every level, ν_j² = ν_1² (τ_j/2)^(α−1), and its running sum
    has the covariance K(m) = ½ν_1² m² (|m|^(α−1) − 1)/(2^(α−1) − 1), up to a + b m².
    """

    stationary = False

    @classmethod
    @abstractmethod
    def exponents(cls, nonlinear: NDArray[np.float64]) -> tuple[Numbers, Numbers]:
        """ε = α − 1 (n,) and ν_1² at scale coefficient 1 (n,); analytic."""

    @property
    def law(self) -> tuple[float, float]:
        """ε = α − 1 and ν_1² in u²."""
        epsilon, first = self.exponents(self.nonlinear.reshape(1, -1))
        return float(epsilon[0]), self.scale * float(first[0])

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """ν_1² (τ/2)^(α−1) for the Haar filter."""
        return np.asarray(cls._shape(nonlinear, as_levels(levels), filter))

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """∂ν²/∂θ (n, J, q), by complex steps, which are exact."""
        moved = np.asarray(nonlinear, dtype=np.complex128) + 1j * _STEP
        if not cls.nonlinear_parameters():
            return np.zeros((len(moved), as_levels(levels).size, 0))
        return np.asarray(cls._shape(moved, as_levels(levels), filter).imag[:, :, None] / _STEP)

    @classmethod
    def _shape(cls, nonlinear: Numbers, levels: NDArray[np.int64], filter: WaveletFilter) -> Numbers:
        epsilon, first = cls.exponents(nonlinear)
        if filter is HAAR:
            return np.asarray(first[:, None] * self_similar.powers_of_two(epsilon, levels))
        return np.asarray(first[:, None] * self_similar.filtered_shape(epsilon, filter, levels))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """K(m) = ½ν_1² m² (|m|^(α−1) − 1)/(2^(α−1) − 1), up to a + b m²."""
        epsilon, first = self.law
        kappa = float(self_similar.unit_factor(np.asarray(epsilon)))
        return 0.5 * first * kappa * self_similar.sum_covariance(as_lags(lags).astype(np.float64), epsilon)

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """A(m) = −K(m+1) + 2K(m) − K(m−1), in u² at integer `lags`; it falls without end, as m^(α−1)."""
        epsilon, first = self.law
        kappa = float(self_similar.unit_factor(np.asarray(epsilon)))
        return -0.5 * first * kappa * self_similar.bend(as_lags(lags).astype(np.float64), epsilon)

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """σ²(n) = 2ν_1² n^(α−1)."""
        epsilon, first = self.law
        return np.asarray(2.0 * first * as_clusters(clusters).astype(np.float64) ** epsilon)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Second differences of K over both half-scales: (n,) in u², one for each pair of levels and lag in `at`."""
        epsilon, first = self.law
        return first * haar_covariance.power(at, epsilon)

    def decays(self, rate: float) -> tuple[float, ...]:
        """A power of the lag is as smooth as exponentials of every length together."""
        return (2.0, 1e-290)

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """S(f) = C Σ_k |f + k/Δt|^(−α) sinc²((f + k/Δt)Δt), C of the continuous noise; at f = 0 its limit.

        Where the process is not stationary, as a filter that sums to 0 sees it.
        """
        f = as_frequencies(frequencies, as_rate(rate))
        epsilon, first = self.law
        return np.asarray(first * self_similar.spectrum(np.abs(f) / rate, epsilon) / rate)

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> NDArray[np.float64]:
        """Gaussian sample paths of the exact law: (n,), or (paths, n).

        From α = 1 on the increments are stationary, and X_0 is the first of them: the level is arbitrary.
        """
        n, count = as_paths(n, paths)
        as_rate(rate)
        epsilon, first = self.law
        return _simulated(epsilon, first, n=n, rng=as_rng(rng), count=count).reshape(shape_of_paths(n, paths))

    def missing(self, theory: str) -> MissingTheoryError:
        """Make the error for theory that the process does not define, with a substitute for a state space."""
        error = super().missing(theory)
        if theory != "state_space":
            return error
        error.message += "; no finite number of states has a spectrum |f|^(-α)"
        error.advice = "Fit Gauss-Markov processes instead, one for every two or three octaves of averaging time."
        return error


def _simulated(epsilon: float, first: float, n: int, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    found = paths(_roots(epsilon, half_period(n)), n, rng, count)
    found *= math.sqrt(first)
    return found if epsilon < 0 else np.asarray(np.cumsum(found, axis=1))


@lru_cache(maxsize=2)
def _roots(epsilon: float, half: int) -> Vector:
    """For paths of ν_1² = 1, or of their increments where ε ≥ 0; kept, as simulations come in hundreds."""
    if epsilon < 0:
        return amplitudes(lambda k: _variance(epsilon) * 0.5 * self_similar.power_bend(k, epsilon), half)
    ones = np.ones(half + 1)
    return amplitudes(lambda k: haar_covariance.power(LagGrid(ones, ones, k), epsilon), half)


def _variance(epsilon: float) -> float:
    """Variance of a sample where ν_1² = 1, ε < 0."""
    return -1.0 / math.expm1(epsilon * _LOG2)


@dataclass(frozen=True, repr=False)
class FN(PowerLaw):
    """Flicker noise, the bias instability of IEEE Std 952: two-sided density B²/(2π|f|), as its mean over each sample.

    ν_j² = B² ln 2/π at every level, so that the Allan deviation is flat at B √(2 ln 2/π) = 0.664 B.

    Parameters
    ----------
    b2 : float, fixed or None
        Square of the coefficient, B², in u².

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
        """0 and ln 2/π."""
        return np.zeros(len(nonlinear)), np.full(len(nonlinear), _LOG2 / math.pi)

    def correlation_time(self, rate: float) -> float:
        """Infinite: it wanders, though ever more slowly."""
        return math.inf

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """B = √B², the bias instability of a datasheet as IEEE 952 defines it."""
        return (Physical("B_f", "flicker noise", math.sqrt(self.scale), 0.0, slopes={"b2": 0.5}),)


@dataclass(frozen=True, repr=False)
class PL(PowerLaw):
    """Power-law noise: spectrum |f|^(−α), as its mean over each sample.

    ν_j² = ν_1² (τ_j/2)^(α−1). White noise has α = 0 and ν_1² = σ²/2, flicker noise α = 1 and ν_1² = B² ln 2/π. At α = 2
    it is a walk that goes on between the samples, ν_1² = γ²/6, γ² the variance of its steps. For α < 1 it is
    fractional Gaussian noise, H = (α + 1)/2, of variance ν_1²/(1 − 2^(α−1)).

    Parameters
    ----------
    alpha : float, fixed or None
        Exponent α, between −1 and 3.
    nu2 : float, fixed or None
        Haar wavelet variance at the first level ν_1², in u²: half the Allan variance of successive samples.

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
        """α − 1 and 1."""
        return nonlinear[:, 0] - 1.0, np.ones(len(nonlinear))


@dataclass(frozen=True, repr=False)
class FGN(PowerLaw):
    """Fractional Gaussian noise: increments of a Brownian motion of Hurst exponent H, long memory from H = ½ on.

    r(k) = ½σ² (|k+1|^(2H) − 2|k|^(2H) + |k−1|^(2H)),  ν_j² = σ² (1 − 2^(2H−2)) (τ_j/2)^(2H−2).

    The same law as power-law noise with α = 2H − 1.

    Parameters
    ----------
    hurst : float, fixed or None
        Hurst exponent H, between 0 and 1; ½ is white noise.
    sigma2 : float, fixed or None
        Variance of a sample σ², in u².

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
        """2H − 2 and 1 − 2^(2H−2)."""
        epsilon = 2.0 * nonlinear[:, 0] - 2.0
        return epsilon, -np.expm1(epsilon * _LOG2)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """K(m) = −½σ²|m|^(2H)."""
        m = np.abs(as_lags(lags)).astype(np.float64)
        return np.asarray(-0.5 * self.scale * m ** (2.0 * self.value("hurst")))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """r(k) = ½σ² (|k+1|^(2H) − 2|k|^(2H) + |k−1|^(2H))."""
        return 0.5 * self.scale * self_similar.power_bend(as_lags(lags).astype(np.float64), self.law[0])

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """The autocovariance r(k), in u² at integer `lags` and in their shape: the process is stationary.

        It has no dependence on `rate`: H is a pure number and σ² the variance of a sample.
        """
        return self.autocovariance(lags, rate)
