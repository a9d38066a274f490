"""Decide which gaps of a recording are filled."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.time_base import lost_before
from gmwm.recording.gaps.drawing import LONGEST_PREDICTED_SAMPLES

AROUND, LEAST_AROUND = 32, 1024
"""The neighbourhood of a gap of g samples has max(32 g, 1024) samples on each side, but at most `CONTEXT`, and fewer at
an end of the recording. All constants here are measured in tests/filling."""
LEAST_NEIGHBOUR_SHARE = 0.75
"""Smallest share of the neighbourhood that must be known for a gap to be filled."""
BESIDE, BESIDE_LONG = 2, 16
"""Smallest number of known samples on each side of a gap, as a multiple of its length. The first value is for gaps that
are predicted from neighbours, the second for longer gaps, after which a sensor may have another offset. Both also apply
near the ends of the recording."""
LONGEST_FILLED_SAMPLES = 1 << 13
"""Longest gap that is filled (samples)."""
CONTEXT = BESIDE_LONG * LONGEST_FILLED_SAMPLES
"""Number of samples on each side of a block that determine which gaps are filled, and from which they are filled."""
BLOCK_SAMPLES = 1 << 20
"""Number of samples whose gaps are filled together. Blocks bound the memory, and the prediction follows a sensor that
changes."""

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
    """Return a mask of the gaps that are filled, from the lengths of the segments and the number of samples lost
    between them.

    Long gaps are decided first, and their samples are treated as known for shorter gaps near them.
    """
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
