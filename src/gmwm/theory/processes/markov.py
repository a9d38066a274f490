"""First-order Markov processes: AR1 in discrete time and Gauss-Markov in continuous time."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Matrix, Vector, as_levels, as_rate
from gmwm.base.remarks import Remark
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import exponential_sum, filtered, haar_covariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.noise import RW, WN
from gmwm.theory.processes.parameter import Branch, Exponential, Occasion, Parameter, Physical, Value
from gmwm.theory.processes.validation import as_clusters, as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace

_PROCESS = "first-order Markov"

FEW_TIMES = 30
"""Correlation times in a recording below which intervals cover too little; docs/validation, study `short`."""
SEARCH_BEND = 0.01
"""The search coordinate is linear in λ below `SEARCH_BEND`/N and logarithmic above. At λ = `SEARCH_BEND`/N a recording
of N samples cannot distinguish the process from a random walk; see test_search_branches_run_along_the_parameter."""


@dataclass(frozen=True)
class _DecayCoordinate:
    """Search coordinate u of λ = bend·(e^(u − low) − 1 + `least`), with bend = `SEARCH_BEND`/N and low = ln bend. At
    the lower end, the process is practically a random walk; for larger λ, u approaches ln λ."""

    bend: float
    least: float

    @property
    def low(self) -> float:
        return math.log(self.bend)

    @property
    def high(self) -> float:
        return self.of(NEGLIGIBLE_EXPONENT)

    def decay(self, u: Vector) -> Vector:
        """Return λ at coordinates u."""
        return np.asarray(self.bend * (np.expm1(u - self.low) + self.least))

    def of(self, decay: float) -> float:
        """Return the coordinate u of a λ."""
        return self.low + math.log1p(decay / self.bend - self.least)


def _ar1_branch(samples: int, sign: float, low_acts_as: str | None) -> Branch:
    """Return the branch φ = ±e^(−λ) of an AR1, with larger λ than GM, as φ near 1 has a limited resolution."""
    along = _DecayCoordinate(SEARCH_BEND / samples, least=1e-3)

    def coordinate(phi: float) -> float | None:
        if (phi < 0) != (sign < 0):
            return None
        return along.of(float(exponential_sum.log_decay(np.array([phi]))[0]))

    return Branch(
        along.low, along.high, values=lambda u: sign * np.exp(-along.decay(u))[:, None],
        slope=lambda u: -sign * np.exp(u - along.decay(u))[:, None], coordinate=coordinate, low_acts_as=low_acts_as,
        high_acts_as=WN.name, exponential=Exponential(along.bend, along.least, sign, innovation=True),
    )  # fmt: skip


class _Markov(Process, abstract=True):
    """Theory of a first-order Markov process with marginal variance s² and φ = ±e^(−λ)."""

    repeatable = True
    parametrises = _PROCESS

    @abstractmethod
    def _pole(self, rate: float) -> tuple[float, float, float]:
        """Return the marginal variance s², the sign of φ, and λ."""

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k) = s²φ^|k|."""
        s2, sign, lam = self._pole(as_rate(rate))
        k = np.abs(as_lags(lags))
        return np.asarray(s2 * np.where(k % 2 == 1, sign, 1.0) * np.exp(-lam * k))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the covariance of the running sum, K(m) = −½s²[|m|(1+φ)/(1−φ) − 2φ(1−φ^|m|)/(1−φ)²]."""
        s2, sign, lam = self._pole(as_rate(rate))
        m = np.abs(as_lags(lags)).astype(np.float64)
        if sign > 0:
            return -0.5 * s2 * exponential_sum.block_variance(lam, m)
        phi = -math.exp(-lam)
        power = np.where(m % 2 == 1, 1.0 + np.exp(-lam * m), -np.expm1(-lam * m))
        return np.asarray(-0.5 * s2 * (m * -math.expm1(-lam) / (1 - phi) - 2 * phi * power / (1 - phi) ** 2))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute s²(φ^|m| − 1) (u²) for positive φ, which loses no digits for φ near 1, and s²φ^|m| for negative φ."""
        s2, sign, lam = self._pole(as_rate(rate))
        return s2 * np.expm1(-lam * np.abs(as_lags(lags))) if sign > 0 else self.autocovariance(lags, rate)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute the covariances (n,) of Haar wavelet coefficients (u²) in closed form."""
        s2, sign, lam = self._pole(as_rate(rate))
        return s2 * (haar_covariance.exponential(at, lam) if sign > 0 else haar_covariance.alternating(at, lam))

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return the exponential s²φ^|k|."""
        s2, sign, lam = self._pole(as_rate(rate))
        if lam > NEGLIGIBLE_EXPONENT:
            return ExponentialSum(white=s2)
        if lam < haar_covariance.WANDERING:
            return ExponentialSum(walk=2 * lam * s2)
        return ExponentialSum.of_exponential(s2, lam if sign > 0 else complex(lam, math.pi))

    def decays(self, rate: float) -> tuple[float, ...]:
        """Return the decay rate λ per sample, negative for negative φ."""
        _, sign, lam = self._pole(as_rate(rate))
        return (sign * lam,)

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance (u²) of clusters of n samples: for positive φ twice the wavelet variance at the
        half-scale n, else from the covariance of the running sum."""
        s2, sign, lam = self._pole(as_rate(rate))
        if sign < 0:
            return super().allan_variance(clusters, rate)
        n = as_clusters(clusters)
        shape = exponential_sum.gm_shape(np.array([lam]), n.ravel().astype(np.float64))
        return np.asarray(2.0 * s2 * shape.reshape(n.shape))

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the power spectral density S(f) = s²(1 − φ²)Δt/(1 − 2φ cos 2πfΔt + φ²)."""
        s2, sign, lam = self._pole(as_rate(rate))
        angle = np.pi * as_frequencies(frequencies, rate) / rate
        half = np.sin(angle) if sign > 0 else np.cos(angle)
        distance = math.expm1(-lam) ** 2 + 4.0 * math.exp(-lam) * half**2
        return np.asarray(-s2 * math.expm1(-2.0 * lam) / (rate * distance))

    def state_space(self, rate: float) -> StateSpace:
        """Return a state space whose single state is the process, starting in its stationary distribution."""
        s2, sign, lam = self._pole(as_rate(rate))
        return StateSpace(F=sign * math.exp(-lam), Q=-s2 * math.expm1(-2.0 * lam), H=1.0, P0=s2)

    def continuous(self, rate: float) -> ContinuousStateSpace | None:
        """Return A = −λ/Δt and Qc = 2λs²/Δt, from λ because ln φ loses digits for φ near 1; None if φ ≤ 0."""
        s2, sign, lam = self._pole(as_rate(rate))
        if sign < 0 or not math.isfinite(lam):
            return None
        return ContinuousStateSpace(A=-lam * rate, Qc=2.0 * lam * rate * s2, H=1.0, P0=s2)

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return a remark if the recording is so short, in correlation times, that intervals are too narrow."""
        _, sign, lam = self._pole(rate)
        times = lam * samples
        if sign < 0 or times >= FEW_TIMES:
            return ()
        return (Remark.of("few-correlation-times", term=term, count=float(times), least=FEW_TIMES),)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths with a stationary start, an array (n,) or (paths, n)."""
        as_paths(n, paths)
        s2, sign, lam = self._pole(as_rate(rate))
        draws = as_rng(rng).standard_normal(shape_of_paths(n, paths))
        innovation = math.sqrt(-s2 * math.expm1(-2.0 * lam))
        _core.autoregress(draws.reshape(-1, n), sign * math.exp(-lam), math.sqrt(s2), innovation)
        return draws


def _draw(occasion: Occasion, rng: np.random.Generator, draws: int, before: Vector | None, number: int) -> Matrix:
    """Draw marginal variances s² and φ (draws, 2) by Algorithm 3 of Balamuta et al. (see `Sampled`).

    The condition is `occasion.first` plus the `number` of earlier Markov terms; φ₋ (`before`) is the last one's φ, or
    0, and u is uniform.

    - In condition 1, φ = (1 − √(1 − u))/5.
    - In condition 2, φ is from U(max(0.9, φ₋), φ_max) and σ² from U(0, σ̂_T²(1 − φ²)/100).
    - Otherwise, φ = (φ_max − φ₋)√(1 − u) + φ₋. Except in 2, σ² is from U(½, 1) σ̂_T²(1 − φ)²; s² = σ²/(1 − φ²)."""
    # Largest φ of the starting values in Algorithm 3 of Balamuta et al. (see `Sampled`).
    fastest_drawn = 0.999995
    condition = occasion.first + number
    last = np.zeros(draws) if before is None else np.maximum(before, 0.0)
    u, v = rng.random((2, draws))
    root = np.sqrt(1.0 - u)
    low = np.maximum(0.9, last)
    later = np.where(condition == 2, low + u * (fastest_drawn - low), (fastest_drawn - last) * root + last)
    phi = np.where(condition == 1, (1.0 - root) / 5.0, later)
    half = occasion.total * (1.0 - phi) ** 2 / 2.0
    innovation = np.where(condition == 2, v * occasion.total * (1.0 - phi**2) / 100.0, half * (1.0 + v))
    return np.column_stack([innovation / (1.0 - phi**2), phi])


@dataclass(frozen=True, repr=False)
class AR1(_Markov):
    """First-order autoregression: X_t = φX_{t−1} + ε_t, Var ε = σ².

    The marginal variance is s² = σ²/(1 − φ²). With τ = 2^j samples, the Haar wavelet variance is

        ν_j² = σ² [τ(1 − φ²)/2 − 3φ + 4φ^(τ/2+1) − φ^(τ+1)] / [½τ²(1 − φ)²(1 − φ²)].

    Parameters
    ----------
    phi : float, fixed or None
        Coefficient φ per sample, −1 < φ < 1.
    sigma2 : float, fixed or None
        Innovation variance σ² (u²).

    Examples
    --------
    >>> AR1(phi=0.5, sigma2=3.0).wavelet_variance(2, rate=100.0)
    array([1.    , 0.9375])
    """

    name = "AR1"
    title = "First-order autoregression"
    parameters = (
        Parameter("phi", "φ", "autoregressive coefficient", domain="between", per_sample=True),
        Parameter("sigma2", "σ²", "innovation variance", signal_power=2, scale_power=1),
    )

    phi: Value = None
    sigma2: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J) for innovation variance 1."""
        if filter is not HAAR:
            return filtered.ar1_shape(np.asarray(nonlinear)[:, 0], filter, as_levels(levels))
        return exponential_sum.ar1_shape(np.asarray(nonlinear)[:, 0], _half_scales(levels))

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute ∂ν²/∂φ (n, J, 1) for innovation variance 1: exact for Haar, otherwise by finite differences."""
        if filter is not HAAR:
            return super().shape_jacobian(nonlinear, levels, rate, filter)
        return exponential_sum.ar1_slope(np.asarray(nonlinear)[:, 0], _half_scales(levels))[:, :, None]

    @classmethod
    def lag_covariances(cls, nonlinear: Matrix, lags: NDArray[np.int64], rate: float) -> Matrix:
        """Compute −φ^(l−1) (1 − φ)/(1 + φ)/4 (n, L) for innovation variance 1."""
        phi = np.asarray(nonlinear)[:, :1]
        return np.asarray(phi ** (lags - 1) * (phi - 1.0) / (1.0 + phi) / 4.0)

    @classmethod
    def search(cls, samples: int, rate: float) -> tuple[Branch, ...]:
        """Return the search branches φ = e^(−λ) and φ = −e^(−λ)."""
        # For φ → −1 the limit is a random walk of alternating sign, which gmwm does not include.
        return _ar1_branch(samples, 1.0, RW.name), _ar1_branch(samples, -1.0, None)

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw σ² and φ (draws, 2) as described at `_draw`."""
        drawn = _draw(occasion, rng, draws=draws, before=before[-1][:, 0] if before else None, number=len(before))
        return np.column_stack([drawn[:, 0] * (1.0 - drawn[:, 1] ** 2), drawn[:, 1]])

    def _pole(self, rate: float) -> tuple[float, float, float]:
        phi = self.value("phi")
        lam = float(exponential_sum.log_decay(np.array([phi]))[0])
        return self.scale / -math.expm1(-2.0 * lam), math.copysign(1.0, phi), lam

    def correlation_time(self, rate: float) -> float | None:
        """Return the correlation time −Δt/ln|φ| (s); None if φ has no value."""
        phi = self.values["phi"]
        if phi is None:
            return None
        return 0.0 if phi == 0 else float(1.0 / (rate * exponential_sum.log_decay(np.array([phi]))[0]))

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return T_c and q_c of the Gauss-Markov process with φ = e^(−Δt/T_c); nothing for φ ≤ 0."""
        s2, _, lam = self._pole(as_rate(rate))
        if not self.value("phi") > 0:
            return ()
        # ln T_c = −ln λ + …, ln q_c = ½ ln λ − ½ ln(1 − φ²) + …, with dλ/d ln φ = −1.
        return _bias(
            s2, lam * rate, {"phi": 1.0 / lam}, {"phi": 1.0 / math.expm1(2.0 * lam) - 0.5 / lam, "sigma2": 0.5}
        )


@dataclass(frozen=True, repr=False)
class GM(_Markov):
    """First-order Gauss-Markov process, with the autocovariance σ² e^(−β|t|) at the time lag t (s).

    The sampled process is an `AR1` with φ = e^(−βΔt) and marginal variance σ². The formula of its Haar wavelet variance
    is in the docstring of `AR1`.

    Parameters
    ----------
    beta : float, fixed or None
        Inverse correlation time β (1/s).
    sigma2 : float, fixed or None
        Marginal variance σ² (u²).

    Examples
    --------
    >>> GM(beta=1.0, sigma2=2.0).wavelet_variance(3, rate=10.0).round(6)
    array([0.095163, 0.131639, 0.207859])
    """

    name = "GM"
    title = "Gauss-Markov process"
    parameters = (
        Parameter("beta", "β", "inverse correlation time", time_power=-1),
        Parameter("sigma2", "σ²", "marginal variance", signal_power=2, scale_power=1),
    )

    beta: Value = None
    sigma2: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J) for marginal variance 1."""
        if filter is not HAAR:
            return filtered.gm_shape(np.asarray(nonlinear)[:, 0] / rate, filter, as_levels(levels))
        return exponential_sum.gm_shape(np.asarray(nonlinear)[:, 0] / rate, _half_scales(levels))

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives ∂ν²/∂β (n, J, 1) for marginal variance 1."""
        if filter is not HAAR:
            return (filtered.gm_slope(np.asarray(nonlinear)[:, 0] / rate, filter, as_levels(levels)) / rate)[:, :, None]
        slope = exponential_sum.gm_slope(np.asarray(nonlinear)[:, 0] / rate, _half_scales(levels))
        return (slope / rate)[:, :, None]

    @classmethod
    def lag_covariances(cls, nonlinear: Matrix, lags: NDArray[np.int64], rate: float) -> Matrix:
        """Compute −φ^(l−1) (1 − φ)²/4 (n, L) for marginal variance 1, φ = e^(−βΔt)."""
        decay = np.asarray(nonlinear)[:, :1] / rate
        return np.asarray(-np.exp(-decay * (lags - 1)) * np.expm1(-decay) ** 2 / 4.0)

    @classmethod
    def search(cls, samples: int, rate: float) -> tuple[Branch, ...]:
        """Return one search branch, from a random walk (small β) to white noise (large β)."""
        along = _DecayCoordinate(SEARCH_BEND / samples, least=1e-8)
        return (
            Branch(
                along.low, along.high, values=lambda u: rate * along.decay(u)[:, None],
                slope=lambda u: rate * np.exp(u)[:, None], coordinate=lambda beta: along.of(beta / rate),
                low_acts_as=RW.name, high_acts_as=WN.name, exponential=Exponential(along.bend, along.least),
            ),
        )  # fmt: skip

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Draw σ² and φ = e^(−βΔt) as described at `_draw`, and return σ² and β (draws, 2)."""
        phi = np.exp(-before[-1][:, 0] / occasion.rate) if before else None
        drawn = _draw(occasion, rng, draws=draws, before=phi, number=len(before))
        # φ = 0 is white noise, for which β would be infinite.
        decay = np.minimum(exponential_sum.log_decay(drawn[:, 1]), NEGLIGIBLE_EXPONENT)
        return np.column_stack([drawn[:, 0], occasion.rate * decay])

    def _pole(self, rate: float) -> tuple[float, float, float]:
        return self.scale, 1.0, self.value("beta") / rate

    def correlation_time(self, rate: float) -> float | None:
        """Return the correlation time 1/β (s); None if β has no value."""
        beta = self.values["beta"]
        return None if beta is None else 1.0 / beta

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the correlation time T_c = 1/β and the driving noise density q_c = √(2βσ²)."""
        as_rate(rate)
        return _bias(self.scale, self.value("beta"), {"beta": -1.0}, {"beta": 0.5, "sigma2": 0.5})


def _bias(s2: float, beta: float, time: dict[str, float], walk: dict[str, float]) -> tuple[Physical, ...]:
    """Return T_c and q_c with derivatives `time` and `walk`; for τ ≪ T_c it acts as a walk with K = q_c."""
    return (
        Physical("T_c", "correlation time", 1.0 / beta, 1.0, signal_power=0, slopes=time),
        Physical("q_c", "driving noise density", math.sqrt(2.0 * beta * s2), -0.5, slopes=walk),
    )


def _half_scales(levels: int | ArrayLike) -> Vector:
    return np.ldexp(1.0, as_levels(levels) - 1)
