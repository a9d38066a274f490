"""Regression inside the likelihood: generalised least squares against dense matrices, and coverage."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm.base.errors import OptionError
from gmwm.fitting.likelihood import LikelihoodFit
from gmwm.fitting.likelihood.estimator import Regressed
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record
from gmwm.measuring.regression.against import Asked
from tests.helpers import raises

N = 400
T = np.arange(N) / N
TEMPERATURE = 25 + 15 * (1 - np.exp(-5 * T)) + np.sin(12 * T)


def drawn(n=N, seed=1, walk=0.05):
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) + walk * np.cumsum(rng.normal(size=n))


def recording(gap, markov):
    x = drawn() + 0.2 * TEMPERATURE
    if markov:
        steps = np.random.default_rng(3).normal(size=N)
        x = drawn(walk=0.0) + 0.2 * TEMPERATURE + lfilter([1.0], [1.0, -0.95], 0.5 * steps)
    if not gap:
        return gmwm.Signal(x, 10.0), TEMPERATURE, np.ones(N, dtype=bool)
    there = np.ones(N, dtype=bool)
    there[150:190] = False
    return gmwm.Signal.from_missing(np.where(there, x, np.nan), 10.0), TEMPERATURE[there], there


def dense(model, there, columns, values):
    """Generalised least squares with an unknown level: estimate, covariance and restricted log-likelihood."""
    at = np.flatnonzero(there)
    lags = sum(process.generalised_covariance(np.arange(N), 10.0) for process in model.processes)
    sigma = lags[np.abs(np.subtract.outer(at, at))]
    D = np.diff(np.eye(at.size), axis=0)  # the level drops out
    root = np.linalg.cholesky(D @ sigma @ D.T)
    x, y = np.linalg.solve(root, D @ columns), np.linalg.solve(root, D @ values)
    gram = x.T @ x
    beta = np.linalg.solve(gram, x.T @ y)
    rest = y - x @ beta
    value = -np.sum(np.log(np.diag(root))) - np.linalg.slogdet(gram)[1] / 2 - rest @ rest / 2
    return beta, np.linalg.inv(gram), value


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize(
    ("model", "other"),
    [("WN + RW", "WN(sigma2=0.9) + RW(gamma2=1e-3)"), ("GM + WN", "GM(beta=0.4, sigma2=1.5) + WN(sigma2=0.9)")],
)
def test_estimate_covariance_and_likelihood_are_those_of_dense_matrices(model, other, gap):
    signal, temperature, there = recording(gap, "GM" in model)
    against = {"temperature:2,exact": temperature}
    found = gmwm.fit_ml(model, signal, against=against)
    own = found.regression
    away = temperature - own.references["temperature"]
    columns = np.column_stack([away, away**2])
    beta, covariance, value = dense(found.model, there, columns, signal.values)
    assert np.allclose(own.estimates, beta, rtol=1e-8)
    assert np.allclose(own.covariance, covariance, rtol=1e-8)
    other = gmwm.Model.parse(other)
    record = Regressed.of(signal, None, as_record(signal, None), Asked.of(against)).record
    values = [LikelihoodProblem(model, record).value(model)[0] for model in (found.model, other)]
    assert values[0] == pytest.approx(found.loglikelihood, rel=1e-12)
    assert values[0] - values[1] == pytest.approx(value - dense(other, there, columns, signal.values)[2], abs=1e-8)


@pytest.mark.slow
def test_intervals_of_slope_and_noise_cover():
    n, slopes, walks, scores = 4096, [], [], []
    temperature = np.interp(np.linspace(0, N - 1, n), np.arange(N), TEMPERATURE)
    for seed in range(24):
        x = drawn(n, seed, 0.01) + 0.2 * temperature
        found = gmwm.fit_ml("WN + RW", x, 10.0, against={"temperature": temperature})
        low, high = found.regression["temperature"].interval()
        slopes.append(low <= 0.2 <= high)
        low, high = found.confidence_intervals()["RW.gamma2"]
        walks.append(low <= 1e-4 <= high)
        scores.append((found.regression["temperature"].value - 0.2) / found.regression["temperature"].error)
    assert np.mean(slopes) > 0.8  # 20 of 24: probability of fewer 0.4 % at 95 %
    assert np.mean(walks) > 0.8
    assert np.std(scores) == pytest.approx(1, abs=0.5)


def test_the_likelihood_does_not_depend_on_the_unit_of_the_covariate():
    x = drawn() + 0.2 * TEMPERATURE
    one, other = (
        gmwm.fit_ml("WN + RW", x, 10.0, against={"covariate": 100 * scale + scale * TEMPERATURE}) for scale in (1, 1e3)
    )
    assert one.loglikelihood == pytest.approx(other.loglikelihood, abs=1e-6)
    assert one.regression["covariate"].value == pytest.approx(1e3 * other.regression["covariate"].value, rel=1e-6)


def test_a_fit_keeps_its_regression_and_the_curve_of_the_noise():
    x = drawn() + 5.0 * TEMPERATURE
    found = gmwm.fit_ml("WN + RW", x, 10.0, against={"temperature": TEMPERATURE})
    assert "temperature" in found.summary()
    again = LikelihoodFit.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.regression.summary() == found.regression.summary()
    clean = gmwm.wavelet_variance(drawn(), 10.0)
    assert np.allclose(found.wavelet_variance.variance[:5], clean.variance[:5], rtol=0.02)
    assert found.confidence_intervals(method="profile")["WN.sigma2"][0] > 0.5


def test_a_covariate_that_is_missing_is_one_error():
    with raises(OptionError, argument="against"):
        gmwm.fit_ml("WN", drawn(), 10.0, against="temperature")
