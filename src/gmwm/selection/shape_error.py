"""Uncertainty of the shapes that a search fixes, as a relative covariance of the wavelet variance."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.estimation.result import Fit
from gmwm.filters import HAAR, find_filter
from gmwm.processes.base import Process
from gmwm.processes.noise import WN
from gmwm.processes.ordered import find_class
from gmwm.processes.parameter import Fixed
from gmwm.processes.power import FN
from gmwm.spectrum.short_memory import Alternative, SpectralShape
from gmwm.variance.result import WaveletVariance

SAMPLED = (0.4427, 0.1542, 0.0500, 0.0154, 0.0046, 0.0013)
"""Haar wavelet variance of discrete flicker noise, fractionally integrated white noise of order 1/2 (Kasdin 1995),
relative to the wavelet variance of continuous flicker noise averaged over each sampling interval, minus 1, from level 1
on. The ratio follows from the density π/sin(πf) per sample instead of 1/f (tests/selection/test_shape_error.py)."""

SPREAD = 0.75
"""Standard deviation of the difference from continuous flicker noise, relative to `SAMPLED`: the difference is 0 for
the mean over each interval, 0.45 for a density of 1/f up to half the rate, and 1 for discrete flicker noise."""
BAND = ("f_b", "f_r", "Q_r")
"""Symbols of the numbers of a shape that do not depend on its density."""
CHOSEN = 1.5
"""Factor on the covariance of a shape, because its order was selected with the same spectrum. Without it, intervals of
N hold in 88 % of recordings with an FIR filter (docs/validation/sensors.md)."""


def process_of(shape: SpectralShape | Alternative) -> Process:
    """Return the ARMA process of a shape, with its variance free."""
    p, q = shape.phi.size, shape.theta.size
    if p + q == 0:
        return WN()
    kind = find_class(f"ARMA({p},{q})" if p and q else f"AR({p})" if p else f"MA({q})")
    assert kind is not None
    names = [parameter.name for parameter in kind.nonlinear_parameters()]
    values = np.concatenate([shape.phi, shape.theta]).tolist()
    return kind(**{name: Fixed(value) for name, value in zip(names, values, strict=True)})


def with_shape_error(wv: WaveletVariance, fit: Fit, shape: SpectralShape, process: Process) -> WaveletVariance:
    """Add the covariance from the uncertainty of a shape, whose density at frequency 0 is free, to the data.

    It is the covariance of the coefficients, and the spread of the other orders that describe the spectrum as well.

    Parameters
    ----------
    wv : WaveletVariance
    fit : Fit
        A fit with the shape, for its share of each level.
    shape : SpectralShape
    process : Process
        The shape as a term of the fit.
    """
    if not shape.covariance.size:
        return wv
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    slopes = type(process).shape_jacobian(nonlinear, wv.levels, wv.rate)[0]
    slopes /= type(process).shape(nonlinear, wv.levels, wv.rate)[0][:, None]
    slopes[:, : shape.phi.size] -= 2 / (1 - shape.phi.sum())
    slopes[:, shape.phi.size :] -= 2 / (1 + shape.theta.sum())
    relative: Matrix = slopes @ shape.covariance @ slopes.T
    own = _unit_curve(shape, wv)
    for other in shape.alternatives:
        apart = _unit_curve(other, wv) / own - 1
        relative = relative + other.weight * np.outer(apart, apart)
    term = next(t for t, p in zip(fit.model.terms, fit.model.processes, strict=True) if type(p) is type(process))
    share = fit.decomposition[term] / fit.implied
    return _with(wv, CHOSEN * relative * np.outer(share, share))


def band_errors(shape: SpectralShape, rate: float) -> dict[str, float]:
    """Return relative standard errors of the bandwidth f_b, the resonance frequency f_r and its quality factor Q_r.

    By the delta method from the covariance of the coefficients, with the spread of the other orders.

    Parameters
    ----------
    shape : SpectralShape
    rate : float
        Sampling rate (Hz).
    """
    values = np.concatenate([shape.phi, shape.theta])
    if not values.size:
        return {}
    names = [parameter.name for parameter in process_of(shape).nonlinear_parameters()]
    others = [(other.weight, _band(process_of(other), rate)) for other in shape.alternatives]
    found = {}
    free: dict[str, Any] = {**dict(zip(names, values.tolist(), strict=True)), "sigma2": shape.innovation}
    for number in type(process_of(shape))(**free).physical(rate):
        if number.signal_power or number.symbol not in BAND:
            continue
        slopes = np.array([number.slopes.get(name, 0.0) for name in names]) / values
        square = float(slopes @ shape.covariance @ slopes)
        square += sum(w * math.log(b[number.symbol] / number.value) ** 2 for w, b in others if number.symbol in b)
        found[number.symbol] = math.sqrt(max(square, 0.0))
    return found


def _band(process: Process, rate: float) -> dict[str, float]:
    scale = process.scale_parameter().name
    numbers = process.with_values(**{scale: process.value_from(1.0)}).physical(rate)
    return {number.symbol: number.value for number in numbers if number.symbol in BAND}


def _unit_curve(shape: SpectralShape | Alternative, wv: WaveletVariance) -> Vector:
    """Return the wavelet variance (J,) of a process with the density 1 at frequency 0."""
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    curve = type(process_of(shape)).shape(nonlinear, wv.levels, wv.rate)[0]
    return np.asarray(curve * ((1 - shape.phi.sum()) / (1 + shape.theta.sum())) ** 2)


def with_sampling_error(wv: WaveletVariance, fit: Fit) -> WaveletVariance:
    """Add the uncertainty of flicker noise near half the sampling rate, which depends on how it is sampled, to the
    data.

    The model has the mean of continuous noise over each sampling interval. Noise from the output stage itself, or
    aliased noise, has more power at the first levels, which a fit would attribute to white noise.

    Parameters
    ----------
    wv : WaveletVariance
    fit : Fit
        A fit with or without flicker noise, for its share of each level.
    """
    flicker = [t for t, p in zip(fit.model.terms, fit.model.processes, strict=True) if isinstance(p, FN) and p.scale]
    if not flicker or find_filter(wv.filter) is not HAAR:
        return wv
    places = np.minimum(wv.levels, len(SAMPLED) + 1) - 1
    apart = SPREAD * np.append(SAMPLED, 0.0)[places]
    apart *= sum(fit.decomposition[term] for term in flicker) / fit.implied
    return _with(wv, np.outer(apart, apart))


def _with(wv: WaveletVariance, added: Matrix) -> WaveletVariance:
    return replace(wv, excess=added if wv.excess is None else wv.excess + added)
