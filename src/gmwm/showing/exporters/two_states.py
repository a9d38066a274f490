"""Approximate a model by white noise and Gauss-Markov states, for filters with one or two bias states per axis."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.lazy import once_per_result, scipy
from gmwm.base.text import duration_text
from gmwm.choosing.datasheets.effective import Use, filter_entries
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import gm_shape, gm_slope
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import WN

STATES = 2  # number of Gauss-Markov states
LONGEST_AVERAGING_S = 3600.0
"""Default of the longest averaging time (s) in the fit. For a shorter recording, its length is used."""
LEAST_AVERAGING_RATIO = 4.0  # smallest ratio of the longest averaging time to the horizon
POINTS = 25  # number of averaging times in the fit, with equal distances in the logarithm
_TRIED = {1: 80, 2: 16}  # grid size of correlation times by number of states; the best of all combinations is refined


@dataclass(frozen=True)
class TwoStates:
    """White noise and at most two Gauss-Markov states that approximate a noise model."""

    N: float  # white noise density (SI)
    # standard deviation (SI) and correlation time (s) of each state
    sigma: tuple[float, ...]
    time: tuple[float, ...]
    # Shortest and longest averaging time (s) in the fit. `low` is the horizon.
    low: float
    high: float
    # largest relative difference from the model's Allan deviation without its sinusoids and ramps
    error: float
    # largest relative difference with one state, and with a random walk K instead of the states
    error_of_one: float
    error_of_walk: float

    def model(self, rate: float) -> Model:
        """Return the white noise and the states as a model for samples at a rate (Hz)."""
        states = (GM(beta=1 / time, sigma2=sigma**2) for sigma, time in zip(self.sigma, self.time, strict=True))
        return Model((*states, WN(sigma2=self.N**2 * rate)))

    def text(self, unit: str) -> str:
        """Describe the states and their error in text."""
        each = [f"sigma {sigma:.3g} {unit}, T {time:.4g} s" for sigma, time in zip(self.sigma, self.time, strict=True)]
        return (
            f"{'; '.join(each)}. From {duration_text(self.low, 3)} to {duration_text(self.high, 3)}, their Allan "
            f"deviation is {apart(self.error)} the Allan deviation of the model, with one such state "
            f"{apart(self.error_of_one)} it, and with N and K {apart(self.error_of_walk)} it"
        )


def apart(error: float) -> str:
    """Format a relative difference as a percentage, or as a ratio if it is larger than 1.

    >>> apart(0.0453), apart(0.00001), apart(110.0)
    ('within 4.5 % of', 'within 0.01 % of', 'up to 110 times')
    """
    if error > 1:
        return f"up to {float(f'{1 + error:.2g}'):g} times"
    return f"within {float(f'{max(100 * error, 0.01):.2g}'):g} % of"


def two_states(fit: Fit, horizon: float, duration: float | None = None) -> TwoStates | None:
    """Fit white noise and two GM states from the horizon to the duration (s; one hour, or the recording) by least
    squares of the log Allan variance; None if no walk is best, or a sample is longer."""
    return once_per_result(fit, "two states", (horizon, duration), lambda: _two_states(fit, horizon, duration))


def longest_averaging(fits: Iterable[Fit], horizon: float, duration: float | None = None) -> float:
    """Return the longest averaging time (s): `duration`, or an hour, or the shortest recording if it is shorter."""
    curves = (fit.wavelet_variance for fit in fits)
    longest = min([LONGEST_AVERAGING_S, *(wv.samples / wv.rate for wv in curves)]) if duration is None else duration
    return max(longest, LEAST_AVERAGING_RATIO * horizon)


def _two_states(fit: Fit, horizon: float, duration: float | None) -> TwoStates | None:
    noise = filter_entries(fit, Use(horizon), 0.95)
    high = longest_averaging([fit], horizon, duration)
    if noise["K"].value == 0 or high * fit.wavelet_variance.rate < 1:
        return None
    curve = Curve.of(fit, horizon, high)
    # At 100 times the longest averaging time, the Allan deviation of a Gauss-Markov process differs from that of a
    # random walk by 0.3 % (tests/exporters/test_two_states.py).
    two, one = (fit_states(curve, count, horizon, 100.0 * high) for count in (STATES, 1))
    times = curve.clusters / curve.rate
    white, walk = noise["N"].value, noise["K"].value
    return TwoStates(
        N=two.white, sigma=two.sigma, time=two.time, low=horizon, high=high, error=two.error, error_of_one=one.error,
        error_of_walk=curve.error(white**2 / times + walk**2 * times / 3),
    )  # fmt: skip


@dataclass(frozen=True)
class States:
    """White noise density, σ and T (s) of each state, and the largest relative error of their Allan deviation."""

    white: float
    sigma: tuple[float, ...]
    time: tuple[float, ...]
    error: float


@dataclass(frozen=True, eq=False)
class Curve:
    """Allan variance of a model without its sinusoids and ramps."""

    clusters: Integers  # (n,) averaging times, in samples
    rate: float  # sampling rate (Hz)
    whole: Vector  # (n,) Allan variance

    @classmethod
    def of(cls, fit: Fit, low: float, high: float) -> Curve:
        """Compute the Allan variance at averaging times from `low` to `high` (s)."""
        rate = fit.wavelet_variance.rate
        clusters = np.unique(np.round(np.geomspace(low, high, POINTS) * rate).astype(np.int64))
        clusters = clusters[clusters >= 1]
        processes = [
            p for p in fit.model.processes if p.scale > 0 and p.oscillation() is None and not is_ramp_of(p, rate)
        ]
        return cls(clusters, rate, np.sum([p.allan_variance(clusters, rate) for p in processes], axis=0))

    @property
    def white(self) -> Vector:
        """Allan variance (n,) of white noise with the density 1."""
        return np.asarray(self.rate / self.clusters)

    def units(self, times: Vector) -> Matrix:
        """Return the Allan variances (m, n) of Gauss-Markov processes with variance 1 and correlation times (s)."""
        # The Allan variance is twice the wavelet variance at half-scales of the averaging times.
        return np.asarray(2.0 * gm_shape(1 / times / self.rate, self.clusters.astype(np.float64)))

    def slopes(self, times: Vector) -> Matrix:
        """Return the derivatives (m, n) of `units` with respect to the logarithms of the times."""
        decays = 1 / times / self.rate
        return np.asarray(-2.0 * decays[:, None] * gm_slope(decays, self.clusters.astype(np.float64)))

    def error(self, reduced: Vector) -> float:
        """Return the largest relative difference between the Allan deviations of a reduced and of the whole model.
        `reduced` is the Allan variance (n,) of the reduced model."""
        return float(np.max(np.abs(np.sqrt(reduced / self.whole) - 1)))


def fit_states(curve: Curve, count: int, low: float, high: float) -> States:
    """Fit white noise and at most `count` GM states, with times from `low` to `high` (s), by least squares of the log
    Allan variance."""
    times, parts = _start(curve, count, low, high)
    split = parts.size
    # If there is no white noise, the search starts from a trace of it, because it takes logarithms.
    start = np.log([*np.maximum(parts, 1e-12 * curve.whole[0] / curve.white[0]), *times])
    free, ends = np.full(split, np.inf), np.full(times.size, 1.0)
    lower, upper = np.append(-free, ends * math.log(low)), np.append(free, ends * math.log(high))

    def terms(x: Vector) -> Matrix:
        return np.asarray(np.exp(x[:split, None]) * np.vstack([curve.white, curve.units(np.exp(x[split:]))]))

    def residuals(x: Vector) -> Vector:
        return np.asarray(np.log(terms(x).sum(axis=0) / curve.whole))

    def slopes(x: Vector) -> Matrix:
        each, moved = terms(x), np.exp(x[1:split, None]) * curve.slopes(np.exp(x[split:]))
        return np.asarray((np.vstack([each, moved]) / each.sum(axis=0)).T)

    inside = np.clip(start, lower + 1e-9, upper - 1e-9)
    x = scipy.optimize.least_squares(residuals, inside, jac=slopes, bounds=(lower, upper), xtol=1e-10, ftol=1e-10).x
    order, (white, *sigmas), ends = np.argsort(x[split:]), np.exp(x[:split] / 2).tolist(), np.exp(x[split:]).tolist()
    return States(
        white, sigma=tuple(sigmas[k] for k in order), time=tuple(ends[k] for k in order),
        error=curve.error(terms(x).sum(axis=0)),
    )  # fmt: skip


def _start(curve: Curve, count: int, low: float, high: float) -> tuple[Vector, Vector]:
    """Return the best times on a grid, and white noise and variances, without states that are zero."""
    grid = np.geomspace(low, high, _TRIED[count])
    shapes = np.vstack([curve.white, curve.units(grid)]) / curve.whole
    combined = [[0, *(1 + k for k in places)] for places in combinations(range(grid.size), count)]
    solved = [scipy.optimize.nnls(shapes[rows].T, np.ones(shapes.shape[1])) for rows in combined]
    best = int(np.argmin([distance for _, distance in solved]))
    parts = solved[best][0]
    present = np.append(True, parts[1:] > 0)
    return grid[np.array(combined[best][1:]) - 1][present[1:]], parts[present]


def is_ramp_of(process: Process, rate: float) -> bool:
    """Return whether a process is a ramp, whose Allan deviation no stationary state can follow."""
    return not process.has("psd") and is_ramp(process, rate)
