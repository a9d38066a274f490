"""Find the time ranges in which a unit was moved or shaken, and noise whose level changes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.measuring.inspection.axis_statistics import AxisStatistics
from gmwm.measuring.inspection.knocks import Knock
from gmwm.measuring.inspection.time_grid import Extent

_SHAKEN = 4.0
"""Ratio of the standard deviation of a window to the median of all windows, above which the unit was not at rest
(tests/test_inspection_limits.py)."""
_TOUCHED = 2.0
"""Ratio above which a window beside such a window belongs to the motion (tests/test_inspection_limits.py)."""
_UNLIKE, _LINKED = 1.2, 0.5
"""Smallest ratio of the 90 % to the 10 % quantile of the standard deviations of windows, and smallest correlation of
the ranks of neighbouring windows, with which the level of the noise changes. In 300 recordings of steady noise, also
with heavy tails, the correlation is at most 0.41 (tests/test_inspection_faults.py)."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Time ranges of motion (s since the first sample of the file), rounded outwards, the largest ratio of the standard
    deviation to its usual value for each axis that moved, and the windows without motion."""

    spans: tuple[tuple[float, float], ...]
    ratios: Mapping[str, float]
    still: NDArray[np.bool_]

    def meets(self, begin: float, end: float) -> bool:
        """Return whether a time range has a part in common with the motion."""
        return any(begin <= last and end >= first for first, last in self.spans)


def motion_of(statistics: Mapping[str, AxisStatistics], knocks: Sequence[Knock], extent: Extent) -> Motion:
    """Find the windows with an unusual standard deviation on any axis, and join them with the knocks at their edges."""
    windows = extent.windows()
    shaken, touched = np.zeros(len(windows), dtype=bool), np.zeros(len(windows), dtype=bool)
    ratios = {}
    for axis, sums in statistics.items():
        spreads = np.sqrt(sums.calm.variances())
        changing = spreads[sums.steps.means > 0]  # windows in which the output is not stuck
        usual = float(np.median(changing)) if changing.size else 0.0
        if usual > 0 and np.max(spreads) > _SHAKEN * usual:
            shaken |= spreads > _SHAKEN * usual
            touched |= spreads > _TOUCHED * usual
            ratios[axis] = float(np.max(spreads) / usual)
    ranges = np.flatnonzero(np.diff(np.concatenate([[False], touched, [False]]))).reshape(-1, 2)
    spans = []
    still = np.ones(len(windows), dtype=bool)
    for a, b in ranges:
        if np.any(shaken[a:b]):
            still[a:b] = False
            begin, end = extent.times([windows[a][0], windows[b - 1][1] - 1])
            window = float(end - begin) / float(b - a)
            spans.append(_widened(float(begin), float(end), window, knocks))
    return Motion(spans=_joined(spans), ratios=ratios, still=still)


def level_change(sums: AxisStatistics, motion: Motion, extent: Extent) -> tuple[float, float] | None:
    """Return the ratio of the levels of the noise in its loud and its quiet windows, and the time (s) between two
    windows at which it changes most; None if it does not change. The level is that of first differences, which slow
    noise does not affect."""
    used = np.flatnonzero(motion.still & (sums.steps.means > 0))
    if used.size < 32:
        return None
    levels = np.log(sums.steps.means[used]) / 2
    ranks = np.argsort(np.argsort(levels)) - (used.size - 1) / 2
    low, high = np.quantile(levels, [0.1, 0.9])
    ratio = math.exp(high - low)
    if ratio < _UNLIKE or float(ranks[1:] @ ranks[:-1]) < _LINKED * float(ranks @ ranks):
        return None
    count = np.arange(1, used.size)
    sums_before = np.cumsum(levels - np.mean(levels))[:-1]
    split = int(np.argmax(sums_before**2 / (count * (used.size - count)))) + 1
    return ratio, float(extent.times([extent.windows()[used[split]][0]])[0])


def _widened(begin: float, end: float, window: float, knocks: Sequence[Knock]) -> tuple[float, float]:
    """Extend a time range by the knocks at its edges and an eighth of a window, and round it outwards."""
    margin = window / 8
    for knock in knocks:
        if knock.time <= end + margin and knock.time + knock.duration >= begin - margin:
            begin, end = min(begin, knock.time), max(end, knock.time + knock.duration)
    step = next((step for step in (300.0, 60.0, 15.0, 5.0) if 3 * step <= window), 1.0)
    return max(0.0, math.floor((begin - margin) / step) * step), math.ceil((end + margin) / step) * step


def _joined(spans: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Join ordered time ranges that overlap or touch."""
    joined: list[tuple[float, float]] = []
    for begin, end in spans:
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        else:
            joined.append((begin, end))
    return tuple(joined)
