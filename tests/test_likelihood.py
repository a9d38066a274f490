"""The yardstick of the study of efficiency: a wrong likelihood would flatter or shame the wavelet moments."""

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.stats import multivariate_normal

from gmwm import GM, WN
from validation.likelihood import (
    concentrated,
    fisher_errors,
    haar_gains,
    midpoints,
    moment_errors,
    most_likely,
    octave_gains,
    spectrum,
)

RATE = 100.0


@pytest.mark.parametrize("samples", [1, 2, 300])
@pytest.mark.parametrize(("decay", "ratio"), [(0.3, 0.5), (0.01, 3.0), (2.0, 0.1), (1e-3, 0.01), (1e-4, 50.0)])
def test_likelihood_is_that_of_the_multivariate_normal(samples, decay, ratio):
    x = 3.0 * np.random.default_rng(1).standard_normal(samples)
    value, scale = concentrated(x, decay, ratio)
    shape = ratio * np.exp(-decay * toeplitz(np.arange(samples))) + np.eye(samples)
    assert scale == pytest.approx(x @ np.linalg.solve(shape, x) / samples, rel=1e-10)
    dense = multivariate_normal(np.zeros(samples), scale * shape).logpdf(x)
    assert value == pytest.approx(-2 * dense / samples - np.log(2 * np.pi) - 1, rel=1e-10)


def test_the_largest_likelihood_is_found_from_elsewhere_too():
    x = (GM(beta=10.0, sigma2=2e-6) + WN(sigma2=4e-6)).simulate(4000, RATE, rng=2)
    found = most_likely(x, RATE, (10.0, 2e-6, 4e-6))
    assert most_likely(x, RATE, (2.0, 2e-5, 1e-6)) == pytest.approx(found, rel=1e-3)
    top = concentrated(x, found[0] / RATE, found[1] / found[2])[0]
    for step in (0.9, 1.1):
        assert concentrated(x, step * found[0] / RATE, found[1] / found[2])[0] > top
        assert concentrated(x, found[0] / RATE, step * found[1] / found[2])[0] > top


def test_spectrum_is_the_process_s_own_and_scores_are_its_derivatives():
    f = midpoints(256)
    at = np.array([0.05, 3.0, 0.7])
    density, scores = spectrum(*at, f)
    model = GM(beta=at[0] * RATE, sigma2=at[1]) + WN(sigma2=at[2])
    np.testing.assert_allclose(density, RATE * model.psd(f * RATE, RATE), rtol=1e-12)
    step = 1e-5 * np.eye(3)
    for k in range(3):
        high, low = (np.log(spectrum(*(at * np.exp(s * step[k])), f)[0]) for s in (1, -1))
        np.testing.assert_allclose(scores[k], (high - low) / 2e-5, atol=1e-9)


@pytest.mark.slow
def test_likelihood_attains_the_cramer_rao_bound():
    truth, samples, draws = (20.0, 2e-5, 4e-6), 3000, 60
    model = GM(beta=truth[0], sigma2=truth[1]) + WN(sigma2=truth[2])
    paths = model.simulate(samples, RATE, np.random.default_rng(3), draws)
    errors = np.log([most_likely(x, RATE, truth) for x in paths]) - np.log(truth)
    ratio = np.sqrt(np.mean(errors**2, axis=0)) / fisher_errors(truth[0] / RATE, *truth[1:], samples)
    # A root mean square of n draws has a relative standard error of 1/√(2n).
    assert np.all(np.abs(ratio - 1) < 4 / np.sqrt(2 * draws)), ratio


def test_no_moments_beat_the_bound_and_more_moments_are_no_worse():
    at = (0.1, 2e-6, 4e-6)
    bound = fisher_errors(*at, 10_000)
    count = 1 << 14
    dyadic = moment_errors(*at, 10_000, haar_gains(2 ** np.arange(11), count))
    denser = moment_errors(*at, 10_000, haar_gains(np.unique(2.0 ** (np.arange(21) / 2)).astype(np.int64), count))
    octaves = moment_errors(*at, 10_000, octave_gains(11, count))
    assert np.all(bound <= denser)
    assert np.all(denser <= dyadic)
    assert np.all(bound < octaves)
    # Haar gains are those of ν²: half the noise at level 1, a quarter at level 2.
    np.testing.assert_allclose(haar_gains(np.array([1, 2])).mean(axis=1), [0.5, 0.25])


def test_the_bound_for_a_long_record_holds_for_a_short_one():
    decay, marginal, noise, samples = 0.1, 2.0, 0.4, 400
    lags = toeplitz(np.arange(samples))
    markov, white = marginal * np.exp(-decay * lags), noise * np.eye(samples)
    slopes = [np.linalg.solve(markov + white, c) for c in (-decay * lags * markov, markov, white)]
    information = np.array([[0.5 * np.sum(a * b.T) for a in slopes] for b in slopes])
    exact = np.sqrt(np.diag(np.linalg.inv(information)))
    np.testing.assert_allclose(fisher_errors(decay, marginal, noise, samples), exact, rtol=0.03)
