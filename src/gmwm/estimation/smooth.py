"""A smooth curve through a wavelet variance, for weights: data alone are a poor judge of their own scatter.

A level with one degree of freedom is now and then a thousand times smaller than it should be, and a weight
1/ν̂⁴ would let it decide the whole fit. The curve here is the mixture of all processes there are, at many
correlation times, that is likeliest under the chi-square law of the levels; no model is asked for, so that all
models are fitted with the same weights.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gmwm import _core
from gmwm._arrays import Matrix, Vector
from gmwm.filters import WaveletFilter, find_filter
from gmwm.processes.base import Process, registry
from gmwm.variance.result import WaveletVariance

PRIOR = 30.0
"""Degrees of freedom that the smooth curve counts for beside those of a level."""
_PLACES = 48
_ROUNDS = 30
_SETTLED = 1e-3


def smoothed(wv: WaveletVariance) -> Vector:
    """ν̄² = (η ν̂² + 30 ν̃²)/(η + 30), ν̃² the smooth curve: the data where they are many, the curve where few.

    A curve with a level of zero variance is left as it is.
    """
    if not np.all(wv.variance > 0):
        return wv.variance
    unit = 2.0 ** np.floor(np.log2(wv.variance.max()))
    observed, freedom = wv.variance / unit, wv.degrees_of_freedom
    shapes = _shapes(tuple(int(j) for j in wv.levels), wv.samples, wv.rate, find_filter(wv.filter))
    # No wavelet variance falls much faster than quantization noise, by four from level to level.
    curve = observed.copy()
    for k in range(1, curve.size):
        curve[k] = max(curve[k], curve[k - 1] / 4)
    for _ in range(_ROUNDS):
        # Fisher scoring of the gamma likelihood: least squares with the weights of the last curve.
        root = np.sqrt(freedom / 2) / curve
        rows = shapes * root
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        weights, _ = _core.nonnegative_least_squares(root * observed, np.ascontiguousarray(rows / length))
        before, curve = curve, weights @ (shapes / length)
        if np.all(np.abs(curve - before) <= _SETTLED * before):
            break
    return np.asarray(unit * (freedom * observed + PRIOR * curve) / (freedom + PRIOR))


@lru_cache(maxsize=16)
def _shapes(levels: tuple[int, ...], samples: int, rate: float, filter: WaveletFilter) -> Matrix:
    """Wavelet variances of every process at unit scale, one of each family, those with a search at many places."""
    number = np.asarray(levels, dtype=np.int64)
    kinds: dict[str, type[Process]] = {}
    for kind in registry.values():
        kinds.setdefault(kind.family or kind.name, kind)
    rows = []
    for kind in kinds.values():
        if not kind.nonlinear_parameters():
            rows.append(kind.shape(np.empty((1, 0)), number, rate, filter))
        for branch in kind.search(samples, rate):
            places = branch.values(np.linspace(branch.low, branch.high, _PLACES))
            rows.append(kind.shape(places, number, rate, filter))
    shapes = np.concatenate(rows)
    return np.asarray(shapes[np.any(shapes > 0, axis=1)])
