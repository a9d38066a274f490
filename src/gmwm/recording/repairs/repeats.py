"""Recognise values that a logger repeated: a log faster than the sensor, and lost samples that repeat the last one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, row_medians, runs_of

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
    runs = runs_of(same)
    long = runs[runs[:, 1] - runs[:, 0] + 1 >= least]
    if not long.size:
        return np.zeros(same.size, dtype=np.bool_)
    ends = np.zeros(same.size + 1, dtype=np.int8)
    ends[long] = 1, -1
    return np.cumsum(ends[:-1], dtype=np.int8).view(np.bool_)


def rounding_of(values: Vector) -> float:
    """Return the rounding error of interpolated values, by float64 or by the digits of a file."""
    return 1e-9 * max(float(np.max(values) - np.min(values)), 1e-300)


def straight(values: Vector, begins: Indices) -> Mask:
    """Return whether each sample is on the straight line between its two neighbours, and differs from them."""
    line = np.zeros(values.size, dtype=np.bool_)
    if values.size < 3:
        return line
    rounding = rounding_of(values)
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
    reach: int = 1000  # samples on each side of one from which the probability of its value is estimated
    smoothest: float = 1.3  # largest roughness whose equal neighbours are examined; a walk has 1.41, smooth noise 2
    clear: float = 4.0  # smallest excess of equal neighbours that is a finding, in standard errors
    false_share: float = 0.1  # largest expected share of chance among the runs of equal samples that are left out
    written_twice: float = 0.1
    """Relative difference of repeated stamps and samples of rows written twice (tests/test_inspection.py)."""


LIMITS = RepeatLimits()

_PER_WINDOW, _WINDOWS = 30, 10  # expected number of repeats in such a window, and smallest number of windows


@dataclass(frozen=True)
class Chance:
    """Which equal neighbours chance does not explain: runs of L samples, of a value of probability p, with a logarithm
    of (ρp)^(L − 1) up to `limit`, and a `share` h / (h + ρp) of the others; ρ is the `roughness` of each axis."""

    limit: float
    share: float
    roughness: tuple[float, ...]


@dataclass(frozen=True)
class Repeats:
    """How values repeat: "held" by a faster logger, "lost" or "frozen" samples, or rows written twice. `every` counts
    samples per value, `exact` if always the same; `by_chance`: neighbours of a coarse output can be equal."""

    kind: Literal["held", "lost", "frozen", "twice"]
    every: float = 1.0
    exact: bool = False
    by_chance: bool = False
    chance: Chance | None = None


def repeats_of(axes: Sequence[Vector], same: Mask, duplicates: float = 0.0) -> Repeats | None:
    """Return how values repeat on axes of one device, from their `repeats`; None if they do not.
    `duplicates`: share of repeated stamps.

    If nearly all runs of equal samples are multiples of k, the logger repeats values k times. In fine outputs, equal
    neighbours are repeats: regular for a faster logger, random for lost samples."""
    repeated = fraction(same)
    if repeated < LIMITS.least_share or same.size - np.count_nonzero(same) < LIMITS.least_changes:
        return None
    # How often a value returns after one other value: never for a fine output, often for a coarse one.
    starts = np.flatnonzero(~same)
    levels = [values[starts] for values in axes]
    returned = fraction(np.logical_and.reduce([x[2:] == x[:-2] for x in levels]))
    single = np.count_nonzero(~(same[1:] | same[:-1]))  # runs of one sample, without the last run
    if 2 * single > levels[0].size and returned > LIMITS.chance_share * (1 - (levels[0].size - 1) / same.size):
        return None  # the share below is at most that of all runs
    lengths = np.diff(starts)
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
    return bool(row_medians(sizes[None])[0] <= 1.5 * np.quantile(sizes[sizes > 0], 0.01))


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


def held_by_chance(axes: Sequence[Vector], same: Mask) -> Repeats | None:
    """Return how values of axes that can be equal by chance are held together; None if chance explains `same`.

    Three samples of white noise are exchangeable, so a, a, b is as frequent as a, b, a. Correlation makes neighbours
    equal ρ times as often, and three different samples monotone more often than 1 in 3, which determines ρ."""
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, same.size))
    if same.size - starts.size < LIMITS.least_share * same.size or starts.size < 10 * LIMITS.least_changes:
        return None
    if any(_is_counter(values) for values in axes):
        return None
    roughness = tuple(_roughness(values) for values in axes)
    factor = max(math.prod(roughness), 1.0)
    if max(roughness) > LIMITS.smoothest:
        return None
    pairs = np.count_nonzero(same[1:-1] != same[2:]) / 2
    returns = np.count_nonzero(np.logical_and.reduce([values[2:] == values[:-2] for values in axes]) & ~same[2:])
    error = math.sqrt(pairs / 2 + factor**4 * returns + 1)
    is_clear = pairs - factor**2 * returns > LIMITS.clear * error
    if not is_clear and not _has_long_runs(lengths, factor * returns / starts.size):
        return None
    chance = _by_chance(axes, starts, roughness)
    logs = (lengths - 1) * np.log(chance)
    # In noise whose spread varies, a value stays with at most the root of its probability.
    sure = logs / 2 <= _limit_of(logs / 2)
    if not is_clear and np.sum(lengths[sure] - 1) < LIMITS.least_share * same.size:
        return None
    limit = _limit_of(logs)
    long, other = logs <= limit, logs > limit
    share = np.sum((lengths - 1 - chance * lengths)[other]) / max(np.sum(lengths[other]), 1)
    if not is_clear or share < max((factor - 1) * np.average(chance, weights=lengths), LIMITS.least_share):
        share = 0.0
    is_frozen = np.sum(lengths[long & (lengths > 3)]) > share * same.size
    return Repeats("frozen" if is_frozen else "lost", chance=Chance(limit, float(share), roughness))


def _is_counter(values: Vector) -> bool:
    """Return whether a rounding error is carried over to the next value: then it stays at a count for a long time, and
    successive differences have a correlation down to −2/3, which is −1/2 for white noise and higher for held values."""
    steps = np.diff(values)
    return bool(steps[1:] @ steps[:-1] < -0.55 * (steps @ steps))


def _roughness(values: Vector) -> float:
    """Return how much more often neighbours are equal than samples two apart; infinity if too few samples differ."""
    steps = np.diff(values)
    turns = steps[1:] * steps[:-1]
    different = (turns != 0) & (values[2:] != values[:-2])
    count = np.count_nonzero(different)
    if count < max(10 * LIMITS.least_changes, 0.01 * values.size):
        return math.inf
    # The correlation of neighbouring differences is ρ²/2 − 1, and they have one sign with probability 1/2 + asin(·)/π.
    same_sign = np.count_nonzero(different & (turns > 0)) / count
    return max(math.sqrt(2 + 2 * math.sin(math.pi * (same_sign - 0.5))), 1.0)


def _has_long_runs(lengths: Indices, share: float) -> bool:
    """Return whether more samples are late in runs of equal ones than if this share of Gaussian values returns."""
    counts = np.bincount(lengths)
    length = np.arange(counts.size)
    samples = counts @ length
    late = [counts @ np.maximum(length - m, 0) / samples - (1.8 * share) ** m for m in (3, 7, 15, 31)]
    return bool(max(late) > LIMITS.least_share / 2)


def _by_chance(axes: Sequence[Vector], starts: Indices, roughness: tuple[float, ...]) -> Vector:
    """Return the probability that the sample after each of `starts` is equal on all axes by chance: how often the value
    returns after another one nearby, and for rare values its frequency."""
    chance, size = np.ones(starts.size), axes[0].size
    start = np.isin(np.arange(size), starts)
    place = np.cumsum(start) - 1  # among `starts`
    for values, rough in zip(axes, roughness, strict=False):  # a plan can be for some of the axes
        # Samples of one value follow each other in this number, and those of different values are far apart.
        number = np.unique(values, return_inverse=True)[1] * (size + 2 * LIMITS.reach) + np.arange(size)
        number.sort()
        sample = number % (size + 2 * LIMITS.reach)
        end = np.append(values[1:] != values[:-1], False)
        returns = end & np.append(values[2:] == values[:-2], (False, False))
        chosen, counts = start[sample], np.empty((2, starts.size))
        counts[:, place[sample[chosen]]] = [_near(number[e[sample]], number[chosen]) for e in (end, returns)]
        (visits, returned), ends = counts, np.concatenate([[0], np.cumsum(end)])
        around = ends[np.minimum(starts + LIMITS.reach + 1, size)] - ends[np.maximum(starts - LIMITS.reach, 0)]
        frequency = np.maximum(visits - 1, 0) / np.maximum(around, 1)
        # A rare value returns too seldom: its frequency counts as 20 visits.
        chance *= np.minimum(rough * (returned + 20 * frequency) / (visits + 20), 0.99)
    return np.maximum(chance, 1e-12)


def _near(events: Indices, places: Indices) -> Indices:
    """Return the number of events, in order, within `LIMITS.reach` of each place."""
    reach = LIMITS.reach
    return np.asarray(np.searchsorted(events, places + reach, "right") - np.searchsorted(events, places - reach))


def _limit_of(logs: Vector) -> float:
    """Return the largest logarithm of a probability among which at most `false_share` are chance (Benjamini and
    Hochberg 1995, JRSS B 57)."""
    ordered = np.sort(logs)
    chosen = np.flatnonzero(np.exp(ordered) * logs.size <= LIMITS.false_share * np.arange(1, logs.size + 1))
    return float(ordered[chosen[-1]]) if chosen.size and ordered[chosen[-1]] < 0 else -math.inf


def beyond_chance(axes: Sequence[Vector], same: Mask, chance: Chance, first: int) -> Mask:
    """Return the samples of `same`, numbered from `first`, that are held, not equal to the one before by chance."""
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, same.size))
    equal = _by_chance(axes, starts, chance.roughness)
    held = np.where((lengths - 1) * np.log(equal) <= chance.limit, 1.0, chance.share / (chance.share + equal))
    # Multiples of the golden ratio choose a share of any samples in the same way in each portion.
    return np.asarray(same & ((first + np.arange(same.size)) * 0.618033988749895 % 1 < np.repeat(held, lengths)))
