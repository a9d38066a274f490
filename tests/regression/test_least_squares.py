"""Generalised least squares against dense matrices, with gaps."""

import numpy as np
import pytest

from gmwm import GM, RW, WN
from gmwm.measuring.regression.least_squares import RegressionDesign

N = 200
NOISE = (WN(sigma2=1.0), GM(beta=0.02, sigma2=0.5), RW(gamma2=1e-3))


def lags_of(n):
    return sum(process.generalised_covariance(np.arange(n), 1.0) for process in NOISE)


def density(frequencies):
    return sum(process.psd(frequencies, 1.0) for process in NOISE)


def columns():
    t = np.arange(N) / N
    return np.column_stack([15 * (1 - np.exp(-5 * t)), np.sin(7 * t), t**2])


def gaps(*ranges):
    present = np.ones(N, dtype=bool)
    for first, last in ranges:
        present[first:last] = False
    return present


def dense_haar(present, level, least=1.0):
    """Rows of all Haar coefficients that have at least a share of the values of both halves."""
    half, rows = 1 << (level - 1), []
    for t in range(N - 2 * half + 1):
        parts = [slice(t, t + half), slice(t + half, t + 2 * half)]
        if all(present[part].mean() >= least for part in parts):
            row = np.zeros(N)
            for part, sign in zip(parts, (-1, 1), strict=True):
                row[part] = sign * present[part] / (2 * present[part].sum())
            rows.append(row)
    return np.array(rows)


def dense_cosines(first, last):
    """Rows of the orthonormal cosine transform of the values from `first` to `last`, without their mean."""
    size = last - first
    at, k = np.arange(size) + 0.5, np.arange(1, size)
    rows = np.zeros((size - 1, N))
    rows[:, first:last] = np.sqrt(2 / size) * np.cos(np.pi * np.outer(k, at) / size)
    return rows, k / (2 * size)


def dense(design, highest, y):
    """Estimate, covariance and what is removed from each level, from matrices that are written out."""
    X, lags = columns(), lags_of(N)
    S = np.array([[lags[abs(a - b)] for a in range(N)] for b in range(N)])
    U = np.zeros_like(X)
    for first, last in design.spans:
        rows, at = dense_cosines(first, last)
        held = np.flatnonzero(design.present[first:last]) + first
        if held.size == last - first:
            U += rows.T @ (np.where(at <= highest, 1 / density(at), 0.0)[:, None] * (rows @ X))
            continue
        # Generalised least squares at the present times, with one offset.
        weights = 1 / density(at)
        weights = np.where(at <= highest, weights, 1e-3 * weights[at <= highest][-1])
        best = np.linalg.pinv((rows[:, held].T / weights) @ rows[:, held] + np.ones((held.size, held.size)) * 1e-3)
        ones = np.ones(held.size)
        best -= np.outer(best @ ones, ones @ best) / (ones @ best @ ones)
        U[held] = best @ X[held]
    B = np.linalg.inv(X.T @ U) @ U.T
    left, removed = np.eye(N) - X @ B, []
    for j in range(1, design.levels + 1):
        H = dense_haar(design.whole, j)
        H = H if len(H) else dense_haar(design.present, j)
        H = H if len(H) else dense_haar(design.present, j, least=0.5)
        removed.append((np.trace(H @ S @ H.T) - np.trace(H @ left @ S @ left.T @ H.T)) / len(H))
    return B @ np.where(design.present, y, 0.0), B @ S @ B.T, np.array(removed)


GAPS = [
    (gaps(), gaps()),
    (gaps((70, 83)), gaps((70, 83))),
    (gaps((70, 83), (120, 121)), gaps((60, 90), (120, 121), (10, 12))),
]


@pytest.mark.slow
@pytest.mark.parametrize(("present", "whole"), GAPS, ids=["none", "one", "two"])
@pytest.mark.parametrize("highest", [0.5, 0.125])
@pytest.mark.parametrize("offsets", [False, True], ids=["joint", "offsets"])
def test_estimate_covariance_and_bias_are_those_of_dense_matrices(present, whole, highest, offsets):
    y = np.random.default_rng(1).normal(size=N).cumsum()
    design = RegressionDesign(columns(), present, whole, offsets)
    under = design.under(design.weights(density, highest))
    beta, covariance, removed = dense(design, highest, y)
    spread = under.covariance_rows(lags_of(N))
    # A recording with gaps is solved by iteration.
    digits = 1e-10 if offsets or present.all() else 1e-5
    assert np.allclose(under.estimate(y), beta, rtol=digits, atol=0)
    assert np.allclose(under.rows.T @ columns(), np.eye(3), atol=digits)
    assert np.allclose(under.covariances(lags_of(N)[None])[0], covariance, rtol=digits, atol=0)
    assert np.allclose(under.rows.T @ spread, covariance, rtol=digits, atol=0)
    assert np.allclose(under.removed_variance(spread), removed, rtol=digits, atol=1e-2 * digits)


def test_one_offset_is_as_precise_as_generalised_least_squares_and_sees_a_step_in_a_gap():
    rng = np.random.default_rng(2)
    present = rng.random(N) > 0.2
    present[80:100] = False
    X = np.column_stack([np.arange(N) / N, np.arange(N) >= 90])
    lags = lags_of(N)
    held = np.flatnonzero(present)
    S = lags[np.abs(held[:, None] - held)]
    D = np.diff(np.eye(held.size), axis=0)
    best = np.linalg.inv((D @ X[held]).T @ np.linalg.solve(D @ S @ D.T, D @ X[held]))
    errors = []
    for offsets in (False, True):
        design = RegressionDesign(X.astype(float), present, present, offsets)
        under = design.under(design.weights(density))
        errors.append(
            under.condition if offsets else np.sqrt(np.diag(under.covariances(lags[None])[0]) / np.diag(best))
        )
    assert np.all(errors[0] < 1.05)
    assert errors[1] == np.inf


@pytest.mark.parametrize(
    ("noise", "more"),
    [
        ((WN(sigma2=1.0),), 1 + 1e-9),
        ((WN(sigma2=1.0), RW(gamma2=1e-3)), 1 + 1e-9),
        ((WN(sigma2=1.0), RW(gamma2=1.0)), 1 + 1e-9),
        (NOISE, 1.03),
        ((GM(beta=0.05, sigma2=1.0),), 1.03),
    ],
)
def test_standard_errors_are_those_of_generalised_least_squares(noise, more):
    lags = sum(process.generalised_covariance(np.arange(N), 1.0) for process in noise)
    D = np.diff(np.eye(N), axis=0)
    S = np.array([[lags[abs(a - b)] for a in range(N)] for b in range(N)])
    X = D @ columns()
    best = np.linalg.inv(X.T @ np.linalg.solve(D @ S @ D.T, X))
    design = RegressionDesign(columns(), gaps(), gaps())
    under = design.under(design.weights(lambda f: sum(process.psd(f, 1.0) for process in noise)))
    ratio = np.sqrt(np.diag(under.covariances(lags[None])[0]) / np.diag(best))
    assert np.all(ratio >= 1 - 1e-9)
    assert np.all(ratio <= more)


def test_an_offset_of_each_segment_changes_nothing():
    present = gaps((70, 83))
    y = np.random.default_rng(2).normal(size=N)
    design = RegressionDesign(columns(), present, present, offsets=True)
    under = design.under(design.weights(density))
    moved = y + np.where(np.arange(N) < 75, 100.0, -50.0)
    assert np.allclose(under.estimate(moved), under.estimate(y), atol=1e-10)


def test_a_column_that_is_a_multiple_of_another_has_an_infinite_condition():
    own = columns()[:, :1]
    design = RegressionDesign(np.hstack([own, 2 * own]), gaps(), gaps())
    assert design.under(design.weights(density)).condition > 1e12
