"""Fits of wavelet variances and of autocovariances of first differences (GMWM+)."""

from __future__ import annotations

import json
import pickle

import numpy as np
import pytest
from gmwm.errors import ModelError, OptionError
from gmwm.estimation import Sampled
from gmwm.filters import find_filter
from scipy.signal import lfilter

import gmwm
from gmwm.measuring.covariance import Design, covariance
from validation.study_moments import SEED, series

MODELS = {
    "MA(1)": ([], [0.6]), "MA(2)": ([], [0.6, 0.3]), "ARMA(2,1)": ([0.9, -0.3], [0.5]), "AR(2)": ([1.4, -0.6], []),
}  # fmt: skip


def recording(model: str, samples: int, seed: int) -> np.ndarray:
    phi, theta = MODELS[model]
    noise = np.random.default_rng(seed).standard_normal(samples + 500)
    return lfilter([1.0, *theta], [1.0, *(-np.array(phi))], noise)[500:]


def bounds(model: str, samples: int) -> np.ndarray:
    """Standard errors of maximum likelihood, from N/2 ∫ ∂log S ∂log S."""
    phi, theta = MODELS[model]
    z = np.exp(-2j * np.pi * np.arange(4096) / 4096)
    slopes = []
    for coefficients, sign in ((phi, -1.0), (theta, 1.0)):
        polynomial = 1 + sign * sum(c * z ** (k + 1) for k, c in enumerate(coefficients))
        slopes += [2 * np.real(z ** (k + 1) / polynomial) for k in range(len(coefficients))]
    every = np.array([*slopes, np.ones(z.size)])
    return np.sqrt(np.diag(np.linalg.inv(samples / 2 * every @ every.T / z.size)))


@pytest.mark.slow
@pytest.mark.parametrize(("model", "before"), [("MA(1)", 1.8), ("MA(2)", 2.2), ("ARMA(2,1)", 3.5), ("AR(2)", 1.0)])
def test_standard_errors_are_near_those_of_maximum_likelihood(model, before):
    x = recording(model, 20_000, 3)
    plain, augmented, two = (
        np.array(list(gmwm.fit(model, x, moments=moments).standard_errors.values())) / bounds(model, x.size)
        for moments in ("haar", "haar + lags:8", "haar + lags:3,5")
    )
    assert plain.max() > before
    assert augmented.max() < 1.1
    assert two.max() < 1.1


@pytest.mark.slow
def test_intervals_and_tests_hold_in_simulated_recordings():
    inside, pvalues = [], []
    for seed in range(20):
        fit = gmwm.fit("MA(1)", recording("MA(1)", 500, seed), moments="haar + lags:4")
        low, high = fit.confidence_intervals()["MA(1).theta1"]
        inside.append(low <= 0.6 <= high)
        pvalues.append(fit.goodness_of_fit().pvalue)
    assert np.mean(inside) > 0.8
    assert np.mean(np.array(pvalues) < 0.05) < 0.2
    assert 0.35 < np.mean(pvalues) < 0.65


def test_a_wrong_model_is_rejected_although_its_wavelet_variances_fit():
    x = recording("MA(2)", 20_000, 1)
    assert gmwm.fit("ARMA(1,1)", x, moments="haar + lags:8").goodness_of_fit().pvalue < 1e-6


def test_a_fit_with_one_shape_has_a_certificate_and_the_same_estimates_as_wavelet_variances():
    rng = np.random.default_rng(5)
    x = lfilter([1.0], [1.0, -0.99], rng.standard_normal(20_000)) * 0.1 + rng.standard_normal(20_000)
    plain = gmwm.fit("GM + WN", x, weighting="optimal")
    augmented = gmwm.fit("GM + WN", x, moments="haar + lags:8")
    assert augmented.weighting == "optimal"
    assert augmented.gap is not None
    assert 0 <= augmented.gap < 1e-4
    assert augmented.implied == pytest.approx(augmented.model.wavelet_variance(
        augmented.wavelet_variance.levels, 1.0, augmented.wavelet_variance.filter))  # fmt: skip
    for name, error in plain.standard_errors.items():
        assert augmented.standard_errors[name] == pytest.approx(error, rel=0.05)
        assert abs(augmented.parameters[name] - plain.parameters[name]) < error


def test_other_weights_and_random_starts_are_possible():
    x = recording("MA(1)", 4000, 2)
    for options in ({"weighting": "diagonal"}, {"weighting": "identity"}, {"start": Sampled(draws=100, rng=1)}):
        fit = gmwm.fit("MA(1)", x, moments="haar + lags:4", **options)
        assert fit.parameters["MA(1).theta1"] == pytest.approx(0.6, abs=0.1)


@pytest.mark.slow
def test_gaps_and_several_recordings():
    x = recording("MA(2)", 12_000, 4)
    x[np.random.default_rng(1).random(x.size) < 0.02] = np.nan
    gapped = gmwm.fit("MA(2)", gmwm.Signal.from_missing(x, 10.0), moments="haar + lags:8")
    halves = [gmwm.wavelet_variance(recording("MA(2)", 6000, k), filter="haar + lags:8") for k in (1, 2)]
    several = gmwm.fit("MA(2)", halves)
    assert several.replicates is not None
    for fit in (gapped, several):
        assert fit.parameters["MA(2).theta2"] == pytest.approx(0.3, abs=0.05)
        assert fit.goodness_of_fit().pvalue > 0.01


@pytest.mark.slow
def test_results_can_be_stored_and_drawn():
    fit = gmwm.fit("MA(2)", recording("MA(2)", 2000, 1), moments="haar + lags:3,5")
    assert fit.wavelet_variance.levels.tolist() == [-5, -3, *range(1, 11)]
    assert fit.wavelet_variance.tau[:3].tolist() == [6.0, 4.0, 2.0]
    assert "10 levels and 2 lags" in fit.summary()
    assert "levels 1 to 8 and 2 lags" in str(fit.goodness_of_fit())
    restored = gmwm.Fit.from_dict(json.loads(json.dumps(fit.to_dict())))
    assert restored.standard_errors == pytest.approx(fit.standard_errors)
    assert pickle.loads(pickle.dumps(fit)).wic().value == pytest.approx(fit.wic().value)
    assert fit.bootstrap(20, rng=1).variances.shape == (20, 12)
    assert fit.without_lags.wavelet_variance.filter == "haar"
    assert len(fit.without_lags.implied) == 10
    assert fit.datasheet()["B"].value > 0
    assert fit.plot() is not None
    assert gmwm.select("ARMA(1,1)", fit.wavelet_variance).best.fit.wavelet_variance.levels[0] == -5


def test_levels_that_the_lags_contain_are_left_out():
    x = recording("ARMA(2,1)", 2000, 1)
    curve = gmwm.wavelet_variance(x, filter="haar + lags:8")
    assert curve.levels.tolist() == [*range(-8, 0), 1, 4, 5, 6, 7, 8, 9, 10]
    full = gmwm.wavelet_variance(x)
    assert curve.without_lags.variance == pytest.approx(full.only(curve.levels[8:].tolist()).variance)
    # Without them, no combination of the moments is nearly zero but for the ends of the series.
    truth = "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1)"
    v = covariance(gmwm.Model.parse(truth), Design.of(curve))
    assert np.linalg.eigvalsh(v / np.sqrt(np.outer(np.diag(v), np.diag(v))))[0] > 1e-4


def test_weights_of_a_poor_first_estimate_do_not_end_a_fit():
    # The weights of the first estimate lead to a model without noise.
    x = series(np.random.default_rng([SEED, 1, 241]), "ARMA(2,1)", 2000, None)
    fit = gmwm.fit("ARMA(2,1)", x, moments="haar + lags:8", certify=False)
    assert fit.parameters["ARMA(2,1).theta1"] == pytest.approx(0.5, abs=0.1)


def test_names_of_moments():
    assert find_filter("Haar+lags: 3") is find_filter("haar + lags:3")
    assert find_filter("haar + lags:3").lags == (1, 2, 3)
    assert find_filter("haar + lags:5,3").name == "haar + lags:3,5"
    assert pickle.loads(pickle.dumps(find_filter("haar + lags:3"))) is find_filter("haar + lags:3")


@pytest.mark.parametrize("moments", ["haar + lags:0", "haar + lags:3,65", "haar + lags:", "lags:3"])
def test_unknown_moments_are_refused(moments):
    with pytest.raises(OptionError):
        gmwm.fit("WN", np.random.default_rng(1).standard_normal(100), moments=moments)


def test_options_that_contradict_the_moments_are_refused():
    x = np.random.default_rng(1).standard_normal(500)
    for options in ({"robust": True}, {"against": "time"}):
        with pytest.raises(OptionError):
            gmwm.fit("WN", x, moments="haar + lags:3", **options)
    with pytest.raises(OptionError, match="lags up to 6"):
        gmwm.fit("WN", x[:8], moments="haar + lags:8")
    with pytest.raises(OptionError, match="Pass the signal"):
        gmwm.fit("WN", gmwm.wavelet_variance(x), moments="haar + lags:3")
    with pytest.raises(OptionError, match="moments"):
        gmwm.fit("WN", {0.0: x, 1.0: x}, varies={"WN": "1 + rate"}, moments="haar + lags:3")
    with pytest.raises(ModelError):
        gmwm.fit("MA(12)", x[:10], moments="haar + lags:2")
