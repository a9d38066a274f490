"""Frequency, amplitude and width of a line, from the density above the level on both sides of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.measuring.spectrum.line import Line

if TYPE_CHECKING:
    from gmwm.measuring.spectrum.result import PowerSpectrum

CORRELATIONS = (1.0, 2 / 3, 1 / 6)
"""Absolute correlations of the Fourier coefficients of a block with a Hann window that are 0, 1 and 2 bins apart."""
FREQUENCY_OVERLAP = 0.4
"""Variance of the mean frequency over half-overlapping blocks, relative to independent blocks. The noise is weighted by
the window times its derivative, whose overlapping halves have the correlation −3/10: 1 − 2 · 3/10."""
WINDOW_MOMENT = 1 / 3
"""Second central moment (bins²) of a line with a Hann window: −r''(0) / 4π², with the autocorrelation r of the window.
"""
TRUNCATION = 3e-4
"""Largest error (bins) of the mean frequency over seven bins, from the side lobes outside these bins."""
GAUSSIAN_WIDTH = 2 * math.sqrt(2 * math.log(2))
"""Width of a Gaussian shape at half its height, in units of its standard deviation."""


def measured_line(
    spectrum: PowerSpectrum, first: int, last: int, *, level: float, freedom: float, height: float, p_value: float
) -> Line:
    """Measure the line in the bins `first` to `last`, from the excess of the density over `level`.

    Its sum gives the power A²/2 of a sinusoid with the amplitude A, its mean position the frequency, and its second
    moment the width. All are linear in the density, so their standard errors follow from its covariance. A narrow line
    is treated as a sinusoid in noise, a wider line as narrow-band noise. `freedom` are the degrees of freedom of a
    density.
    """
    spacing = spectrum.rate / spectrum.length
    excess = spectrum.density[first : last + 1] - level
    place = np.arange(first, last + 1, dtype=np.float64)
    total = float(excess.sum())
    middle = float(np.clip(place @ excess / total, first, last))
    away = place - middle
    moment = float(away**2 @ excess) / total
    spread = moment - WINDOW_MOMENT
    error = math.sqrt(_variance((away**2 - moment) / total, excess, level=level, freedom=freedom, wandering=False))
    wandering = spread > 2 * error
    scatter = {
        name: math.sqrt(
            _variance(weights, excess, level=level, freedom=freedom, wandering=wandering, overlap=overlap)
        )
        for name, weights, overlap in (
            ("power", np.ones(place.size), 1.0), ("frequency", away / total, FREQUENCY_OVERLAP)
        )
    }  # fmt: skip
    power = total * spacing
    amplitude = math.sqrt(2 * power)
    return Line(
        frequency=middle * spacing,
        frequency_error=spacing * math.hypot(scatter["frequency"], TRUNCATION),
        amplitude=amplitude,
        amplitude_error=scatter["power"] * spacing / amplitude,
        width=GAUSSIAN_WIDTH * math.sqrt(spread) * spacing if wandering else 0.0,
        height=height,
        p_value=p_value,
    )


def _variance(
    weights: Vector, excess: Vector, *, level: float, freedom: float, wandering: bool, overlap: float = 1.0
) -> float:
    """Compute the variance of Σ weights · excess, including the error of the level.

    If `wandering`, the line is treated as narrow-band noise, and otherwise as a sinusoid. `overlap` is the factor by
    which overlapping blocks change the variance of the product of the sinusoid and the noise.
    """
    line = np.maximum(excess, 0.0)
    # The level is the mean of two medians of 16 bins each, so it has ten times the degrees of freedom of a bin.
    total = (float(weights.sum()) * level) ** 2 / 10
    for lag, correlation in enumerate(CORRELATIONS):
        one, two = slice(0, weights.size - lag), slice(lag, None)
        if wandering:
            values = weights * (level + line)
            part = correlation**2 * float(values[one] @ values[two])
        else:
            noise = correlation**2 * level**2 * float(weights[one] @ weights[two])
            root = weights * np.sqrt(line)
            part = noise + overlap * 2 * correlation * level * float(root[one] @ root[two])
        total += part if lag == 0 else 2 * part
    return max(2 / freedom * total, 0.0)
