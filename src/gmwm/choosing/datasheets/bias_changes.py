"""Variance of the mean of a recording, and mean square of the bias over a duration, from a fitted model."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from statistics import NormalDist

import numpy as np

from gmwm.choosing.datasheets.bias import FitCurve, sensitivity
from gmwm.choosing.datasheets.effective import is_flicker
from gmwm.choosing.datasheets.filter_numbers import Shape, shape_of, unit_of
from gmwm.choosing.datasheets.limits import variance_limit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process


@dataclass(frozen=True)
class Variance:
    """A variance, its relative standard error, and the largest value that the measured wavelet variance allows."""

    value: float
    relative: float
    limit: float = math.inf


@dataclass(frozen=True)
class BiasTerms:
    """The nonzero terms of a fit, each with whether it is part of the bias (`is_slow`); `moving` is by parameter."""

    processes: tuple[tuple[Process, bool], ...]
    curve: FitCurve
    moving: tuple[bool, ...]
    wavelet_variance: WaveletVariance

    @classmethod
    def of(cls, fit: Fit) -> BiasTerms:
        """Return the terms of a fit."""
        rate, curve = fit.wavelet_variance.rate, FitCurve.of(fit)
        processes = tuple((p, is_slow(p, rate)) for p in fit.model.processes if p.scale > 0)
        known = {id(p): slow for p, slow in processes}
        moving = (known[id(p)] if id(p) in known else is_slow(p, rate) for p, _ in curve.moving)
        return cls(processes, curve, tuple(moving), fit.wavelet_variance.without_lags)

    def variance_of_mean(self, samples: int, span: int) -> Variance:
        """Compute the error variance of a recording's mean as an estimate of the constant bias.

        Stationary noise contributes the variance of the mean, a random walk that minus the level at the end, K²T/3.
        Flicker, power laws and noise slower than T contribute the Allan variance at T; ramps are no noise. `span`
        includes gaps; each term has the larger variance of both lengths."""
        rate = self.curve.design.rate

        def of(process: Process) -> float:
            return process.scale * max(_unit_variance(shape_of(process), length, rate) for length in {samples, span})

        return self._sum(of, fast=True)

    def variance_over(self, duration: float) -> Variance:
        """Compute the mean square of the bias (terms slower than 1 s, walks, flicker, power laws) about its mean over a
        duration (s): for 2^J samples the sum of Haar variances of levels 1 to J, even for walks (Percival and Walden
        2000, section 8.1), logarithmically interpolated."""
        rate = self.curve.design.rate
        position = max(math.log2(max(duration * rate, 1.0)), 1.0)
        low = math.floor(position)

        def of(process: Process) -> float:
            sums = np.cumsum(process.wavelet_variance(low + 1, rate))
            below, above = float(sums[low - 1]), float(sums[low])
            return below * (above / below) ** (position - low) if below > 0 else 0.0

        return self._sum(of, fast=False)

    def _sum(self, of: Callable[[Process], float], *, fast: bool) -> Variance:
        """Add up the variances `of` the slow terms and, if `fast`, of the others.

        The slow sum v ± s cannot be negative: a uniform prior for positive values gives the mean v + sλ and variance
        s²(1 − uλ − λ²), u = v/s, λ = φ(u)/Φ(u), up to `variance_limit`. A walk estimated as zero is not absent."""
        total, square, limit, once = 0.0, 0.0, 0.0, cache(of)
        for slow in (True, False) if fast else (True,):
            value = sum(once(p) for p, own in self.processes if own is slow)
            slopes = [
                sensitivity(p, name, once) if own is slow else 0.0
                for (p, name), own in zip(self.curve.moving, self.moving, strict=True)
            ]
            error = self.curve.error(np.array(slopes))
            if slow and error > 0:
                u = value / error
                hazard = NormalDist().pdf(u) / NormalDist().cdf(u)
                value, error = value + error * hazard, error * math.sqrt(max(1 - u * hazard - hazard**2, 0.0))
                shapes = [p for p, own in self.processes if own]
                shapes += [p for (p, _), own in zip(self.curve.moving, self.moving, strict=True) if own]
                most = float(variance_limit(self.wavelet_variance, shapes, once))
                value, error = min(value, most), min(error, most)
                limit += most
            else:
                if error > value:
                    shapes = [p for p, own in self.processes if not own]
                    error = min(error, float(variance_limit(self.wavelet_variance, shapes, once)))
                limit += value + 2 * error
            total, square = total + value, square + error**2
        return Variance(total, math.sqrt(square) / total if total > 0 else 0.0, limit)


def is_slow(process: Process, rate: float) -> bool:
    """Return whether a process is part of the bias: flicker, power laws, or over 1 s without oscillations and ramps."""
    if process.oscillation() is not None or process.scale == 0:
        return False
    time = process.correlation_time(rate)
    if time is None or is_flicker(process, rate):
        return True
    powers = {number.time_power for number in process.physical(rate) if number.signal_power}
    # Smallest correlation time (s) of the bias: the averaging time at which N is defined, and the default horizon.
    if time < 1.0 or (powers and not powers & {0.5, -0.5}):
        return False
    # An ARMA process of the sensor can have a slow pole, but most of its variance is at scales below 1 s.
    if time == math.inf or not process.has("autocovariance"):
        return True
    fast = process.wavelet_variance(max(1, round(math.log2(max(rate, 2.0)))), rate).sum()
    return bool(fast <= float(process.autocovariance([0], rate)[0]) / 2)


def is_scale_free(process: Process, rate: float) -> bool:
    """Return whether a process has no correlation time and is not a random walk, like flicker and power-law noise."""
    if process.oscillation() is not None:
        return False
    return process.correlation_time(rate) is None or is_flicker(process, rate)


@lru_cache(maxsize=256)
def _unit_variance(shape: Shape, samples: int, rate: float) -> float:
    """Return the variance of a mean for scale coefficient 1; the models of an axis have most shapes in common."""
    process = unit_of(shape)
    # A recording does not show the level of a stationary process whose correlation time exceeds its length.
    time = process.correlation_time(rate)
    beyond = time is not None and samples / rate < time < math.inf
    if beyond or not process.has("state_space") or is_scale_free(process, rate):
        return float(process.allan_variance([samples], rate)[0])
    if process.has("autocovariance"):
        begin, end = process.running_sum_covariance([0, samples], rate)
        return 2 * float(begin - end) / samples**2
    # The mean of the states is not used. For a ramp, it contains the slope, which is not noise.
    return float(process.state_space(rate).block_variance([samples])[0]) / samples**2
