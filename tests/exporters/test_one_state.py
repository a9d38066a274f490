"""White noise and a Gauss-Markov bias: the errors that a filter with them states, by formulas of this file."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.showing.exporters.one_state import Predictions, fit_biases
from gmwm.showing.exporters.two_states import LONGEST_AVERAGING_S, Curve
from gmwm.theory.processes import Model

RATE = 10.0
TIMES = (1.0, 10.0, 30.0, 100.0)
SCALES = [10 ** (k / 2) for k in range(-1, 8)]  # correlation times (s) of terms whose sum is flicker noise
NOISES = {
    "white noise and flicker noise": [(0.0144, time) for time in SCALES],
    "weak flicker noise": [(0.005, time) for time in SCALES],
    "a Gauss-Markov term": [(0.25, 15.0)],
    "a slow Gauss-Markov term": [(0.04, 300.0)],
    "two Gauss-Markov terms": [(0.06, 20.0), (0.09, 400.0)],
    "nearly a random walk": [(0.05**2 * 2e4 / 2, 2e4)],
}
"""Variances and correlation times (s) beside white noise of the density 1."""


def stated_over_real(terms, white, sigma, time, seconds):
    """The filter's own covariance, and the quadratic form of its weights with the covariance of the noise."""
    keep, r = math.exp(-1 / (time * RATE)), white**2 * RATE
    q, p = sigma**2 * (1 - keep**2), sigma**2
    for _ in range(20_000):
        p = keep**2 * p * r / (p + r) + q
    gain, n = p / (p + r), round(seconds * RATE)
    ahead = np.mean(keep ** np.arange(1, n + 1))
    steps = [(keep ** np.arange(k)).sum() / n for k in range(1, n + 1)]
    stated = ahead**2 * p * (1 - gain) + q * np.sum(np.square(steps)) + r / n
    memory = ((1 - gain) * keep) ** np.arange(round(30 / (1 - (1 - gain) * keep)))
    weights = np.r_[-ahead * gain * memory[::-1], np.full(n, 1 / n)]
    real = RATE * weights @ weights
    for variance, slow in terms:
        real += variance * weights @ (2 * lfilter([1], [1, -math.exp(-1 / (slow * RATE))], weights) - weights)
    return math.sqrt(stated / real)


@pytest.mark.parametrize("name", NOISES)
def test_a_filter_states_the_errors_that_it_makes(name):
    """With N of the table, over 1 to 100 s, and also over times that the fit does not use."""
    terms = NOISES[name]
    model = Model.parse(" + ".join([f"WN(sigma2={RATE})", *(f"GM(beta={1 / t!r}, sigma2={v!r})" for v, t in terms)]))
    clusters = np.unique(np.round(np.geomspace(1.0, LONGEST_AVERAGING_S, 25) * RATE).astype(np.int64))
    curve = Curve(clusters, RATE, model.allan_variance(clusters, RATE))
    white = filter_numbers(model.processes, RATE).N
    noise = Predictions.of(curve, model.processes, 1.0, LONGEST_AVERAGING_S)
    (sigma,), time = fit_biases([noise], 1.0, LONGEST_AVERAGING_S)
    claims = [stated_over_real(terms, white, sigma, time, seconds) for seconds in TIMES]
    assert claims[0] == pytest.approx(1, abs=0.02)
    assert claims[1:3] == pytest.approx([1, 1], abs=0.04)
    assert claims[3] == pytest.approx(1, abs=0.15)
    assert claims[:2] == pytest.approx(noise.claims(sigma, time)[:2], rel=0.03)
