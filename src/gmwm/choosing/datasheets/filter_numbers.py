"""White noise N and random walk K with which a filter predicts a noise best and states the error that it makes, and
the error of the filter of the full model."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gmwm.base.errors import GmwmError
from gmwm.choosing.datasheets.prediction import FilterGain, FilterPrediction, Spectrum
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace

SLOWEST_FILTER_SAMPLES = 1e10
"""Default of the longest time constant 1/w of a filter, in samples."""
_HIGHEST, _PER_DECADE = 1e3, 6
"""Largest w Δt, and number of grid points per decade. A filter with a larger w Δt has no white noise."""


@dataclass(frozen=True, kw_only=True)
class FilterNumbers:
    """White noise N (u/√Hz) and random walk K (u/√s) of a filter for one noise; zero if a filter without it is best.
    `samples` is the number of samples in the horizon of `prediction`."""

    N: float
    K: float
    gain: FilterGain
    samples: int
    rate: float
    prediction: FilterPrediction


def samples_in(time: float, rate: float) -> int:
    """Convert a time (s) to a number of samples, which is at least 1."""
    return max(1, round(time * rate))


def filter_numbers(
    processes: Iterable[Process], rate: float, horizon: float = 1.0, *, ratio: Spectrum | None = None,
    slowest: float = SLOWEST_FILTER_SAMPLES,
) -> FilterNumbers:  # fmt: skip
    """Compute N and K of the filter that predicts the mean of a noise over the next T = `horizon` seconds best.

    The filter has the bandwidth w = K/N. Two conditions determine N and K, without a division of the noise into terms:

        w = argmin J_T(w)    N² (1/T + w + w² T/3) = J_T(w)

    J_T is the mean square of the prediction error (see `FilterPrediction`, also for `ratio`). The left side of the
    second condition is the error that the filter states. The formulas are for T far above the sampling interval Δt. The
    code uses their exact form for samples, so that the numbers of white noise plus a random walk are those of its terms
    for every T. For white noise N and flicker noise B, w T ≪ 1 gives K = B²/(πN). If the time constant of the best
    filter is longer than `slowest` samples, K is zero. Raises MissingTheoryError if the spectrum of a process is
    unknown.

    >>> import gmwm
    >>> model = gmwm.WN(sigma2=1e-6) + gmwm.RW(gamma2=1e-12)
    >>> numbers = filter_numbers(model.processes, rate=100.0)
    >>> round(numbers.N, 12), round(numbers.K, 12)
    (0.0001, 1e-05)
    """
    samples = samples_in(horizon, rate)
    prediction = FilterPrediction.of(processes, rate, samples, ratio)
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
    from scipy.optimize import brentq

    def slope(u: float) -> float:
        return prediction.error(FilterGain(math.exp(u)))[1]

    count = 1 + math.ceil(_PER_DECADE * math.log10(_HIGHEST * slowest))
    grid = np.linspace(-math.log(slowest), math.log(_HIGHEST), count)
    slopes = np.array([slope(u) for u in grid])
    gains = [
        FilterGain(math.exp(brentq(slope, grid[k], grid[k + 1], xtol=1e-12, rtol=1e-12)))
        for k in np.flatnonzero((slopes[:-1] < 0) & (slopes[1:] >= 0))
    ]
    gains += [FilterGain(1 / slowest)] if slopes[0] >= 0 else []
    gains += [FilterGain(_HIGHEST)] if slopes[-1] < 0 else []
    return min(gains, key=lambda gain: prediction.error(gain)[0])


def smallest_error(processes: Iterable[Process], rate: float, samples: int) -> float | None:
    """Return the mean square error of the steady-state filter of the full model for the mean of n samples, without
    sinusoids and ramps; None without a state space or a solution of the Riccati equation in double precision."""
    from scipy.linalg import LinAlgError, solve_discrete_are

    noises = [p for p in processes if p.scale > 0 and p.line(rate) is None]
    try:
        noises = [p for p in noises if p.has("psd") or not is_ramp(p, rate)]
        space = StateSpace.sum([p.state_space(rate) for p in noises])
    except GmwmError:
        return None
    measured = float(space.R[0, 0])
    if space.states == 0:
        return measured / samples
    # Variance of the measurement noise that is added to a model without any, relative to the variance of its
    # innovations. The Riccati equation cannot be solved without it.
    floor = 1e-8 * (measured + float((space.H @ space.Q @ space.H.T)[0, 0]))
    try:
        before = solve_discrete_are(space.F.T, space.H.T, space.Q, np.array([[measured + floor]]))
    except (LinAlgError, ValueError):
        return None
    start = StateSpace(space.F, space.Q, space.H, space.R, m0=space.m0, P0=(before + before.T) / 2)
    error = float(start.block_variance([samples])[0]) / samples**2
    return error if math.isfinite(error) and error > 0 else None
