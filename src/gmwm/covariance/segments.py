"""The covariance of a wavelet variance of several segments between gaps, from those of the segments by themselves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from gmwm._arrays import Matrix
from gmwm.covariance.design import Design

EXACT = 64
"""So many different lengths are taken one by one; of more, some stand for all."""
_OCTAVE = 8
"""Lengths in an octave that stand for those between."""


def pooled(design: Design, alone: Callable[[Design], Matrix]) -> Matrix:
    """Σ_s M_sj M_sk V_sjk / (M_j M_k) from V_s of segments by themselves (J, J), or of its diagonal (J,).

    Segments are taken for independent, and those of one length have one V_s.
    """
    counts, total = design.counts, None
    for length, times in _lengths(design.lengths):
        segment = design.segment(length, counts)
        if segment is None:
            continue
        part = alone(segment)
        if total is None:
            total = np.zeros((counts.size,) * part.ndim)
        own = segment.counts.astype(np.float64)
        total[tuple(slice(n) for n in part.shape)] += times * part * _outer(own, part.ndim)
    assert total is not None
    return np.asarray(total / _outer(counts.astype(np.float64), total.ndim))


def _outer(values: Matrix, dimensions: int) -> Matrix:
    return np.asarray(np.outer(values, values) if dimensions == 2 else values**2)


def _lengths(lengths: tuple[int, ...]) -> Iterator[tuple[int, float]]:
    """Lengths, and how many segments each stands for.

    M² V is a convex function of the length, nearly a straight line from a few scales on: between two lengths near each
    other a segment counts as part of each.
    """
    sizes, times = np.unique(np.asarray(lengths, dtype=np.int64), return_counts=True)
    if sizes.size > EXACT:
        steps = np.arange(_OCTAVE * math.log2(sizes[0]) - 1, _OCTAVE * math.log2(sizes[-1]) + 1)
        grid = np.unique(np.rint(np.exp2(np.ceil(steps) / _OCTAVE)).astype(np.int64))
        nodes = np.unique(np.concatenate([sizes[[0, -1]], grid[(grid > sizes[0]) & (grid < sizes[-1])]]))
        right = np.clip(np.searchsorted(nodes, sizes), 1, nodes.size - 1)
        share = (sizes - nodes[right - 1]) / (nodes[right] - nodes[right - 1])
        weights = np.bincount(right, share * times, nodes.size)
        weights += np.bincount(right - 1, (1 - share) * times, nodes.size)
        sizes, times = nodes[weights > 0], weights[weights > 0]
    yield from zip(sizes.tolist(), times.tolist(), strict=True)
