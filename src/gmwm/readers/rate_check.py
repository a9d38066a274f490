"""Whether time stamps can be used as they are: in order, and at one rate from the first to the last."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm._arrays import Vector
from gmwm.errors import ReadError

_PIECE = 64  # intervals at least: their mean fades the jitter of single stamps
_PIECES = 64
_BESIDE = 3  # windows on each side of a change: a gap or a pause spoils one of them
_BESIDE_BURSTS = 8
_CHANGED = 1.05  # a crystal drifts by less; two settings of a sensor differ by more
_CHANGED_BURSTS = 1.2  # a window holds a burst more or less
_NEAR = 8.0  # intervals: stamps that step back by less are out of order, by more the clock was set
_SOME = 2  # stamps out of order in any recording, and their share, that are cut out and told
_SHARE = 1e-3
_RESETS = 8  # clocks set back in any recording, and their share, that only split it
_RESET_SHARE = 1e-2


@dataclass(frozen=True)
class Change:
    """A change of the sampling interval: the sample from which on the new one holds, and both (ticks)."""

    index: int
    before: float
    after: float


def require_order(ticks: Vector, nominal: float, origin: float, per_second: float) -> None:
    """Raise an error where stamps step back so often that they tell neither order nor rate.

    Parameters
    ----------
    ticks : (N,) array
        Stamps from the first one on, in their unit.
    nominal : float
        Sampling interval in ticks, roughly.
    origin : float
        The first stamp.
    per_second : float
        Ticks in a second.

    Raises
    ------
    ReadError
        If more than a few stamps, or a thousandth of them, are out of order.
    """
    steps = np.diff(ticks)
    back = np.flatnonzero(steps < 0)
    near = int(np.count_nonzero(steps[back] > -_NEAR * nominal))
    if near <= max(_SOME, _SHARE * ticks.size) and back.size <= max(_RESETS, _RESET_SHARE * ticks.size):
        return
    first, most = (origin + ticks[back[0] + 1]) / per_second, -float(np.min(steps)) / per_second
    raise ReadError(
        f"the time stamps are not in order: {back.size} of {ticks.size} are earlier than the one before, by up to "
        f"{most:.3g} s (the first in row {back[0] + 2}, at {first:.6g} s). If the rows stand in the order of "
        "sampling and only the stamps are loose, leave them out with columns={'time': None} and pass rate= "
        f"(on average they say {per_second / nominal:.4g} Hz); if the rows are mixed up, sort them by time first"
    )


def require_one_rate(ticks: Vector, origin: float, per_second: float) -> None:
    """Raise an error where the sampling rate changes within the recording.

    Raises
    ------
    ReadError
        With both rates, and the time and row of the change.
    """
    change = rate_change(ticks)
    if change is None:
        return
    when = (origin + float(ticks[change.index])) / per_second
    before, after = per_second / change.before, per_second / change.after
    raise ReadError(
        f"the sampling rate changes from {before:.4g} Hz to {after:.4g} Hz at {when:.6g} s (row {change.index + 1}, by "
        "the time stamps), and one recording has one rate: cut the file there and read the parts one at a time"
    )


def rate_change(ticks: Vector) -> Change | None:
    """The first lasting change of the sampling interval by more than 5 %, or None.

    Pieces of at least 64 intervals are compared, three on either side. What counts is the median interval,
    which gaps do not move, together with the mean, which jitter and rounding do not move: both must change
    alike, and all windows of one side must lie beyond all of the other. Where samples are stamped in bursts the
    median says nothing: there the mean must change by more, and for longer.

    Parameters
    ----------
    ticks : (N,) array
        Stamps in any unit, in order but for a few.

    >>> rate_change(np.cumsum(np.repeat([1.0, 2.0], 500)))
    Change(index=499, before=1.0, after=2.0)
    """
    steps = np.diff(ticks)
    burst = _burst(steps)
    beside, factor = (_BESIDE, _CHANGED) if burst == 1 else (_BESIDE_BURSTS, _CHANGED_BURSTS)
    length = max(steps.size // _PIECES, _PIECE, 8 * burst)
    count = steps.size // length
    if count < 2 * beside:
        return None
    blocks = np.where(steps < 0, 0.0, steps)[: count * length].reshape(count, length)
    means, medians = np.mean(blocks, axis=1), np.median(blocks, axis=1)
    for k in range(beside, count - beside + 1):
        mean, middle = (_Sides.of(values, k, beside) for values in (means, medians))
        chosen = middle if burst == 1 else mean
        if chosen.apart(factor) and (burst > 1 or mean.agrees(middle)):
            at = _corner(steps, (k - 1) * length, (k + 1) * length, chosen)
            return Change(at, chosen.before, chosen.after)
    return None


@dataclass(frozen=True)
class _Sides:
    """Pieces before and behind a place: their medians and their ranges."""

    before: float
    after: float
    ranges: tuple[float, float, float, float]

    @classmethod
    def of(cls, values: Vector, k: int, beside: int) -> _Sides:
        left, right = np.sort(values[k - beside : k]), np.sort(values[k : k + beside])
        ranges = (float(left[0]), float(left[-1]), float(right[0]), float(right[-1]))
        return cls(float(np.median(left)), float(np.median(right)), ranges)

    def apart(self, factor: float) -> bool:
        """Whether one side lies beyond the other by more than a factor, and by more than either is wide."""
        low, high, first, last = self.ranges
        if self.before <= 0 or self.after <= 0 or (first <= factor * high and low <= factor * last):
            return False
        return max(first - high, low - last) > max(high - low, last - first)

    def agrees(self, other: _Sides) -> bool:
        """Whether both change alike."""
        mine, theirs = np.log(self.after / self.before), np.log(other.after / other.before)
        return bool(abs(mine) > np.log(_CHANGED) and abs(mine - theirs) < np.log(_CHANGED_BURSTS))


def _burst(steps: Vector) -> int:
    """How many samples are stamped together: 1 where the median interval is that of uniform sampling."""
    forward = steps[steps >= 0]
    single = float(np.median(forward)) if forward.size else 0.0
    long = int(np.count_nonzero(forward > 4 * single))
    return max(2, round(forward.size / long)) if long > 0.05 * forward.size else 1


def _corner(steps: Vector, low: int, high: int, sides: _Sides) -> int:
    """The last sample that the old interval leads to, within a range that holds the change."""
    part = steps[low:high]
    # Each interval votes for the rate it is nearer to: a gap votes no louder than any other.
    votes = np.where(np.abs(part - sides.before) < np.abs(part - sides.after), 1, -1)
    return low + int(np.argmax(np.concatenate(([0], np.cumsum(votes)))))
