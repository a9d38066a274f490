"""How far the mean of a recording and the bias of a sensor move: variances from a fitted model, with their errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from gmwm.datasheets.curve import Curve, sensitivity
from gmwm.datasheets.effective import WALK, Use, counted, is_scale_free
from gmwm.datasheets.equivalent_terms import translated
from gmwm.estimation.result import Fit
from gmwm.processes.base import Process

SLOW = 1.0
"""Correlation time (s) from which a term is part of the bias. It is the time at which N is defined, and the default
horizon of exported files."""


@dataclass(frozen=True)
class Variance:
    """A variance and its relative standard error."""

    value: float
    relative: float


def variance_of_mean(fit: Fit, samples: int, span: int) -> Variance:
    """Compute the variance of the mean of a recording, as an estimate of the constant bias.

    For stationary noise it is the variance of the mean. The level of a random walk is not constant: it is the variance
    of the mean minus the level at the end of the recording, K²T/3, which is the same at the beginning. Flicker and
    power-law noise have the Allan variance at the length T of the recording: half the variance of the difference from
    the mean of the next recording of this length. Ramps are not noise.

    Parameters
    ----------
    fit : Fit
        The model of the noise.
    samples, span : int
        Number of samples, and number with those that are missing in gaps. Each term has the larger of its variances for
        these two lengths.
    """
    rate = fit.wavelet_variance.rate

    def of(process: Process) -> float:
        return max(_mean_variance(process, length, rate) for length in {samples, span})

    return _sum(fit, of, fast=True)


def bias_variance(fit: Fit, duration: float) -> Variance:
    """Compute the mean square of the bias around its mean over a duration (s).

    The bias is the sum of the terms with a correlation time of at least 1 s, of random walks, and of flicker and
    power-law noise. The variance of 2^J samples around their mean is Σ ν_j² over the levels 1 to J of the Haar wavelet
    variance (exact, also for a random walk); between two such lengths it is interpolated in the logarithm.

    References
    ----------
    Percival and Walden (2000), Wavelet Methods for Time Series Analysis, section 8.1.
    """
    rate = fit.wavelet_variance.rate
    position = max(math.log2(max(duration * rate, 1.0)), 1.0)
    low = math.floor(position)

    def of(process: Process) -> float:
        sums = np.cumsum(process.wavelet_variance(low + 1, rate))
        below, above = float(sums[low - 1]), float(sums[low])
        return below * (above / below) ** (position - low) if below > 0 else 0.0

    return _sum(fit, of, fast=False)


def is_slow(process: Process, rate: float) -> bool:
    """Return whether a process is part of the bias of a sensor."""
    if process.line(rate) is not None or process.scale == 0:
        return False
    return WALK in counted(process, Use(SLOW), rate) or is_scale_free(process, rate)


def _sum(fit: Fit, of: Callable[[Process], float], *, fast: bool) -> Variance:
    """Add the variances of the slow terms and, with `fast`, of the others.

    An estimate v of the slow part with the standard error s is normal and cannot be negative. Its mean and variance for
    a uniform prior on positive values are v + s λ and s²(1 − uλ − λ²) with u = v/s and λ = φ(u)/Φ(u), so that a random
    walk that is estimated as zero is not assumed to be absent.
    """
    written, _ = translated(fit)
    rate, curve = fit.wavelet_variance.rate, Curve.of(written)
    total, square = 0.0, 0.0
    for slow in (True, False) if fast else (True,):
        value = sum(of(p) for p in written.model.processes if p.scale > 0 and is_slow(p, rate) is slow)
        slopes = [sensitivity(p, name, of) if is_slow(p, rate) is slow else 0.0 for p, name in curve.moving]
        error = curve.error(np.array(slopes))
        if slow and error > 0:
            u = value / error
            hazard = NormalDist().pdf(u) / NormalDist().cdf(u)
            value, error = value + error * hazard, error * math.sqrt(max(1 - u * hazard - hazard**2, 0.0))
        total, square = total + value, square + error**2
    return Variance(total, math.sqrt(square) / total if total > 0 else 0.0)


def _mean_variance(process: Process, samples: int, rate: float) -> float:
    if process.has("state_space") and not is_scale_free(process, rate):
        # The mean of a state is left out: that of a ramp is its slope, which is not noise.
        return float(process.state_space(rate).block_variance([samples])[0]) / samples**2
    return float(process.allan_variance([samples], rate)[0])
