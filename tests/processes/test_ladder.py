"""Sums of Gauss-Markov processes for noise without a finite state: their Allan deviation, between the octaves too."""

import math

import numpy as np
import pytest
from scipy.special import gamma, kv

from gmwm import fit_ml
from gmwm.base.errors import FitWarning
from gmwm.theory.processes import FGN, FN, MAT, PL, Model
from gmwm.theory.processes.ladder import LADDER_OCTAVES, approximation_remarks, state_space_error
from gmwm.theory.statespace import _StateBlock
from tests.helpers import each, only

RATE = 100.0
CLUSTERS = np.unique(np.round(np.geomspace(1, 2**LADDER_OCTAVES, 60)).astype(int))


def allan_variance(space, clusters):
    """By sums over the blocks of the state space, for any number of samples."""
    values = []
    for n in clusters:
        block = _StateBlock.of(space, int(n))
        # E(second block sum − first block sum)² of two adjacent blocks from t = 0 on.
        start, weights = block.sum_of @ block.transition - block.sum_of, np.append(block.sum_of, -1.0)
        noise = weights @ block.noise @ weights + block.noise[-1, -1]
        values.append((start @ space.P0 @ start + noise + (start @ space.m0) ** 2) / (2 * n**2))
    return np.array(values)


def flicker_allan_variance(b2):
    """IEEE Std 952: flat at 2 ln 2/π B²."""
    return 2 * math.log(2) / math.pi * b2


def test_flicker_noise_is_within_one_percent_over_six_decades():
    found = np.sqrt(allan_variance(FN(b2=3.0).state_space(RATE), CLUSTERS) / flicker_allan_variance(3.0))
    assert CLUSTERS[-1] / CLUSTERS[0] > 4e6
    assert np.max(np.abs(found - 1)) < 0.006
    assert state_space_error(FN(b2=3.0), RATE) == pytest.approx(np.max(np.abs(found - 1)), abs=5e-4)


@pytest.mark.parametrize("alpha", [0.0, 1e-9, 0.1, 0.3, 0.7, 1.0, 1.4, 1.8, 1.99, 2.0])
def test_power_law_noise_is_within_one_percent(alpha):
    found = allan_variance(PL(alpha=alpha, nu2=0.5).state_space(RATE), CLUSTERS)
    # σ²(n) = 2 ν_1² n^(α − 1).
    assert np.max(np.abs(np.sqrt(found / CLUSTERS ** (alpha - 1.0)) - 1)) < 0.01


def test_fractional_gaussian_noise_is_power_law_noise():
    space, other = FGN(hurst=0.9, sigma2=1.0).state_space(RATE), PL(alpha=0.8, nu2=1 - 2**-0.2).state_space(RATE)
    assert np.allclose(space.Q, other.Q, rtol=1e-12)


@each("nu", [0.05, 0.3, 0.5, 0.51, 0.8, 1.2, 1.5, 2.2, 2.5, 4.7])
@each("beta", [1e-3, 1.0, 100.0])
def test_matern_autocovariance(nu, beta):
    """Against the Bessel function of the definition, relative to the variance."""
    space = MAT(beta=beta, nu=nu, sigma2=2.0).state_space(RATE)
    lags = np.unique(np.round(np.geomspace(1, max(20, 5 * RATE / beta), 30)).astype(int))
    x = beta * lags / RATE
    exact = 2.0 * 2 ** (1 - nu) / gamma(nu) * x**nu * kv(nu, x)
    found = space.autocovariance(np.append(0, lags))
    assert found[0] == pytest.approx(2.0, rel=1e-9)
    exact_state = nu % 1 == 0.5
    assert np.max(np.abs(found[1:] - exact)) < (1e-9 if exact_state else 0.03)
    assert state_space_error(MAT(beta=beta, nu=nu, sigma2=2.0), RATE) <= (0.0 if exact_state else 0.015)


def test_matrices_change_smoothly_with_the_exponent():
    at = np.arange(0.5, 1.5, 0.01)
    traces = [np.trace(PL(alpha=float(a), nu2=1.0).state_space(RATE).P0) for a in at]
    assert np.max(np.abs(np.diff(np.log(traces), 3))) < 1e-3


@pytest.mark.parametrize("process", [FN(b2=2.0), PL(alpha=0.5, nu2=1.0), MAT(beta=0.5, nu=0.8, sigma2=1.0)])
def test_continuous_time_has_the_same_allan_deviation_at_long_times(process):
    smooth = process.continuous(RATE)
    clusters = np.array([64, 500, 4000, 30_000])
    found = allan_variance(smooth.discrete(RATE), clusters)
    # The samples of a continuous process are not averaged, which matters for short times only.
    assert np.sqrt(found / process.allan_variance(clusters, RATE)) == pytest.approx(1.0, abs=0.015)


def dense(x, b2, sigma2):
    """Log-density of the differences of x, in which the unknown level has vanished, from their covariance matrix."""
    n = x.size
    lags = np.subtract.outer(np.arange(n), np.arange(n)).ravel()
    a = FN(b2=b2).generalised_covariance(lags, RATE).reshape(n, n) + sigma2 * np.eye(n)
    d = np.diff(np.eye(n), axis=0)
    e, covariance = d @ x, d @ a @ d.T
    return -0.5 * (np.linalg.slogdet(2 * math.pi * covariance)[1] + e @ np.linalg.solve(covariance, e))


def test_likelihood_ratios_of_flicker_noise_are_those_of_its_covariance_matrix():
    one, other = Model.parse("FN(b2=0.5) + WN(sigma2=0.2)"), Model.parse("FN(b2=0.3) + WN(sigma2=0.4)")
    x = one.simulate(400, RATE, 3)
    found = one.loglikelihood(x, RATE) - other.loglikelihood(x, RATE)
    wanted = dense(x, 0.5, 0.2) - dense(x, 0.3, 0.4)
    assert abs(wanted) > 3
    assert found == pytest.approx(wanted, abs=0.05)


@pytest.mark.slow
def test_likelihood_fits_flicker_and_power_law_noise():
    x = Model.parse("FN(b2=0.5) + WN(sigma2=0.2)").simulate(20_000, RATE, 5)
    with pytest.warns(FitWarning):
        fit = fit_ml("FN + WN", x, rate=RATE)
    assert [remark.code for remark in fit.remarks] == ["approximated"]
    errors = fit.standard_errors
    assert abs(fit.parameters["FN.b2"] - 0.5) < 4 * errors["FN.b2"] < 0.1
    with pytest.warns(FitWarning):
        fit = fit_ml("PL + WN", x, rate=RATE)
    assert abs(fit.parameters["PL.alpha"] - 1.0) < 4 * fit.standard_errors["PL.alpha"] < 0.4


def test_the_remark_names_the_terms_and_the_error():
    model = Model.parse("FN(b2=1.0) + WN(sigma2=1.0) + MAT(beta=1.0, nu=0.8, sigma2=1.0)")
    remark = only(approximation_remarks(model, RATE, "gyro_x"), "approximated:states")
    assert remark.facts["terms"] == ("FN", "MAT")
    assert remark.facts["error"].value < 1.5
    assert abs(remark.facts["longest"].value / (2**22 / RATE) - 1.0) < 0.005  # three digits
    assert approximation_remarks(Model.parse("WN(sigma2=1.0) + GM(beta=1.0, sigma2=1.0)"), RATE) == ()
    assert approximation_remarks(Model.parse("WN(sigma2=1.0) + MAT(beta=1.0, nu=1.5, sigma2=1.0)"), RATE) == ()
