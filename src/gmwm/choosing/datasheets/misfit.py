"""Ratio of the measured spectrum to the spectrum of a model at the scales where the model does not fit."""

from __future__ import annotations

import math

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.choosing.datasheets.prediction import Spectrum
from gmwm.fitting.estimation.result import Fit


def curve_ratio(fit: Fit) -> Spectrum | None:
    """Return the factor by which the density of a model has to be multiplied so that it has the measured variance.

    At the levels where the model lies outside the confidence limits of the measured wavelet variance, the factor is the
    ratio of the measured variance to the variance of the model, both without the sinusoids of the model. At the other
    levels it is 1. Level j stands for the centre √2 π/2^j of its octave of angular frequencies, and the logarithm of
    the factor is interpolated linearly in the logarithm of frequency.

    Returns
    -------
    callable or None
        The factor as a function of the angular frequency (rad per sample); None if the model lies inside the limits at
        all levels.
    """
    wv = fit.wavelet_variance
    lines = np.zeros(len(wv))
    for process in fit.model.processes:
        if process.scale != 0 and process.line(wv.rate) is not None:
            lines += process.wavelet_variance(wv.levels, wv.rate, wv.filter)
    outside = (fit.implied < wv.lower) | (fit.implied > wv.upper)
    outside &= (wv.variance > lines) & (fit.implied > lines)
    if not np.any(outside):
        return None
    logs = np.zeros(len(wv))
    logs[outside] = np.log((wv.variance - lines)[outside] / (fit.implied - lines)[outside])
    octaves = np.asarray(wv.levels, dtype=np.float64)

    def ratio(theta: Vector) -> Vector:
        return np.asarray(np.exp(np.interp(math.log2(math.sqrt(2) * math.pi) - np.log2(theta), octaves, logs)))

    return ratio
