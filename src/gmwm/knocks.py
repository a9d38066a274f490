"""Knocks, bursts of samples far from what a sensor at rest shows, and steps, after which its level is another."""

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
_LEVELS = 256  # medians of as many blocks of a recording are compared for steps
_SHORTEST = 100  # samples in such a block
_FEWEST = 32  # differences that show what is usual among them
_STEP = 8.0  # standard deviations of these differences
_ISOLATED = 4.0  # a ramp changes twice as much over two blocks as over one beside them; a step changes there alone


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


@dataclass(frozen=True)
class Step:
    """A lasting change of the level of an axis.

    Parameters
    ----------
    time : float
        When, on the recording's clock (s).
    axis : str
        The axis that shows it.
    size : float
        Level after less level before, in the axis' unit.
    times : float
        Its size in standard deviations of what the level usually changes by.
    """

    time: float
    axis: str
    size: float
    times: float


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


def find_steps(imu: Imu, resolutions: Mapping[str, float | None]) -> tuple[Step, ...]:
    """Abrupt changes of level within segments, in the order of time.

    The medians m_i of blocks, 256 of them, 100 samples each at least, show the level and no knock. m_{i+2} − m_i has
    all of a step that lies in block i + 1. It is one where this is 8 times the standard deviation of all such
    differences, found from their median, which takes in random walks, and 4 times what the level changes by next to
    it, which leaves out warm-up; the first and the last three blocks of a segment are not looked at. Of 8680 simulated
    recordings of seven models, from 3400 to 100 000 samples, none had one.

    Parameters
    ----------
    imu : Imu
        The recording; one of fewer than 3400 samples is not looked at.
    resolutions : mapping of axis to float or None
        Quantisation step of each axis: half of it is the least that a level is taken to change by.
    """
    length = max(len(imu) // _LEVELS, _SHORTEST)
    found = [step for axis in imu for step in _steps(imu[axis], length, resolutions[axis] or 0.0)]
    return tuple(sorted(found, key=lambda step: (step.time, step.axis)))


def _steps(signal: Signal, length: int, resolution: float) -> list[Step]:
    """The steps of one axis."""
    levels = [
        (first, np.median(signal.values[first : last - (last - first) % length].reshape(-1, length), axis=1))
        for first, last in signal.segments
        if last - first >= 5 * length
    ]
    changes = [level[2:] - level[:-2] for _, level in levels]
    everything = np.concatenate([np.empty(0), *changes])
    if everything.size < _FEWEST:
        return []
    usual = float(np.median(everything))
    spread = max(float(np.median(np.abs(everything - usual))) / 0.67449, 0.5 * resolution)
    found = []
    for (first, level), change in zip(levels, changes, strict=True):
        beside = np.abs(np.diff(level))
        # Just before the change over two blocks and just behind; at the ends of a segment warm-up looks like a step.
        before, behind = np.append(np.inf, beside[:-2]), np.append(beside[2:], np.inf)
        size = np.abs(change - usual)
        least = np.maximum(_STEP * spread, _ISOLATED * np.maximum(before, behind))
        at = np.flatnonzero((size > least) & (spread > 0))
        # Neighbouring blocks show one and the same step.
        for group in np.split(at, np.flatnonzero(np.diff(at) > 2) + 1) if at.size else []:
            i = int(group[np.argmax(size[group])])
            place = _corner(signal.values[first + i * length : first + (i + 3) * length], level[i], level[i + 2])
            time = float(signal.times([first + i * length + place])[0])
            found.append(Step(time, signal.axis, float(change[i]), float(size[i] / spread)))
    return found


def _corner(values: Vector, before: float, after: float) -> int:
    """The first sample at the new level: each sample votes for the level it is nearer to."""
    votes = np.where(np.abs(values - before) < np.abs(values - after), 1, -1)
    return min(int(np.argmax(np.concatenate([[0], np.cumsum(votes)]))), values.size - 1)
