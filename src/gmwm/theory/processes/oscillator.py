"""Damped oscillator driven by white noise, such as a resonance, sway, or the temperature cycle of a room."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Matrix, Vector, as_levels, as_rate, freeze
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.text import round_text
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes import exponential_sum
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.matern import LONGEST_LAGS, NEGLIGIBLE_CORRELATION
from gmwm.theory.processes.parameter import Parameter, Physical, Value
from gmwm.theory.processes.validation import as_clusters, as_frequencies, as_lags
from gmwm.theory.statespace import StateSpace

CRITICAL, SHARPEST = 0.5, 1e9
"""Qualities of an oscillator: at ½ it does not oscillate, and 10⁹ periods do not distinguish a sinusoid."""
PERIODIC_QUALITY = 2.0  # quality of nearly periodic processes: density at low frequencies below a quarter of the peak's
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
"""Integrates the process noise of a step of ω₀Δt < 1 to all digits."""


@dataclass(frozen=True, repr=False)
class OSC(Process):
    """Damped oscillator x″ + (ω₀/Q) x′ + ω₀² x = w, driven by white noise w, with ω₀ = 2πf₀ and Q > ½.

    Its autocovariance is σ² e^(−at) [cos ωt + (a/ω) sin ωt] at the time lag t (s), with a = ω₀/2Q and ω² = ω₀² − a².
    The spectrum has a peak at f₀ whose width at half its height is f₀/Q. For a large Q, the process is a sinusoid whose
    amplitude and phase wander with the correlation time Q/πf₀; at Q = ½ it is a smooth bias.

    The process is sampled, so that a frequency above half the sampling rate appears at its alias.

    Parameters
    ----------
    frequency : float, fixed or None
        Natural frequency f₀ (Hz).
    quality : float, fixed or None
        Quality factor Q, larger than ½.
    sigma2 : float, fixed or None
        Marginal variance σ² (u²).

    References
    ----------
    Jazwinski, A. H. (1970), Stochastic Processes and Filtering Theory, section 4.3, for the linear stochastic
    differential equation and its covariance.

    Examples
    --------
    >>> OSC(frequency=1.0, quality=5.0, sigma2=2.0).wavelet_variance(3, rate=10.0).round(6)
    array([0.18328 , 0.565485, 0.934259])
    """

    name = "OSC"
    title = "Damped oscillator"
    parameters = (
        Parameter("frequency", "f₀", "natural frequency", time_power=-1, unit_name="Hz"),
        Parameter("quality", "Q", "quality factor", domain="between", limits=(CRITICAL, SHARPEST)),
        Parameter("sigma2", "σ²", "marginal variance", signal_power=2, scale_power=1),
    )
    repeatable = True

    frequency: Value = None
    quality: Value = None
    sigma2: Value = None

    @classmethod
    def scan(cls, samples: int, rate: float) -> Matrix:
        """Return ranges (2, 2) of starts: f₀ from one period per recording to half the rate, and Q from 0.7 to 300."""
        return np.log([[rate / samples, rate / 2], [0.7 - CRITICAL, 300.0 - CRITICAL]])

    @classmethod
    def coordinates(cls, nonlinear: Matrix) -> Matrix:
        """Transform f₀ and Q (n, 2) to ln f₀ and ln(Q − ½)."""
        return np.log(nonlinear - [0.0, CRITICAL])

    @classmethod
    def at_coordinates(cls, z: NDArray[Any]) -> NDArray[Any]:
        """Compute f₀ and Q (n, 2) at coordinates, which are complex for derivatives."""
        return np.asarray(np.exp(z) + np.array([0.0, CRITICAL]))

    @classmethod
    def shape(cls, nonlinear: Matrix, levels: int | ArrayLike, rate: float, filter: WaveletFilter = HAAR) -> Matrix:
        """Compute the wavelet variances (n, J) for σ² = 1; for the Haar filter in closed form."""
        frequency, quality = np.asarray(nonlinear).T
        natural = 2.0 * math.pi / as_rate(rate) * frequency
        damping, turn = (natural * part for part in _relative_rates(quality))
        if filter is not HAAR or np.any(turn < 1e-3 * natural):
            return super().shape(nonlinear, levels, rate, filter)
        return exponential_sum.oscillation_shape(damping, turn, np.ldexp(1.0, as_levels(levels) - 1))

    def autocovariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute the autocovariance r(k)."""
        t = np.abs(as_lags(lags)) / as_rate(rate)
        damping, turn = self._rates()
        angle = turn * t
        return np.asarray(self.scale * np.exp(-damping * t) * (np.cos(angle) + damping * t * np.sinc(angle / np.pi)))

    def generalised_covariance(self, lags: ArrayLike, rate: float) -> Vector:
        """Compute A(m) = r(m) − r(0), at short lags by a series in ω₀t, whose first terms would cancel."""
        x = np.asarray(2.0 * math.pi * self.value("frequency") / as_rate(rate) * np.abs(as_lags(lags)))
        result, near = np.array(self.autocovariance(lags, rate) - self.scale), x < 1.0
        before, last, small = 1.0, 0.0, x[near]  # coefficients of x⁰ and x¹ in r/σ²
        series = np.zeros(small.shape)
        # Terms of the series of the autocovariance at ω₀t < 1, whose n-th term is below 2ⁿ/n!.
        for n in range(2, 40):
            before, last = last, -((n - 1) / self.value("quality") * last + before) / (n * (n - 1))
            series += last * small**n
        result[near] = self.scale * series
        return result

    def exponential_sum(self, rate: float) -> ExponentialSum:
        """Return the pair of complex exponentials of the autocovariance."""
        damping, turn = self._rates()
        # At Q = ½ the two exponentials coincide. This changes the autocovariance by 1e-6 there.
        turn = max(turn, 1e-3 * damping)
        decay, cycle = damping / as_rate(rate), math.fmod(turn / rate, 2.0 * math.pi)
        if decay > NEGLIGIBLE_EXPONENT:
            return ExponentialSum(white=self.scale)
        alias = cycle > math.pi
        amplitude = complex(self.scale, (-1.0 if alias else 1.0) * self.scale * damping / turn)
        return ExponentialSum.of_exponential(amplitude, complex(decay, 2.0 * math.pi - cycle if alias else cycle))

    def allan_variance(self, clusters: ArrayLike, rate: float) -> Vector:
        """Compute the Allan variance (u²) of clusters of n samples, twice the Haar wavelet variance."""
        n, (damping, turn) = as_clusters(clusters), self._rates()
        if turn < 1e-3 * math.tau * self.value("frequency"):
            return super().allan_variance(n, rate)
        rates = np.array([[damping], [turn]]) / as_rate(rate)
        shape = exponential_sum.oscillation_shape(rates[0], rates[1], n.ravel().astype(np.float64))
        return np.asarray(2.0 * self.scale * shape[0].reshape(n.shape))

    def memory(self, rate: float) -> int | None:
        """Return the lag at which the autocovariance is negligible; None if it is too large."""
        decay = self._rates()[0] / as_rate(rate)
        # The factor (1 + 1/decay)³ covers the double sum of the tail, and (1 + at) near Q = ½.
        lags = math.ceil((3.0 * math.log1p(1.0 / decay) - math.log(NEGLIGIBLE_CORRELATION)) / decay)
        return lags if lags <= LONGEST_LAGS else None

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Compute the density of the recursion of the two states, which is a sum of terms that are not negative."""
        rate = as_rate(rate)
        f = as_frequencies(frequencies, rate)
        transition, noise = _recursion(2.0 * math.pi * self.value("frequency") / rate, self.value("quality"))
        z = np.exp(2j * np.pi / rate * f)
        rows = z - transition[1, 1], transition[0, 1]
        square = np.abs(rows[0]) ** 2 * noise[0, 0] + rows[1] * (
            2.0 * rows[0].real * noise[0, 1] + rows[1] * noise[1, 1]
        )
        determinant = rows[0] * (z - transition[0, 0]) - transition[0, 1] * transition[1, 0]
        return np.asarray(self.scale / rate * square / np.abs(determinant) ** 2)

    def state_space(self, rate: float) -> StateSpace:
        """Return a state space whose states are the process and its velocity divided by ω₀."""
        transition, noise = _recursion(2.0 * math.pi * self.value("frequency") / as_rate(rate), self.value("quality"))
        return StateSpace(F=transition, Q=self.scale * noise, H=[1.0, 0.0], P0=self.scale * np.eye(2))

    def continuous(self, rate: float) -> ContinuousStateSpace:
        """Return the state space in continuous time, with the same states."""
        as_rate(rate)
        natural, loss = 2.0 * math.pi * self.value("frequency"), 1.0 / self.value("quality")
        return ContinuousStateSpace(
            A=natural * np.array([[0.0, 1.0], [-1.0, -loss]]), Qc=np.diag([0.0, 2.0 * loss * natural * self.scale]),
            H=[1.0, 0.0], P0=self.scale * np.eye(2),
        )  # fmt: skip

    def correlation_time(self, rate: float) -> float | None:
        """Return the time Q/πf₀ (s) of decay of the envelope to 1/e; None if f₀ or Q has no value."""
        frequency, quality = self.values["frequency"], self.values["quality"]
        return None if frequency is None or quality is None else quality / (math.pi * frequency)

    def oscillation(self) -> float | None:
        """Return the frequency f₀ (Hz) if Q is at least `PERIODIC_QUALITY`."""
        return self.value("frequency") if self.value("quality") >= PERIODIC_QUALITY else None

    def remarks(self, term: str, samples: int, rate: float) -> tuple[Remark, ...]:
        """Return a remark on an oscillation with a period above 3 s, which N and K for a horizon of 1 s leave out."""
        frequency = self.oscillation()
        if self.scale == 0 or frequency is None or 3.0 * frequency >= 1.0:
            return ()
        return (Remark.of("lines", case="oscillation", term=term, frequency=Quantity(frequency, "Hz")),)

    def physical(self, rate: float) -> tuple[Physical, ...]:
        """Return the frequency f₀ (Hz), the quality factor Q and the standard deviation σ."""
        as_rate(rate)
        return (
            Physical(
                "f_0", "frequency of an oscillation", self.value("frequency"), -1.0, signal_power=0,
                slopes={"frequency": 1.0},
            ),
            Physical(
                "Q_0", "quality factor of an oscillation", self.value("quality"), 0.0, signal_power=0,
                slopes={"quality": 1.0},
            ),
            Physical("rms", "rms of an oscillation", math.sqrt(self.scale), 0.0, slopes={"sigma2": 0.5}),
        )  # fmt: skip

    def _rates(self) -> tuple[float, float]:
        """Return the damping a and the angular frequency ω (1/s)."""
        ratio, turn = _relative_rates(np.asarray(self.value("quality")))
        natural = 2.0 * math.pi * self.value("frequency")
        return natural * float(ratio), natural * float(turn)


def name_in_text(term: str, process: Process) -> str:
    """Return the name of a term for readers; nearly periodic ones are named by frequency, not number.

    >>> from gmwm.processes import SIN, WN
    >>> name_in_text("OSC[2]", OSC(frequency=0.5643, quality=90.0, sigma2=1.0)), name_in_text("WN", WN())
    ('oscillation 0.564 Hz', 'WN')
    >>> name_in_text("SIN", SIN(frequency=50.0, power=1.0))
    'line 50 Hz'
    """
    frequency = process.oscillation() if process.is_complete else None
    if frequency is None:
        return term
    return f"{'oscillation' if isinstance(process, OSC) else 'line'} {round_text(frequency, 3)} Hz"


def _relative_rates(quality: Vector) -> tuple[Vector, Vector]:
    """Return the damping a and the angular frequency ω, relative to ω₀."""
    ratio = 0.5 / quality
    return ratio, np.sqrt((1.0 - ratio) * (1.0 + ratio))


@lru_cache(maxsize=256)
def _recursion(step: float, quality: float) -> tuple[Matrix, Matrix]:
    """Return e^(AΔt) and the covariance of the process noise for σ² = 1, for the angle ω₀Δt of a step."""
    ratio, turn = (float(part) for part in _relative_rates(np.asarray(quality)))

    def transition(angle: Vector) -> NDArray[np.float64]:
        """Return e^(At) (2, 2, n) at the angles ω₀t."""
        even, odd = np.cos(turn * angle), angle * np.sinc(turn * angle / math.pi)
        return np.asarray(np.exp(-ratio * angle) * np.array([[even + ratio * odd, odd], [-odd, even - ratio * odd]]))

    matrix = transition(np.array([step]))[:, :, 0]
    if step < 1.0:  # the two terms of Σ − F Σ Fᵀ would cancel
        response = transition(0.5 * step * (_NODES + 1.0))[:, 1]
        return freeze(matrix), freeze(step / quality * (response * _WEIGHTS) @ response.T)
    return freeze(matrix), freeze(np.eye(2) - matrix @ matrix.T)
