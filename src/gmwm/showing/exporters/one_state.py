"""White noise and one Gauss-Markov bias with which a filter states the errors that it makes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.lazy import once_per_result, scipy
from gmwm.choosing.datasheets.effective import curve_ratio
from gmwm.choosing.datasheets.filter_numbers import CurveRatio, FilterPrediction, filter_numbers, samples_in
from gmwm.showing.exporters.reduction import AxisNoise, Number
from gmwm.showing.exporters.two_states import Curve, is_ramp_of, longest_averaging
from gmwm.theory.processes.base import Process

TIMES = (1.0, 10.0, 60.0)  # times (s) over which the predictions of the filters are compared


@dataclass(frozen=True)
class Bias:
    """Gauss-Markov bias of one axis, for its N."""

    sigma: Number  # standard deviation (SI), before inflation
    time: float  # correlation time (s)
    claims: tuple[float, ...] = ()  # stated over real error of predictions over `TIMES` horizons
    error: float = 0.0  # largest relative difference to the Allan deviation of the model


@dataclass(frozen=True, eq=False)
class Predictions:
    """Errors with which filters with a Gauss-Markov bias predict the mean of a noise over several horizons.

    With the factor φ = e^(−Δt/T), a filter with the gain g has the estimate H = g/(1 − (1 − g) φ e^{−iθ}) times the
    noise, and predicts the mean of n samples by α H, α = (φ + … + φ^n)/n. The mean square error is that of
    `FilterPrediction` with α H for H. Noise slower than the longest averaging time is a constant bias, and left out."""

    curve: Curve  # Allan variance of the noise
    # white noise and random walk of a filter with these two numbers
    N: float
    K: float
    # for each horizon its samples n, e^{−iθ}, G, weights of the angular frequencies, and weights times the density
    parts: tuple[tuple[int, Vector, Vector, Vector, Vector], ...]

    @classmethod
    def of(
        cls, curve: Curve, noises: Sequence[Process], low: float, high: float, ratio: CurveRatio | None = None
    ) -> Predictions:
        """Return the predictions over `TIMES` times `low` (s), and at most over the longest averaging time `high` (s),
        none without a walk; `ratio` as for `filter_numbers`."""
        numbers, rate, parts = filter_numbers(noises, curve.rate, low, ratio=ratio), curve.rate, []
        for samples in (samples_in(min(time * low, high), rate) for time in TIMES if numbers.K > 0):
            at, mass = FilterPrediction.of(noises, rate, samples, ratio).parts[0]
            seen = at.theta * high * rate > 1
            theta, turn = at.theta[seen], np.exp(-1j * at.theta[seen])
            mean = np.expm1(1j * samples * theta) / (samples * (1 - turn))
            parts.append((samples, turn, mean, at.weights[seen], mass[seen]))
        return cls(curve, numbers.N, numbers.K, tuple(parts))

    def claims(self, sigma: float, time: float) -> Vector:
        """Return the stated over the real error of the steady-state filter with N, σ and T, for each horizon."""
        step = 1 / (time * self.curve.rate)
        keep, drive, noise = math.exp(-step), -(sigma**2) * math.expm1(-2 * step), self.N**2 * self.curve.rate
        excess = drive + noise * math.expm1(-2 * step)
        before = (excess + math.sqrt(excess**2 + 4 * drive * noise)) / 2
        gain, ratios = before / (before + noise), []
        for samples, turn, mean, weights, mass in self.parts:
            ahead = keep * math.expm1(-samples * step) / (samples * math.expm1(-step))
            square = np.abs(mean - ahead * gain / (1 - (1 - gain) * keep * turn)) ** 2
            ratios.append(square @ (weights * (noise + drive / np.abs(1 - keep * turn) ** 2)) / (square @ mass))
        return np.sqrt(ratios)

    def allan(self, sigma: float, time: float) -> Vector:
        """Return the Allan variance (n,) of N, σ and T."""
        return np.asarray(self.N**2 * self.curve.white + sigma**2 * self.curve.units(np.array([time]))[0])


def fit_biases(noises: Sequence[Predictions], low: float, high: float) -> tuple[list[float], float]:
    """Return σ (the product of the stated over the real errors is 1) and one T (s; nearest Allan deviation)."""

    def residuals(x: Vector) -> Vector:
        *sigmas, time = np.exp(x).tolist()
        rows = [
            # The nearest Allan deviation has a σ of its own: T is longer then, and the filter forgets less.
            [*np.log(noise.allan(near, time) / noise.curve.whole), np.log(noise.claims(sigma, time)).sum()]
            for noise, sigma, near in zip(noises, sigmas[::2], sigmas[1::2], strict=True)
        ]
        return np.concatenate(rows)

    free, middle = np.full(2 * len(noises), np.inf), math.sqrt(low * high)
    start = np.log([*(noise.K * math.sqrt(middle / 2) for noise in noises for _ in range(2)), middle])
    bounds = np.append(-free, math.log(low)), np.append(free, math.log(high))
    *sigmas, time = np.exp(scipy.optimize.least_squares(residuals, start, bounds=bounds).x).tolist()
    return sigmas[::2], time


def biases(
    axes: Sequence[AxisNoise], horizon: float, duration: float | None = None, *, common: bool = False
) -> dict[str, Bias]:
    """Return the bias of each axis by `fit_biases`, from the horizon to `longest_averaging`; `common` gives one T. If K
    is an upper limit, so is σ, which has the walk K at times below T."""
    high = longest_averaging([axis.fit for axis in axes], horizon, duration)
    options = tuple(axes), horizon, high, common
    return once_per_result(axes[0].fit, "biases", options, lambda: _biases(axes, horizon, high, common=common))


def _biases(axes: Sequence[AxisNoise], low: float, high: float, *, common: bool) -> dict[str, Bias]:
    slow = {axis.axis: noise for axis in axes if not axis.K.upper and (noise := _predictions(axis, low, high)).K > 0}
    fitted, time = {}, high
    for names in [list(slow)] if common and slow else [[axis] for axis in slow]:
        sigmas, time = fit_biases([slow[axis] for axis in names], low, high)
        for axis, sigma in zip(names, sigmas, strict=True):
            claims, error = slow[axis].claims(sigma, time), slow[axis].curve.error(slow[axis].allan(sigma, time))
            fitted[axis] = Bias(Number(sigma, False), time, tuple(claims.tolist()), error)
    last = time if common else high
    return {axis.axis: Bias(axis.K.scaled(math.sqrt(last / 2)), last) for axis in axes} | fitted


def _predictions(axis: AxisNoise, low: float, high: float) -> Predictions:
    curve, processes = Curve.of(axis.fit, low, high), axis.fit.model.processes
    # The filter tracks no sinusoids, and a ramp is that of one recording.
    noises = [p for p in processes if p.line(curve.rate) is None and not is_ramp_of(p, curve.rate)]
    noises = [p for p in noises if axis.use.contains(p, curve.rate)]
    return Predictions.of(curve, noises, low, high, ratio=curve_ratio(axis.fit))
