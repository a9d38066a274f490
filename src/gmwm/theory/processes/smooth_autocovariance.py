"""Wavelet variances from autocovariances that are smooth functions of the lag, for any filter and level.

The scaling coefficients of level i have the autocovariance A_i(m) = Σ_n r_g(n) A_{i−1}(2m − n), where r_g is the
autocorrelation of the smoothing filter. The wavelet variance is ν_j² = Σ_n r_h(n) A_{j−1}(n), where r_h is the
autocorrelation of the wavelet filter. Values at lags up to a few filter lengths are stored individually. At longer
lags, A_i is interpolated by one polynomial per octave of lags, which is stored as its values at Chebyshev points. A
step of the recursion is then a small matrix for each octave. All steps are linear in A_0. One adjoint recursion per
filter expresses each ν_j² as a sum over about twenty lags per level.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.theory.filters import WaveletFilter

NODES_OF_OCTAVE = 20
"""Chebyshev points per octave [a, 2a] of lags; the interpolation error is about 5.8^−20."""
_SPILL = 8
"""Octave from which the polynomial of the next octave is extrapolated to lags slightly outside it."""
_SHORT = 64
"""Number of lags that are summed individually."""

Levels = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LagSums:
    """Weights (J, P) of the autocovariance A at `places` (lags, not necessarily integers) that give the wavelet
    variances."""

    places: Vector
    weights: Matrix

    def variance(self, known: Matrix, levels: Levels) -> tuple[Matrix, Matrix]:
        """Compute the wavelet variances (n, J) from A at `places` (n, P), and the sums of absolute terms, which measure
        cancellation."""
        weights = self.weights[levels - 1]
        return np.asarray(known @ weights.T), np.asarray(np.abs(known) @ np.abs(weights).T)


@lru_cache(maxsize=64)
def sums(filter: WaveletFilter, level: int) -> LagSums:
    """Return the sums for levels 1 … `level` of a filter."""
    reach, octaves = _reach(filter), level + _SPILL
    near_step, far_step = _near_step(filter, reach), _far_step(filter, reach, octaves)
    detail = np.correlate(filter.wavelet, filter.wavelet, "full")[filter.length - 1 :] / 2.0
    near, far = np.zeros(reach + 1), np.zeros((octaves + 2, NODES_OF_OCTAVE))
    near[: filter.length] = detail * np.where(np.arange(filter.length) > 0, 2.0, 1.0)
    rows = np.empty((level, reach + 1 + octaves * NODES_OF_OCTAVE))
    for j in range(level):
        rows[j] = np.concatenate([near, far[:octaves].ravel()])
        from_near, spread = near @ near_step, np.zeros_like(far)
        parts = (far[:octaves, None] @ far_step)[:, 0]
        for k in range(3):
            spread[k : k + octaves] += parts[:, k * NODES_OF_OCTAVE : (k + 1) * NODES_OF_OCTAVE]
        near = from_near[: reach + 1]
        spread[:2] += from_near[reach + 1 :].reshape(2, NODES_OF_OCTAVE)
        far = spread
    return LagSums(freeze(spread_places(reach, octaves)), freeze(rows))


def _reach(filter: WaveletFilter) -> int:
    """Return the number of lags that are stored individually."""
    return max(64, 1 << (4 * filter.length - 1).bit_length())


@lru_cache(maxsize=64)
def _near_step(filter: WaveletFilter, reach: int) -> Matrix:
    """Return the matrix (T + 1, T + 1 + 2 NODES) of A_{i+1} at lags 0 … T from A_i there and in the first two
    octaves."""
    lags = np.arange(2 * reach + filter.length)
    takes = np.eye(lags.size, reach + 1 + 2 * NODES_OF_OCTAVE)
    for octave, here in enumerate(((lags > reach) & (lags <= 2 * reach), lags > 2 * reach)):
        start = reach + 1 + octave * NODES_OF_OCTAVE
        takes[here] = 0.0
        takes[here, start : start + NODES_OF_OCTAVE] = _polynomials(lags[here] / (reach << octave))
    twice, table = 2 * np.arange(reach + 1), np.zeros((reach + 1, takes.shape[1]))
    for n, weight in enumerate(np.correlate(filter.scaling, filter.scaling, "full") / 2.0, 1 - filter.length):
        table += weight * takes[np.abs(twice - n)]
    return freeze(table)


@lru_cache(maxsize=64)
def _far_step(filter: WaveletFilter, reach: int, octaves: int) -> NDArray[np.float64]:
    """Return the matrices (octaves, NODES, 3 NODES) of A_{i+1} in each octave from A_i in it and the next two
    octaves."""
    smooth = np.correlate(filter.scaling, filter.scaling, "full") / 2.0
    n = np.arange(1 - filter.length, filter.length)
    table = np.zeros((octaves, NODES_OF_OCTAVE, 3 * NODES_OF_OCTAVE))
    for p in range(octaves):
        # In units of the start of the octave.
        lags = 2.0 * (1.5 + 0.5 * _points())[:, None] - np.ldexp(n / reach, -p)
        octave = np.clip(np.floor(np.log2(lags)).astype(np.int64), 0, 2) if p < _SPILL else np.ones(lags.shape, int)
        rows = (
            _polynomials(np.ldexp(lags, -octave).ravel()).reshape(NODES_OF_OCTAVE, n.size, NODES_OF_OCTAVE)
            * smooth[:, None]
        )
        for k in range(3):
            table[p, :, k * NODES_OF_OCTAVE : (k + 1) * NODES_OF_OCTAVE] = np.sum(
                np.where((octave == k)[:, :, None], rows, 0.0), axis=1
            )
    return freeze(table)


def partial_sums(known: Callable[[Vector], Matrix], ends: NDArray[np.int64]) -> tuple[Matrix, Matrix]:
    """Compute the sums of f(k) and of k f(k) over k = 1 … m, m in `ends`, for functions f that are smooth in each
    octave, by a Gauss rule for sums over integers in each octave. `known` returns f (functions, n) at real lags."""
    first = known(np.arange(1.0, _SHORT + 1))
    moments = np.stack([first, first * np.arange(1.0, _SHORT + 1)])
    near = np.concatenate([np.zeros_like(moments[:, :, :1]), np.cumsum(moments, axis=2)], axis=2)
    octave = np.where(ends <= _SHORT, 0, np.frexp((ends - 0.5) / _SHORT)[1] - 1)
    starts = _SHORT << np.arange(int(octave.max(initial=0)))
    totals = np.concatenate([np.zeros((2, len(first), 1)), np.cumsum(_pieces(known, starts, starts), axis=2)], axis=2)
    start = _SHORT << octave
    total = near[:, :, np.minimum(ends, _SHORT)] + totals[:, :, octave]
    beyond = ends > _SHORT
    total[:, :, beyond] += _pieces(known, start[beyond], (ends - start)[beyond])
    return total[0], total[1]


def _pieces(
    known: Callable[[Vector], Matrix], starts: NDArray[np.int64], counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Compute the sums (2, functions, pieces) of f(k) and k f(k) over the `counts` integers after each of `starts`."""
    nodes, weights = _rules(counts.astype(np.float64))
    lags = starts[:, None] + 0.5 * (counts[:, None] + 1.0) + nodes
    values = known(lags.ravel())
    values = values.reshape(len(values), *lags.shape) * weights
    return np.stack([np.sum(values, axis=2), np.sum(values * lags, axis=2)])


def _rules(counts: Vector) -> tuple[Matrix, Matrix]:
    """Compute Gauss rules for sums over M consecutive integers, M from `counts` (n,): nodes about the centre and
    weights (n, NODES). Their Jacobi matrices have b_i = i² (M² − i²)/(4(4i² − 1)); b_M = 0 removes surplus nodes."""
    i = np.arange(1.0, NODES_OF_OCTAVE)
    b = np.maximum(i**2 * (counts[:, None] ** 2 - i**2) / (4.0 * (4.0 * i**2 - 1.0)), 0.0)
    matrices = np.zeros((counts.size, NODES_OF_OCTAVE, NODES_OF_OCTAVE))
    matrices[:, np.arange(1, NODES_OF_OCTAVE), np.arange(NODES_OF_OCTAVE - 1)] = np.sqrt(b)
    nodes, vectors = np.linalg.eigh(matrices)
    return np.asarray(nodes), np.asarray(counts[:, None] * vectors[:, 0, :] ** 2)


def spread(known: Vector, lags: NDArray[np.int64], reach: int) -> Vector:
    """Interpolate a function at integer lags ≥ 0 from its values at the lags of `spread_places`."""
    # Number of lags that are interpolated at once, so that they fit into the cache.
    batch = 2**14
    out, coefficients = np.empty(lags.size), known[reach + 1 :].reshape(-1, NODES_OF_OCTAVE) @ _coefficients().T
    for start in range(0, lags.size, batch):
        part, target = lags[start : start + batch], out[start : start + batch]
        where = np.where(part <= reach, -1, np.frexp((part - 0.5) / reach)[1] - 1)
        target[where < 0] = known[part[where < 0]]
        for p in np.unique(where[where >= 0]).tolist():
            here = where == p
            target[here] = chebyshev.chebval(2.0 * np.ldexp(part[here] / reach, -p) - 3.0, coefficients[p])
    return out


def spread_places(reach: int, octaves: int) -> Vector:
    """Return the lags 0 … T, with T = `reach`, and the Chebyshev points of the next `octaves` octaves."""
    starts = np.ldexp(float(reach), np.arange(octaves))
    return np.concatenate([np.arange(reach + 1.0), (starts[:, None] * (1.5 + 0.5 * _points())).ravel()])


def _points() -> Vector:
    return np.asarray(chebyshev.chebpts1(NODES_OF_OCTAVE))


@lru_cache(maxsize=1)
def _coefficients() -> Matrix:
    """Return the matrix that maps values at the Chebyshev points to the coefficients of Chebyshev polynomials."""
    table = chebyshev.chebvander(_points(), NODES_OF_OCTAVE - 1).T
    return np.asarray(table * np.where(np.arange(NODES_OF_OCTAVE) > 0, 2.0, 1.0)[:, None] / NODES_OF_OCTAVE)


def _polynomials(x: Vector) -> Matrix:
    """Return the matrix that maps values at the Chebyshev points of the octave [1, 2] to values at x."""
    return np.asarray(chebyshev.chebvander(2.0 * x - 3.0, NODES_OF_OCTAVE - 1) @ _coefficients())
