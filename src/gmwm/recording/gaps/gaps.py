"""Decide which gaps are filled: not those after which a restarted sensor has another offset, which would look like a
random walk.

Differences of means of w samples are compared with those at other places, so that drift is no restart."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.base.time_base import lost_before
from gmwm.recording.gaps.drawing import LONGEST_PREDICTED_SAMPLES

AROUND, LEAST_AROUND = 32, 1024
"""Neighbours of a gap of g samples on each side: max(32 g, 1024), up to `CONTEXT` (tests/filling, also below)."""
LEAST_NEIGHBOUR_SHARE = 0.75  # smallest share of the neighbourhood that must be known for a gap to be filled
BESIDE, BESIDE_LONG = 2, 16
"""Least known samples on each side over the gap's length, for gaps predicted from neighbours, and for longer ones,
after which an offset may differ; also near the recording's ends."""
LONGEST_FILLED_SAMPLES = 1 << 13  # longest gap that is filled (samples)
CONTEXT = BESIDE_LONG * LONGEST_FILLED_SAMPLES
"""Number of samples on each side of a block that determine which gaps are filled, and from which they are filled."""
BLOCK_SAMPLES = 1 << 20
"""Samples whose gaps are filled together: this bounds the memory, and predictions follow a changing sensor."""

Ranges = NDArray[np.int64]


def is_short(lost: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return whether gaps with these numbers of lost samples are filled if enough samples around them are known."""
    return np.asarray((lost > 0) & (lost <= LONGEST_FILLED_SAMPLES))


def has_short_gaps(rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]) -> bool:
    """Return whether any gap between segments may be filled."""
    return len(segments) > 1 and bool(np.any(is_short(lost_before(rate, segments, starts))))


def joined_ranges(
    rate: float, segments: Sequence[tuple[int, int]], starts: Sequence[float]
) -> tuple[tuple[int, int], ...]:
    """Return index ranges (first, last) of the known samples between the gaps that are not filled."""
    if not has_short_gaps(rate, segments, starts):
        return tuple(segments)
    ranges = np.array(segments, dtype=np.int64)
    lost = lost_before(rate, ranges, starts)
    accepted = np.zeros(lost.size, dtype=np.bool_)
    total = int(ranges[-1, 1])
    for first in range(0, total, BLOCK_SAMPLES):
        last = min(first + BLOCK_SAMPLES, total)
        subset = slice(*np.searchsorted(ranges[:, 0], [max(first - CONTEXT, 0) + 1, last + CONTEXT]).tolist())
        subset = slice(subset.start - 1, subset.stop)
        near = np.clip(ranges[subset], first - CONTEXT, last + CONTEXT)
        behind = ranges[subset.start + 1 : subset.stop, 0]
        places = np.flatnonzero((behind >= first) & (behind < last))
        gaps = slice(subset.start, subset.stop - 1)
        accepted[gaps][places] = fillable(near[:, 1] - near[:, 0], lost[gaps])[places]
    cuts = ranges[1:, 0][~accepted].tolist()
    return tuple(pairwise([0, *cuts, total]))


def fillable(lengths: NDArray[np.int64], lost: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which gaps are filled, from segments' lengths and lost samples; long ones first, then known."""
    accepted = np.zeros(lost.size, dtype=np.bool_)
    missing = np.maximum(lost, 0)
    # On a timeline with the lost samples: the end of the known samples before each gap, and the beginning after it.
    ends = np.cumsum(lengths[:-1]) + np.concatenate([[0], np.cumsum(missing)[:-1]])
    begins = ends + missing
    total = int(lengths.sum() + missing.sum())
    corners = np.stack([ends, begins], axis=1).ravel()
    for gap in np.unique(lost[is_short(lost)])[::-1].tolist():
        subset = np.flatnonzero(lost == gap)
        away = np.where(accepted, 0, missing)
        summed = np.stack([np.cumsum(away) - away, np.cumsum(away)], axis=1).ravel()
        context = min(max(AROUND * gap, LEAST_AROUND), CONTEXT)
        far = np.maximum(ends[subset] - context, 0), np.minimum(begins[subset] + context, total)
        unknown = (
            summed[2 * subset] - np.interp(far[0], corners, summed, left=0.0),
            np.interp(far[1], corners, summed) - summed[2 * subset + 1],
        )
        sizes = np.stack([ends[subset] - far[0], far[1] - begins[subset]])
        counts = sizes - np.stack(unknown)
        least = np.maximum(
            LEAST_NEIGHBOUR_SHARE * sizes, (BESIDE if gap <= LONGEST_PREDICTED_SAMPLES else BESIDE_LONG) * gap
        )
        accepted[subset] = np.all(counts >= least, axis=0)
    return accepted


LEAST, SHARE = 16, 16
"""Smallest width w, and smallest number of widths in a recording, so that the usual difference is known accurately
enough. All constants here are measured in tests/filling/test_restarts.py."""
LEAST_JUMP = 6.0  # smallest size of a jump at a gap, in standard deviations of the usual differences
_NEARER = 12.0
"""Twice the log likelihood by which another place takes a jump; wrong for 0.5 % of those at gaps in white noise."""
_SLOPE = 0.5
"""Smallest share of a jump that remains without the slopes of both sides; nothing remains of a ramp."""
_PLACES = 1 << 13  # number of places from which the usual difference is estimated

Places = NDArray[np.int64]


def restarts(values: Vector, places: Places, lost: Places, cuts: Sequence[int]) -> NDArray[np.bool_]:
    """Return the gaps (m,) after which the sensor has another offset, from known samples, places after gaps, `lost`
    counts and `cuts` of ranges.

    The signal is cut at the largest jump before the next search, so that a restart counts once.

    >>> x = np.random.default_rng(1).normal(size=20_000)
    >>> x[10_000:] += 2
    >>> restarts(x, np.array([5_000, 9_900, 10_000]), np.array([1, 1, 1]), ())
    array([False, False,  True])
    """
    flags = np.zeros(places.size, dtype=np.bool_)
    differences = _Differences(values, int(lost.max(initial=0)))
    if not differences.widths:
        return flags
    edges, open_ = [0, *cuts, values.size], np.ones(places.size, dtype=np.bool_)
    octaves = np.ceil(np.log2(np.maximum(lost, 1))).astype(np.int64)
    before, after = _edges(places, edges)
    ratios, widths = differences.ratios(places, octaves, np.minimum(places - before, after - places))
    elsewhere = 0
    while np.any(open_):
        k = int(np.argmax(np.where(open_, ratios, 0.0)))
        if not open_[k] or ratios[k] < LEAST_JUMP:
            break
        open_[k] = False
        width, octave, place = int(widths[k]), int(octaves[k]), int(places[k])
        least, most = int(before[k]) + LEAST, int(after[k]) - LEAST
        near = np.arange(max(place - width, least), min(place + width, most) + 1)
        gains = differences.gains(near, place, octave=octave, width=width)
        begin, end = np.searchsorted(places, [near[0], near[-1] + 1])
        indices = places[begin:end] - near[0]
        nearest = indices[np.argmax(gains[indices])]
        best = nearest if gains[nearest] > np.max(gains) - _NEARER else np.argmax(gains)
        jump = int(near[best])
        if differences.is_steep(jump, octave, min(width, jump - int(before[k]), int(after[k]) - jump)):
            flags |= (places == jump) & (best == nearest)
            open_ &= places != jump
            elsewhere += int(best != nearest)
            edges.append(jump)
            before, after = _edges(places, edges)
            ratios, widths = differences.ratios(places, octaves, np.minimum(places - before, after - places))
    # If a sensor jumps more often at other places than at gaps, its jumps are not restarts.
    return flags if np.count_nonzero(flags) > elsewhere else np.zeros_like(flags)


def _edges(places: Places, edges: Sequence[int]) -> tuple[Places, Places]:
    """Return the nearest edges before and after each place."""
    bounds = np.unique(edges)
    after = np.searchsorted(bounds, places, side="right")
    return bounds[after - 1], bounds[np.minimum(after, bounds.size - 1)]


class _Differences:
    """Differences of means of w samples before and after places, and their usual size, for all `widths` w."""

    def __init__(self, values: Vector, longest: int) -> None:
        most = min(values.size // SHARE, CONTEXT // 2)
        self.widths = [LEAST << k for k in range(max(most // LEAST, 0).bit_length())]
        self._values = values - values.mean()
        self._path = np.concatenate([[0.0], np.cumsum(self._values)])
        self._floor = 1e-9 * float(np.max(np.abs(self._values), initial=0.0)) + np.finfo(float).tiny
        self._usual: dict[tuple[int, int], tuple[float, float]] = {}

    def at(self, places: Places, width: int, lost: int = 0) -> Vector:
        """Return the mean of `width` samples from `lost` after each place on, minus that of the `width` before it."""
        path, behind = self._path, places + lost
        return np.asarray((path[behind + width] - path[behind] - path[places] + path[places - width]) / width)

    def usual(self, width: int, octave: int) -> tuple[float, float]:
        """Return the median difference across 2^octave samples, and the standard deviation about it."""
        if (width, octave) not in self._usual:
            lost = 1 << octave
            most = self._values.size - width - lost
            if most <= width:
                return 0.0, np.inf
            every = np.linspace(width, most, min(_PLACES, most - width + 1)).astype(np.int64)
            differences = self.at(every, width, lost)
            middle = float(np.median(differences))
            spread = float(np.median(np.abs(differences - middle))) / 0.67449
            self._usual[width, octave] = middle, max(spread, self._floor)
        return self._usual[width, octave]

    def ratios(self, places: Places, octaves: Places, room: Places) -> tuple[Vector, Places]:
        """Return absolute differences in standard deviations, and the width up to `room` with the smallest one."""
        ratio, chosen = np.zeros(places.size), np.zeros(places.size, dtype=np.int64)
        spread = np.full(places.size, np.inf)
        for octave in np.unique(octaves).tolist():
            for width in self.widths:
                middle, usual = self.usual(width, octave)
                subset = np.flatnonzero((octaves == octave) & (room >= width) & (usual < spread))
                ratio[subset] = np.abs(self.at(places[subset], width) - middle) / usual
                spread[subset], chosen[subset] = usual, width
        return ratio, chosen

    def gains(self, near: Places, place: int, *, octave: int, width: int) -> Vector:
        """Return twice the log likelihood of the jump at `place` if it were at `near`, minus the first of them."""
        size = float(self.at(np.array([place]), width)[0])
        middle = 0.5 * float(self._path[place + width] - self._path[place - width]) / width
        # Samples from a place to a later one have the mean before the jump: it grows by 2 size (middle − x) / σ².
        path = self._path[near] - middle * near
        return np.asarray(-4 * size / (width * self.usual(width, octave)[1] ** 2) * (path - path[0]))

    def is_steep(self, place: int, octave: int, width: int) -> bool:
        """Return whether a jump at a place is steeper than the slope of the signal around it."""
        here, *slopes = (
            float(self.at(np.array([place + shift]), part)[0])
            for shift, part in ((0, width), (-width // 2, width // 2), (width // 2, width // 2))
        )
        return abs(here - sum(slopes)) > max(_SLOPE * abs(here), LEAST_JUMP * self.usual(width, octave)[1])
