"""Runs of equal values and of values on a straight line."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, runs_of

Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]


def repeats(axes: list[Vector], begins: Indices) -> Mask:
    """Return whether each sample equals the sample before it on all axes, in the same segment. `begins` are the first
    samples of the segments."""
    same = np.zeros(axes[0].size, dtype=np.bool_)
    same[1:] = axes[0][1:] == axes[0][:-1]
    for values in axes[1:]:
        same[1:] &= values[1:] == values[:-1]
    same[begins] = False
    return same


def offsets(same: Mask) -> Indices:
    """Return the position of each sample in its run of equal samples, from 0."""
    at = np.arange(same.size)
    return np.asarray(at - np.maximum.accumulate(np.where(same, 0, at)))


def in_long_runs(same: Mask, least: int) -> Mask:
    """Return the samples that continue a run of at least `least` samples. The first sample of a run is not among
    them."""
    inside = np.zeros(same.size, dtype=np.bool_)
    runs = runs_of(same)
    for first, last in runs[runs[:, 1] - runs[:, 0] + 1 >= least]:
        inside[first:last] = True
    return inside


def straight(values: Vector, begins: Indices) -> Mask:
    """Return whether each sample is on the straight line between its two neighbours, and differs from them."""
    line = np.zeros(values.size, dtype=np.bool_)
    if values.size < 3:
        return line
    steps = np.diff(values)
    # Interpolated values are rounded to float64, or to the digits of a file.
    rounding = 1e-9 * max(float(np.max(values) - np.min(values)), 1e-300)
    line[1:-1] = (np.abs(np.diff(steps)) <= rounding) & (np.abs(steps[1:]) > rounding)
    line[begins] = False
    line[np.maximum(begins - 1, 0)] = False
    return line
