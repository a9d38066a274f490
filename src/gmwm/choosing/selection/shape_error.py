"""Covariance of the wavelet variance from the uncertainty of shapes that the search for a model fixes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.spectrum.short_memory import Alternative, SpectralShape
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import HAAR, find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.noise import WN
from gmwm.theory.processes.ordered import find_class
from gmwm.theory.processes.oscillator import OSC
from gmwm.theory.processes.parameter import Fixed
from gmwm.theory.processes.power import FN

SAMPLED = (0.4427, 0.1542, 0.0500, 0.0154, 0.0046, 0.0013)
"""Relative difference between the Haar wavelet variances of discrete and of continuous flicker noise, from level 1 on.
Discrete flicker noise is fractionally integrated white noise of order 1/2 (Kasdin 1995), with the spectral density
π/sin(πf) per sample instead of 1/f. Continuous flicker noise is averaged over each sampling interval
(tests/selection/test_shape_error.py)."""

FLICKER_SPREAD = 0.75
"""Standard deviation of the unknown difference of the sampled noise from continuous flicker noise, relative to
`SAMPLED`. The difference is 0 for noise that is averaged over each sampling interval, 0.45 for a density of 1/f up to
half the sampling rate, and 1 for discrete flicker noise."""
BAND = ("f_b", "f_r", "Q_r")
"""Symbols of the physical parameters of a shape that do not depend on its scale."""
SELECTION_FACTOR = 2.0
"""Factor by which the covariance of a shape is increased, because the order of the shape was selected with the same
spectrum. With a factor of 1.5, 95 % intervals of N contain the true value in 89 % of recordings with an FIR filter
(docs/validation/sensors.md)."""

FILTER_TIME_SAMPLES = 3.0
"""A Gauss-Markov term with a correlation time up to this value (samples) is assumed to describe the low-pass filter of
the sensor. Because a filter does not have exactly this form, N is then wrong by 0.5 % although the test accepts the
model (docs/validation/sensors.md)."""


def process_of(shape: SpectralShape | Alternative) -> Process:
    """Return the ARMA process of a shape, with fixed coefficients and a free variance."""
    p, q = shape.phi.size, shape.theta.size
    if p + q == 0:
        return WN()
    kind = find_class(f"ARMA({p},{q})" if p and q else f"AR({p})" if p else f"MA({q})")
    assert kind is not None
    names = [parameter.name for parameter in kind.nonlinear_parameters()]
    values = np.concatenate([shape.phi, shape.theta]).tolist()
    return kind(**{name: Fixed(value) for name, value in zip(names, values, strict=True)})


def acts_as_filter(process: Process, fit: Fit) -> bool:
    """Return whether a Gauss-Markov process is so fast that it may describe the low-pass filter of the sensor."""
    time = process.correlation_time(fit.wavelet_variance.rate)
    return time is not None and 0 < time * fit.wavelet_variance.rate <= FILTER_TIME_SAMPLES


def with_shape_error(wv: WaveletVariance, fit: Fit, shape: SpectralShape, process: Process) -> WaveletVariance:
    """Add the uncertainty of a shape to the covariance of a wavelet variance. It consists of the covariance of the
    coefficients and the differences to other ARMA orders that describe the spectrum equally well. The density at
    frequency 0 is held constant, because the fit estimates it. `fit` is a fit with the term `process`, from which the
    share of the shape at each level is taken."""
    if not shape.covariance.size:
        return wv
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    slopes = type(process).shape_jacobian(nonlinear, wv.levels, wv.rate)[0]
    slopes /= type(process).shape(nonlinear, wv.levels, wv.rate)[0][:, None]
    slopes[:, : shape.phi.size] -= 2 / (1 - shape.phi.sum())
    slopes[:, shape.phi.size :] -= 2 / (1 + shape.theta.sum())
    relative: Matrix = slopes @ shape.covariance @ slopes.T
    curve = _unit_curve(shape, wv)
    for other in shape.alternatives:
        apart = _unit_curve(other, wv) / curve - 1
        relative = relative + other.weight * np.outer(apart, apart)
    # A fast Gauss-Markov term can take the place of the shape, or of a part of it.
    fast = [
        fit.decomposition[term]
        for term, part in zip(fit.model.terms, fit.model.processes, strict=True)
        if type(part) is type(process) or acts_as_filter(part, fit)
    ]
    share = np.sum(fast, axis=0) / fit.implied
    return _with(wv, SELECTION_FACTOR * relative * np.outer(share, share))


def with_oscillator_error(wv: WaveletVariance, fit: Fit, terms: Sequence[Process]) -> WaveletVariance:
    """Add the uncertainty of the frequency and the quality of oscillators to the covariance of a wavelet variance.

    For a Lorentz peak with the damping a = πf₀/Q over a duration T, Whittle's likelihood gives the variances a/T of the
    angular frequency and 1/aT of ln a. `fit` is a fit with the terms, from which their share at each level is taken.
    """
    duration = float(wv.samples) / wv.rate
    for process in terms:
        if not isinstance(process, OSC):
            continue
        frequency, quality = process.value("frequency"), process.value("quality")
        shape = OSC.standard((frequency, quality))
        slopes = OSC.shape_jacobian(np.array([[frequency, quality]]), wv.levels, wv.rate)[0] * [frequency, quality]
        slopes /= shape.wavelet_variance(wv.levels, wv.rate)[:, None]
        # ln a = ln f₀ − ln Q + …, and the errors of ω₀ and a are uncorrelated.
        damping = math.pi * frequency / quality
        frequency_square, decay_square = damping / duration / (2 * math.pi * frequency) ** 2, 1 / (damping * duration)
        relative = frequency_square * np.outer(slopes.sum(axis=1), slopes.sum(axis=1))
        relative = relative + decay_square * np.outer(slopes[:, 1], slopes[:, 1])
        share = (
            sum(
                fit.decomposition[term]
                for term, part in zip(fit.model.terms, fit.model.processes, strict=True)
                if isinstance(part, OSC) and np.allclose(part.nonlinear, process.nonlinear, rtol=1e-9, atol=0.0)
            )
            / fit.implied
        )
        wv = _with(wv, SELECTION_FACTOR * relative * np.outer(share, share))
    return wv


def band_errors(shape: SpectralShape, rate: float) -> dict[str, float]:
    """Return the relative standard errors of f_b, f_r and Q_r by the delta method, with other ARMA orders that fit
    equally well."""
    values = np.concatenate([shape.phi, shape.theta])
    if not values.size:
        return {}
    names = [parameter.name for parameter in process_of(shape).nonlinear_parameters()]
    others = [(other.weight, _band(process_of(other), rate)) for other in shape.alternatives]
    errors = {}
    free: dict[str, Any] = {**dict(zip(names, values.tolist(), strict=True)), "sigma2": shape.innovation}
    for number in type(process_of(shape))(**free).physical(rate):
        if number.signal_power or number.symbol not in BAND:
            continue
        slopes = np.array([number.slopes.get(name, 0.0) for name in names]) / values
        square = float(slopes @ shape.covariance @ slopes)
        square += sum(w * math.log(b[number.symbol] / number.value) ** 2 for w, b in others if number.symbol in b)
        errors[number.symbol] = math.sqrt(max(square, 0.0))
    return errors


def _band(process: Process, rate: float) -> dict[str, float]:
    scale = process.scale_parameter().name
    numbers = process.with_values(**{scale: process.value_from(1.0)}).physical(rate)
    return {number.symbol: number.value for number in numbers if number.symbol in BAND}


def _unit_curve(shape: SpectralShape | Alternative, wv: WaveletVariance) -> Vector:
    """Return the wavelet variance (J,) of a shape, scaled to the spectral density 1 at frequency 0."""
    nonlinear = np.concatenate([shape.phi, shape.theta]).reshape(1, -1)
    curve = type(process_of(shape)).shape(nonlinear, wv.levels, wv.rate)[0]
    return np.asarray(curve * ((1 - shape.phi.sum()) / (1 + shape.theta.sum())) ** 2)


def with_sampling_error(wv: WaveletVariance, fit: Fit) -> WaveletVariance:
    """Add the uncertainty of flicker noise near half the sampling rate, which is modelled as an average over each
    interval. Flicker of the output stage, or aliased noise, has more power there, which a fit would attribute to white
    noise."""
    flicker = [t for t, p in zip(fit.model.terms, fit.model.processes, strict=True) if isinstance(p, FN) and p.scale]
    if not flicker or find_filter(wv.filter) is not HAAR:
        return wv
    places = np.minimum(wv.levels, len(SAMPLED) + 1) - 1
    apart = FLICKER_SPREAD * np.append(SAMPLED, 0.0)[places]
    apart *= sum(fit.decomposition[term] for term in flicker) / fit.implied
    return _with(wv, np.outer(apart, apart))


def _with(wv: WaveletVariance, added: Matrix) -> WaveletVariance:
    return replace(wv, excess=added if wv.excess is None else wv.excess + added)
