"""Reduce a model to white noise and two Gauss-Markov states, for filters with two bias states per axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.text import duration_text
from gmwm.choosing.datasheets.effective import WALK, Use, counted, noise_in_use
from gmwm.choosing.datasheets.equivalent_terms import translated
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import WN

STATES = 2
"""Number of Gauss-Markov states."""
LONGEST = 3600.0
"""Default of the longest averaging time (s) in the fit. For a shorter recording, its length is used."""
WIDEST = 4.0
"""Smallest ratio of the longest averaging time to the horizon."""
POINTS = 25
"""Number of averaging times in the fit, with equal distances in the logarithm."""
BEYOND = 100.0
"""Largest correlation time, relative to the longest averaging time. The Allan deviation of a Gauss-Markov process with
this correlation time differs from a random walk by 0.3 % (tests/exporters/test_two_states.py)."""
_TRIED = 16
"""Number of correlation times on the grid. All combinations are tried, and the best one is refined."""

Clusters = NDArray[np.int64]


@dataclass(frozen=True)
class TwoStates:
    """White noise and at most two Gauss-Markov states that approximate a noise model.

    Attributes
    ----------
    N : float
        White noise density (SI), which includes all terms that count as white noise for the horizon.
    sigma, time : tuple of float
        Standard deviation (SI) and correlation time (s) of each state.
    low, high : float
        Shortest and longest averaging time (s) in the fit. `low` is the horizon.
    error : float
        Largest relative difference between the Allan deviations of the states and of the model without its sinusoids
        and ramps.
    error_of_one, error_of_walk : float
        Largest relative difference with one state, and with a random walk K instead of the states.
    """

    N: float
    sigma: tuple[float, ...]
    time: tuple[float, ...]
    low: float
    high: float
    error: float
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
    """Fit two Gauss-Markov states to a model by least squares of the logarithm of the Allan variance.

    The white noise has the density N for this horizon. The fit uses averaging times from the horizon to the duration.

    Parameters
    ----------
    fit : Fit
        Fit of the model.
    horizon : float
        Horizon T_h (s); see `effective_noise`.
    duration : float, optional
        Longest averaging time (s); by default one hour, or the length of a shorter recording.

    Returns
    -------
    TwoStates or None
        The reduced model, or None if the model has no slow term.
    """
    known: dict[tuple[float, float | None], TwoStates | None] = fit.__dict__.setdefault("_two_states", {})
    if (horizon, duration) not in known:
        known[horizon, duration] = _two_states(fit, horizon, duration)
    return known[horizon, duration]


def _two_states(fit: Fit, horizon: float, duration: float | None) -> TwoStates | None:
    rate, use = fit.wavelet_variance.rate, Use(horizon)
    processes = [
        p
        for p in translated(fit)[0].model.processes
        if p.scale > 0 and p.line(rate) is None and not is_ramp(p, rate)
    ]  # fmt: skip
    if not any(WALK in counted(p, use, rate) for p in processes):
        return None
    longest = min(LONGEST, fit.wavelet_variance.samples / rate) if duration is None else duration
    high = max(longest, WIDEST * horizon)
    clusters = np.unique(np.round(np.geomspace(horizon, high, POINTS) * rate).astype(np.int64))
    clusters = clusters[clusters >= 1]
    whole = np.sum([p.allan_variance(clusters, rate) for p in processes], axis=0)
    noise = noise_in_use(fit, use, 0.95)
    white, walk = (noise[symbol].value for symbol in ("N_eff", "K_eff"))
    curve = _Curve(clusters, rate, whole=whole, white=white**2 * rate / clusters)
    found = curve.fitted(STATES, horizon, BEYOND * high)
    alone = curve.fitted(1, horizon, BEYOND * high)
    times = clusters / rate
    return TwoStates(
        N=white,
        sigma=tuple(np.exp(found[:, 0] / 2).tolist()),
        time=tuple(np.exp(found[:, 1]).tolist()),
        low=horizon,
        high=high,
        error=curve.error(curve.of(found)),
        error_of_one=curve.error(curve.of(alone)),
        error_of_walk=curve.error(curve.white + walk**2 * times / 3),
    )


@dataclass(frozen=True, eq=False)
class _Curve:
    """Allan variance of a model.

    Attributes
    ----------
    clusters : (n,) array of int
        Averaging times, in samples.
    rate : float
        Sampling rate (Hz).
    whole, white : (n,) arrays
        Allan variance of the whole model, and of its white noise.
    """

    clusters: Clusters
    rate: float
    whole: Vector
    white: Vector

    def unit(self, time: float) -> Vector:
        """Return the Allan variance (n,) of a Gauss-Markov process with variance 1 and a correlation time (s)."""
        return np.asarray(GM(beta=1 / time, sigma2=1.0).allan_variance(self.clusters, self.rate), dtype=np.float64)

    def of(self, states: Matrix) -> Vector:
        """Return the Allan variance (n,) of the white noise plus Gauss-Markov states.

        Each row of `states` has the logarithms of the variance and of the correlation time of a state.
        """
        return np.asarray(self.white + sum(math.exp(v) * self.unit(math.exp(t)) for v, t in states.tolist()))

    def error(self, reduced: Vector) -> float:
        """Return the largest relative difference between the Allan deviations of a reduced model and of the whole
        model.

        `reduced` is the Allan variance (n,) of the reduced model.
        """
        return float(np.max(np.abs(np.sqrt(reduced / self.whole) - 1)))

    def fitted(self, count: int, low: float, high: float) -> Matrix:
        """Fit at most `count` states with correlation times from `low` to `high` (s), and return them with the fastest
        first."""
        from scipy.optimize import least_squares

        start = self._start(count, low, high)
        if start.size == 0:
            return np.empty((0, 2))
        ends = np.tile([[-np.inf, np.inf], [math.log(low), math.log(high)]], (len(start), 1)).T
        inside = np.clip(start.ravel(), ends[0] + 1e-9, ends[1] - 1e-9)

        def residuals(x: Vector) -> Vector:
            return np.asarray(np.log(self.of(x.reshape(-1, 2)) / self.whole))

        found: Vector = least_squares(residuals, inside, bounds=(ends[0], ends[1]), xtol=1e-10, ftol=1e-10).x
        states = found.reshape(-1, 2)
        return states[np.argsort(states[:, 1])]

    def _start(self, count: int, low: float, high: float) -> Matrix:
        """Return the best states with correlation times on a grid, without states of variance zero."""
        from scipy.optimize import nnls

        grid = np.geomspace(low, high, _TRIED)
        shapes = np.array([self.unit(float(time)) for time in grid]) / self.whole
        target = 1 - self.white / self.whole
        tried = [list(chosen) for chosen in combinations(range(_TRIED), count)]
        solved = [nnls(shapes[chosen].T, target) for chosen in tried]
        best = int(np.argmin([distance for _, distance in solved]))
        variances, times = solved[best][0], grid[tried[best]]
        there = variances > 0
        return np.log(np.column_stack([variances[there], times[there]]))
