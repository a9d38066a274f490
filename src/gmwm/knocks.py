"""Knocks: bursts of samples far from what a sensor at rest shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.signals import Imu, Signal

_BLOCK = 1000  # samples over which a local median is taken: knocks are shorter, drift is slower
_KNOCK = 8.0  # local standard deviations; Gaussian noise reaches them once in 10^15 samples
_BURST = 1.0  # seconds between outliers of the same knock


@dataclass(frozen=True)
class Knock:
    """A burst of outliers.

    Parameters
    ----------
    time : float
        When it began, on the recording's clock (s).
    duration : float
        How long it lasted (s).
    axes : tuple of str
        The axes that show it.
    peak : float
        The largest deviation, in local standard deviations.
    """

    time: float
    duration: float
    axes: tuple[str, ...]
    peak: float


def find_knocks(imu: Imu, steps: Mapping[str, float | None]) -> tuple[tuple[Knock, ...], dict[str, NDArray[np.int64]]]:
    """Bursts of outliers over all axes, and the indices of the outliers of each axis.

    Parameters
    ----------
    imu : Imu
        The recording.
    steps : mapping of axis to float or None
        Quantisation step of each axis: no axis is taken to be quieter than half of it.
    """
    outliers, found = {}, []
    for k, axis in enumerate(imu):
        index, deviation = _outliers(imu[axis], steps[axis] or 0.0)
        outliers[axis] = index
        found.append((index, deviation, np.full(index.size, k)))
    index, deviation, axis_number = (np.concatenate(column) for column in zip(*found, strict=True))
    if index.size == 0:
        return (), outliers
    order = np.argsort(index, kind="stable")
    index, deviation, axis_number = index[order], deviation[order], axis_number[order]
    times = imu[imu.axes[0]].times(index)
    seams = np.searchsorted([first for first, _ in imu.segments], index, side="right")
    begins = np.flatnonzero((np.diff(times) > _BURST) | (np.diff(seams) != 0)) + 1
    knocks = []
    for a, b in zip([0, *begins.tolist()], [*begins.tolist(), index.size], strict=True):
        axes = tuple(imu.axes[k] for k in np.unique(axis_number[a:b]))
        knocks.append(Knock(float(times[a]), float(times[b - 1] - times[a]), axes, float(np.max(deviation[a:b]))))
    return tuple(knocks), outliers


def _outliers(signal: Signal, step: float) -> tuple[NDArray[np.int64], Vector]:
    """Indices and sizes of the samples far from the local median, in local standard deviations."""
    indices, sizes = [np.empty(0, dtype=np.int64)], [np.empty(0)]
    for first, last in signal.segments:
        length = min(_BLOCK, last - first)
        if length < 64:  # too few to tell what is usual
            continue
        whole = last - (last - first) % length
        # Blocks from the first sample on; the remainder is seen in a block that ends with the last one.
        for a, b, new in ((first, whole, first), (last - length, last, whole)):
            blocks = signal.values[a:b].reshape(-1, length)
            distance = np.abs(blocks - np.median(blocks, axis=1, keepdims=True))
            spread = _usual_spread(blocks, distance, step)
            at = np.flatnonzero((distance > _KNOCK * spread) & (spread > 0))
            at = at[a + at >= new]
            indices.append(a + at)
            sizes.append(distance.ravel()[at] / spread.ravel()[at // length])
    return np.concatenate(indices), np.concatenate(sizes)


def _usual_spread(blocks: Vector, distance: Vector, step: float) -> Vector:
    """The standard deviation of each block as it would be without knocks.

    A knock raises the standard deviation, so the median distance bounds it. That of coarsely quantised
    values is one step or nothing: it is trusted to a step only, and no spread is below half a step.
    """
    bound = np.median(distance, axis=1, keepdims=True) / 0.67449 + step
    spread = np.minimum(np.std(blocks, axis=1, keepdims=True), bound)
    return np.asarray(np.maximum(spread, 0.5 * step))
