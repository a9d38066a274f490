"""Weights from the data: no level of few coefficients decides a fit."""

import numpy as np
import pytest

import gmwm
from gmwm.fitting.estimation.weighting import weighting_matrix
from gmwm.measuring.covariance.mixture import smoothed
from tests.helpers import codes

TRUTH = gmwm.Model.parse("GM(beta=0.05, sigma2=0.3) + WN(sigma2=1.0)")


@pytest.mark.slow
@pytest.mark.parametrize("samples", [2**15, 33_000, 65_000])
def test_a_last_level_of_one_coefficient_does_not_decide(samples):
    found = [gmwm.fit("GM + WN", TRUTH.simulate(samples, 10.0, seed), 10.0, certify=False) for seed in range(40)]
    ratio = np.array([fit.parameters["GM.beta"] / 0.05 for fit in found])
    assert np.all((ratio > 0.5) & (ratio < 2))
    assert max(fit.objective for fit in found) < 30
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / np.sqrt(40)


def test_a_vanishing_last_level_changes_the_weights_little():
    values = TRUTH.wavelet_variance(15, 10.0)
    spoilt = values.copy()
    spoilt[-1] *= 1e-6
    one, other = (
        np.diag(weighting_matrix("diagonal", gmwm.WaveletVariance.from_values(v, 2**15, 10.0)))
        for v in (values, spoilt)
    )
    np.testing.assert_allclose(other[:-3], one[:-3], rtol=0.1)
    assert other[-1] < 20 * one[-1]


@pytest.mark.parametrize("factor", [2.0**-40, 2.0**40])
def test_smoothing_scales_and_leaves_what_is_smooth(factor):
    values = TRUTH.wavelet_variance(15, 10.0)
    wv, scaled = (gmwm.WaveletVariance.from_values(values * f, 2**15, 10.0) for f in (1.0, factor))
    np.testing.assert_allclose(smoothed(wv), values, rtol=0.05)
    np.testing.assert_array_equal(smoothed(scaled), smoothed(wv) * factor)


@pytest.mark.parametrize("samples", [500, 20_000])
def test_a_covariance_that_is_not_inverted_is_noticed(samples):
    wv = gmwm.wavelet_variance(TRUTH.simulate(samples, 10.0, 1), 10.0)
    v = gmwm.covariance.wavelet_covariance(TRUTH, samples, 10.0)
    scale = np.sqrt(np.diag(v))
    inverse = np.linalg.inv(v / np.outer(scale, scale)) / np.outer(scale, scale)
    for matrix in (v, np.diag(v)):
        with pytest.warns(gmwm.errors.FitWarning) as caught:
            found = gmwm.fit("WN", wv, weighting=matrix)
        assert [one.message.remark.code for one in caught] == codes(found.remarks) == ["weights-are-covariance"]
    for matrix in (inverse, 1 / np.diag(v), np.ones(len(wv)), wv.degrees_of_freedom):
        assert not gmwm.fit("WN", wv, weighting=matrix).remarks


@pytest.mark.slow
@pytest.mark.parametrize("name", ["d4", "mb16"])
def test_under_other_filters(name):
    wv = gmwm.wavelet_variance(TRUTH.simulate(40_000, 10.0, 3), 10.0, filter=name)
    assert np.all(smoothed(wv) > 0)
    assert 0.4 < gmwm.fit("GM + WN", wv).parameters["GM.beta"] / 0.05 < 2.0


@pytest.mark.parametrize("weighting", ["optimal", "diagonal"])
def test_a_fit_to_nearly_the_same_data_has_its_own_weights(weighting):
    wv = gmwm.wavelet_variance(TRUTH.simulate(2**14, 10.0, 5), 10.0)
    short = wv.first(len(wv) - 2)
    again = gmwm.fit("GM + WN", wv, weighting=weighting).refit(short)
    fit = gmwm.fit("GM + WN", short, weighting=weighting)
    assert again.diagnostics.remarks == fit.diagnostics.remarks
    np.testing.assert_allclose(again.weighting_matrix, fit.weighting_matrix, rtol=1e-4, atol=0)
    assert again.objective == pytest.approx(fit.objective, rel=1e-4)


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("model", ["2*GM", "GM + RW"])
def test_only_models_far_from_the_data_have_no_weights_that_agree(model):
    x = np.random.default_rng(1).standard_normal(2**14) + 10.0 * np.sin(0.3 * np.arange(2**14))
    fit = gmwm.fit(model, gmwm.wavelet_variance(x, 100.0), weighting="optimal", certify=False)
    again = fit.refit(fit.wavelet_variance)
    assert min(fit.objective, again.objective) > 1000


def test_levels_with_the_weight_zero_are_left_out():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(4000) + np.diff(rng.standard_normal(4001))
    wv = gmwm.wavelet_variance(x, 1.0)
    weights = 1 / wv.variance**2
    weights[[0, -1]] = 0.0
    expected = gmwm.fit("WN + QN", wv.only(wv.levels[1:-1]), weighting=weights[1:-1])
    for matrix in (weights, np.diag(weights)):
        fit = gmwm.fit("WN + QN", wv, weighting=matrix)
        assert fit.parameters == expected.parameters
        assert fit.wavelet_variance.levels.tolist() == wv.levels[1:-1].tolist()
    with pytest.raises(gmwm.errors.OptionError):
        gmwm.fit("WN", wv, weighting=np.zeros(len(wv)))
