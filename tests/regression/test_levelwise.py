"""Level-wise least squares against dense matrices, with gaps."""

import numpy as np
import pytest

from gmwm import GM, RW, WN
from gmwm.regression.levelwise import Levelwise, haar, haar_adjoint

N = 200
NOISE = (WN(sigma2=1.0), GM(beta=0.02, sigma2=0.5), RW(gamma2=1e-3))


def lags_of(n):
    return sum(process.generalised_covariance(np.arange(n), 1.0) for process in NOISE)


def columns():
    t = np.arange(N) / N
    return np.column_stack([15 * (1 - np.exp(-5 * t)), np.sin(7 * t), t**2])


def gaps(*ranges):
    present = np.ones(N, dtype=bool)
    for first, last in ranges:
        present[first:last] = False
    return present


def dense_haar(present, level):
    """Rows of all Haar coefficients whose values are all present."""
    half, rows = 1 << (level - 1), []
    for t in range(N - 2 * half + 1):
        if present[t : t + 2 * half].all():
            row = np.zeros(N)
            row[t : t + half], row[t + half : t + 2 * half] = -1 / (2 * half), 1 / (2 * half)
            rows.append(row)
    return np.array(rows)


def dense(present, whole, weights, y):
    """Estimate, covariance and what is removed from each level, from matrices that are written out."""
    X, lags = columns(), lags_of(N)
    S = np.array([[lags[abs(a - b)] for a in range(N)] for b in range(N)])
    U = sum(w * dense_haar(present, j).T @ dense_haar(present, j) @ X for j, w in enumerate(weights, 1) if w > 0)
    B = np.linalg.inv(X.T @ U) @ U.T
    left, removed = np.eye(N) - X @ B, []
    for j in range(1, len(weights) + 1):
        H = dense_haar(whole, j)
        H = H if len(H) else dense_haar(present, j)
        removed.append((np.trace(H @ S @ H.T) - np.trace(H @ left @ S @ left.T @ H.T)) / len(H))
    return B @ np.where(present, y, 0.0), B @ S @ B.T, np.array(removed)


GAPS = [
    (gaps(), gaps()),
    (gaps((70, 83)), gaps((70, 83))),
    (gaps((70, 83), (120, 121)), gaps((60, 90), (120, 121), (10, 12))),
]


@pytest.mark.parametrize(("present", "whole"), GAPS, ids=["none", "one", "two"])
@pytest.mark.parametrize("skipped", [0, 2])
def test_estimate_covariance_and_bias_are_those_of_dense_matrices(present, whole, skipped):
    y = np.random.default_rng(1).normal(size=N).cumsum()
    design = Levelwise(columns(), present, whole)
    weights = 1 / (2.0 ** np.arange(1, design.levels + 1) * np.linspace(1, 3, design.levels))
    weights[:skipped] = 0
    under = design.under(weights)
    beta, covariance, removed = dense(present, whole, weights, y)
    spread = under.spread(lags_of(N))
    assert np.allclose(under.estimate(y), beta, rtol=1e-10, atol=0)
    assert np.allclose(under.rows.T @ columns(), np.eye(3), atol=1e-10)
    assert np.allclose(under.covariances(lags_of(N)[None])[0], covariance, rtol=1e-10, atol=0)
    assert np.allclose(under.rows.T @ spread, covariance, rtol=1e-10, atol=0)
    assert np.allclose(under.removed(spread), removed, rtol=1e-10, atol=1e-12)


def test_an_offset_of_each_segment_changes_nothing():
    present = gaps((70, 83))
    y = np.random.default_rng(2).normal(size=N)
    under = Levelwise(columns(), present, present).under(1 / 2.0 ** np.arange(1, 7))
    moved = y + np.where(np.arange(N) < 75, 100.0, -50.0)
    assert np.allclose(under.estimate(moved), under.estimate(y), atol=1e-10)


def test_a_column_that_is_a_multiple_of_another_has_an_infinite_condition():
    own = columns()[:, :1]
    under = Levelwise(np.hstack([own, 2 * own]), gaps(), gaps()).under(np.ones(7))
    assert under.condition > 1e12


@pytest.mark.parametrize("level", [1, 4])
def test_the_adjoint_is_the_transpose(level):
    x = np.random.default_rng(3).normal(size=(N, 2))
    d = np.random.default_rng(4).normal(size=haar(x, level).shape)
    assert np.allclose(np.sum(haar(x, level) * d), np.sum(x * haar_adjoint(d, N, level)))
