"""Level of a power spectral density on both sides of each frequency, and the significance of a density above it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gmwm.base.arrays import Matrix, Vector, row_medians

NEIGHBOURS = (4 / 9, 1 / 36)
"""Correlations (2/3)² and (1/6)² of the values of a periodogram with a Hann window that are one and two bins apart."""
FLANK_SHARE = 5.0
"""Degrees of freedom of the median of a flank, relative to one value. Its 16 frequencies have the information of 8
independent values, and a median has the efficiency 2/π."""


class Flanks(NamedTuple):
    """Medians of the values to the left and to the right of each value; NaN if there are too few values."""

    left: Vector
    right: Vector

    @property
    def level(self) -> Vector:
        """Higher one of the two medians, which is at least the level between them for every monotone spectrum."""
        return np.maximum(self.left, self.right)

    @property
    def between(self) -> Vector:
        """Geometric mean of the two medians, which is the level between them for a power law."""
        return np.sqrt(self.left * self.right)


def flanks(values: Vector, freedom: Vector, nearest: int, farthest: int, *, least: int) -> Flanks:
    """Compute the medians of the values that are `nearest` to `farthest` positions away on each side of every value.
    They are divided by the median of χ²_ν / ν, so that they estimate the level. A side with fewer than `least` values
    gives NaN."""
    width = farthest - nearest + 1
    padded = np.concatenate([np.full(farthest, np.nan), values, np.full(farthest, np.nan)])
    windows = sliding_window_view(padded, width)
    counts = np.count_nonzero(~np.isnan(windows), axis=1)
    medians = np.full(len(windows), np.nan)
    full = counts == width
    medians[full] = row_medians(windows[full])
    partial = np.flatnonzero((counts >= least) & ~full)
    # NaN are last in sorted rows.
    ordered, number = np.sort(windows[partial], axis=1), counts[partial]
    rows = np.arange(partial.size)
    medians[partial] = (ordered[rows, (number - 1) // 2] + ordered[rows, number // 2]) / 2
    shift = farthest + nearest
    before, after = medians[: values.size], medians[shift : shift + values.size]
    factor = median_factor(freedom)
    return Flanks(before / factor, after / factor)


def median_factor(freedom: Vector) -> Vector:
    """Return the median of χ²_ν / ν for `freedom` ν (Wilson and Hilferty 1931)."""
    return (1 - 2 / (9 * freedom)) ** 3


def p_values(ratio: Vector, freedom: Vector, below: float) -> Vector:
    """Return the probability that noise gives a larger ratio of a value to the level of a flank, by the F distribution.
    Only probabilities up to `below` are computed. Larger ones are 1, and those of NaN are NaN."""
    from scipy.special import fdtrc, fdtri

    # With fewer degrees of freedom, a ratio of the same significance is larger.
    most = float(np.nanmax(freedom, initial=1.0))
    large = ratio >= (1 - 1e-6) * float(fdtri(most, FLANK_SHARE * most, 1 - below))
    p = np.where(np.isnan(ratio), np.nan, 1.0)
    p[large] = fdtrc(freedom[large], FLANK_SHARE * freedom[large], ratio[large])
    return np.asarray(p)


def effective_freedom(density: Vector, freedom: Vector) -> Vector:
    """Return the degrees of freedom of each density, reduced where neighbours scatter more than in stationary noise."""
    from scipy.special import polygamma

    # Number of neighbouring frequencies whose scatter checks the degrees of freedom, with a standard error of 7 %.
    size = 256
    reduced = freedom.copy()
    with np.errstate(divide="ignore"):
        logs = np.log(density)
    firsts = np.arange(2, density.size - size // 4, size)
    expected = np.sqrt(polygamma(1, freedom[firsts + 1] / 2))
    complete = np.count_nonzero(firsts + size <= density.size)
    scatter = _scatter(logs[2 : 2 + complete * size].reshape(complete, size))
    if complete < firsts.size:
        scatter = np.append(scatter, _scatter(logs[None, firsts[-1] :]))
    for first, spread, usual in zip(firsts.tolist(), scatter.tolist(), expected.tolist(), strict=True):
        part = reduced[first : first + size]
        excess = spread / usual / (1 + 3 * 1.6 / np.sqrt(part.size))
        if part.size >= 16 and excess > 1:  # not where the scatter is NaN
            part /= excess**2
    return np.maximum(reduced, 1.0)


def _scatter(logs: Matrix) -> Vector:
    """Return the robust standard deviation (m,) of each group of logarithms (m, n); NaN if one is not finite."""
    # Values three bins apart are nearly independent, and their second differences remove a smooth spectrum.
    good = np.isfinite(logs).all(axis=1)
    scatter = np.full(len(logs), np.nan)
    if logs.shape[1] > 6:
        rows = logs[good]
        differences = np.abs(rows[:, 6:] - 2 * rows[:, 3:-3] + rows[:, :-6])
        scatter[good] = row_medians(differences) / 0.6745 / np.sqrt(6.0)
    return scatter


def pooled_freedom(freedom: Vector, count: Vector) -> Vector:
    """Return the degrees of freedom of the mean of `count` neighbouring densities with `freedom` each, for a Hann
    window."""
    first, second = NEIGHBOURS
    return freedom * count / (1 + 2 * first * (1 - 1 / count) + 2 * second * np.maximum(1 - 2 / count, 0))
