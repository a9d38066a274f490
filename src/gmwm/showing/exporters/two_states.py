"""Approximate a model by white noise and Gauss-Markov states, for filters with one or two bias states per axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector, freeze
from gmwm.base.lazy import once_per_result, scipy
from gmwm.base.text import duration_text
from gmwm.choosing.datasheets.effective import Use, filter_entries
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import gm_shape
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


def _two_states(fit: Fit, horizon: float, duration: float | None) -> TwoStates | None:
    noise = filter_entries(fit, Use(horizon), 0.95)
    longest = (
        min(LONGEST_AVERAGING_S, fit.wavelet_variance.samples / fit.wavelet_variance.rate)
        if duration is None
        else duration
    )
    high = max(longest, LEAST_AVERAGING_RATIO * horizon)
    if noise["K"].value == 0 or high * fit.wavelet_variance.rate < 1:
        return None
    curve = Curve.of(fit, horizon, high)
    # At 100 times the longest averaging time, the Allan deviation of a Gauss-Markov process differs from that of a
    # random walk by 0.3 % (tests/exporters/test_two_states.py).
    two, one = (fit_states([curve], count, horizon, 100.0 * high)[0] for count in (STATES, 1))
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

    def unit(self, time: float) -> Vector:
        """Return the Allan variance (n,) of a Gauss-Markov process with variance 1 and a correlation time (s)."""
        return _unit(self, time)

    def error(self, reduced: Vector) -> float:
        """Return the largest relative difference between the Allan deviations of a reduced and of the whole model.
        `reduced` is the Allan variance (n,) of the reduced model."""
        return float(np.max(np.abs(np.sqrt(reduced / self.whole) - 1)))


@lru_cache(maxsize=64)
def _unit(curve: Curve, time: float) -> Vector:
    # The Allan variance is twice the wavelet variance at half-scales of the averaging times. A derivative with respect
    # to a strength uses the same times again.
    return freeze(2.0 * gm_shape(np.array([1 / time / curve.rate]), curve.clusters.astype(np.float64))[0])


def fit_states(
    curves: Sequence[Curve], count: int, low: float, high: float, *, white: Sequence[float] | None = None
) -> list[States]:
    """Fit white noise (or `white`) and at most `count` GM states to each curve, with common times from `low` to `high`
    (s), by least squares of the log Allan variance."""
    times, parts = _start(curves, count, low, high)
    held = 0 if white is None else 1
    # If there is no white noise, the search starts from a trace of it, because it takes logarithms.
    floors = [1e-12 * curve.whole[0] / curve.white[0] for curve in curves]
    start = [math.log(max(x, floor)) for part, floor in zip(parts, floors, strict=True) for x in part[held:]]
    lower = np.array([-np.inf] * len(start) + [math.log(low)] * times.size)
    upper = np.array([np.inf] * len(start) + [math.log(high)] * times.size)
    inside = np.clip([*start, *np.log(times)], lower + 1e-9, upper - 1e-9)

    def strengths(x: Vector) -> Matrix:
        """Return the squared density of the white noise and the variances of the states, one row for each curve."""
        rows = np.exp(x[: len(start)]).reshape(len(curves), -1)
        return rows if white is None else np.column_stack([np.square(white), rows])

    def reduced(x: Vector) -> Iterator[Vector]:
        for curve, (density, *variances) in zip(curves, strengths(x), strict=True):
            units = (v * curve.unit(math.exp(t)) for v, t in zip(variances, x[len(start) :], strict=True))
            yield np.asarray(density * curve.white + sum(units))

    def residuals(x: Vector) -> Vector:
        return np.concatenate([np.log(r / curve.whole) for r, curve in zip(reduced(x), curves, strict=True)])

    x = scipy.optimize.least_squares(residuals, inside, bounds=(lower, upper), xtol=1e-10, ftol=1e-10).x
    order = np.argsort(x[len(start) :])
    return [
        States(
            white=float(roots[0]), sigma=tuple(roots[1:][order].tolist()),
            time=tuple(np.exp(x[len(start) :][order]).tolist()), error=curve.error(allan),
        )
        for roots, allan, curve in zip(np.sqrt(strengths(x)), reduced(x), curves, strict=True)
    ]  # fmt: skip


def _start(curves: Sequence[Curve], count: int, low: float, high: float) -> tuple[Vector, list[Vector]]:
    """Return the best times on a grid, and white noise and variances by curve, without states zero in all."""
    grid = np.geomspace(low, high, _TRIED[count])
    shapes = [np.array([curve.white, *map(curve.unit, grid.tolist())]) / curve.whole for curve in curves]
    combined = [[0, *(1 + k for k in places)] for places in combinations(range(grid.size), count)]
    solved = [[scipy.optimize.nnls(shape[rows].T, np.ones(shape.shape[1])) for shape in shapes] for rows in combined]
    best = int(np.argmin([sum(distance**2 for _, distance in each) for each in solved]))
    parts = np.array([part for part, _ in solved[best]])
    kept = np.append(True, np.any(parts[:, 1:] > 0, axis=0))
    return grid[np.array(combined[best][1:]) - 1][kept[1:]], list(parts[:, kept])


def is_ramp_of(process: Process, rate: float) -> bool:
    """Return whether a process is a ramp, whose Allan deviation no stationary state can follow."""
    return not process.has("psd") and is_ramp(process, rate)
