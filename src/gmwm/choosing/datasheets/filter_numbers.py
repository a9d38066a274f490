"""N and K with which a filter predicts a noise best and states its own error, and the full model's error."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, reduce

import numpy as np
from numpy.polynomial.chebyshev import chebpts1
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.errors import GmwmError
from gmwm.base.lazy import scipy
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace

_LEGENDRE = leggauss(12)
"""Nodes and weights of the Gauss-Legendre rule of each panel, which integrates one period of a cosine within 1e-12."""
_FIRST = 1e-14  # lowest angular frequency (rad per sample) of a panel; below, power laws are integrated in closed form
_COARSE, _FINE = 4.0, 2**0.25
"""Ratios of the ends of a panel at low frequencies, and above `_RESONANT`, where the spectrum may have resonances."""
_RESONANT = 0.01  # angular frequency (rad per sample) above which the panels are narrow enough to detect resonances
_PERIODS = 76  # periods 2π/n of a mean of n samples with panels of their own; above, the oscillating part is negligible
_FADE, _WIDTH = 300.0, 30.0
"""Centre and width (rad) of the smooth transition to frequencies at which the oscillating part is left out."""

LEAST_PERIODS, MOST_PERIODS = 1 / 3, 10.0
"""Periods in the horizon of a line in the error: faster ones average out, slower ones would be followed
(tests/test_filter_numbers.py). On 11 axes of an ADIS16405 (0.56 Hz), stated over real error at 1 s is 1.00 with, 0.79
to 0.89 without lines, which predict better at 1, 10 and 60 s (docs/concepts/two-numbers.md)."""

Spectrum = Callable[[Vector], Vector]
"""Density (u² per sample) at angular frequencies (rad per sample) above zero; 1 for white noise of variance 1."""
Shape = tuple[type[Process], bytes]  # class and nonlinear parameters of a process, which its strength does not change


@dataclass(frozen=True, eq=False)
class CurveRatio:
    """Ratio of measured to model spectrum by frequency: logarithms by level and their errors, 0 where they agree."""

    levels: Vector
    logs: Vector
    errors: Vector

    def __call__(self, theta: Vector) -> Vector:
        """Return the ratio at frequencies (rad per sample), linear in logarithms between octave centres √2 π/2^j."""
        level = math.log2(math.sqrt(2) * math.pi) - np.log2(theta)
        return np.asarray(np.exp(np.interp(level, self.levels, self.logs)))

    def moved(self) -> Iterator[CurveRatio]:
        """Yield the ratio with its logarithm increased by one standard error at one level after another."""
        for k in np.flatnonzero(self.errors):
            yield replace(self, logs=self.logs + np.where(np.arange(self.logs.size) == k, self.errors, 0.0))


@dataclass(frozen=True, eq=False)
class Quadrature:
    """Angular frequencies (rad per sample) at which |G − H|² of n samples is integrated, and weights over π.

    One object serves all noises with the same resonances, so that the responses are computed once for them."""

    theta: Vector
    weights: Vector
    samples: int

    def mass(self, density: Vector) -> Vector:
        """Return the weights times a density."""
        # Below the first panel, ∫ θ² θ^(−α) dθ is the mass of one frequency, because |G − H|² grows as θ².
        power = math.log(density[0] / density[1]) / math.log(self.theta[1] / self.theta[0]) if density[0] > 0 else 0.0
        mass = np.asarray(self.weights * density)
        mass[0] /= 3 - power
        return mass

    @cached_property
    def terms(self) -> Matrix:
        """(5, m) numbers a, b, c, d and e = |1 − e^{−iθ}|² that do not depend on the gain, with k = 1 − g and

            |G − H|² = a + (b g² + c g k + d k²)/(g² + e k),

        from |G|² and H above one radian of the mean, and from G − 1 and 1 − H below, where G − H is small."""
        n, difference = self.samples, -np.expm1(-1j * self.theta)
        start = 1 / (n * difference)  # G = start (e^{inθ} − 1)
        shown = 0.5 * scipy.special.erfc((n * self.theta - _FADE) / _WIDTH) if n > 2 * _PERIODS else 1.0
        oscillation = shown * start * np.exp(1j * n * self.theta)
        mean, near = oscillation - start, start * np.expm1(1j * n * self.theta) - 1
        slow, size = n * self.theta < 1, np.abs(difference) ** 2
        return np.array([
            np.where(slow, np.abs(near) ** 2, -2 * np.real(np.conj(start) * mean)),
            np.where(slow, 0, 1 - 2 * mean.real),
            2 * np.real(np.where(slow, np.conj(near), -mean) * difference),
            np.where(slow, size * (2 * near.real + 1), 0), size,
        ])  # fmt: skip


@dataclass(frozen=True, eq=False)
class FilterPrediction:
    """The error with which a filter predicts the mean of the next n samples of a noise.

    Exponential smoothing b_k = b_{k−1} + g (x_k − b_{k−1}), the steady-state Kalman filter of white noise and a walk,
    predicts the mean of x_{k+1}, …, x_{k+n}. With the two-sided density S(θ), the mean square error is

        J(g) = (1/2π) ∫ |G(θ) − H(θ)|² S(θ) dθ,  G = (1/n) Σ_{m=1}^{n} e^{imθ},  H = g / (1 − (1 − g) e^{−iθ}).

    G − H is zero at θ = 0, so J is finite for walks and flicker. Ramps ω add ω² ((n + 1)/2 + (1 − g)/g)², sinusoids P
    |G − H|². `parts` are quadratures with densities times weights, or with powers."""

    parts: tuple[tuple[Quadrature, Vector], ...]
    samples: int
    ramp: float = 0.0

    @classmethod
    def of(
        cls, processes: Iterable[Process], rate: float, samples: int, ratio: CurveRatio | None = None, *,
        lines: bool = True, shared: tuple[Shape, ...] = (),
    ) -> FilterPrediction:  # fmt: skip
        """Return the prediction of a sum of processes, with a factor `ratio` of their density and, if `lines`,
        sinusoids near the horizon; sums whose `resonances_of` are among `shared` have the same quadrature."""
        seen, moving, ramp = [], [], 0.0
        for process in processes:
            if process.scale == 0:
                continue
            if (line := process.line(rate)) is not None:
                seen += [line] if lines and LEAST_PERIODS <= abs(line[1]) * samples <= MOST_PERIODS else []
            elif not process.has("psd") and is_ramp(process, rate):
                ramp += float(np.diff(process.mean([0, 1]))[0]) ** 2
            else:
                moving.append(process)
        parts = []
        if moving:
            resonances = resonances_of(moving, rate)
            kinks = () if ratio is None else tuple((math.sqrt(2) * math.pi / 2**ratio.levels).tolist())
            at = _quadrature(shared if set(resonances) <= set(shared) else resonances, rate, samples, kinks)
            masses = np.array([_unit_mass(shape_of(process), rate, at) for process in moving])
            mass = np.array([process.scale for process in moving]) @ masses
            parts.append((at, mass if ratio is None else mass * _factor(ratio, at)))
        if seen:
            at = _at_lines(tuple(abs(cycles) for _, cycles in seen), samples)
            parts.append((at, np.array([power for power, _ in seen])))
        return cls(tuple(parts), samples, ramp)

    def error(self, gain: FilterGain) -> tuple[float, float]:
        """Return the mean square of the prediction error (u²), and its derivative with respect to ln(w Δt)."""
        lag = (self.samples + 1) / 2 + gain.keep / gain.g
        error, change = self.ramp * lag**2, -2 * self.ramp * lag / gain.g**2
        for at, mass in self.parts:
            square, slope = _responses(at, gain)
            error, change = error + float(square @ mass), change + float(slope @ mass)
        return error, change * gain.slope

    def slopes(self, gains: _Gains) -> Vector:
        """Return the derivatives of the error with respect to ln(w Δt) at several gains."""
        sums = -2 * self.ramp * ((self.samples + 1) / 2 + gains.keep / gains.g) / gains.g**2
        for at, mass in self.parts:
            sums = sums + _slopes(at, gains) @ mass
        return np.asarray(sums * gains.slope)


@dataclass(frozen=True)
class FilterGain:
    """The gain of the steady-state filter for white noise N and a random walk K, with `bandwidth` w Δt = K Δt/N."""

    bandwidth: float

    @cached_property
    def keep(self) -> float:
        """Factor 1 − g of the estimate in each step."""
        q = self.bandwidth
        return 2 / (2 + q**2 + q * math.sqrt(q**2 + 4))

    @cached_property
    def g(self) -> float:
        """Factor g of a new sample."""
        return self.bandwidth * math.sqrt(self.keep)

    @property
    def slope(self) -> float:
        """Derivative of g with respect to ln(w Δt)."""
        return 2 * self.g * self.keep / (2 * self.keep + self.g)

    def claim(self, samples: int) -> tuple[float, float]:
        """Return the filter's variance of the mean of n samples over white noise, 1/n + g + q² (n + 1)(2n + 1)/(6n)
        with q = w Δt, and its derivative by ln q."""
        walk = self.bandwidth**2 * (samples + 1) * (2 * samples + 1) / (6 * samples)
        return 1 / samples + self.g + walk, self.slope + 2 * walk


def shape_of(process: Process) -> Shape:
    """Return the shape of a process."""
    return type(process), process.nonlinear.tobytes()


def unit_of(shape: Shape) -> Process:
    """Return the process of a shape with scale coefficient 1."""
    return shape[0].standard(np.frombuffer(shape[1]))


@lru_cache(maxsize=256)
def _unit_mass(shape: Shape, rate: float, at: Quadrature) -> Vector:
    """Return the weights of a quadrature times the density of a process with scale coefficient 1."""
    return freeze(at.mass(spectrum_of(unit_of(shape), rate)(at.theta)))


@lru_cache(maxsize=4)
def _factor(ratio: CurveRatio, at: Quadrature) -> Vector:
    return freeze(ratio(at.theta))


def resonances_of(processes: Iterable[Process], rate: float) -> tuple[Shape, ...]:
    """Return the shapes of processes whose density the panels may have to be halved for."""
    shapes = (shape_of(process) for process in processes if process.scale != 0 and process.line(rate) is None)
    return tuple(dict.fromkeys(shape for shape in shapes if _may_resonate(shape, rate)))


@lru_cache(maxsize=256)
def _may_resonate(shape: Shape, rate: float) -> bool:
    # A power law is smooth, and so is the density of an exponential covariance that does not alternate.
    process, count = unit_of(shape), len(shape[0].nonlinear_parameters())
    return not process.has("psd") or (count > 0 and (count > 1 or min(process.decays(rate), default=-1.0) <= 0))


def spectrum_of(process: Process, rate: float) -> Spectrum:
    """Return the spectral density of a process, from its state space if it does not define a density."""
    if process.has("psd"):
        return lambda theta: rate * process.psd(theta * (rate / (2 * math.pi)), rate)
    if process.has("state_space"):
        space = process.state_space(rate)
        return lambda theta: rate * space.psd(theta * (rate / (2 * math.pi)), rate)
    return _of_octaves(process, rate)


def _of_octaves(process: Process, rate: float) -> Spectrum:
    """Return ν_j² 2^j at octave centres √2 π/2^j: exact for white noise, within 20 % if the density falls."""
    # Number of levels of the wavelet variance of a process without a density. Below, its density is a power law.
    count = 20
    levels = np.arange(1, count + 1)
    logs = np.log(process.wavelet_variance(levels, rate)) + levels * math.log(2)

    def density(theta: Vector) -> Vector:
        level = np.log2(math.sqrt(2) * math.pi / theta)
        slope = logs[-1] - logs[-2]
        return np.asarray(np.exp(np.interp(level, levels, logs) + slope * np.maximum(level - count, 0.0)))

    return density


@lru_cache(maxsize=16)
def _responses(at: Quadrature, gain: FilterGain) -> tuple[Vector, Vector]:
    return _of_gains(at, gain.g, gain.keep)


def _of_gains(at: Quadrature, g: float | Matrix, keep: float | Matrix) -> tuple[Matrix, Matrix]:
    """Return |G − H|² at the frequencies of a quadrature, and its derivative with respect to g, for gains in rows."""
    steady, white, both, walk, size = at.terms
    inverse = 1 / (g**2 + keep * size)
    follows = (g**2 * white + g * keep * both + keep**2 * walk) * inverse
    change = 2 * g * white + (keep - g) * both - 2 * keep * walk
    return steady + follows, (change - (2 * g - size) * follows) * inverse


@dataclass(frozen=True, eq=False)
class _Gains:
    """Several gains by ln(w Δt) = `logs` (m,), with `FilterGain`'s numbers."""

    logs: Vector
    g: Vector
    keep: Vector
    slope: Vector

    @classmethod
    def at(cls, logs: Vector) -> _Gains:
        """Return the gains at ln(w Δt)."""
        gains = [FilterGain(math.exp(u)) for u in logs]
        return cls(logs, *np.array([(gain.g, gain.keep, gain.slope) for gain in gains]).T)


@lru_cache(maxsize=4)
def _grid(slowest: float) -> _Gains:
    count = 1 + math.ceil(_PER_DECADE * math.log10(_HIGHEST * slowest))
    return _Gains.at(np.linspace(-math.log(slowest), math.log(_HIGHEST), count))


@lru_cache(maxsize=32)
def _between(low: float, high: float) -> _Gains:
    return _Gains.at((low + high) / 2 + (high - low) / 2 * _NODES)


@lru_cache(maxsize=16)
def _slopes(at: Quadrature, gains: _Gains) -> Matrix:
    """Return the derivatives of |G − H|² (m, n) with respect to g."""
    return _of_gains(at, gains.g[:, None], gains.keep[:, None])[1]


def _panels(samples: int, kinks: Sequence[float]) -> Vector:
    """Return the ends of the panels, from `_FIRST` to π."""
    period = 2 * math.pi / samples
    first, last = min(period, math.pi), min(_PERIODS * period, math.pi)
    count = max(1, math.ceil((last - first) / period - 1e-9))
    low = _grown(_FIRST, min(first, _RESONANT), _COARSE)
    parts = [low, _grown(low[-1], first, _FINE), np.linspace(first, last, count + 1), _grown(last, math.pi, _FINE)]
    inside = [theta for theta in kinks if _FIRST < theta < math.pi]
    return np.unique(np.concatenate([*parts, inside]))


def _grown(low: float, high: float, by: float) -> Vector:
    """Return ends of panels from low to high whose ratio is at most `by`."""
    if high <= low:
        return np.array([low])
    return np.geomspace(low, high, 1 + math.ceil(math.log(high / low) / math.log(by)))


@lru_cache(maxsize=32)
def _quadrature(resonances: tuple[Shape, ...], rate: float, samples: int, kinks: tuple[float, ...]) -> Quadrature:
    """Return a quadrature whose panels end at `kinks` and are halved at resonances; densities are smooth elsewhere."""
    halved = [_halved(shape, rate) for shape in resonances]
    return _on_panels(np.unique(np.concatenate([_panels(samples, kinks), *halved])).tobytes(), samples)


@lru_cache(maxsize=256)
def _halved(shape: Shape, rate: float) -> Vector:
    """Return the ends of panels that are halved until they are accurate at the resonance of a process."""
    splits = 12
    spectrum, ends = spectrum_of(unit_of(shape), rate), []

    def integrals(low: Vector, high: Vector) -> Vector:
        theta, weights = _rule(low, high)
        # Where the resonance is far below white noise, it need not be accurate.
        return np.asarray((weights * (1 + spectrum(theta.ravel()).reshape(theta.shape))).sum(axis=1))

    panels = _panels(1, ())
    low, high = panels[:-1], panels[1:]
    coarse = integrals(low, high)
    for _ in range(splits):
        middle = np.sqrt(low * high)
        fine = integrals(np.concatenate([low, middle]), np.concatenate([middle, high])).reshape(2, -1)
        # Relative accuracy of the integral of a spectrum over each panel.
        again = np.abs(fine.sum(axis=0) - coarse) > 1e-10 * np.abs(fine.sum(axis=0))
        low, middle, high, coarse = low[again], middle[again], high[again], fine[:, again].ravel()
        ends += [low, middle, high]
        low, high = np.concatenate([low, middle]), np.concatenate([middle, high])
    return freeze(np.concatenate(ends))


@lru_cache(maxsize=32)
def _on_panels(ends: bytes, samples: int) -> Quadrature:
    low, high = (np.frombuffer(ends)[part] for part in (slice(-1), slice(1, None)))
    lowest = np.array([[_FIRST, 1.01 * _FIRST], [_FIRST, 0.0]])  # the second shows the slope of the density
    theta, weights = np.concatenate([lowest, _rule(low, high).reshape(2, -1)], axis=1)
    return Quadrature(theta, weights / math.pi, samples)


@lru_cache(maxsize=4)
def _at_lines(cycles: tuple[float, ...], samples: int) -> Quadrature:
    return Quadrature(2 * math.pi * np.array(cycles), np.ones(len(cycles)), samples)


def _rule(low: Vector, high: Vector) -> NDArray[np.float64]:
    """Return nodes (n, 12) of Gauss-Legendre quadrature in ln θ on n panels, and weights."""
    x, w = _LEGENDRE
    octaves = np.log(high / low)[:, None]
    theta = low[:, None] * np.exp(octaves * (x + 1) / 2)
    return np.stack([theta, theta * (octaves * w / 2)])


SLOWEST_FILTER_SAMPLES = 1e10  # default of the longest time constant 1/w of a filter, in samples
_HIGHEST, _PER_DECADE = 1e3, 6
"""Largest w Δt, and number of grid points per decade. A filter with a larger w Δt has no white noise."""
_NODES = chebpts1(12)
_COEFFICIENTS = np.linalg.inv(np.vander(_NODES))
"""Nodes between two grid points, and matrix of the coefficients of the polynomial through the derivative there. The
error is analytic for an imaginary part of ln w below π/2, so that 12 nodes are exact to double precision."""


@dataclass(frozen=True, kw_only=True)
class FilterNumbers:
    """White noise N (u/√Hz) and walk K (u/√s) of a filter, 0 if it is best without; `samples` in the horizon."""

    N: float
    K: float
    gain: FilterGain
    samples: int
    rate: float
    prediction: FilterPrediction

    def __getstate__(self) -> dict[str, object]:
        """Leave the prediction out, which a copy in another process does not need."""
        return {name: value for name, value in self.__dict__.items() if name != "prediction"}


def samples_in(time: float, rate: float) -> int:
    """Convert a time (s) to a number of samples, which is at least 1."""
    return max(1, round(time * rate))


def filter_numbers(
    processes: Iterable[Process], rate: float, horizon: float = 1.0, *, ratio: CurveRatio | None = None,
    slowest: float = SLOWEST_FILTER_SAMPLES, shared: tuple[Shape, ...] = (),
) -> FilterNumbers:  # fmt: skip
    """Compute N and K of the filter that predicts the mean of a noise over the next T = `horizon` seconds best.

    Two conditions determine them, with the bandwidth w = K/N, and no division of the noise into terms:

        w = argmin J_T(w)    N² (1/T + w + w² T/3) = J_T(w)

    J_T is the mean square error (see `FilterPrediction`), and the left side the error that the filter states. The code
    has the exact form for samples, so white noise plus a walk has the numbers of its terms. White N and flicker B have
    K = 2B²/(πN) for w T ≪ 1. K is zero if the best filter is slower than `slowest` samples; see `FilterPrediction.of`
    for `shared`."""
    samples = samples_in(horizon, rate)
    prediction = FilterPrediction.of(processes, rate, samples, ratio, shared=shared)
    gain = best_gain(prediction, slowest)
    error = prediction.error(gain)[0]
    walks = gain.bandwidth * slowest > 1
    # Without a random walk, only the white noise in the estimate of the filter adds to the error.
    claim = gain.claim(samples)[0] if walks else 1 / samples + gain.g / (2 - gain.g)
    white = math.sqrt(error / claim / rate)
    return FilterNumbers(
        N=white if gain.bandwidth < _HIGHEST else 0.0, K=white * gain.bandwidth * rate if walks else 0.0, gain=gain,
        samples=samples, rate=rate, prediction=prediction,
    )  # fmt: skip


def best_gain(prediction: FilterPrediction, slowest: float = SLOWEST_FILTER_SAMPLES) -> FilterGain:
    """Return the gain with the smallest prediction error, which is exact if J has few minima per decade."""

    def root(low: float, high: float) -> float:
        """Return ln(w Δt) of a minimum on the grid, by interpolation of the derivative."""
        coefficients: list[float] = (_COEFFICIENTS @ prediction.slopes(_between(low, high))).tolist()

        def slope(x: float) -> float:
            return reduce(lambda value, coefficient: value * x + coefficient, coefficients)

        x = -1.0 if slope(-1.0) >= 0 else 1.0 if slope(1.0) <= 0 else scipy.optimize.brentq(slope, -1, 1, xtol=1e-14)
        return (low + high) / 2 + (high - low) / 2 * x

    grid, slopes = _grid(slowest).logs, prediction.slopes(_grid(slowest))
    places = np.flatnonzero((slopes[:-1] < 0) & (slopes[1:] >= 0)).tolist()
    gains = [FilterGain(math.exp(root(*grid[k : k + 2].tolist()))) for k in places]
    gains += [FilterGain(1 / slowest)] if slopes[0] >= 0 else []
    gains += [FilterGain(_HIGHEST)] if slopes[-1] < 0 else []
    return min(gains, key=lambda gain: prediction.error(gain)[0])


def smallest_error(processes: Iterable[Process], rate: float, samples: int) -> float | None:
    """Return the mean square error of the steady-state filter of the full model for the mean of n samples, without
    sinusoids and ramps; None without a state space or a solution of the Riccati equation in double precision."""
    start = _predicted(tuple(p for p in processes if p.scale > 0 and p.line(rate) is None), rate)
    error = 0.0 if start is None else float(start.block_variance([samples])[0]) / samples**2
    return error if math.isfinite(error) and error > 0 else None


@lru_cache(maxsize=16)
def _predicted(noises: tuple[Process, ...], rate: float) -> StateSpace | None:
    """Return the state space of noises, without ramps, that starts with the steady-state covariance of its filter."""
    try:
        space = StateSpace.sum([p.state_space(rate) for p in noises if p.has("psd") or not is_ramp(p, rate)])
    except GmwmError:
        return None
    if space.states == 0:
        return space
    measured = float(space.R[0, 0])
    # Relative measurement noise of a model without any, without which the Riccati equation cannot be solved.
    floor = 1e-8 * (measured + float((space.H @ space.Q @ space.H.T)[0, 0]))
    try:
        before = scipy.linalg.solve_discrete_are(space.F.T, space.H.T, space.Q, np.array([[measured + floor]]))
    except (scipy.linalg.LinAlgError, ValueError):
        return None
    return StateSpace(space.F, space.Q, space.H, space.R, m0=space.m0, P0=(before + before.T) / 2)
