"""Decide from the first batch of a recording what is repaired."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.threads import in_threads
from gmwm.base.units import by_sensor
from gmwm.recording.batches import Batch
from gmwm.recording.repairs.patterns import TwoLevels, modulus_of, slower_rate, two_levels_of, unwrapped
from gmwm.recording.repairs.repeats import (
    LIMITS,
    Indices,
    Mask,
    Repeats,
    beyond_chance,
    fraction,
    held_by_chance,
    in_long_runs,
    is_slow,
    offsets,
    repeats,
    repeats_of,
    rounding_of,
    straight,
)
from gmwm.recording.resolution import count_of, step_of

_BY_AXIS = ("frozen", "straight", "wraps", "counts", "levels", "resampled")
_FROZEN, _FROZEN_TIMES = 32, 6
"""Smallest number of equal samples in a row at which the output froze: also as a multiple of the length that one run of
a thousand exceeds (tests/recording/test_repairs.py)."""
_COARSE = 0.4
"""Share of values that return after another; above, a coarse output stays at a value, so it is not tested."""
_MOST_FROZEN = 0.1
"""Largest share of samples in standstills of a 64th of the recording that are treated as gaps."""
_MOST_DEAD = 0.5  # largest share of the recording that is left out at its beginning
_UNLIKELY = 1e-3  # largest expected number of straight runs by chance
_OF_STEP, _ON_GRID = 1 << 15, 0.01
"""Samples for the quantization step, and distance of slopes from whole steps of a slow rounded signal's runs."""
_MOST_STRAIGHT = 0.3  # largest share of interpolated samples that are treated as gaps. Above it, the log was resampled


@dataclass(frozen=True, kw_only=True)
class RepairPlan:
    """What is repaired on axes with one clock."""

    axes: tuple[str, ...]
    repeats: Repeats | None = None  # how their values repeat
    # Smallest length of a run of equal samples, and of samples on a straight line, that are treated as a gap
    frozen: Mapping[str, int] = field(default_factory=dict)
    straight: Mapping[str, int] = field(default_factory=dict)
    dead: int = 0  # number of samples at the beginning that are left out
    # Range of the word that overflowed, and median of the values
    wraps: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # Size of a count, for axes whose values are whole counts but for float64 rounding
    counts: Mapping[str, float] = field(default_factory=dict)
    # Levels between which the mean of an axis switches. They are named, and nothing is changed
    levels: Mapping[str, TwoLevels] = field(default_factory=dict)
    # Relative rate of the log from which an axis was resampled by straight lines; named, and nothing is changed
    resampled: Mapping[str, float] = field(default_factory=dict)

    @property
    def changes_nothing(self) -> bool:
        """Whether no sample is changed or left out, and nothing is named."""
        return not (self.repeats or self.dead or any(getattr(self, name) for name in _BY_AXIS))

    @property
    def every(self) -> float:
        """Number of samples of the log for each value of the sensor."""
        return 1.0 if self.repeats is None else self.repeats.every

    @property
    def reach(self) -> int:
        """Number of samples around a sample that decide whether it is left out."""
        runs = [*self.frozen.values(), *self.straight.values(), round(64 * self.every)]
        return 2 + max(runs) + (2 * LIMITS.reach if self.repeats is not None and self.repeats.chance else 0)

    def left_out(self, values: Mapping[str, Vector], begins: Indices, first: int = 0) -> dict[str, Mask]:
        """Return masks of the samples, numbered from `first`, that repeat, are frozen, or are interpolated."""
        masks = dict[str, Mask]()
        if self.repeats is not None and self.repeats.chance is not None:
            chance, count = self.repeats.chance, len(self.repeats.chance.roughness)
            # Sensors, or single axes, that hold values alike have one plan.
            groups = [[values[axis] for axis in self.axes[k : k + count]] for k in range(0, len(self.axes), count)]
            name = "frozen" if self.repeats.kind == "frozen" else "repeated"
            masks[name] = np.any([beyond_chance(x, repeats(x, begins), chance, first) for x in groups], axis=0)
        elif self.repeats is not None:
            same = repeats([values[axis] for axis in self.axes], begins)
            exact = self.repeats.exact and self.repeats.by_chance
            masks["repeated"] = offsets(same) % round(self.every) != 0 if exact else same
        if self.frozen:
            masks["frozen"] = np.any(
                [in_long_runs(repeats([values[axis]], begins), least) for axis, least in self.frozen.items()], axis=0
            )
        if self.straight:
            masks["interpolated"] = np.any(
                [_in_straight_runs(values[axis], begins, least) for axis, least in self.straight.items()], axis=0
            )
        return masks

    def whole_counts(self, axis: str, values: Vector) -> Vector:
        """Return the values of an axis without float64 rounding of its counts."""
        return np.asarray(np.rint(values / self.counts[axis]) * self.counts[axis]) if axis in self.counts else values

    def of(self, axes: Sequence[str]) -> RepairPlan:
        """Return the plan for some of the axes."""
        mappings: Any = {
            name: {axis: value for axis, value in getattr(self, name).items() if axis in axes} for name in _BY_AXIS
        }
        return replace(self, axes=tuple(axes), **mappings)

    def beside(self, other: RepairPlan) -> RepairPlan:
        """Return the plan for the axes of this and of another plan."""
        mappings: Any = {name: {**getattr(self, name), **getattr(other, name)} for name in _BY_AXIS}
        return replace(self, axes=(*self.axes, *other.axes), **mappings)

    def unwrapped(self, axis: str, values: Vector) -> Vector:
        """Return the values of an axis with overflows undone."""
        return unwrapped(values, *self.wraps[axis]) if axis in self.wraps else values


def plans_of(batch: Batch, duplicates: float) -> list[RepairPlan]:
    """Return plans for axes of one clock, so that faults leave the others; `duplicates`: share of equal stamps."""
    signals = batch.signals
    begins = np.array([first for first, _ in next(iter(signals.values())).segments])
    same = in_threads(lambda _, signal: repeats([signal.values], begins), signals)
    groups: dict[Repeats | None, list[str]] = {}
    lost = dict[str, Mask]()  # samples of a sensor, or of one axis, that repeat the last one
    of_sensors = in_threads(
        lambda _, axes: _patterns(axes, duplicates),
        by_sensor({axis: (signal.values, same[axis]) for axis, signal in signals.items()}),
    )
    for patterns in of_sensors.values():
        for axis, (pattern, repeated) in patterns.items():
            groups.setdefault(pattern, []).append(axis)
            if pattern is not None and pattern.kind in ("lost", "frozen"):
                lost[axis] = repeated
    plans = in_threads(
        lambda axis, pattern: _plan(axis, pattern, signals[axis].values, same[axis], begins=begins),
        {axis: pattern for pattern, axes in groups.items() for axis in axes},
    )
    return _joined(plans, lost, batch, begins)


def _patterns(axes: Mapping[str, tuple[Vector, Mask]], duplicates: float) -> dict[str, tuple[Repeats | None, Mask]]:
    """Return how and where values of each axis of a sensor repeat: on all axes together, or else on each axis alone."""
    same = np.logical_and.reduce([alone for _, alone in axes.values()])
    pattern = repeats_of([values for values, _ in axes.values()], same, duplicates)
    # How much more often axes repeat together than independent ones would: up to 2 by chance.
    together = fraction(same) / max(math.prod(fraction(alone) for _, alone in axes.values()), 1 / same.size)
    if pattern is None or (len(axes) > 1 and together < 2):
        pattern = _held([values for values, _ in axes.values()], same) if len(axes) > 1 and together > 1.2 else None
    if pattern is None:
        return {
            axis: (repeats_of([values], alone, duplicates) or _held([values], alone), alone)
            for axis, (values, alone) in axes.items()
        }
    return dict.fromkeys(axes, (pattern, same))


def _held(outputs: list[Vector], same: Mask) -> Repeats | None:
    """Return how values are held beyond chance, but not if the output stands still for a long time."""
    pattern = held_by_chance(outputs, same)
    return None if pattern is None or _stands_still(same) else pattern


def _stands_still(same: Mask) -> bool:
    """Return whether much of the recording is in long standstills, which are a fault of the sensor."""
    return fraction(in_long_runs(same, max(same.size // 64, _FROZEN))) > _MOST_FROZEN


def _plan(axis: str, pattern: Repeats | None, values: Vector, same: Mask, *, begins: Indices) -> RepairPlan:
    """Return the plan of one axis."""
    dead = _dead(same)
    frozen, line, levels, slower = 0, 0, None, 0.0
    if pattern is None:
        levels, slower = two_levels_of(values), slower_rate(values[: int(begins[1]) if begins.size > 1 else None])
        frozen = _frozen_length(values, same)
        frozen = (
            frozen if frozen and np.any(in_long_runs(same, frozen)[dead:]) and not _stands_still(same[dead:]) else 0
        )
        line = 0 if slower else _straight_length(values, begins)
    found = {
        "frozen": frozen, "straight": line, "wraps": modulus_of(values), "counts": count_of(values), "levels": levels,
        "resampled": slower,
    }  # fmt: skip
    mappings: dict[str, Any] = {name: {axis: value} if value else {} for name, value in found.items()}
    return RepairPlan(axes=(axis,), repeats=pattern, dead=dead if dead < _MOST_DEAD * values.size else 0, **mappings)


def _joined(
    plans: Mapping[str, RepairPlan], repeated: Mapping[str, Mask], batch: Batch, begins: Indices
) -> list[RepairPlan]:
    """Join the plans of axes that lose the same samples."""
    joined: list[tuple[RepairPlan, Mask]] = []
    for axis, plan in plans.items():
        lost = repeated[axis].copy() if axis in repeated else np.zeros(len(batch), dtype=np.bool_)
        if plan.repeats is None:
            for mask in plan.left_out({axis: batch.signals[axis].values}, begins).values():
                lost |= mask
        for k, (other, mask) in enumerate(joined):
            # A coarse axis repeats a value by chance at the end of a standstill of all axes.
            if (other.repeats, other.dead) == (plan.repeats, plan.dead) and 10 * np.sum(lost ^ mask) <= np.sum(
                lost | mask
            ):
                joined[k] = other.beside(plan), mask
                break
        else:
            joined.append((plan, lost))
    return [plan for plan, _ in joined]


def _dead(same: Mask) -> int:
    """Return the number of equal samples at the beginning, if they are far more than in other runs."""
    if not np.all(same[1:_FROZEN]):
        return 0
    changes = np.flatnonzero(~same)
    if changes.size < 3:
        return 0
    first = int(changes[1])
    lengths = np.diff(changes[1:])
    return first if first > _FROZEN_TIMES * float(np.max(lengths)) else 0


def _frozen_length(values: Vector, same: Mask) -> int:
    """Return the smallest number of equal samples in a row that chance does not explain; 0 if the output is coarse, or
    if no run is so long."""
    if not np.any(same[3:] & same[2:-1] & same[1:-2]):
        return 0
    starts = np.flatnonzero(~same)
    if starts.size < 100:
        return 0
    level, lengths = values[starts], np.diff(starts)
    returned = level[2:] == level[:-2]
    share = max(fraction(returned), 1 / level.size)
    longest = max(int(np.max(lengths)), same.size - int(starts[-1]))
    if share > _COARSE or longest < min(_FROZEN, _least_run(share, values.size)):  # both are smaller than what follows
        return 0
    usual = max(_FROZEN, int(_FROZEN_TIMES * np.quantile(lengths, 0.999)))
    # The output can be coarser, or quieter, in a part: the most returns among w values, less three standard errors.
    w, sums = min(500, returned.size), np.cumsum(returned)
    most = np.max(sums[w - 1 :] - sums[: 1 - w] + returned[: 1 - w])
    share = max(share, (most - 3 * math.sqrt(most)) / w)
    if share > _COARSE:
        return usual
    least = _least_run(share, values.size)
    # A smooth signal stays at its turns, and leaves them by small steps.
    runs, sizes = np.flatnonzero(lengths[1:] >= least), np.abs(np.diff(level))
    ends = np.maximum(sizes[runs], sizes[runs + 1])
    is_frozen = least < usual and runs.size and np.mean(ends) > np.median(sizes) and not is_slow(level)
    return least if is_frozen else usual


def _least_run(share: float, samples: int) -> int:
    """Return the smallest run of equal samples that chance does not explain, if this `share` of values returns."""
    # Gaussian values stay at the likeliest level with √2 times this share, and any others at most with its root.
    stays = min(3 * share, math.sqrt(share))
    return max(1 + math.ceil(math.log(_UNLIKELY / samples) / math.log(stays)), 4)


def _straight_length(values: Vector, begins: Indices) -> int:
    """Return the least straight run of samples beyond chance; 0 without one, or if most of the log is interpolated."""
    line = straight(values, begins)
    if line.size < 3:
        return 0
    alone = line[1:-1] & ~line[:-2] & ~line[2:]
    share = max(fraction(alone), 1e-6)
    length = max(int(np.ceil(np.log(_UNLIKELY / values.size) / np.log(share))), 3)
    on_line, rounding = np.count_nonzero(line[:_OF_STEP]), rounding_of(values)
    if on_line > LIMITS.least_share * _OF_STEP:
        # By chance, half as many samples are on the line as at any small distance from it, on both sides.
        distances = np.rint(np.abs(np.diff(values[:_OF_STEP], 2)) / rounding)
        counts = np.unique(distances[distances > 1], return_counts=True)[1]
        length = 1 if np.max(counts, initial=0) / 2 <= LIMITS.false_share * on_line else length
    rows = in_long_runs(line, length + 1)  # see `_in_straight_runs`
    if length > _FROZEN or not 0 < fraction(rows) <= _MOST_STRAIGHT:
        return 0
    step, slopes = step_of(values[:_OF_STEP]), np.diff(values)[rows[1:]]
    is_slow = step is not None and np.median(np.abs(slopes / step - np.rint(slopes / step))) < _ON_GRID
    return 0 if is_slow else length


def _in_straight_runs(values: Vector, begins: Indices, least: int) -> Mask:
    """Return the inner samples of straight lines of at least `least` inner samples."""
    line = straight(values, begins)
    # A run of `least` flags is a run of `least` + 1 samples that continue each other.
    return in_long_runs(line, least + 1)
