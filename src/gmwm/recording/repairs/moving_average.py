"""Recognise an output that is the average of the last k samples, taken once or twice, from its spectral density."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.lazy import scipy

_MISFIT, _STRANGE = (2.0, 5.0), (0.1, 0.25)
"""Largest median of the squared residuals over that of noise, and largest share of residuals above three standard
errors (a resonance): for up to three samples, and for more, whose zeros no other filter has
(tests/spectrum/test_averages.py)."""


class MovingAverage(NamedTuple):
    """Average of the last `length` samples, `passes` times; `floor`: density of rounding over that of white noise."""

    length: int
    passes: int
    floor: float = 0.0

    @property
    def taps(self) -> Vector:
        """Coefficients of a moving average that follow the 1, with zeros at 1 − 1e-6 instead of on the unit circle."""
        once = (1 - 1e-6) ** np.arange(self.length)
        return np.asarray((once if self.passes == 1 else np.convolve(once, once))[1:])

    def gain(self, cycles: Vector) -> Vector:
        """Return the factor on a density, at frequencies relative to the rate."""
        sine = self.length * np.sin(np.pi * cycles)
        ratio = np.divide(np.sin(np.pi * self.length * cycles), sine, out=np.ones_like(sine), where=sine > 0)
        return np.asarray(ratio ** (2 * self.passes))


def moving_average(density: Vector, freedom: float) -> MovingAverage | None:
    """Return the average that a density (from frequency 0 to half the rate, with these degrees of freedom) shows.

    White and slow noise pass the average, beside the rounding of the output. A resonance may stand beside them."""
    size = density.size - 1
    width = max(size // 512, 1)  # means of neighbouring densities, 16 between two zeros of the longest average
    first = max(4, width)  # slow noise is strongest below
    count = (size - first) // width
    if count < 64:
        return None
    cycles = (first + np.arange(count * width)) / (2 * size)
    groups = density[first : first + count * width].reshape(count, width).mean(axis=1)
    centres = cycles.reshape(count, width).mean(axis=1)
    if not np.all(groups > 0):
        return None
    # Densities of a Hann window are correlated: 1.94 of them have the freedom of one. A model error of 3 % is allowed.
    error = np.sqrt(2 / freedom * min(1.94 / width, 1.0) + 0.03**2)
    slow = centres[0] / centres

    def misfits(gain: Vector) -> tuple[Vector, Vector]:
        """Return the residuals (standard errors) and the powers of white and slow noise behind a gain, and rounding."""
        columns = np.stack([gain, gain * slow, gain * slow**2, np.ones(count)], axis=1)
        weights = 1 / groups
        for _ in range(3):
            powers = scipy.optimize.nnls(columns * weights[:, None], groups * weights)[0]
            model = np.maximum(columns @ powers, 1e-300)
            residuals = np.abs(np.log(groups / model)) / error
            weights = np.sqrt(np.minimum(1, 2 / np.maximum(residuals, 1.0))) / model
        return residuals, powers

    best, least = None, _loss(misfits(np.ones(count))[0]) - 60.0  # a walk fits as well without an average
    for passes, longest in ((1, 64), (2, 32)):  # an MA process has at most 63 coefficients
        for length in range(2, min(longest, count // 6) + 1):
            zero, half = np.searchsorted(centres, [1 / length - 1 / count / 4, 0.5 / length])
            zero = min(int(zero), count - 1)
            # Without rounding, this ratio is far below that of white noise.
            if groups[max(zero - 1, 0) : zero + 2].min() > 0.2 * groups[half]:
                continue
            average = MovingAverage(length, passes)
            residuals, powers = misfits(average.gain(cycles).reshape(count, width).mean(axis=1))
            misfit, strange = np.median(residuals**2) / 0.455, np.mean(residuals > 3)
            many = int(length > 3)
            if misfit < _MISFIT[many] and strange < _STRANGE[many] and powers[0] > 0 and _loss(residuals) < least:
                best, least = average._replace(floor=float(powers[3] / powers[0])), _loss(residuals)
    return best


def _loss(residuals: Vector) -> float:
    return float(np.sum(np.minimum(residuals, 3.0) ** 2))
