"""A fit near its estimate, where the curve is linear in the parameters: their covariance, and what they cannot fit."""

from __future__ import annotations

import numpy as np

from gmwm._arrays import Matrix, Vector
from gmwm.estimation.weighting import square_root

COLLINEAR = 1e-9
"""Relative singular value of the Jacobian below which a direction of the parameters is not determined. Pinned by
tests/inference/test_plan.py: parameters with the same effect on the curve have infinite errors."""


def relative_covariance(slopes: Matrix, matrix: Matrix, wavelet: Matrix) -> Matrix:
    """B V Bᵀ (p, p) for a Jacobian D (J, p); infinite for parameters that the Jacobian does not determine."""
    size = slopes.shape[1]
    if size == 0:
        return np.zeros((0, 0))
    root = square_root(matrix)
    weighted = root @ slopes
    length = np.linalg.norm(weighted, axis=0)
    seen = length > 0
    left, strength, right = np.linalg.svd(weighted[:, seen] / length[seen], full_matrices=False)
    clear = strength > COLLINEAR * strength.max(initial=0.0)
    gain = np.zeros((size, slopes.shape[0]))
    gain[seen] = (right[clear].T / strength[clear]) @ left[:, clear].T @ root / length[seen, None]
    result = np.asarray(gain @ wavelet @ gain.T)
    lost = ~seen
    lost[seen] = np.any(np.abs(right[~clear]) > 1e-6, axis=0) if np.any(~clear) else False
    result[lost] = result[:, lost] = 0.0
    result[lost, lost] = np.inf
    return (result + result.T) / 2


def unexplained(left: Vector, slopes: Matrix) -> tuple[float, int]:
    """Squared length of a vector (J,) without its part in the span of some columns (J, p), and the rank of these."""
    length = np.linalg.norm(slopes, axis=0)
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    clear = strength > COLLINEAR * strength.max(initial=0.0)
    taken = axes[:, clear].T @ left
    return float(left @ left - taken @ taken), int(np.count_nonzero(clear))
