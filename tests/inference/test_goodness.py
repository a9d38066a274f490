"""The test of a fit: which levels it uses, what it counts, and what it says."""

import numpy as np
import pytest
from scipy.stats import chi2, kstest

import gmwm
from gmwm import GM, RW, WN
from gmwm.fitting.estimation.goodness import usable_levels
from tests.helpers import raises

RATE = 100.0
pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")


@pytest.mark.parametrize("samples", [2**14, 20_000, 2**15 - 1])
def test_the_two_coarsest_levels_are_left_out(samples):
    wv = gmwm.wavelet_variance(WN(sigma2=1.0).simulate(samples, RATE, 1), RATE)
    test = gmwm.fit(WN(), wv).goodness_of_fit()
    assert test.left_out == (len(wv) - 1, len(wv))
    assert test.levels[-1] == len(wv) - 2
    assert test.df == len(wv) - 3


def test_levels_left_out_before_are_not_left_out_again():
    wv = gmwm.wavelet_variance(WN(sigma2=1.0).simulate(20_000, RATE, 1), RATE, levels=10)
    test = gmwm.fit(WN(), wv).goodness_of_fit()
    assert test.left_out == ()
    assert test.df == 9


@pytest.mark.slow
@pytest.mark.parametrize("weighting", ["diagonal", "optimal", "identity"])
def test_p_is_uniform_when_the_model_is_right(weighting):
    truth = WN(sigma2=4.0) + RW(gamma2=1e-3)
    p = [
        gmwm.fit("WN + RW", truth.simulate(16_384, RATE, seed), RATE, weighting=weighting, certify=False)
        .goodness_of_fit()
        .pvalue
        for seed in range(150)
    ]
    assert kstest(p, "uniform").pvalue > 1e-3
    assert np.mean(np.array(p) < 0.05) < 0.05 + 3 * np.sqrt(0.05 * 0.95 / 150)


def test_a_missing_term_is_found():
    x = (GM(beta=0.5, sigma2=0.5) + WN(sigma2=4.0)).simulate(100_000, RATE, 3)
    assert gmwm.fit("WN", x, RATE).goodness_of_fit().pvalue < 1e-10
    assert gmwm.fit("WN + GM", x, RATE).goodness_of_fit().pvalue > 0.01


def test_the_statistic_under_the_inverse_covariance_is_the_criterion():
    # With Ω = V⁻¹ at the estimate, DᵀΩr = 0, and T is rᵀV⁻¹r itself.
    truth = GM(beta=0.5, sigma2=0.5) + WN(sigma2=4.0)
    wv = gmwm.wavelet_variance(truth.simulate(100_000, RATE, 3), RATE)
    v = gmwm.covariance.wavelet_covariance(truth, wv.samples, RATE)
    used = int(np.count_nonzero(usable_levels(wv)))
    short = wv.first(used)
    for _ in range(12):
        scale = np.sqrt(np.diag(v)[:used])
        omega = np.linalg.inv(v[:used, :used] / np.outer(scale, scale)) / np.outer(scale, scale)
        fit = gmwm.fit("GM + WN", short, weighting=omega)
        v = gmwm.covariance.wavelet_covariance(fit.model, wv.samples, RATE)
    test = gmwm.fit("GM + WN", short, weighting="optimal").goodness_of_fit()
    assert test.statistic == pytest.approx(fit.objective, rel=0.02)
    assert test.pvalue == pytest.approx(chi2.sf(test.statistic, test.df), rel=1e-12)


@pytest.mark.slow
def test_zero_terms_are_not_counted():
    same = []
    for seed in range(8):
        wv = gmwm.wavelet_variance(WN(sigma2=4.0).simulate(20_000, RATE, seed), RATE)
        large, small = (gmwm.fit(model, wv).goodness_of_fit() for model in ("WN + RW", "WN"))
        same.append(large.df == small.df)
        assert large.statistic <= small.statistic * 1.01
        assert large.df == small.df - (0 if same[-1] else 1)
        if same[-1]:
            assert large.statistic == pytest.approx(small.statistic, rel=1e-9)
    assert 0 < sum(same) < 8


def test_too_few_levels_are_an_error_that_says_so():
    wv = gmwm.wavelet_variance((WN(sigma2=4.0) + RW(gamma2=1.0)).simulate(20, RATE, 5), RATE)
    fit = gmwm.fit("WN + RW", wv)
    with raises(gmwm.errors.ModelError, "2 parameters", "2 levels", advises=["Record longer", "bootstrap"]):
        fit.goodness_of_fit()
    assert "not tested" in fit.summary()
    short = gmwm.fit("WN + RW", gmwm.wavelet_variance((WN(4.0) + RW(1.0)).simulate(8, RATE, 5), RATE))
    with raises(gmwm.errors.ModelError, "2 parameters", "1 level ", advises=["bootstrap"]):
        short.goodness_of_fit()
    assert short.goodness_of_fit("bootstrap", draws=19).levels.size == 3


def test_a_bootstrap_that_could_not_reject_is_refused():
    x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(8192, RATE, 1)
    wrong = gmwm.fit("WN", x, RATE)
    with raises(gmwm.errors.OptionError, "at least 19,", argument="draws", got=18):
        wrong.goodness_of_fit("bootstrap", draws=18)
    test = wrong.goodness_of_fit("bootstrap", draws=19)
    assert test.pvalue == 0.05
    assert "the model is rejected" in test.summary()


@pytest.mark.slow
def test_bootstrap():
    x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(8192, RATE, 1)
    good, bad = gmwm.fit("WN + RW", x, RATE), gmwm.fit("WN", x, RATE)
    test = good.goodness_of_fit("bootstrap", draws=200, rng=1)
    assert test.df is None
    assert test.left_out == ()
    assert test.pvalue > 0.05
    assert bad.goodness_of_fit("bootstrap", draws=99, rng=1).pvalue == pytest.approx(0.01)
    with raises(gmwm.errors.OptionError, "'bootstrap'", argument="method", got="bootstap"):
        good.goodness_of_fit("bootstap")


def test_in_words():
    x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(8192, RATE, 1)
    text = gmwm.fit("WN", x, RATE).goodness_of_fit().summary()
    assert "p < 0.001" in text
    assert "rejected" in text
    assert "levels 1 to 11" in text
