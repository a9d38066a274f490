"""Fit a damped oscillator to a peak of a power spectral density, however narrow the peak is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.lazy import scipy
from gmwm.measuring.spectrum.line import Bump, Line
from gmwm.measuring.spectrum.narrow import FIRST_BIN
from gmwm.measuring.spectrum.result import PowerSpectrum

_BINS, _WIDTHS = 40, 6.0
"""Distance from the peak up to which the density is fitted: at least in bins, and in widths of the peak."""
_MOST = 200
"""Number of densities from which neighbours are averaged."""
_SINUSOID = 0.01
"""Damping times the length of a block of a line that is indistinguishable from a sinusoid."""
_GAIN = 25.0
"""Smallest reduction of the deviance by a width. Sinusoids in noise exceed it in fewer than 1 of 200 recordings
(tests/spectrum/test_resonance.py)."""


class Resonance(NamedTuple):
    """A damped oscillator with its natural frequency (Hz), its quality and its variance (u²)."""

    frequency: float
    quality: float
    variance: float


def resonance_of(spectrum: PowerSpectrum, peak: Line | Bump, others: Iterable[Line | Bump]) -> Resonance | None:
    """Return the oscillator that a peak shows; None if the peak is a sinusoid, or if the fit fails.

    The expected density of a Lorentz peak over blocks with a Hann window has a closed form, which holds for peaks that
    are narrower than the resolution too: their flanks are visible far from the peak, where a sinusoid has none.
    `others` are peaks whose surroundings are left out.
    """
    spacing = spectrum.rate / spectrum.length
    reach = min(max(_BINS * spacing, _WIDTHS * peak.width), 0.8 * peak.frequency)
    used = np.abs(spectrum.frequencies - peak.frequency) <= reach
    used[:FIRST_BIN] = used[-1] = False
    for other in others:
        apart = abs(other.frequency - peak.frequency)
        if apart > max(4 * spacing, peak.width):
            used &= np.abs(spectrum.frequencies - other.frequency) > min(max(6 * spacing, 2 * other.width), apart / 2)
    used &= spectrum.density > 0
    size = max(1, int(np.count_nonzero(used)) // _MOST)
    frequencies, density = (_means(values[used], size) for values in (spectrum.frequencies, spectrum.density))
    # Neighbouring densities of a Hann window are correlated: 1.94 of them have the freedom of one.
    freedom = _means(spectrum.degrees_of_freedom[used], size) * max(size / 1.94, 1.0)
    if density.size < 12:
        return None
    block, logs = spectrum.length / spectrum.rate, np.log(frequencies / peak.frequency)
    level = float(np.median(density))
    weights = np.sqrt(freedom)
    # Density of an oscillator relative to a Lorentz peak, which is symmetric.
    bend = (2 * peak.frequency / (peak.frequency + frequencies)) ** 2

    def residuals(parameters: Vector, damping: float | None = None) -> Vector:
        a, slope, height, shift, *width = np.clip(parameters, -200, 200)
        alpha = damping if damping is not None else math.exp(min(width[0], 25.0)) + _SINUSOID
        distance = 2 * math.pi * block * (frequencies - peak.frequency) - shift
        model = np.exp(np.clip(a + slope * logs, -200, 200)) + np.exp(height) * bend * _hann_lorentz(alpha, distance)
        ratio = density / model
        deviance = np.maximum(ratio - 1 - np.log(ratio), 0.0)
        return np.asarray(weights * np.sign(ratio - 1) * np.sqrt(deviance))

    top = float(density.max())
    damping = max(math.pi * peak.width * block, 0.3)
    start = np.array([math.log(level), 0.0, math.log(max(top, 2 * level) * (1 + damping)), 0.0])
    sinusoid = scipy.optimize.least_squares(residuals, start, method="lm", max_nfev=300, args=(_SINUSOID,))
    fit = scipy.optimize.least_squares(residuals, np.append(start, math.log(damping)), method="lm", max_nfev=300)
    if not fit.success or 2 * float(sinusoid.cost - fit.cost) < _GAIN:
        return None
    damping = math.exp(min(fit.x[4], 25.0)) + _SINUSOID
    frequency = peak.frequency + float(fit.x[3]) / (2 * math.pi * block)
    if abs(frequency - peak.frequency) > max(2 * spacing, peak.width):
        return None
    return Resonance(frequency, math.pi * frequency * block / damping, math.exp(fit.x[2]) / (2 * block))


def _hann_lorentz(damping: float, distance: Vector) -> Vector:
    """Return ∫₀¹ e^(−αu) cos(δu) c(u) du, with the autocorrelation c of the Hann window, the damping α = πwT of a peak
    of width w over the length T of a block, and distances δ from the peak (rad per block)."""
    s = damping - 1j * distance
    turn = 2j * math.pi

    def constant(z: NDArray[Any]) -> NDArray[Any]:
        return np.asarray(-np.expm1(-z) / z)

    def falling(z: NDArray[Any]) -> NDArray[Any]:
        return np.asarray((1 - constant(z)) / z)

    sums: NDArray[Any] = 2 / 3 * falling(s) + (falling(s + turn) + falling(s - turn)) / 6
    sums = sums + (constant(s - turn) - constant(s + turn)) / (4j * math.pi)
    return np.asarray(np.maximum(sums.real, 1e-300))


def _means(values: Vector, size: int) -> Vector:
    """Return the means of groups of neighbours."""
    count = values.size - values.size % size
    return np.asarray(values[:count].reshape(-1, size).mean(axis=1))
