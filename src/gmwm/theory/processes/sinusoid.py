"""Sinusoids of random phase, such as mains hum, motor vibration or a turntable that is not level."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Integers, Matrix, Vector, as_levels, as_rate
from gmwm.base.remarks import Quantity, Remark
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import filtered
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.parameter import Parameter, Physical, Value
from gmwm.theory.processes.validation import as_clusters, as_lags, as_paths, as_rng, shape_of_paths
from gmwm.theory.statespace import StateSpace


@dataclass(frozen=True, repr=False)
class SIN(Process):
    """Sinusoid X_t = A sin(2πf₀tΔt + U) of fixed amplitude A and uniform random phase U.

    ν_j² = P |H_j(f₀)|² with P = A²/2. For the Haar filter it is P sin⁴(πhf₀Δt) / (h² sin²(πf₀Δt)), with h = τ_j/2.

    A model can contain several sinusoids of different frequencies; they are sorted by frequency. A frequency above half
    the rate appears at its alias: at a rate of 250 Hz, a sinusoid at 260 Hz appears at 10 Hz. The wavelet coefficients
    are not Gaussian, and their squares vary far less than for noise of the same variance; see `gmwm.covariance.lines`.

    A wavelet variance determines the frequency to a fraction of an octave at best. Fix the frequency if it is known:
    ``SIN(frequency=fixed(50.0))``.

    Parameters
    ----------
    frequency : float, fixed or None
        Frequency f₀ (Hz).
    power : float, fixed or None
        Mean square P = A²/2 (u²).

    Examples
    --------
    >>> SIN(frequency=1.0, power=0.5).wavelet_variance(3, rate=10.0).round(6)
    array([0.047746, 0.15625 , 0.267738])
    """

    name = "SIN"
    title = "Sinusoid"
    parameters = (
        Parameter("frequency", "f₀", "frequency", time_power=-1, unit_name="Hz"),
        Parameter("power", "P", "mean square", signal_power=2, scale_power=1),
    )
    repeatable = True

    frequency: Value = None
    power: Value = None

    @classmethod
    def has(cls, theory: str) -> bool:
        """Return whether the process defines this theory. A sinusoid has no power spectral density."""
        return super().has(theory) and theory != "psd"

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J) for P = 1, which are the squared gains |H_j(f₀)|²."""
        return _gain(np.asarray(nonlinear)[:, 0], as_levels(levels), rate, filter)[0]

    @classmethod
    def shape_jacobian(
        cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR
    ) -> Matrix:
        """Compute the derivatives (n, J, 1) of |H_j(f₀)|² with respect to f₀."""
        return _gain(np.asarray(nonlinear)[:, 0], as_levels(levels), rate, filter)[1][:, :, None]

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Return the range (1, 2) of ln f₀, from one period per recording to half the sampling rate."""
        return np.log([[rate / samples, rate / 2]])

    def line(self, rate: float) -> tuple[float, float]:
        """Return the power P, and f₀Δt or its alias in cycles per sample."""
        return self.scale, float(_fold(np.array([self.value("frequency")]), rate)[0]) / rate

    def oscillation(self) -> float:
        """Return the frequency f₀ (Hz)."""
        return self.value("frequency")

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k) = P cos(2πf₀kΔt)."""
        return np.asarray(self.scale * np.cos(2.0 * np.pi * self._turns(as_lags(lags), as_rate(rate))))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance A(m) = −2P sin²(πf₀mΔt)."""
        return np.asarray(-2.0 * self.scale * np.sin(np.pi * self._turns(as_lags(lags), as_rate(rate))) ** 2)

    def running_sum_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the generalised covariance of the running sum, K(m) = −½ P sin²(πmf₀Δt) / sin²(πf₀Δt)."""
        m, (_, cycles) = as_lags(lags), self.line(as_rate(rate))
        # If the frequency is a multiple of the rate, all samples are equal.
        ratio = m if cycles == 0 else np.sin(np.pi * self._turns(m, rate)) / math.sin(math.pi * cycles)
        return np.asarray(-0.5 * self.scale * ratio.astype(np.float64) ** 2)

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance 2P sin⁴(πnf₀Δt) / (n² sin²(πf₀Δt)) of clusters of n samples."""
        n = as_clusters(clusters)
        frequency = np.full(n.size, self.value("frequency"))
        gain = _haar_gain(frequency, n.ravel().astype(np.float64), as_rate(rate))[0]
        return np.asarray(2.0 * self.scale * gain.reshape(n.shape))

    def state_space(self, rate: float) -> StateSpace:
        """Return a state space with two states that rotate by 2πf₀Δt per sample, without process noise."""
        _, cycles = self.line(as_rate(rate))
        c, s = math.cos(2.0 * math.pi * cycles), math.sin(2.0 * math.pi * cycles)
        return StateSpace(F=[[c, s], [-s, c]], Q=np.zeros((2, 2)), H=[1.0, 0.0], P0=self.scale * np.eye(2))

    def continuous(self, rate: float) -> ContinuousStateSpace:
        """Return two states that rotate by 2πf₀ per second, or at its alias above half the sampling rate."""
        turn = 2.0 * math.pi * self.line(as_rate(rate))[1] * rate
        start = self.scale * np.eye(2)
        return ContinuousStateSpace(A=[[0.0, turn], [-turn, 0.0]], Qc=np.zeros((2, 2)), H=[1.0, 0.0], P0=start)

    def simulate(self, n: int, rate: float, rng: np.random.Generator | int, paths: int | None = None) -> Vector:
        """Simulate sample paths of fixed amplitude and random phase, an array (n,) or (paths, n)."""
        n, count = as_paths(n, paths)
        turns = self._turns(np.arange(n), as_rate(rate))
        path = turns + as_rng(rng).random((count, 1))
        np.sin(np.multiply(path, 2.0 * np.pi, out=path), out=path)
        path *= math.sqrt(2.0 * self.scale)
        return path.reshape(shape_of_paths(n, paths))

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the frequency f₀ (Hz) and the amplitude A = √(2P)."""
        as_rate(rate)
        return (
            Physical(
                symbol="f_0", title="frequency of a line", value=self.value("frequency"), time_power=-1.0,
                signal_power=0, slopes={"frequency": 1.0},
            ),
            Physical("A", "amplitude of a line", math.sqrt(2.0 * self.scale), 0.0, slopes={"power": 0.5}),
        )  # fmt: skip

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return a remark if the frequency is a multiple of half the rate: all samples are then A sin U, or alternate
        with −A sin U."""
        frequency, half = self.value("frequency"), 0.5 * as_rate(rate)
        turn = round(frequency / half)
        # If the phase changes by half a turn over the recording, the remark does not apply.
        if self.scale == 0 or turn == 0 or abs(frequency - turn * half) * samples >= half:
            return ()
        if turn % 2 == 0:
            return (Remark.of("line-invisible", case="rate", term=term, frequency=Quantity(frequency, "Hz")),)
        facts = {"frequency": Quantity(frequency, "Hz"), "half": Quantity(half, "Hz")}
        return (Remark.of("line-invisible", case="half", term=term, **facts),)

    def _turns(self, lags: Integers, rate: float) -> Vector:
        """Compute f₀kΔt modulo 1 at the full precision of f₀ for any lag."""
        below = _fold(np.array(self.value("frequency")), rate)
        # Products of a lag below 2^29 with the first 24 digits are exact.
        first = below.astype(np.float32).astype(np.float64)
        return np.asarray((np.fmod(lags * first, rate) + np.fmod(lags * (below - first), rate)) / rate)


def _fold(frequency: Vector, rate: float) -> Vector:
    """Reduce frequencies (Hz) by multiples of the rate to ±rate/2, without rounding."""
    alias = np.fmod(frequency, rate)
    return np.asarray(np.where(np.abs(alias) > 0.5 * rate, alias - np.copysign(rate, alias), alias))


def _gain(frequency: Vector, levels: Integers, rate: float, filter: WaveletFilter) -> tuple[Matrix, Matrix]:
    """Compute |H_j(f)|² (n, J) and its derivative with respect to f."""
    if filter is HAAR:
        return _haar_gain(frequency[:, None], np.ldexp(1.0, levels - 1), rate)
    return _any_gain(frequency, levels, rate, filter)


def _haar_gain(frequency: Matrix, half: Vector, rate: float) -> tuple[Matrix, Matrix]:
    """Compute sin⁴ a / (h² sin² b) and its derivative by f, a = πhfΔt (reduced without rounding), b = πfΔt."""
    below = _fold(frequency, rate)
    a, b = np.pi * (_fold(below * half, rate) / rate), np.pi * (below / rate)
    # If the frequency is a multiple of the rate, all samples are equal, and every wavelet filter gives zero.
    still = b == 0
    sine_b = np.where(still, 1.0, np.sin(b))
    ratio = np.where(still, 0.0, np.sin(a) / (half * sine_b))
    gain = ratio**2 * np.sin(a) ** 2
    # 2h sin a cos a − sin² a cot b; a ≤ hb avoids cancellation for small a and b.
    turn = 2.0 * half * np.sin(a) * np.cos(a) - np.sin(a) ** 2 * (np.cos(b) / sine_b)
    return np.asarray(gain), np.asarray(2.0 * np.pi / rate * ratio**2 * turn)


def _any_gain(frequency: Vector, levels: Integers, rate: float, filter: WaveletFilter) -> tuple[Matrix, Matrix]:
    """Compute Π_{i < j−1} G(2^i φ) · G(½ − 2^(j−1) φ) and its derivative by f; G half the squared gain, φ = fΔt."""
    gain, slope = np.ones(frequency.size), np.zeros(frequency.size)
    below = _fold(frequency, rate)
    gains = np.empty((frequency.size, int(levels[-1])))
    slopes = np.empty_like(gains)
    for j in range(gains.shape[1]):
        here, factor = _fold(np.ldexp(below, j), rate), np.ldexp(1.0 / rate, j)
        # Near half the rate the cosine is proportional to the distance from half the rate, which is exact.
        cosine, sine = np.sin(np.pi * (0.5 * rate - np.abs(here)) / rate), np.sin(np.pi * here / rate)
        value, change = _scaling_gain(cosine, sine, filter)
        last, turn = _scaling_gain(sine, cosine, filter)
        gains[:, j] = gain * last
        slopes[:, j] = slope * last - gain * turn * factor
        gain, slope = gain * value, slope * value + gain * change * factor
    return gains[:, levels - 1], slopes[:, levels - 1]


def _scaling_gain(cosine: Vector, sine: Vector, filter: WaveletFilter) -> tuple[Vector, Vector]:
    """Compute G(φ) = (4 cos² πφ)^p R(φ) and its derivative; g(z) = (1 + z)^p Q(z) without its zeros stays accurate. R
    is Daubechies' polynomial in sin² πφ for 2p taps, otherwise |Q|²."""
    p, power, slope = filter.vanishing_moments, 4.0 * cosine**2, -8.0 * np.pi * cosine * sine
    if filter.length == 2 * p:
        terms = np.array([math.comb(p - 1 + k, k) for k in range(p)]) / 4.0**p
        gain, turn = np.polyval(terms[::-1], sine**2), -0.25 * slope * np.polyval(np.polyder(terms[::-1]), sine**2)
    else:
        taps, z = _without_zeros(filter), (cosine - 1j * sine) ** 2
        q = np.polyval(taps[::-1], z)
        gain = np.abs(q) ** 2
        turn = 4.0 * np.pi * np.imag(np.polyval((taps * np.arange(taps.size))[::-1], z) * np.conj(q))
    return np.asarray(power**p * gain), np.asarray(p * power ** (p - 1) * slope * gain + power**p * turn)


@lru_cache(maxsize=64)
def _without_zeros(filter: WaveletFilter) -> Vector:
    """Return the coefficients of Q(z) in the scaling filter g(z) = (1 + z)^p Q(z), which has p zeros at z = −1."""
    factor = filtered.without_zero(filter)
    for _ in range(filter.vanishing_moments - 1):
        sign = (-1.0) ** np.arange(factor.size)
        factor = np.asarray((np.cumsum(factor * sign) * sign)[:-1])
    return factor
