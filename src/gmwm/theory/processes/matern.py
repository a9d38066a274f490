"""Matérn process, which has a time scale and a smoothness parameter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate, freeze
from gmwm.base.errors import MissingTheoryError
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import circulant_embedding, haar_covariance, smooth_autocovariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.ladder import SMOOTHEST
from gmwm.theory.processes.ladder import matern as ladder
from gmwm.theory.processes.parameter import Parameter, Value
from gmwm.theory.processes.smooth_autocovariance import LARGEST_SMOOTHNESS, matern
from gmwm.theory.processes.validation import as_clusters, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace

LONGEST_LAGS = 2048  # largest number of lags L: with 19 levels, 3 million terms, 0.1 s and 150 MB; see benchmarks
NEGLIGIBLE_CORRELATION = 1e-11
"""Relative size of ρ(m) that is left out; the error of the covariance is then below 1e-10."""


@dataclass(frozen=True, eq=False)
class ShortMemory:
    """Autocovariance for scale 1: a table r(0), …, r(L), and Σ a e^(−λ|k|), or (−1)^k e^(−|λ|k) for λ < 0."""

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


_SHORT = 512  # largest length (samples) of paths that are simulated with a square root of their covariance matrix


@dataclass(frozen=True, repr=False)
class MAT(Process):
    """Matérn process, with the autocovariance σ² 2^(1−ν)/Γ(ν) (β|t|)^ν K_ν(β|t|) at the time lag t (s).

    K_ν is the modified Bessel function of the second kind. For ν = ½ the process is a Gauss-Markov process; larger ν
    gives smoother paths, smaller ν rougher paths. At frequencies well above β/2π its spectrum decreases as f^(−2ν−1).
    An exact state space exists for ν = ½, 3/2, 5/2, … only; for other ν up to 5, `state_space` is an approximation.

    The wavelet variance is computed from the autocovariance at a few hundred lags (see `smooth_autocovariance`), for
    any filter. Its relative error is 1e-12 for the Haar filter. The error is larger for long filters and small β,
    because the variance of a smooth path after such a filter is less than the rounding error.

    Parameters
    ----------
    beta : float, fixed or None
        Inverse time scale β (1/s).
    nu : float, fixed or None
        Smoothness ν, below 50.
    sigma2 : float, fixed or None
        Marginal variance σ² (u²).

    References
    ----------
    Lilly, J. M., Sykulski, A. M., Early, J. J. and Olhede, S. C. (2017), Fractional Brownian motion, the Matérn
    process, and stochastic modeling of turbulent dispersion, Nonlinear Processes in Geophysics 24, 481-514.

    Examples
    --------
    >>> MAT(beta=1.0, nu=0.5, sigma2=2.0).wavelet_variance(3, rate=10.0).round(6)
    array([0.095163, 0.131639, 0.207859])
    >>> MAT(beta=1.0, nu=1.5, sigma2=2.0).wavelet_variance(3, rate=10.0).round(6)
    array([0.004679, 0.016826, 0.055933])
    """

    name = "MAT"
    approximate = True
    title = "Matérn process"
    parameters = (
        Parameter("beta", "β", "inverse scale of time", time_power=-1),
        Parameter("nu", "ν", "smoothness", domain="between", limits=(0.0, LARGEST_SMOOTHNESS)),
        Parameter("sigma2", "σ²", "marginal variance", signal_power=2, scale_power=1),
    )

    beta: Value = None
    nu: Value = None
    sigma2: Value = None

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives (n, J, 2) of the wavelet variances with respect to β and ν, for σ² = 1."""
        numbers, rows = as_levels(levels), []
        sums = smooth_autocovariance.sums(filter, int(numbers[-1]))
        for beta, nu in np.asarray(nonlinear, dtype=np.float64):
            at = matern(sums.places * (beta / rate), nu)
            slopes, _ = sums.variance(-np.stack([at.by_distance, at.by_smoothness]), numbers)
            rows.append(slopes.T / [beta, 1.0])
        return np.array(rows).reshape(-1, numbers.size, 2)

    def _variance_under(self, filter: WaveletFilter, levels: NDArray[np.int64], rate: float) -> Vector:
        sums = smooth_autocovariance.sums(filter, int(levels[-1]))
        at = matern(sums.places * (self.value("beta") / rate), self.value("nu"))
        # Use the sum over the correlation or the sum over its complement, whichever loses fewer digits.
        values, sizes = sums.variance(np.stack([at.correlation, -at.lost]), levels)
        return np.asarray(self.scale * np.maximum(np.where(sizes[0] < sizes[1], values[0], values[1]), 0.0))

    @classmethod
    def room(cls, nonlinear: Matrix) -> Matrix:
        """Return the distance (n, 2) of β and ν from their domains' ends, at most 0.25 for ν, with which the variance
        of a slow process changes by orders of magnitude."""
        return np.minimum(super().room(nonlinear), [math.inf, 0.25])

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Return ranges (2, 2) of starts: β from 1/duration to the sampling rate, and ν from 0.1 to 3."""
        smoothness = cls.parameters[1].coordinate(np.array([0.1, 3.0]))
        return np.array([[math.log(rate / samples), math.log(rate)], smoothness])

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k) = σ² M(βkΔt), where M is the Matérn correlation."""
        return self._at_lags("correlation", lags, rate)

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance A(m) = −σ² [1 − M(βmΔt)], where M is the Matérn correlation."""
        return -self._at_lags("lost", lags, rate)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the covariance of the running sum, K(m) = −½ σ² [|m| + 2 Σ_{0 < k < |m|} (|m| − k) M(βkΔt)]."""
        m, unit = np.abs(as_lags(lags)), self.value("beta") / as_rate(rate)
        (zeroth,), (first,) = smooth_autocovariance.partial_sums(
            lambda k: matern(k * unit, self.value("nu")).correlation[None], m.ravel()
        )
        return np.asarray(-0.5 * self.scale * (m + 2.0 * (m * zeroth.reshape(m.shape) - first.reshape(m.shape))))

    def memory(self, rate: float) -> int | None:
        """Return the lag at which the autocovariance becomes negligible; None if this lag is too large."""
        tail = _short_memory(self.value("beta") / rate, self.value("nu"))
        return None if tail is None else tail.lags

    def coefficient_covariance(self, at: LagGrid, rate: float) -> Vector:
        """Compute the covariances (n,) of Haar wavelet coefficients (u²) from a table of the autocovariance."""
        tail = _short_memory(self.value("beta") / rate, self.value("nu"))
        if tail is None:
            raise self.missing("coefficient_covariance")
        return self.scale * tail.coefficient_covariance(at)

    def exponential_sum(self, rate: float) -> ExponentialSum | None:
        """Return the table of the autocovariance; None if it is too long."""
        tail = _short_memory(self.value("beta") / rate, self.value("nu"))
        return None if tail is None else ExponentialSum.of_table(self.scale * tail.autocovariance)

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance (σ²/n²) Σ_k w_k M(βkΔt) of n samples, with the Matérn correlation M, w_0 = n, w_k
        = 2n − 3k for 1 ≤ k ≤ n, and w_k = k − 2n for n < k ≤ 2n."""
        n, unit = as_clusters(clusters), self.value("beta") / as_rate(rate)

        def known(k: Vector) -> Matrix:
            at = matern(k * unit, self.value("nu"))
            return np.stack([at.correlation, -at.lost])

        h = n.ravel().astype(np.float64)
        zeroth, first = smooth_autocovariance.partial_sums(known, np.concatenate([n.ravel(), 2 * n.ravel()]))
        terms = np.stack([
            np.array([[1.0], [0.0]]) * h, 4.0 * h * zeroth[:, : h.size], -4.0 * first[:, : h.size],
            -2.0 * h * zeroth[:, h.size :], first[:, h.size :],
        ])  # fmt: skip
        values, sizes = np.sum(terms, axis=0), np.sum(np.abs(terms), axis=0)
        result = np.where(sizes[0] < sizes[1], values[0], values[1]) / h**2
        return np.asarray(self.scale * result.reshape(n.shape))

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate Gaussian sample paths (n,) or (paths, n) with a stationary start, exactly.

        Short paths use a root of the covariance, longer ones circulant embedding, for lags up to the path (ν ≤ ½,
        convex) or until the autocovariance is negligible. Raises MissingTheoryError beyond 2^25 samples."""
        n, count = as_paths(n, paths)
        rate, generator, size = as_rate(rate), as_rng(rng), math.sqrt(self.scale)
        if n <= _SHORT:
            # RᵀR is the correlation matrix of the samples.
            beta, k = self.value("beta"), np.arange(n)
            correlations = matern(k.astype(np.float64) * (beta / rate), self.value("nu")).correlation
            values, vectors = np.linalg.eigh(correlations[np.abs(np.subtract.outer(k, k))])
            draws = generator.standard_normal((count, n)) @ (np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T)
        else:
            draws = circulant_embedding.paths(self._amplitudes(n, rate), n, generator, count)
        draws *= size
        return np.asarray(draws.reshape(shape_of_paths(n, paths)))

    def state_space(self, rate: float) -> StateSpace:
        """Return the state space of Gauss-Markov processes, which drive others if ν > ½ (`ladder`); MissingTheoryError
        for ν > 5."""
        return self.continuous(rate).discrete(rate)

    def continuous(self, rate: float) -> ContinuousStateSpace:
        """Return the state space in continuous time, which `state_space` discretises."""
        size, nu, rate = self.scale, self.value("nu"), as_rate(rate)
        if nu > SMOOTHEST:
            raise MissingTheoryError(
                f"{self.name} has a state space for a smoothness ν of at most {SMOOTHEST:g}; got {nu:g}",
                advice="Use a smaller `nu`, or fit the wavelet variance.", theory="state_space", process=self.name,
            )  # fmt: skip
        space = ladder(self.value("beta") / rate, nu)
        return ContinuousStateSpace(
            A=rate * space.A, Qc=size * rate * space.Qc, H=space.H, Rc=size * space.Rc / rate, P0=size * space.P0
        )

    def correlation_time(self, rate: float) -> float | None:
        """Return the lag (s) at which the autocovariance is σ²/e; None if β or ν has no value."""
        beta, nu = self.values["beta"], self.values["nu"]
        if beta is None or nu is None:
            return None
        # Newton steps in ln x, or bisection if a step leaves the bracket.
        low, log, high = -700.0, 0.0, 5.0
        for _ in range(100):
            at = matern(np.array([math.exp(log)]), nu)
            excess, slope = float(at.correlation[0]) - math.exp(-1.0), float(at.by_distance[0])
            low, high = (log, high) if excess > 0 else (low, log)
            moved = log + excess / slope if slope > 0 else low
            before, log = log, moved if low < moved < high else 0.5 * (low + high)
            if abs(log - before) < 1e-13:
                break
        return math.exp(log) / beta

    def _at_lags(self, what: str, lags: ArrayLike, rate: float) -> Vector:
        # Number of lags that are computed individually, before the first octave of interpolated lags.
        single = 64
        k, rate = np.abs(as_lags(lags)), as_rate(rate)
        beta, nu = self.value("beta"), self.value("nu")
        # Smallest number of lags for which the correlation is interpolated, because this is then faster. Interpolation
        # does not change the result: tests/processes/test_matern.py, test_many_lags_are_interpolated_to_all_digits.
        if k.size < 4096:
            values = getattr(matern(k.ravel() * (beta / rate), nu), what)
        else:
            longest = int(k.max())
            places = smooth_autocovariance.spread_places(single, max(longest // single, 1).bit_length())
            values = smooth_autocovariance.spread(getattr(matern(places * (beta / rate), nu), what), k.ravel(), single)
        return np.asarray(self.scale * values.reshape(k.shape))

    def _amplitudes(self, n: int, rate: float) -> Vector:
        """Return the square roots of the eigenvalues of the circulant correlation matrix for paths of n samples."""
        # Largest half period of a circulant embedding (samples): 2^24 doubles take 128 MB.
        longest = 2**24
        beta, nu, half = self.value("beta"), self.value("nu"), circulant_embedding.half_period(n)
        if nu > 0.5:
            far = np.arange(8.0, 400.0, dtype=np.float64)
            # Correlations below this value are treated as zero; it is below the rounding error of 1.
            reach = far[np.argmax(matern(far, nu).correlation < 1e-18)] * rate / beta
            half = max(half, circulant_embedding.half_period(math.ceil(min(reach, 2.0 * longest))))
        if half > longest:
            raise MissingTheoryError(
                f"{self} is too slow and too smooth to be simulated at {rate:g} Hz: paths of {n} samples need a "
                f"circulant embedding of more than {2 * longest} samples",
                advice="Use a larger `beta`, a lower rate, at most {short} samples, or `nu` = 0.5.",
                short=_SHORT,
            )
        unit = self.with_values(sigma2=1.0)
        return circulant_embedding.amplitudes(lambda k: unit.autocovariance(k.astype(np.int64), rate), half)


@lru_cache(maxsize=64)
def _short_memory(unit: float, nu: float) -> ShortMemory | None:
    """Return the correlation at the lags 0, 1, 2, … for β = `unit` per sample; None if it decays too slowly."""
    if matern(np.array([LONGEST_LAGS * unit]), nu).correlation[0] > NEGLIGIBLE_CORRELATION:
        return None
    lags = np.arange(math.ceil((50.0 + 5.0 * nu) / unit) + 1, dtype=np.float64)
    table = trim(matern(lags * unit, nu).correlation)
    return None if table is None else ShortMemory(table)
