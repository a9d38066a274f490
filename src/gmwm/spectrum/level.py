"""Local level of a power spectral density beside each frequency, and the significance of a density above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gmwm._arrays import Vector, row_medians

NEIGHBOURS = (4 / 9, 1 / 36)
"""Correlation of Hann periodograms one and two bins apart: (2/3)² and (1/6)²."""
FLANK_SHARE = 5.0
"""Degrees of freedom of the median of a flank, relative to the degrees of freedom of a value: 8 independent values,
times the efficiency 2/π of a median. 16 neighbouring frequencies of a Hann spectrum have the information of 8
independent ones."""
GROUP = 256
"""Number of frequencies whose scatter is used to check the degrees of freedom; the scatter then has a standard error of
7 %."""


class Flanks(NamedTuple):
    """Medians of the values on the left and on the right of each value; NaN if there are too few."""

    left: Vector
    right: Vector

    @property
    def level(self) -> Vector:
        """The higher of the two medians: at least the level between them, for every monotone spectrum."""
        return np.maximum(self.left, self.right)

    @property
    def between(self) -> Vector:
        """The geometric mean of the two medians: the level between them for a power law."""
        return np.sqrt(self.left * self.right)


def flanks(values: Vector, freedom: Vector, nearest: int, farthest: int, *, least: int) -> Flanks:
    """Compute local levels from the values that are `nearest` to `farthest` places away, at least `least` on each
    side."""
    width = farthest - nearest + 1
    padded = np.concatenate([np.full(farthest, np.nan), values, np.full(farthest, np.nan)])
    windows = sliding_window_view(padded, width)
    known = np.count_nonzero(~np.isnan(windows), axis=1)
    medians = np.full(len(windows), np.nan)
    full = known == width
    medians[full] = row_medians(windows[full])
    some = (known >= least) & ~full
    medians[some] = np.nanmedian(windows[some], axis=1)
    shift = farthest + nearest
    left, right = medians[: values.size], medians[shift : shift + values.size]
    factor = median_factor(freedom)
    return Flanks(left / factor, right / factor)


def median_factor(freedom: Vector) -> Vector:
    """Return the median of χ²_ν / ν (Wilson and Hilferty 1931)."""
    return (1 - 2 / (9 * freedom)) ** 3


def p_values(ratio: Vector, freedom: Vector) -> Vector:
    """Return the probability that noise gives a larger ratio of a value to the median of a flank: an F distribution."""
    from scipy.special import fdtrc

    return np.asarray(fdtrc(freedom, FLANK_SHARE * freedom, ratio))


def effective_freedom(density: Vector, freedom: Vector) -> Vector:
    """Return the degrees of freedom of each density, reduced where neighbouring densities scatter more than expected.

    They do if the noise is not stationary, for example if single blocks contain knocks.
    """
    from scipy.special import polygamma

    reduced = freedom.copy()
    with np.errstate(divide="ignore"):
        logs = np.log(density)
    for first in range(2, density.size - GROUP // 4, GROUP):
        part = slice(first, first + GROUP)
        # Second differences of values that are three bins apart, nearly independent, have no part of a smooth spectrum.
        values = logs[part]
        if values.size < 16 or not np.all(np.isfinite(values)):
            continue
        differences = values[6:] - 2 * values[3:-3] + values[:-6]
        scatter = float(np.median(np.abs(differences))) / 0.6745 / np.sqrt(6.0)
        expected = np.sqrt(float(polygamma(1, freedom[first + 1] / 2)))
        excess = scatter / expected / (1 + 3 * 1.6 / np.sqrt(values.size))
        if excess > 1:
            reduced[part] /= excess**2
    return np.maximum(reduced, 1.0)


def pooled_freedom(freedom: Vector, count: Vector) -> Vector:
    """Return the degrees of freedom of the mean of `count` neighbouring densities of a Hann spectrum."""
    one, two = NEIGHBOURS
    return freedom * count / (1 + 2 * one * (1 - 1 / count) + 2 * two * np.maximum(1 - 2 / count, 0))
