"""Find knocks (bursts of outliers) and lasting jumps of the mean in a recording of a sensor at rest."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector, row_medians
from gmwm.measuring.inspection.time_grid import Extent

BLOCK = 1000
"""Samples of a local median: longer than a knock, shorter than a drift (tests/test_inspection_limits.py; all here)."""
FEWEST = 64  # smallest number of samples of a segment for a local standard deviation, whose relative error is then 9 %

Indices = NDArray[np.int64]
Outliers = tuple[Indices, Vector]
"""Indices of the outliers in the recording, and their distances from the median in local standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Knock:
    """A burst of outliers: start (s), `duration` (s), and largest deviation `peak` in local standard deviations."""

    time: float
    duration: float
    axes: tuple[str, ...]
    peak: float


@dataclass(frozen=True, kw_only=True)
class Step:
    """A lasting jump of the mean of an axis at `time` (s), before sample `index`.

    `times` is the size in standard deviations of usual changes. `at_gap`: the sensor restarted in a short gap, which is
    not filled (`Signal.fill_gaps`). A `possible` jump may be part of a random walk. One that `recurs` is noise of the
    axis. `until` is the time (s) up to which the mean settles, for a jump that is part of a settling."""

    time: float
    axis: str
    size: float
    times: float
    at_gap: bool = False
    index: int = 0
    possible: bool = False
    recurs: bool = False
    until: float | None = None

    @property
    def is_certain(self) -> bool:
        """Whether the jump can be subtracted."""
        return not (self.at_gap or self.possible or self.recurs)


def knocks_of(outliers: Mapping[str, Outliers], extent: Extent) -> tuple[Knock, ...]:
    """Group the outliers of all axes into knocks."""
    axes = tuple(outliers)
    if not axes:
        return ()
    index, deviation = (np.concatenate(column) for column in zip(*outliers.values(), strict=True))
    axis_number = np.repeat(np.arange(len(axes)), [places.size for places, _ in outliers.values()])
    if index.size == 0:
        return ()
    order = np.argsort(index, kind="stable")
    index, deviation, axis_number = index[order], deviation[order], axis_number[order]
    times = extent.times(index)
    seams = np.searchsorted([first for first, _ in extent.segments], index, side="right")
    # Longest time (s) between outliers of the same knock.
    begins = np.flatnonzero((np.diff(times) > 1.0) | (np.diff(seams) != 0)) + 1
    knocks = []
    for a, b in zip([0, *begins.tolist()], [*begins.tolist(), index.size], strict=True):
        shown = tuple(axes[k] for k in np.unique(axis_number[a:b]))
        knocks.append(
            Knock(
                time=float(times[a]), duration=float(times[b - 1] - times[a]), axes=shown,
                peak=float(np.max(deviation[a:b])),
            )
        )  # fmt: skip
    return tuple(knocks)


def outliers_of(blocks: Vector, resolution: float) -> Outliers:
    """Find samples far from their block's median: flat indices, and distances over the spread (≥ `resolution`/2)."""
    # Distance of an outlier from the local median, in local standard deviations; by chance once in 10¹⁵ samples.
    limit, length = 8.0, blocks.shape[1]
    uneven = _core.uneven_rows(np.ascontiguousarray(blocks), resolution, limit)
    blocks = blocks[uneven]
    distance = np.abs(blocks - row_medians(blocks)[:, None])
    spread = _usual_spread(blocks, distance, resolution)
    row, at = np.nonzero((distance > limit * spread) & (spread > 0))
    return uneven[row] * length + at, distance[row, at] / spread[row, 0]


def _usual_spread(blocks: Vector, distance: Vector, step: float) -> Vector:
    """Bound the standard deviation of each block without its knocks by the median distance. For coarsely quantized
    values it is accurate to one step, so one step is added, and the result is at least half a step."""
    bound = row_medians(distance)[:, None] / 0.67449 + step
    spread = np.minimum(np.std(blocks, axis=1, keepdims=True), bound)
    return np.asarray(np.maximum(spread, 0.5 * step))


def level_length(samples: int) -> int:
    """Return the number of samples in the blocks whose medians are compared, so that there are about 256."""
    return max(samples // 256, 100)


def steps_of(
    axis: str, levels: Sequence[tuple[int, Vector]], extent: Extent, resolution: float,
    values: Callable[[int, int], Vector],
) -> list[Step]:  # fmt: skip
    """Find lasting jumps of the mean within segments, ordered by time, from medians m_i of about 256 blocks.

    m_{i+2} − m_i contains a jump in block i + 1. It must exceed 8 standard deviations (from the MAD, at least half a
    quantization step) of all such differences, against random walks, and 4 times the changes around it, against
    warm-ups. Three blocks at both ends are excluded. 8680 simulated recordings of seven models had none
    (tests/test_inspection.py)."""
    length = level_length(extent.samples)
    changes = [level[2:] - level[:-2] for _, level in levels]
    everything = np.concatenate([np.empty(0), *changes])
    # Smallest number of differences between block medians from which their usual size is estimated.
    if everything.size < 32:
        return []
    usual = float(np.median(everything))
    spread = max(float(np.median(np.abs(everything - usual))) / 0.67449, 0.5 * resolution)
    steps = []
    for (first, level), change in zip(levels, changes, strict=True):
        neighbours = np.abs(np.diff(level))
        # Changes just before and just after the two blocks. At the ends of a segment a warm-up looks like a jump.
        before, behind = np.append(np.inf, neighbours[:-2]), np.append(neighbours[2:], np.inf)
        size = np.abs(change - usual)
        # The ratio to the changes before and after is 2 for a ramp.
        least = np.maximum(8.0 * spread, 4.0 * np.maximum(before, behind))
        at = np.flatnonzero((size > least) & (spread > 0))
        # Several neighbouring blocks can show the same jump.
        for group in np.split(at, np.flatnonzero(np.diff(at) > 2) + 1) if at.size else []:
            i = int(group[np.argmax(size[group])])
            begin = first + i * length
            part = values(begin, begin + 3 * length)
            place = begin + corner(part, level[i], level[i + 2])
            reach = jump_reach(part, change[i])
            steps.append(
                Step(
                    time=float(extent.times([place])[0]), axis=axis, size=float(change[i]),
                    times=float(size[i] / spread), at_gap=extent.has_short_gap(place, reach), index=place,
                )
            )  # fmt: skip
    return steps


def jump_reach(values: Vector, size: float) -> float:
    """Return the largest error (samples) of the place of a jump of this size within some samples."""
    # That of the most likely place, in units of (σ/size)², exceeds 11 in 5 % of the cases (Yao 1987, Annals of
    # Statistics 15, 1321-1328). Squared differences have the median 0.91 σ².
    return 1 + 32.0 * float(np.median(np.diff(values) ** 2)) / size**2


def corner(values: Vector, before: float, after: float) -> int:
    """Return the first sample after the jump: the split that assigns the most samples to the nearer mean."""
    votes = np.where(np.abs(values - before) < np.abs(values - after), 1, -1)
    return min(int(np.argmax(np.concatenate([[0], np.cumsum(votes)]))), values.size - 1)
