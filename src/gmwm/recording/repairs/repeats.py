"""Recognise values that a logger repeated: a log faster than the sensor, and lost samples that repeat the last one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, runs_of

Mask = NDArray[np.bool_]
Indices = NDArray[np.int64]


def repeats(axes: list[Vector], begins: Indices) -> Mask:
    """Return whether samples equal the one before on all axes in the segment; `begins` are first samples."""
    same = np.zeros(axes[0].size, dtype=np.bool_)
    same[1:] = axes[0][1:] == axes[0][:-1]
    for values in axes[1:]:
        same[1:] &= values[1:] == values[:-1]
    same[begins] = False
    return same


def fraction(flags: Mask) -> float:
    """Return the fraction of flags that are true, far faster than by their mean."""
    return np.count_nonzero(flags) / flags.size


def offsets(same: Mask) -> Indices:
    """Return the position of each sample in its run of equal samples, from 0."""
    at = np.arange(same.size)
    return np.asarray(at - np.maximum.accumulate(np.where(same, 0, at)))


def in_long_runs(same: Mask, least: int) -> Mask:
    """Return the samples that continue a run of at least `least`, without its first one."""
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
    # Interpolated values are rounded to float64, or to the digits of a file.
    rounding = 1e-9 * max(float(np.max(values) - np.min(values)), 1e-300)
    length = 1 << 15  # the samples and their differences then fit in the cache of a processor
    for first in range(0, values.size - 2, length):
        steps = np.diff(values[first : first + length + 2])
        at = slice(first + 1, first + steps.size)
        line[at] = (np.abs(np.diff(steps)) <= rounding) & (np.abs(steps[1:]) > rounding)
    line[begins] = False
    line[np.maximum(begins - 1, 0)] = False
    return line


@dataclass(frozen=True)
class RepeatLimits:
    """Limits at which values are repeated by the logger (tests/recording/test_repairs.py)."""

    least_share: float = 1e-3
    """Smallest share of repeated samples that matters. A share s changes N by s/2 (tests/recording/test_repairs.py)."""
    least_changes: int = 100  # smallest number of changes of the output from which repetition is recognised
    multiple_share: float = 0.98
    """Smallest share of runs of a multiple of k, for values repeated k times; by chance at most 1/2."""
    most_repeats: int = 100  # largest number of repetitions that is recognised
    chance_share: float = 0.1
    """Largest share of the repeated samples that chance may explain, for a sample to be recognised as repeated."""
    longest_run: int = 4
    """Longest run, in median runs, that belongs to the pattern of the logger. In a longer one, the output froze."""
    pattern_share: float = 0.02
    """Smallest share of repeats called a pattern; fewer ones are lost samples, with the same numbers."""
    regular_ratio: float = 0.3
    """Variance of repeats in windows over that of random ones, 1 ± 0.3, up to which a log is regular."""
    short_chance: float = 1e-3
    """Largest probability that random repeats look regular, for a short log with a regular pattern."""
    written_twice: float = 0.1
    """Relative difference of repeated stamps and samples of rows written twice (tests/test_inspection.py)."""


LIMITS = RepeatLimits()

_PER_WINDOW, _WINDOWS = 30, 10  # expected number of repeats in such a window, and smallest number of windows


@dataclass(frozen=True)
class Repeats:
    """How values repeat: "held" by a faster logger, "lost" samples, or rows written twice. `every` counts samples per
    value, `exact` if always the same; `by_chance`: neighbours of a coarse output can be equal."""

    kind: Literal["held", "lost", "twice"]
    every: float = 1.0
    exact: bool = False
    by_chance: bool = False


def repeats_of(axes: Sequence[Vector], same: Mask, duplicates: float = 0.0) -> Repeats | None:
    """Return how values repeat on axes of one device, from their `repeats`; None if they do not.
    `duplicates`: share of repeated stamps.

    If nearly all runs of equal samples are multiples of k, the logger repeats values k times. In fine outputs, equal
    neighbours are repeats: regular for a faster logger, random for lost samples."""
    repeated = fraction(same)
    if repeated < LIMITS.least_share or same.size - np.count_nonzero(same) < LIMITS.least_changes:
        return None
    # How often a value returns after one other value: never for a fine output, often for a coarse one.
    levels = [values[~same] for values in axes]
    returned = fraction(np.logical_and.reduce([x[2:] == x[:-2] for x in levels]))
    single = np.count_nonzero(~(same[1:] | same[:-1]))  # runs of one sample, without the last run
    if 2 * single > levels[0].size and returned > LIMITS.chance_share * (1 - (levels[0].size - 1) / same.size):
        return None  # the share below is at most that of all runs
    lengths = np.diff(np.flatnonzero(~same))
    # Without the samples at which the output froze.
    lengths = lengths[lengths <= LIMITS.longest_run * np.median(lengths)]
    every = float(np.mean(lengths))
    share = 1 - 1 / every
    by_chance = returned > LIMITS.chance_share * share or all(map(is_slow, levels))
    k = _common_multiple(lengths)
    if k > 1:
        return Repeats("held", float(k), exact=True, by_chance=by_chance)
    if by_chance or share < LIMITS.least_share:
        return None
    if abs(duplicates - repeated) < LIMITS.written_twice * duplicates:
        return Repeats("twice", 1 / (1 - repeated))
    return Repeats("held", every) if _is_regular(same, share, lengths) else Repeats("lost")


def is_slow(levels: Vector) -> bool:
    """Return whether most changes of the output are of one step, so that a slow signal stays at one value."""
    sizes = np.abs(np.diff(levels))
    return bool(np.median(sizes) <= 1.5 * np.quantile(sizes[sizes > 0], 0.01))


def _common_multiple(lengths: Indices) -> int:
    """Return the largest k of which almost all lengths of runs are multiples; 1 if there is none."""
    for k in range(min(int(np.median(lengths)), LIMITS.most_repeats), 1, -1):
        if np.mean(lengths % k == 0) >= LIMITS.multiple_share:
            return k
    return 1


def _is_regular(same: Mask, share: float, lengths: Indices) -> bool:
    """Return whether repeats vary less than random ones; in short recordings, no run may exceed a regular one."""
    window = round(_PER_WINDOW / share)
    count = same.size // window
    if share < LIMITS.pattern_share:
        return False
    if count < _WINDOWS:
        longest = int(np.ceil(np.mean(lengths)))
        return bool(lengths.max() <= longest and (1 - share**longest) ** lengths.size < LIMITS.short_chance)
    counts = np.sum(same[: count * window].reshape(count, window), axis=1)
    # The median ignores windows in which the output froze.
    spread = 1.4826 * float(np.median(np.abs(counts - np.median(counts))))
    return spread**2 < LIMITS.regular_ratio * window * share * (1 - share)
