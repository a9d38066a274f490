"""The covariance of all wavelet variances and cross-covariances, against brute force and against one signal."""

import numpy as np
import pytest

import gmwm
from gmwm.applications.several.matrices import _by_polarisation, lag_products, moment_covariance, stack, symmetric
from gmwm.measuring.covariance.design import Design

PROCESSES = (gmwm.WN(sigma2=1.0), gmwm.RW(gamma2=1.0), gmwm.GM(beta=0.05, sigma2=1.0), gmwm.QN(q2=1.0))


def sigmas(d, seed=0):
    rng = np.random.default_rng(seed)
    roots = rng.standard_normal((len(PROCESSES), d, d))
    return np.array([(root @ root.T) * scale for root, scale in zip(roots, (1.0, 0.02, 1.0, 1.0), strict=True)])


@pytest.mark.parametrize("segments", [(), (40, 56)])
def test_the_covariance_is_that_of_quadratic_forms(segments):
    n, d = 96, 2
    design = Design(np.arange(1, 6), n, 1.0, segments=segments)
    t = np.arange(n)
    lag = np.abs(np.subtract.outer(t, t))
    own = [np.eye(n), np.minimum.outer(t + 1.0, t + 1.0), np.exp(-0.05 * lag),
           2.0 * (lag == 0) - 1.0 * (lag == 1)]  # fmt: skip
    pieces = np.zeros(n, dtype=int) if not segments else np.repeat([0, 1], segments)
    # Segments count as independent.
    apart = pieces[:, None] == pieces[None, :]
    if segments:
        own[1] = np.where(apart, np.minimum.outer(t + 1.0, t + 1.0), 0.0)
    full = sum(np.kron(sigma, kernel * apart) for sigma, kernel in zip(sigmas(d), own, strict=True))
    forms = []
    for a, b in ((0, 0), (0, 1), (1, 1)):
        for level in design.levels:
            half = 1 << (level - 1)
            rows = [r for r in range(n - 2 * half + 1) if pieces[r] == pieces[r + 2 * half - 1]]
            w = np.zeros((len(rows), n))
            for k, r in enumerate(rows):
                w[k, r : r + half], w[k, r + half : r + 2 * half] = -1, 1
            e = np.zeros((d, d))
            e[a, b] += 0.5
            e[b, a] += 0.5
            forms.append(np.kron(e, w.T @ w / 4.0**level / len(rows)) @ full)
    expected = np.array([[2 * np.sum(x * y.T) for y in forms] for x in forms])
    found = moment_covariance(sigmas(d), lag_products(PROCESSES, design))
    size = np.sqrt(np.diag(expected))
    assert np.abs((found - expected) / np.outer(size, size)).max() < 1e-8
    shapes = np.array([p.wavelet_variance(design.levels, 1.0) for p in PROCESSES])
    means = stack(np.einsum("pj,pab->jab", shapes, sigmas(d)))
    assert np.allclose(means, [np.trace(form) for form in forms], rtol=1e-9, atol=1e-12)


def test_one_signal_has_the_covariance_of_the_package():
    design = Design(np.arange(1, 14), 10_000, 100.0)
    own = sigmas(1)[:3]
    found = moment_covariance(own, lag_products(PROCESSES[:3], design))
    model = "WN({!r}) + RW({!r}) + GM(0.05, {!r})".format(*map(float, own.ravel()))
    assert np.allclose(found, gmwm.covariance.wavelet_covariance(model, 10_000, 100.0), rtol=1e-13)


def test_sums_of_two_processes_give_the_same_products():
    design = Design(np.arange(1, 5), 200, 1.0)
    pair = (gmwm.WN(sigma2=1.0), gmwm.GM(beta=0.3, sigma2=1.0))
    assert np.allclose(_by_polarisation(pair, design), lag_products(pair, design), rtol=1e-9)


def test_symmetric_matrices_and_their_entries():
    matrices = sigmas(3)
    rows, columns = np.triu_indices(3)
    assert np.array_equal(symmetric(matrices[:, rows, columns], 3), matrices)
