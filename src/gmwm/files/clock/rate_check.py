"""Check that time stamps are in order, and that the sampling rate is the same from the first to the last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import ReadError
from gmwm.base.remarks import Quantity


@dataclass(frozen=True)
class RateComparison:
    """Limits at which a recording has two rates, or time stamps out of order (test_steady.py, test_timebase.py)."""

    block: int = 64  # smallest number of intervals in a block, over which the jitter of single time stamps averages out
    most_blocks: int = 64
    """Largest number of blocks in a recording. A change is found if it lasts for 3/64 of the recording."""
    blocks_compared: int = 3
    """Blocks that are compared on each side of a change. A gap or a pause affects only one of them."""
    blocks_compared_bursts: int = 8
    """The same for samples in bursts, whose mean interval varies more from block to block."""
    changed: float = 1.05
    """Smallest ratio of two rates that is a change. Oscillators drift by less, settings of a sensor differ by more."""
    changed_bursts: float = 1.2
    """The same ratio if samples come in bursts, because a block can contain one burst more or less."""
    out_of_order: float = 8.0
    """Intervals by which a time stamp may be earlier than the previous one; beyond, the clock was set back."""


COMPARISON = RateComparison()

_FEW_OUT_OF_ORDER, _SHARE_OUT_OF_ORDER = 2, 1e-3
"""Number of time stamps out of order that is accepted in any recording, and share that is accepted in a long one."""
_RESETS, _RESET_SHARE = 8, 1e-2  # the same for backward steps of the clock, at each of which the recording is split


@dataclass(frozen=True)
class Change:
    """A change of the sampling interval: the first sample with the new interval, and both intervals (ticks)."""

    index: int
    before: float
    after: float


def require_order(ticks: Vector, nominal: float, origin: float, per_second: float, row: int = 0) -> None:
    """Require that time stamps are in order, except for a few. `row` rows are before the first one, `origin`."""
    steps = np.diff(ticks)
    back = np.flatnonzero(steps < 0)
    near = int(np.count_nonzero(steps[back] > -COMPARISON.out_of_order * nominal))
    if near <= max(_FEW_OUT_OF_ORDER, _SHARE_OUT_OF_ORDER * ticks.size) and back.size <= max(
        _RESETS, _RESET_SHARE * ticks.size
    ):
        return
    first, most = (origin + ticks[back[0] + 1]) / per_second, -float(np.min(steps)) / per_second
    raise ReadError(
        f"the time stamps are not in order: {back.size} of {ticks.size} are earlier than the one before, by up to "
        f"{most:.3g} s (the first in row {row + back[0] + 2}, at {first:.6g} s)",
        code="time-order",
        advice="If the rows are not in the order of sampling, sort them by time; if they are, leave the time stamps "
        "out with {--columns=time:none} and pass {--rate} (on average they show {rate:.4g}).",
        rate=Quantity(per_second / nominal, "Hz"),
    )


def require_one_rate(ticks: Vector, per_second: float, row: int = 0) -> None:
    """Require that the sampling rate does not change within the recording."""
    change = rate_change(ticks)
    if change is None:
        return
    when = float(ticks[change.index]) / per_second
    before, after = per_second / change.before, per_second / change.after
    raise ReadError(
        f"the sampling rate changes from {before:.4g} Hz to {after:.4g} Hz at {when:.6g} s from the start of the "
        f"recording (row {row + change.index + 1}), by the time stamps",
        code="rate-changes",
        advice="Read one part at a time: the first with {--stop=@when}, the second with {--start=@when}.",
        when=round(when, 3),
    )


def rate_change(ticks: Vector) -> Change | None:
    """Find the first lasting change of the sampling interval by more than 5 %; None if there is none.

    Three blocks of at least 64 intervals on either side are compared by medians, which gaps do not affect, and means,
    which jitter and rounding do not. Both must change alike, and all blocks of a side must be beyond the other. In
    bursts, the median has no meaning, and the mean of eight blocks must change by 20 %."""
    steps = np.diff(ticks)
    burst = _burst(steps)
    width, factor = (
        (COMPARISON.blocks_compared, COMPARISON.changed)
        if burst == 1
        else (COMPARISON.blocks_compared_bursts, COMPARISON.changed_bursts)
    )
    length = max(steps.size // COMPARISON.most_blocks, COMPARISON.block, 8 * burst)
    count = steps.size // length
    if count < 2 * width:
        return None
    blocks = np.where(steps < 0, 0.0, steps)[: count * length].reshape(count, length)
    means, medians = np.mean(blocks, axis=1), np.median(blocks, axis=1)
    values = medians if burst == 1 else means
    if np.max(values) <= factor * np.min(values):
        return None  # no block differs by this factor from any other
    for k in range(width, count - width + 1):
        mean, middle = (_Sides.of(values, k, width) for values in (means, medians))
        chosen = middle if burst == 1 else mean
        if chosen.apart(factor) and (burst > 1 or mean.agrees(middle)):
            at = _corner(steps, (k - 1) * length, (k + 1) * length, chosen)
            return Change(at, chosen.before, chosen.after)
    return None


@dataclass(frozen=True)
class _Sides:
    """Blocks on both sides of a possible change: the medians and ranges of each side."""

    before: float
    after: float
    ranges: tuple[float, float, float, float]

    @classmethod
    def of(cls, values: Vector, k: int, beside: int) -> _Sides:
        before, right = np.sort(values[k - beside : k]), np.sort(values[k : k + beside])
        ranges = (float(before[0]), float(before[-1]), float(right[0]), float(right[-1]))
        return cls(float(np.median(before)), float(np.median(right)), ranges)

    def apart(self, factor: float) -> bool:
        """Return whether the sides differ by more than a factor, and by more than the range of either side."""
        low, high, first, last = self.ranges
        if self.before <= 0 or self.after <= 0 or (first <= factor * high and low <= factor * last):
            return False
        return max(first - high, low - last) > max(high - low, last - first)

    def agrees(self, other: _Sides) -> bool:
        """Return whether two changes have about the same factor."""
        mine, theirs = np.log(self.after / self.before), np.log(other.after / other.before)
        return bool(abs(mine) > np.log(COMPARISON.changed) and abs(mine - theirs) < np.log(COMPARISON.changed_bursts))


def _burst(steps: Vector) -> int:
    """Return the samples of a burst; 1 unless over 5 % of the intervals exceed 4 medians (gaps are rarer)."""
    forward = steps[steps >= 0]
    single = float(np.median(forward)) if forward.size else 0.0
    long = int(np.count_nonzero(forward > 4 * single))
    return max(2, round(forward.size / long)) if long > 0.05 * forward.size else 1


def _corner(steps: Vector, low: int, high: int, sides: _Sides) -> int:
    """Return the last sample with the old interval, within a range of samples that contains the change."""
    part = steps[low:high]
    # Each interval has one vote, for the rate that it is nearer to, so a gap counts no more than any other interval.
    votes = np.where(np.abs(part - sides.before) < np.abs(part - sides.after), 1, -1)
    return low + int(np.argmax(np.concatenate(([0], np.cumsum(votes)))))
