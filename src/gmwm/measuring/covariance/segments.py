"""Covariance of the wavelet variance of a recording with gaps, from the covariances of its segments."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache

import numpy as np

from gmwm.base.arrays import Integers, Matrix
from gmwm.measuring.covariance.design import Design

EXACT_LENGTHS = 64  # largest number of different segment lengths that are computed individually; more are interpolated


def pooled(design: Design, alone: Callable[[Design], Matrix]) -> Matrix:
    """Compute V_jk = Σ_s M_sj M_sk V_sjk / (M_j M_k) of independent segments; `alone` returns V_s or its diagonal."""
    counts, total = design.counts, None
    for segment, times, reached in _parts(design):
        part = alone(segment)
        if total is None:
            total = np.zeros((counts.size,) * part.ndim)
        total[np.ix_(*[reached] * part.ndim)] += times * part * _outer(segment.counts.astype(np.float64), part.ndim)
    assert total is not None
    return np.asarray(total / _outer(counts.astype(np.float64), total.ndim))


@lru_cache(maxsize=16)
def _parts(design: Design) -> list[tuple[Design, float, Integers]]:
    """Return the designs of the segments to compute, the number of segments that each represents, and its levels."""
    parts = [(design.segment(length, design.counts), times) for length, times in lengths_of(design.lengths)]
    return [(part, times, np.flatnonzero(design.reached(part.samples))) for part, times in parts if part is not None]


def _outer(values: Matrix, dimensions: int) -> Matrix:
    return np.asarray(np.outer(values, values) if dimensions == 2 else values**2)


def lengths_of(lengths: tuple[int, ...]) -> Iterator[tuple[int, float]]:
    """Yield segment lengths to compute, and the number of segments that each represents. M² V is convex in the length
    and nearly linear beyond a few scales, so a length between two nodes is divided between both nodes."""
    # Nodes per octave of segment length, for an error of at most 1 % (tests/covariance/test_segments.py).
    octave = 8
    sizes, times = np.unique(np.asarray(lengths, dtype=np.int64), return_counts=True)
    if sizes.size > EXACT_LENGTHS:
        steps = np.arange(octave * math.log2(sizes[0]) - 1, octave * math.log2(sizes[-1]) + 1)
        grid = np.unique(np.rint(np.exp2(np.ceil(steps) / octave)).astype(np.int64))
        nodes = np.unique(np.concatenate([sizes[[0, -1]], grid[(grid > sizes[0]) & (grid < sizes[-1])]]))
        right = np.clip(np.searchsorted(nodes, sizes), 1, nodes.size - 1)
        share = (sizes - nodes[right - 1]) / (nodes[right] - nodes[right - 1])
        weights = np.bincount(right, share * times, nodes.size)
        weights += np.bincount(right - 1, (1 - share) * times, nodes.size)
        sizes, times = nodes[weights > 0], weights[weights > 0]
    yield from zip(sizes.tolist(), times.tolist(), strict=True)
