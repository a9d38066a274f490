"""Robust fits: the robust curve in, its weights, and what contradicts it."""

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN
from gmwm.fitting.estimation.weighting import sampling_variance
from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.mixture import smoothed
from gmwm.measuring.covariance.robust import rounding_bias
from tests.helpers import raises

RATE = 100.0


def spoilt(n=50_000, seed=1):
    """White noise on a random walk with forty samples of a thousand standard deviations."""
    rng = np.random.default_rng(seed)
    x = (WN(sigma2=4e-6) + RW(gamma2=1e-10)).simulate(n, RATE, rng)
    return np.where(np.arange(n) % 1250 == 600, 2.0, x)


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_robust_fit_of_a_signal_is_that_of_its_robust_variance():
    x = spoilt()
    wv = gmwm.wavelet_variance(x, RATE, robust=True, efficiency=0.8)
    direct = gmwm.fit(WN() + RW(), x, RATE, robust=True, efficiency=0.8)
    assert direct.parameters == gmwm.fit(WN() + RW(), wv).parameters
    assert direct.parameters == gmwm.fit(WN() + RW(), wv, robust=True).parameters
    assert direct.wavelet_variance.efficiency == 0.8
    assert "robust, efficiency 0.8" in direct.summary()
    assert direct.to_dict()["wavelet_variance"]["robust"] is True


def test_outliers_reach_the_classical_fit_only():
    x = spoilt()
    robust = gmwm.fit(WN(), x, RATE, robust=True, efficiency=0.9).parameters["WN.sigma2"]
    classical = gmwm.fit(WN(), x, RATE).parameters["WN.sigma2"]
    assert robust == pytest.approx(4e-6, rel=0.05)
    assert classical > 100 * robust


def test_weights_are_those_of_the_robust_estimate():
    x = np.random.default_rng(2).normal(size=20_000)
    wv = gmwm.wavelet_variance(x, RATE, robust=True)
    expected = 2 * smoothed(wv) ** 2 / (0.6 * np.maximum(wv.counts / wv.scales, 1))
    np.testing.assert_allclose(sampling_variance(wv), expected, rtol=1e-14)


def test_weights_of_a_fit_are_those_of_the_robust_estimate():
    x = np.random.default_rng(2).normal(size=20_000)
    wv = gmwm.wavelet_variance(x, RATE, robust=True)
    fit = gmwm.fit(WN(), wv)
    inflation = 1 / np.diag(fit.weighting_matrix) / np.diag(gmwm.covariance.wavelet_covariance(fit.model, 20_000, RATE))
    # Less than 1/0.6: neighbouring coefficients are correlated.
    np.testing.assert_allclose(inflation[:8], [1.49, 1.40, 1.33, 1.30, 1.29, 1.28, 1.28, 1.28], rtol=0.06)


@pytest.mark.slow
def test_sampling_variance_is_a_safe_bound():
    # Of white noise, levels 1 to 6: the scatter of 300 recordings against the bound, which correlation keeps below.
    curves = [
        gmwm.wavelet_variance(np.random.default_rng(seed).normal(size=4096), RATE, levels=6, robust=True)
        for seed in range(300)
    ]
    scatter = np.var([wv.variance for wv in curves], axis=0)
    bound = np.mean([sampling_variance(wv) for wv in curves], axis=0)
    assert np.all(scatter < bound)
    assert np.all(scatter > 0.2 * bound)


def test_asking_for_what_the_data_are_not():
    x = np.random.default_rng(3).normal(size=5000)
    classical = gmwm.wavelet_variance(x, RATE)
    with raises(gmwm.errors.OptionError, "classical", argument="robust", got=True):
        gmwm.fit(WN(), classical, robust=True)
    robust = gmwm.wavelet_variance(x, RATE, robust=True, efficiency=0.8)
    with raises(gmwm.errors.OptionError, 0.8, argument="efficiency", got=0.9):
        gmwm.fit(WN(), robust, robust=True, efficiency=0.9)
    with raises(gmwm.errors.OptionError, "efficiency", 1.0):
        gmwm.fit(WN(), x, RATE, robust=True, efficiency=1.0)


def test_a_level_that_is_zero_cannot_be_weighed():
    x = np.round(np.random.default_rng(4).normal(0, 0.2, size=5000))
    with raises(gmwm.errors.DataError, "zero at level 1", advises=["robust=False"]):
        gmwm.fit(WN(), x, RATE, robust=True)
    assert gmwm.fit(WN(), x, RATE, robust=True, weighting="identity").parameters["WN.sigma2"] > 0


def test_robust_and_classical_agree_on_clean_data():
    truth = GM(beta=1.0, sigma2=1e-6) + WN(sigma2=4e-6)
    x = truth.simulate(200_000, RATE, np.random.default_rng(5))
    one, other = (gmwm.fit(GM() + WN(), x, RATE, robust=r).parameters for r in (False, True))
    assert one["WN.sigma2"] == pytest.approx(other["WN.sigma2"], rel=0.02)
    assert one["GM.beta"] == pytest.approx(other["GM.beta"], rel=0.2)


def test_an_upper_limit_is_not_below_the_estimate_beside_outliers_that_are_kept():
    rng = np.random.default_rng(3)
    x = 1e-3 * rng.normal(size=60_000) + 5e-3 * np.diff(rng.random(60_001))
    x[rng.random(x.size) < 0.005] += 0.1
    wv = gmwm.wavelet_variance(x, 100.0, robust=True)
    fit = gmwm.fit("WN + QN", wv)
    limits = fit.confidence_intervals()
    assert wv.excess is not None
    assert all(limits[name][1] >= value for name, value in fit.parameters.items())
    assert limits["WN.sigma2"][1] > 1e-6


def test_intervals_of_a_robust_fit_include_the_bias_of_rounding():
    rng = np.random.default_rng(4)
    x = 1e-3 * rng.normal(size=200_000) + np.sqrt(12) * 2e-3 * np.diff(rng.random(200_001))
    signal = gmwm.Signal(x, RATE)
    fit, classical = gmwm.fit("WN + QN", signal, robust=True), gmwm.wavelet_variance(signal)
    bias = rounding_bias(fit.model, Design.of(fit.wavelet_variance))
    assert bias[:5] == pytest.approx((fit.wavelet_variance.variance / classical.variance - 1)[:5], abs=0.03)
    assert bias[0] > 0.1
    for name, truth in (("WN.sigma2", 1e-6), ("QN.q2", 4e-6)):
        low, high = fit.confidence_intervals()[name]
        assert low <= truth <= high
        assert truth != pytest.approx(fit.parameters[name], rel=0.03)
