"""White noise and quantization noise.

To add a process of your own, write a class like the ones below, in this file or in a new one that
`processes/__init__.py` imports; the order there is the order in which processes are shown. It needs

- `name`, `title` and `parameters`, with a field for each; exactly one has a `scale_power`. `parameter.py` says what a
  parameter can be, and `markov.py` shows one that changes the shape. `self.value("beta")` is its value, held or not;
- one piece of theory. `state_space` gives all the rest, and at every level; `autocovariance` all but a state space;
  `running_sum_covariance` the wavelet variance and its covariance; `shape` the wavelet variance alone;
- `correlation_time` and `physical`, if its parameters mean something in continuous time that a datasheet could tell.

Everything else follows from these (see `base.py`), and the parser, the command line and the law tests find the class by
themselves: `WN` down to its `physical` is a whole process. Define a further method only where it is more exact or
faster than the default; the law tests then hold the two against each other. A difference such as 1 − e^(−x) cancels
where x is small: write −expm1(−x). `search` says where to look for the one parameter of a shape; with it fits are
proven to be the best there are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Matrix, Vector, as_levels, as_rate
from gmwm.filters import HAAR, WaveletFilter
from gmwm.processes import filtered, haar_covariance
from gmwm.processes.base import Process
from gmwm.processes.haar_covariance import LagGrid
from gmwm.processes.parameter import Parameter, Value
from gmwm.processes.physical import Physical
from gmwm.processes.start_context import Occasion
from gmwm.processes.validation import as_frequencies, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.statespace import StateSpace


@dataclass(frozen=True, repr=False)
class WN(Process):
    """White noise: X_t uncorrelated with variance σ²; angular or velocity random walk after integration.

    ν_j² = σ²/τ_j.

    Parameters
    ----------
    sigma2 : float, fixed or None
        Variance per sample σ², in u².

    Examples
    --------
    >>> WN(sigma2=4.0).wavelet_variance(3, rate=100.0)
    array([2. , 1. , 0.5])
    """

    name = "WN"
    title = "White noise"
    parameters = (Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1),)

    sigma2: Value = None

    def state_space(self, rate: float) -> StateSpace:
        """No state: observation noise of variance σ²."""
        return StateSpace(F=[], Q=[], H=[], R=self.scale)

    def correlation_time(self, rate: float) -> float:
        """0: successive samples are uncorrelated."""
        return 0.0

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """N = √(σ²Δt)."""
        density = math.sqrt(self.scale / as_rate(rate))
        return (Physical("N", "white noise density", density, 0.5, slopes={"sigma2": 0.5}),)

    # A process is whole here. What follows is known in closed form: more exact, or faster, than what these give.

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """1/τ for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.white_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        return np.tile(np.ldexp(1.0, -as_levels(levels)), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """σ² ~ U(σ̂_T²/2, σ̂_T²) where white noise dominates, else U(σ̂_T²/10⁵, σ̂_T²/10)."""
        low, high = (0.5, 1.0) if occasion.dominant == "white" else (1e-5, 0.1)
        return rng.uniform(low * occasion.total, high * occasion.total, (draws, 1))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """K(m) = −σ²|m|/2."""
        return np.asarray(-0.5 * self.scale * np.abs(as_lags(lags)))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """r(k) = σ² at k = 0, else 0."""
        return np.where(as_lags(lags) == 0, self.scale, 0.0)

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Triangles, zero beyond the reach of the filters: (n,) in u², one for each pair of levels and lag in `at`."""
        return self.scale * haar_covariance.white(at)

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> NDArray[np.float64]:
        """Gaussian sample paths: (n,), or (paths, n)."""
        as_paths(n, paths), as_rate(rate)
        draws = as_rng(rng).standard_normal(shape_of_paths(n, paths))
        draws *= math.sqrt(self.scale)
        return draws


@dataclass(frozen=True, repr=False)
class QN(Process):
    """Quantization noise of a sensor that rounds the accumulated quantity: X_t = e_t − e_{t−1}, Var e = Q².

    ν_j² = 6Q²/τ_j². The e_t are uniform, as a rounding error is: e = √12·Q·(U − ½).

    Parameters
    ----------
    q2 : float, fixed or None
        Variance of the rounding error Q², in u².

    Examples
    --------
    >>> QN(q2=2.0).wavelet_variance(3, rate=100.0)
    array([3. , 0.75 , 0.1875])
    """

    name = "QN"
    title = "Quantization noise"
    parameters = (Parameter("q2", "Q²", "variance of the rounding error", signal_power=2, scale_power=1),)

    q2: Value = None

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """6/τ² for the Haar filter."""
        if filter is not HAAR:
            return np.tile(filtered.quantization_shape(filter, as_levels(levels)), (len(nonlinear), 1))
        return np.tile(np.ldexp(6.0, -2 * as_levels(levels)), (len(nonlinear), 1))

    @classmethod
    def drawn(cls, occasion: Occasion, rng: np.random.Generator, draws: int, before: tuple[Matrix, ...]) -> Matrix:
        """Q² ~ U(σ̂_T²/8, σ̂_T²/3) where quantization noise dominates, else U(σ̂_T²/(2·10⁵), σ̂_T²/100)."""
        low, high = (1 / 8, 1 / 3) if occasion.dominant == "quantization" else (5e-6, 0.01)
        return rng.uniform(low * occasion.total, high * occasion.total, (draws, 1))

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """K(m) = Q² at m = 0, else 0: the running sum is e_t itself."""
        return np.where(as_lags(lags) == 0, self.scale, 0.0)

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """r(k) = 2Q², −Q² at k = ±1, else 0."""
        k = np.abs(as_lags(lags))
        return self.scale * (np.where(k == 0, 2.0, 0.0) - np.where(k == 1, 1.0, 0.0))

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Spikes at nine lags: (n,) in u², one for each pair of levels and lag in `at`."""
        return self.scale * haar_covariance.quantization(at)

    @property
    def error_cumulant(self) -> float:
        """−1.2 Q⁴, of a uniform e."""
        return -1.2 * self.scale**2

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """S(f) = 4Q² sin²(πfΔt) Δt."""
        f = as_frequencies(frequencies, as_rate(rate))
        return np.asarray(4.0 * self.scale * np.sin(np.pi * f / rate) ** 2 / rate)

    def state_space(self, rate: float) -> StateSpace:
        """States (e_t, e_{t−1}); second moments only, the e are Gaussian to whoever uses it."""
        q2 = self.scale
        return StateSpace(
            F=[[0.0, 0.0], [1.0, 0.0]],
            Q=[[q2, 0.0], [0.0, 0.0]],
            H=[1.0, -1.0],
            P0=[[q2, 0.0], [0.0, q2]],
        )

    def simulate(
        self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None
    ) -> NDArray[np.float64]:
        """Sample paths with uniform rounding errors: (n,), or (paths, n)."""
        as_paths(n, paths), as_rate(rate)
        errors = as_rng(rng).random(shape_of_paths(n + 1, paths))
        differences = np.diff(errors, axis=-1)
        differences *= math.sqrt(12.0 * self.scale)
        return differences

    def correlation_time(self, rate: float) -> float:
        """0: samples more than one step apart are uncorrelated."""
        return 0.0

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Q of the standard, of the accumulated quantity: Q Δt."""
        error = math.sqrt(self.scale) / as_rate(rate)
        return (Physical("Q", "quantization noise", error, 1.0, slopes={"q2": 0.5}),)
