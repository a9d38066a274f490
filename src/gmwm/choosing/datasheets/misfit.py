"""Ratio of the measured spectrum to the spectrum of a model at the scales where the model does not fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.fitting.estimation.result import Fit

MISFIT_ERRORS = 3.0
"""Number of standard errors between model and measurement from which the measurement is used. In a fit of the true
model, a level exceeds it with a probability of 0.3 %. Pinned by tests/test_effective_noise.py."""


@dataclass(frozen=True, eq=False)
class CurveRatio:
    """Ratio of the measured spectrum to the spectrum of a model, as a function of the angular frequency. `logs` (J,) is
    its logarithm at each level, and `errors` (J,) the standard error; both are 0 where the model fits."""

    levels: Vector
    logs: Vector
    errors: Vector

    def __call__(self, theta: Vector) -> Vector:
        """Return the ratio at angular frequencies (rad per sample), linear in logarithms between centres √2 π/2^j of
        octaves."""
        level = math.log2(math.sqrt(2) * math.pi) - np.log2(theta)
        return np.asarray(np.exp(np.interp(level, self.levels, self.logs)))

    def moved(self) -> Iterator[CurveRatio]:
        """Yield the ratio with its logarithm increased by one standard error at one level after another."""
        for k in np.flatnonzero(self.errors):
            yield replace(self, logs=self.logs + np.where(np.arange(self.logs.size) == k, self.errors, 0.0))


def curve_ratio(fit: Fit) -> CurveRatio | None:
    """Return the factor from the density of a model to the measured one; None if it is 1. It is the ratio of both
    variances, without the sinusoids, at levels that differ by more than `MISFIT_ERRORS` standard errors, and 1 at the
    others."""
    fit = fit.without_lags
    wv = fit.wavelet_variance
    lines = np.zeros(len(wv))
    for process in fit.model.processes:
        if process.scale != 0 and process.oscillation() is not None:
            lines += process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    usable = (wv.variance > lines) & (fit.implied > lines) & (wv.lower > 0)
    measured, implied = np.log(wv.variance[usable]), np.log(fit.implied[usable])
    limit = np.where(implied > measured, np.log(wv.upper[usable]), np.log(wv.lower[usable]))
    error = np.abs(limit - measured) / NormalDist().inv_cdf((1 + wv.confidence) / 2)
    if np.any(lines > 0):  # the power of an oscillation varies more than that of broad noise with the same variance
        error = np.maximum(error, np.sqrt(np.diag(fit.sandwich.sampling.wavelet)[usable]))
    outside = np.abs(implied - measured) > MISFIT_ERRORS * error
    if not np.any(outside):
        return None
    noise = np.log((wv.variance - lines)[usable] / (fit.implied - lines)[usable])
    logs, errors = np.zeros(len(wv)), np.zeros(len(wv))
    logs[usable], errors[usable] = np.where(outside, noise, 0.0), np.where(outside, error, 0.0)
    return CurveRatio(np.asarray(wv.levels, dtype=np.float64), logs, errors)
