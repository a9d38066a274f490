"""The wavelet variances and cross-covariances of d signals as one vector of moments, and their exact covariance.

For signals X = Σ_p L_p u_p of independent processes u_p with wavelet variances κ_pj and Σ_p = L_p L_pᵀ, the covariance
matrix of the coefficients at level j is Γ_j = Σ_p κ_pj Σ_p. Its estimates have the covariances

    Cov(γ̂_ab,j, γ̂_cd,k) = Σ_p Σ_q (Σp_ac Σq_bd + Σp_ad Σq_bc) G_pq,jk,   G_pq,jk = Σ_u n(u) κ_p(u) κ_q(u) / (M_j M_k),

with κ_p(u) = Cov(W_j,t, W_k,t+u), n(u) pairs of coefficients at lag u, and M_j coefficients of level j.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.covariance import gaussian, nodes
from gmwm.measuring.covariance.api import covariance
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.segments import pooled
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model

Indices = NDArray[np.int64]


@lru_cache(maxsize=32)
def entries(d: int) -> tuple[Indices, Indices]:
    """Return the rows a and columns b of the d(d + 1)/2 entries with a ≤ b of a symmetric matrix."""
    rows, columns = np.triu_indices(d)
    return rows.astype(np.int64), columns.astype(np.int64)


def stack(matrices: Matrix) -> Vector:
    """Return matrices Γ (J, d, d) as a vector of moments: all levels of entry (0, 0), then of (0, 1), and so on."""
    rows, columns = entries(matrices.shape[-1])
    return np.ascontiguousarray(matrices[:, rows, columns].T).ravel()


def symmetric(values: Matrix, d: int) -> Matrix:
    """Return symmetric matrices (…, d, d) with the given entries (…, d(d + 1)/2)."""
    rows, columns = entries(d)
    out = np.empty((*values.shape[:-1], d, d))
    out[..., rows, columns] = values
    out[..., columns, rows] = values
    return out


def lag_products(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G (P, P, J, J) of processes at unit scale."""
    if design.filled:
        raise NotImplementedError("a design without filled samples is expected")
    count, size = len(processes), design.levels.size
    if design.segments:
        out = np.zeros((count, count, size, size))
        for p in range(count):
            for q in range(p + 1):
                pair = (processes[p], processes[q])
                product = pooled(design, lambda segment, pair=pair: lag_products(pair, segment)[0, 1])  # type: ignore[misc]
                out[p, q] = out[q, p] = product
        return out
    if not all(gaussian.knows(Model((process,)), design) for process in processes):
        return _by_polarisation(processes, design)
    return _over_lags(processes, design)


def _over_lags(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G as a sum over the same lags that the covariance of the wavelet variance of one signal uses."""
    at, weight, starts = nodes.lags(list(processes), design, diagonal=False)
    coarser, finer = np.tril_indices(design.levels.size)
    half, counts = np.ldexp(1.0, design.levels - 1), design.counts.astype(np.float64)
    scale = (4 * half[finer] * half[coarser]) ** 2 * counts[finer] * counts[coarser]
    shapes = [process.coefficient_covariance(at, design.rate) for process in processes]
    count, size = len(processes), design.levels.size
    out = np.empty((count, count, size, size))
    for p, shape in enumerate(shapes):
        weighted = weight * shape
        for q in range(p + 1):
            products = np.add.reduceat(weighted * shapes[q], starts) / scale
            for r, s in ((p, q), (q, p)):
                out[r, s, finer, coarser] = out[r, s, coarser, finer] = products
    return out


def _by_polarisation(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G from covariances V of wavelet variances: V_{p+q} = V_p + V_q + 4 G_pq, and V_p = 2 G_pp."""
    singles = [covariance(Model((process,)), design) for process in processes]
    count, size = len(processes), design.levels.size
    out = np.empty((count, count, size, size))
    for p, process in enumerate(processes):
        out[p, p] = singles[p] / 2
        for q in range(p):
            both = covariance(Model((process, processes[q])), design)
            out[p, q] = out[q, p] = (both - singles[p] - singles[q]) / 4
    return out


def moment_covariance(sigmas: Matrix, products: Matrix) -> Matrix:
    """Return the covariance V (n, n) of the stacked moments for matrices Σ (P, d, d) and products G (P, P, J, J)."""
    d, size = sigmas.shape[-1], products.shape[-1]
    rows, columns = entries(d)
    count = rows.size
    out = np.empty((count, size, count, size))
    flat = products.reshape(len(sigmas) ** 2, size * size)
    for k in range(count):
        a, b = rows[k], columns[k]
        c, e = rows[: k + 1], columns[: k + 1]
        pairs = sigmas[:, None, a, c] * sigmas[None, :, b, e] + sigmas[:, None, a, e] * sigmas[None, :, b, c]
        block = (pairs.reshape(len(flat), -1).T @ flat).reshape(-1, size, size)
        out[k, :, : k + 1] = block.transpose(1, 0, 2)
        out[: k + 1, :, k] = block.transpose(0, 2, 1)
    return out.reshape(count * size, count * size)
