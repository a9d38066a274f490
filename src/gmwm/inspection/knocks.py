"""Knocks, bursts of samples far from what a sensor at rest shows, and steps, after which its level is another."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.inspection.time_grid import Extent

BLOCK = 1000
"""Samples over which a local median is taken: knocks are shorter, drift is slower."""
FEWEST = 64
"""Samples without a gap that tell what is usual."""
_KNOCK = 8.0  # local standard deviations; Gaussian noise reaches them once in 10^15 samples
_BURST = 1.0  # seconds between outliers of the same knock
_LEVELS = 256  # medians of as many blocks of a recording are compared for steps
_SHORTEST = 100  # samples in such a block
_DIFFERENCES = 32  # that show what is usual among them
_STEP = 8.0  # standard deviations of these differences
_ISOLATED = 4.0  # a ramp changes twice as much over two blocks as over one beside them; a step changes there alone

Indices = NDArray[np.int64]
Outliers = tuple[Indices, Vector]
"""Their numbers in the recording, and how far out they lie, in local standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Knock:
    """A burst of outliers.

    Parameters
    ----------
    time : float
        When it began, in seconds from the first sample of the recording before anything was cut off: what `skip` of
        `read` takes.
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


@dataclass(frozen=True, kw_only=True)
class Step:
    """A lasting change of the level of an axis.

    Parameters
    ----------
    time : float
        When, in seconds from the first sample of the recording before anything was cut off.
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


def knocks_of(outliers: Mapping[str, Outliers], extent: Extent) -> tuple[Knock, ...]:
    """Bursts of the outliers of all axes together."""
    axes = tuple(outliers)
    index, deviation = (np.concatenate(column) for column in zip(*outliers.values(), strict=True))
    axis_number = np.repeat(np.arange(len(axes)), [found.size for found, _ in outliers.values()])
    if index.size == 0:
        return ()
    order = np.argsort(index, kind="stable")
    index, deviation, axis_number = index[order], deviation[order], axis_number[order]
    times = extent.times(index)
    seams = np.searchsorted([first for first, _ in extent.segments], index, side="right")
    begins = np.flatnonzero((np.diff(times) > _BURST) | (np.diff(seams) != 0)) + 1
    knocks = []
    for a, b in zip([0, *begins.tolist()], [*begins.tolist(), index.size], strict=True):
        shown = tuple(axes[k] for k in np.unique(axis_number[a:b]))
        knocks.append(
            Knock(
                time=float(times[a]),
                duration=float(times[b - 1] - times[a]),
                axes=shown,
                peak=float(np.max(deviation[a:b])),
            )
        )
    return tuple(knocks)


def outliers_of(blocks: Vector, resolution: float) -> Outliers:
    """Numbers, in the flat array, and sizes of the samples far from the median of their block.

    Parameters
    ----------
    blocks : (k, n) array
        Blocks of samples in a row.
    resolution : float
        Quantisation step: the axis is not taken to be quieter than half of it.
    """
    distance = np.abs(blocks - np.median(blocks, axis=1, keepdims=True))
    spread = _usual_spread(blocks, distance, resolution)
    at = np.flatnonzero((distance > _KNOCK * spread) & (spread > 0))
    return at, distance.ravel()[at] / spread.ravel()[at // blocks.shape[1]]


def _usual_spread(blocks: Vector, distance: Vector, step: float) -> Vector:
    """The standard deviation of each block as it would be without knocks.

    A knock raises the standard deviation, so the median distance bounds it. That of coarsely quantised
    values is one step or nothing: it is trusted to a step only, and no spread is below half a step.
    """
    bound = np.median(distance, axis=1, keepdims=True) / 0.67449 + step
    spread = np.minimum(np.std(blocks, axis=1, keepdims=True), bound)
    return np.asarray(np.maximum(spread, 0.5 * step))


def level_length(samples: int) -> int:
    """Samples in the blocks whose levels are compared for steps."""
    return max(samples // _LEVELS, _SHORTEST)


def steps_of(
    axis: str,
    levels: Sequence[tuple[int, Vector]],
    extent: Extent,
    resolution: float,
    values: Callable[[int, int], Vector],
) -> list[Step]:
    """Abrupt changes of level within segments, in the order of time.

    The medians m_i of blocks, 256 of them, 100 samples each at least, show the level and no knock. m_{i+2} − m_i has
    all of a step that lies in block i + 1. It is one where this is 8 times the standard deviation of all such
    differences, found from their median, which takes in random walks, and 4 times what the level changes by next to
    it, which leaves out warm-up; the first and the last three blocks of a segment are not looked at. Of 8680 simulated
    recordings of seven models, from 3400 to 100 000 samples, none had one.

    Parameters
    ----------
    axis : str
    levels : sequence of (first, (m,) array)
        Of each segment of five blocks or more, its first sample and the medians m_i.
    extent : Extent
        Of the recording; one of fewer than 3400 samples has too few blocks.
    resolution : float
        Quantisation step: half of it is the least that a level is taken to change by.
    values : callable
        The samples from a first to before a last one, to tell when just it was.
    """
    length = level_length(extent.samples)
    changes = [level[2:] - level[:-2] for _, level in levels]
    everything = np.concatenate([np.empty(0), *changes])
    if everything.size < _DIFFERENCES:
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
            begin = first + i * length
            place = _corner(values(begin, begin + 3 * length), level[i], level[i + 2])
            time = float(extent.times([begin + place])[0])
            found.append(Step(time=time, axis=axis, size=float(change[i]), times=float(size[i] / spread)))
    return found


def _corner(values: Vector, before: float, after: float) -> int:
    """The first sample at the new level: each sample votes for the level it is nearer to."""
    votes = np.where(np.abs(values - before) < np.abs(values - after), 1, -1)
    return min(int(np.argmax(np.concatenate([[0], np.cumsum(votes)]))), values.size - 1)
