"""Find lasting jumps of the mean that are too large for the noise, at all block lengths together."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.remarks import Remark
from gmwm.measuring.inspection.findings import in_datasheet_units, places_of, settling_times
from gmwm.measuring.inspection.knocks import Step, corner, jump_reach, level_length
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.measuring.inspection.trends import EXTRA, FEWEST, BlockMeans, longest_means
from gmwm.measuring.inspection.wander import FIRST, CoursePairs, Likelihood, decay, transformed

if TYPE_CHECKING:
    from gmwm.measuring.inspection.result import Inspection


class _JumpLimits(NamedTuple):
    """Smallest reduction of −2 log L by the clearest jump and by each further one, smallest ratio of K with the jumps,
    as if they were noise, to the upper 95 % limit of K without them, and smallest reduction by each further jump if
    several are found together. The last is that of a place among 256 blocks, 11, and of a size, with a margin."""

    gain: float
    more: float
    matters: float
    together: float


_CLEAR = _JumpLimits(21.0, 21.0, 1.35, 16.0)
"""Limits of subtracted jumps: white noise, walks, flicker noise and Gauss-Markov processes exceed the gain in < 1 of
200 recordings; seven accelerometer axes at rest have ratios of 0.8 to 1.25 (validation/study_faults.py)."""
_POSSIBLE = _JumpLimits(16.0, 11.0, 1.2, 13.0)
"""Limits of jumps that may be part of a random walk, so that K is a bound (tests/test_inspection_faults.py)."""
_SHORT_BOXES = _CLEAR._replace(matters=0.0)
"""Limits of short boxes, such as a disturbance of a few seconds, which raise N more than K."""
_SHORT = 4  # longest box (blocks) whose ends are placed together
MOST = 10  # largest number of jumps of an axis. More of them are noise, such as two levels


class _Jump(NamedTuple):
    """A jump: place (blocks), size, reduction of −2 log L, whether it may be part of a random walk, and the place at
    which a settling of the mean is over that it is a part of."""

    place: float
    size: float
    gain: float
    possible: bool
    until: float | None = None


def jumps_of(
    axis: str, means: Sequence[tuple[int, Vector]], extent: Extent, values: Callable[[int, int], Vector]
) -> list[Step]:
    """Find the jumps of an axis, ordered by time, from segments of about 256 block means.

    As in `trend_of`, noise alone is compared with noise and a jump at any place, at all time scales. The clearest jump
    is subtracted, and the search is repeated. Changes that a trend or a sinusoid describes better are no jumps. Jumps
    that fit the walk are noise; less clear ones that raise K are `possible`. What an exponential describes settles."""
    length = level_length(extent.samples)
    samples, y = longest_means(means, extent, length)
    if y.size < FEWEST or not np.any(np.diff(y)):
        return []
    steps = []
    seams = np.array([first for first, _ in extent.unbroken])
    jumps = sorted(_jumps_in(BlockMeans(y)))
    # A short box has no level between its ends: both are placed together.
    boxes = [
        [a, b] for a, b in pairwise(jumps) if b.place - a.place <= _SHORT and abs(a.size + b.size) < abs(a.size) / 2
    ]
    in_boxes = [jump for box in boxes for jump in box]
    for group in [*boxes, *([jump] for jump in jumps if jump not in in_boxes)]:
        begin, end = int(group[0].place), int(group[-1].place)
        first, last = int(samples[max(begin - 2, 0)]), int(samples[min(end + 1, y.size - 1)]) + length
        if np.any((seams > first) & (seams < last)):
            continue  # coefficients do not extend across a long gap
        part, sizes = values(first, last), [jump.size for jump in group]
        if len(group) == 2:
            *places, size = _box(part)
            sizes = [size, -size]
        else:
            before, after = float(np.mean(y[max(begin - 3, 0) : begin])), float(np.mean(y[begin + 1 : begin + 4]))
            places = [corner(part, before, after)]
        for jump, index, size in zip(group, places, sizes, strict=True):
            place = first + index
            at_gap = (jump.until is None or not jump.possible) and extent.has_short_gap(place, jump_reach(part, size))
            time = float(extent.times([place])[0])
            until = None if jump.until is None else time + (jump.until - jump.place) * length / extent.rate
            steps.append(
                Step(
                    time=time, axis=axis, size=size, times=float(np.sqrt(jump.gain)),
                    at_gap=at_gap, index=place, possible=jump.possible,
                    until=None if until is None else min(until, extent.end),
                )
            )  # fmt: skip
    return sorted(steps, key=lambda step: step.index)


def _box(values: Vector) -> tuple[int, int, float]:
    """Return the first sample in the box that describes values best, the first one after it, and its size."""
    size, sums = values.size, np.concatenate([[0.0], np.cumsum(values - np.mean(values))])
    step = max(size // 256, 1)
    begins = ends = np.arange(0, size + 1, step)
    for _ in range(2):
        width = ends - begins[:, None]
        # The reduction of the sum of squares by a box of this width.
        usable = (width > 0) & (width < size)
        gains = np.where(
            usable, (sums[ends] - sums[begins][:, None]) ** 2 / np.where(usable, width * (size - width), 1), 0.0
        )
        row, column = np.unravel_index(np.argmax(gains), gains.shape)
        begin, end = int(begins[row]), int(ends[column])
        begins, ends = (np.arange(max(place - step, 0), min(place + step, size) + 1) for place in (begin, end))
    return begin, end, float((sums[end] - sums[begin]) * size / ((end - begin) * (size - end + begin)))


def with_shared_settling(steps: Sequence[Step], reach: float) -> list[Step]:
    """Return jumps, within a settling of another axis as a part of it. `reach` (s) is the error of their places."""
    settlings = [(step.time - reach, step.until) for step in steps if step.until is not None]
    return [
        replace(step, until=max((end for begin, end in settlings if begin <= step.time <= end), default=None))
        for step in steps
    ]


def with_recurring(steps: Sequence[Step], length: int) -> list[Step]:
    """Return jumps of an axis. More than two changes recur: they are noise, which a filter meets in use too. A jump and
    the jump back are one change, or a disturbance if they are at most four blocks of `length` samples apart."""
    jumps = sorted((step for step in steps if step.is_certain), key=lambda step: step.index)
    ends = [(a, b) for a, b in pairwise(jumps) if abs(a.size + b.size) < abs(a.size) / 2]
    brief = [step for a, b in ends if b.index - a.index <= _SHORT * length for step in (a, b)]
    changes, before = 0, 0.0
    for jump in (lasting := [step for step in jumps if step not in brief]):
        is_back = abs(before + jump.size) < abs(before) / 2
        changes, before = (changes, 0.0) if is_back else (changes + 1, jump.size)
    noise = jumps if len(jumps) >= MOST else lasting if changes > 2 else []
    return [replace(step, recurs=step in noise) for step in steps]


def jumps_to_subtract(inspection: Inspection) -> tuple[dict[str, list[tuple[int, float]]], list[Remark]]:
    """Return the first sample after each jump of an axis that can be subtracted, and its size, and the remarks."""
    jumps, remarks = dict[str, list[tuple[int, float]]](), list[Remark]()
    for axis, item in inspection.axes.items():
        steps = [step for step in inspection.steps if step.axis == axis]
        if certain := [step for step in steps if step.is_certain]:
            jumps[axis] = [(step.index, step.size) for step in certain]
        if any(step.until is not None for step in steps):
            remarks.append(Remark.of("level-steps", axis, case="settles", **settling_times(inspection.steps)))
        if certain := [step for step in certain if step.until is None]:
            size = in_datasheet_units(max(abs(step.size) for step in certain), 0.0, item.unit)
            remarks.append(Remark.of("fault-undone", axis, case="jumps", size=size, **places_of(certain)))
    return jumps, remarks


def _jumps_in(means: BlockMeans) -> list[_Jump]:
    """Return the jumps in block means."""
    jumps = _one_by_one(means) if means.jump[0] >= _CLEAR.gain else []
    boxes = _boxes_in(means)
    if jumps and boxes:
        places = [jump.place for jump in jumps]
        value = means.with_all(transformed(_courses(places, means.size)))
        gain = float(np.min(means.without().values)) - value - _CLEAR.together * len(places)
        jumps = jumps if gain >= max(gain - _CLEAR.together * len(ends) for ends, gain in boxes) else []
    groups = [] if jumps else [*_together(means), *boxes]
    for limits in (_CLEAR, _POSSIBLE):
        excesses = [gain - limits.gain - limits.together * (len(places) - 1) for places, gain in groups]
        if jumps or max(excesses, default=0.0) <= 0:
            continue
        best = int(np.argmax(excesses))
        gain, places = max(excesses), groups[best][0]
        is_box = best >= len(groups) - len(boxes)
        if limits is _CLEAR and is_box and all(b - a <= _SHORT for a, b in zip(places[::2], places[1::2], strict=True)):
            limits = _SHORT_BOXES
        # A possible jump is compared with a trend as a single one is.
        margin = limits.gain if limits is _POSSIBLE else 0.0
        if means.swing.gain < gain + margin and means.trend.statistic < gain + margin:
            jumps = _one_by_one(means, places, gain / len(places), limits=limits)
    jumps = _with_settling(means, sorted(jumps))
    # Several possible jumps can look like a settling.
    if any(jump.possible or jump.until is not None for jump in jumps):
        return jumps
    if not jumps and means.jump[0] >= _POSSIBLE.gain:
        jumps = _one_by_one(means, limits=_POSSIBLE)
    return _settlings_in(means, jumps) or jumps


def _settlings_in(means: BlockMeans, jumps: Sequence[_Jump]) -> list[_Jump]:
    """Return the settlings, such as a creep or a second warm-up, as possible jumps if they raise K and describe the
    means better than jumps or a sinusoid, beside a trend. They begin with a jump or without one."""
    edges = np.arange(means.size + 1, dtype=np.float64)
    clearest, gain = means.jump[0], means.settling[0]
    if gain < _CLEAR.gain + EXTRA:
        return []
    rival = means.swing.gain
    if jumps:
        courses = transformed(_courses([jump.place for jump in jumps], means.size))
        together = float(np.min(means.without().values)) - means.with_all(courses)
        rival = max(rival, together - _CLEAR.together * (len(jumps) - 1))
    # The 99 % quantile of χ² with one degree of freedom, for the time constant.
    if gain < rival + 6.6:
        return []
    if means.trend.kind is not None and gain < means.trend.statistic + 6.6:
        means = BlockMeans(means.means - means.trend.course())
    settlings, courses, residual = list[_Jump](), np.empty((0, means.size)), means
    while len(settlings) < MOST:
        gain, place, tau, weights = residual.settling
        if gain < _CLEAR.gain + EXTRA or any(abs(place - other.place) < 1 for other in settlings):
            break
        # Other shapes, such as a logarithm, are close to two exponentials.
        decays = [decay(edges - place, tau * k) for k in (1, 4)]
        courses = np.vstack([courses, _courses([place], means.size), *decays])
        sizes = _sizes(means, courses, np.sqrt(weights))
        until = None if gain < clearest else min(place + 4 * tau, float(means.size))
        settlings.append(_Jump(place, float(np.sum(sizes[-3:])), gain, possible=True, until=until))
        residual = BlockMeans(means.means - sizes @ courses)
    _, sizes, basis = np.linalg.svd(transformed(courses), full_matrices=False)
    independent = basis[sizes > 1e-6 * np.max(sizes, initial=0.0)]
    without_courses, with_courses = (means.walk(of, alone=True)[0] for of in (independent, basis[:0]))
    # Otherwise K without them is within the interval of K, half of whose width is seldom below 10 %.
    return settlings if without_courses < 0.9**2 * with_courses else []


def _with_settling(means: BlockMeans, jumps: list[_Jump]) -> list[_Jump]:
    """Return jumps, in order, with the end of each settling: a jump and an exponential decay describe the means better
    than the jump alone, or than the jumps that follow closely (tests/test_inspection_faults.py)."""
    if not 0 < len(jumps) < MOST or any(jump.possible for jump in jumps):
        return jumps
    edges = np.arange(means.size + 1)
    places = [jump.place for jump in jumps]
    # A settling looks like jumps at most 8 blocks apart.
    chains = np.split(np.arange(len(jumps)), np.flatnonzero(np.diff(places) > 8) + 1)
    shifts, taus = (each.ravel() for each in np.meshgrid(np.arange(-3, 3) / 4, [0.25, 2.0, 4.0, 8.0, 16.0, 32.0]))
    base = means.with_all(transformed(_courses(places, means.size)))
    for chain in chains:
        fits = list[tuple[float, float]]()
        for first, last in ((a, b) for a in chain for b in {a, chain[-1]}):
            starts = places[first] + shifts
            settling = transformed(decay(edges - starts[:, None], taus[:, None]))
            pairs = CoursePairs.of(means.grid.weights, transformed(_courses(starts, means.size)), settling)
            others = transformed(_courses(places[:first] + places[last + 1 :], means.size))
            values = np.min(means.with_pairs(pairs, others).values, axis=0)
            # A decay counts as much as a jump. One of a quarter of a block is an error of the place of a jump.
            values += _CLEAR.together * (first - last + (taus > 1))
            fits += zip(values.tolist(), np.where(taus > 1, starts + 4 * taus, 0.0).tolist(), strict=True)
        value, until = min(fits)
        if value < base and until:
            until = min(max(until, places[chain[-1]] + 1), means.size)
            for k in chain:
                jumps[k] = jumps[k]._replace(until=until)
    return jumps


def _one_by_one(
    means: BlockMeans, places: Sequence[float] = (), gain_of_each: float = 0.0, *, limits: _JumpLimits = _CLEAR
) -> list[_Jump]:
    """Return jumps at these places and at further ones, each clear by itself."""
    residual, sizes = means, np.empty(0)
    places, gains = list(places), [gain_of_each] * len(places)
    if places:
        courses = _courses(places, means.size)
        sizes = _sizes(means, courses, np.sqrt(means.grid.weights[0]))
        residual = BlockMeans(means.means - sizes @ courses)
    while len(places) < MOST:
        gain, place, _, weights = residual.jump
        least = limits.more if places else limits.gain
        if gain < least or residual.swing.gain >= gain or residual.trend.statistic >= gain:
            break
        root = np.sqrt(weights)
        place = _within_block(residual, place, root)
        if any(abs(place - other) < 1 for other in places):
            break  # what is left of a jump in means without noise
        places.append(place)
        gains.append(gain)
        courses = _courses(places, means.size)
        sizes = _sizes(means, courses, root)
        residual = BlockMeans(means.means - sizes @ courses)
    if not places or _raising(means, _courses(places, means.size)) <= limits.matters:
        return []
    possible = limits is _POSSIBLE
    return [_Jump(place, float(size), gain, possible) for place, size, gain in zip(places, sizes, gains, strict=True)]


def _together(means: BlockMeans) -> list[tuple[list[float], float]]:
    """Return the places of one, two, … jumps, the best ones in white noise, and the reduction of −2 log L by them."""
    edges = np.arange(means.size + 1)
    without = float(np.min(means.without().values))
    sums = np.concatenate([[0.0], np.cumsum(means.means - np.mean(means.means))])
    length = edges - edges[:, None]
    # The sum of squares that the level of each part takes away, which the best division maximises (Auger and Lawrence
    # 1989, Bull. Math. Biol. 51, 39-54).
    taken = np.where(length > 0, (sums - sums[:, None]) ** 2 / np.maximum(length, 1), -np.inf)
    taken[0, :FIRST] = taken[1 - FIRST + means.size :, -1] = -np.inf
    best, before, groups = taken[0], list[Integers](), list[tuple[list[float], float]]()
    while len(groups) < MOST - 1:
        totals = best[:, None] + taken
        before.append(np.argmax(totals, axis=0))
        best = np.max(totals, axis=0)
        places = [means.size]
        for of_end in reversed(before):
            places.insert(0, int(of_end[places[0]]))
        courses = transformed(_courses(places[:-1], means.size))
        groups.append((list(map(float, places[:-1])), without - means.with_all(courses, alone=True)))
    return groups


def _boxes_in(means: BlockMeans) -> list[tuple[list[float], float]]:
    """Return the places of the ends of one, two, … boxes, and the reduction of −2 log L by all of them."""
    places, residual = list[float](), means
    while len(places) < MOST - 1:
        gain, ends, weights = residual.best_box()
        if gain < _POSSIBLE.gain + _POSSIBLE.together or any(abs(a - b) < 1 for a in places for b in ends):
            break
        places += ends
        courses = _courses(places, means.size)
        residual = BlockMeans(means.means - _sizes(means, courses, np.sqrt(weights)) @ courses)
    if not places:
        return []
    gains = float(np.min(means.without().values)) - means.with_first(transformed(_courses(places, means.size)))
    return [(places[: k + 1], float(gains[k])) for k in range(1, len(places), 2)]


def _courses(places: Sequence[float] | Vector, size: int) -> Matrix:
    """Return a jump of 1 at each place, as block means (C, n)."""
    return np.asarray(np.clip(np.arange(1.0, size + 1) - np.array(places)[:, None], 0.0, 1.0))


def _sizes(likelihood: Likelihood, courses: Matrix, root: Vector) -> Vector:
    """Return the sizes of jumps together, with the square roots of the weights of the noise."""
    weighted = (transformed(courses) * root).T
    return np.asarray(np.linalg.lstsq(weighted, likelihood.z * root, rcond=None)[0], dtype=np.float64)


def _within_block(likelihood: Likelihood, place: float, root: Vector) -> float:
    """Return the place within its block of a large jump: a jump before and one after it, in proportion."""
    at, fits = np.arange(root.size + 1), []
    for block in (math.ceil(place) - 1, math.floor(place)):
        edges = np.clip(at + 1 - np.array([[block], [block + 1]]), 0.0, 1.0)
        courses = (transformed(edges) * root).T
        sizes = np.linalg.lstsq(courses, likelihood.z * root, rcond=None)[0]
        share = float(np.clip(sizes[1] / np.sum(sizes), 0.0, 1.0)) if np.sum(sizes) else 0.5
        residual = float(np.sum((courses @ sizes - likelihood.z * root) ** 2))
        fits.append((residual, block + share))
    return min(fits)[1]


def _raising(means: Likelihood, courses: Matrix) -> float:
    """Return the ratio of K with jumps to the upper limit of K that the noise between them shows."""
    courses = transformed(courses)
    (with_jumps, _), (_, limit) = (means.walk(of, alone=True) for of in (courses[:0], courses))
    return math.sqrt(with_jumps / limit) if limit > 0 else math.inf
