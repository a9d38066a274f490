"""Fit of a resonance by a Lorentz shape on top of a power law."""

from __future__ import annotations

import math

import numpy as np

from gmwm.base.arrays import Vector

LEAST_POINTS = 8
"""Smallest number of densities to which the five parameters of the shape are fitted."""
WITHIN = 3.0
"""Largest factor by which a fit may change the width; beyond, it describes another feature of the spectrum."""


def lorentz_fit(
    frequencies: Vector, density: Vector, freedom: Vector, *, center: float, width: float
) -> tuple[float, float] | None:
    """Fit S(f) = a (f/c)^b + h / (1 + ((f − f₀) / (w/2))²) to densities with `freedom` degrees of freedom.

    Each density has a gamma distribution; the squared deviance residuals are minimised. c is `center`, also the start
    of f₀, and `width` the start of w (Hz). Returns the fitted f₀ and w (Hz), or None if the fit fails.
    """
    from scipy.optimize import least_squares

    known = density > 0
    frequencies, density, freedom = frequencies[known], density[known], freedom[known]
    if density.size < LEAST_POINTS:
        return None
    level, top = float(np.median(density[np.argsort(density)[: density.size // 2]])), float(density.max())
    start = np.array([math.log(level), 0.0, math.log(max(top - level, level / 10)), 0.0, math.log(width)])
    weights, away = np.sqrt(freedom), frequencies - center
    logs = np.log(frequencies / center)

    def residuals(parameters: Vector) -> Vector:
        a, slope, height, shift, size = np.clip(parameters, -200, 200)
        shape = math.exp(height) / (1 + ((away - shift * width) / (math.exp(size) / 2)) ** 2)
        ratio = density / (np.exp(np.clip(a + slope * logs, -300, 300)) + shape)
        deviance = np.maximum(ratio - 1 - np.log(ratio), 0.0)
        return np.asarray(weights * np.sign(ratio - 1) * np.sqrt(deviance))

    found = least_squares(residuals, start, method="lm", max_nfev=400)
    shift, size = float(found.x[3]), math.exp(float(np.clip(found.x[4], -200, 200)))
    if not found.success or abs(shift) > 1 or not width / WITHIN <= size <= width * WITHIN:
        return None
    return center + shift * width, size
