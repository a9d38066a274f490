"""The law of the classical over the robust wavelet variance: its variance and skewness, against other hands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincc
from scipy.stats import pearson3, skew

import gmwm
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import Design, filtered, ratio_variances, variances
from gmwm.measuring.covariance.gaussian import covariance
from gmwm.measuring.covariance.robust import hermite_weights, ratio_skewness
from gmwm.measuring.outliers.ratio_test import ratio_errors, ratio_law

RATE = 100.0
MODELS = ("WN(sigma2=1.0)", "RW(gamma2=1.0)", "GM(beta=5.0, sigma2=1.0) + WN(sigma2=1.0)")


def design(samples: int, efficiency: float, levels: int) -> Design:
    return Design(np.arange(1, levels + 1), samples, RATE, efficiency=efficiency)


@pytest.mark.parametrize("efficiency", [0.4, 0.6, 0.9])
@pytest.mark.parametrize("text", MODELS)
def test_the_ratio_has_what_the_robust_variance_has_beyond_the_classical(text: str, efficiency: float) -> None:
    model, robust = gmwm.Model.parse(text).sorted(RATE), design(3000, efficiency, 8)
    size = model.wavelet_variance(robust.levels, RATE) ** 2
    beyond = (variances(model, robust) - variances(model, replace(robust, efficiency=None))) / size
    assert ratio_variances(model, robust) == pytest.approx(beyond, rel=1e-9)


@pytest.mark.parametrize("text", [*MODELS, "QN(q2=1.0) + WN(sigma2=0.1)", "DR(omega=0.1) + WN(sigma2=1.0)"])
def test_both_ways_to_sum_over_lags_agree(text: str) -> None:
    model, robust = gmwm.Model.parse(text).sorted(RATE), design(3000, 0.6, 8)
    assert filtered.ratio_variances(model, robust) == pytest.approx(ratio_variances(model, robust), rel=1e-6)


def test_uncorrelated_coefficients_have_the_efficiency() -> None:
    # At level 1 of white noise neighbours are correlated by ½ and nothing else is.
    robust, q = design(1000, 0.6, 1), np.arange(4, 17, 2)
    expected = hermite_weights(0.6)[1:] @ (999 + 2 * 998 * 0.5**q) / 999**2
    assert ratio_variances(gmwm.Model.parse("WN(sigma2=3.0)"), robust) == pytest.approx([expected], rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_skewness_is_that_of_simulated_ratios(efficiency: float) -> None:
    from gmwm.measuring.variance.biweight import biweight

    # Uncorrelated coefficients, their root by Newton's method on all records at once.
    law, w = biweight(efficiency), np.random.default_rng(5).standard_normal((10_000, 1000))
    x = np.zeros((len(w), 1))
    for _ in range(5):
        v = np.minimum(w**2 * np.exp(-x) / law.c**2, 1.0)
        value, slope = law.criterion(
            ((1 - v) ** 3 * v).sum(axis=1), ((1 - v) ** 4 * v).sum(axis=1), np.float64(w.shape[1])
        )
        x -= (value / slope)[:, None]
    d = np.log(np.mean(w**2, axis=1)) - x[:, 0]
    assert d.std() == pytest.approx(np.sqrt((2 / efficiency - 2) / 1000), rel=0.04)
    # The skewness of n numbers is known to √(6 / n), and more where they are skewed themselves.
    assert skew(d) == pytest.approx(ratio_skewness(efficiency) * d.std(), abs=5 * np.sqrt(6 / len(d)))


@pytest.mark.slow
@pytest.mark.parametrize("text", MODELS)
def test_ratios_of_simulated_records_follow_the_law(text: str) -> None:
    model, robust, draws = gmwm.Model.parse(text).sorted(RATE), design(4000, 0.6, 7), 1200
    pair = [simulated_variances(model, s, draws, seed=3) for s in (replace(robust, efficiency=None), robust)]
    ratios, errors = np.log(pair[0] / pair[1]), np.sqrt(ratio_variances(model, robust))
    assert ratios.std(axis=0) / errors == pytest.approx(np.ones(7), abs=5 / np.sqrt(2 * draws))
    for ratio, error in zip(ratios.T, errors, strict=True):
        pvalues = gammaincc(*ratio_law(ratio / error, np.full(draws, error), 0.6))
        for share in (0.05, 0.01):
            assert np.mean(pvalues < share) < share + 4 * np.sqrt(share / draws)


def test_the_law_is_the_gamma_law_of_its_skewness() -> None:
    place, error = np.linspace(-2.0, 5.0, 15), np.full(15, 0.05)
    skewness = 2 / np.sqrt(ratio_law(place, error, 0.6)[0][0])
    assert skewness == pytest.approx(1.3 * ratio_skewness(0.6) * 0.05)
    assert gammaincc(*ratio_law(place, error, 0.6)) == pytest.approx(pearson3.sf(place, skewness), rel=1e-9)


@pytest.mark.parametrize("text", MODELS)
def test_without_a_model_the_errors_are_those_of_the_mixture(text: str) -> None:
    model = gmwm.Model.parse(text).sorted(RATE)
    robust = gmwm.wavelet_variance(model.simulate(20_000, RATE, rng=2), RATE, robust=True)
    tested = np.arange(len(robust)) < 9
    known, found = (ratio_errors(robust, tested, given) for given in (model, None))
    assert known == pytest.approx(np.sqrt(ratio_variances(model, design(20_000, 0.6, 9))))
    assert found == pytest.approx(known, rel=0.1)


def test_a_median_scatters_more_and_a_drift_alone_has_a_bound() -> None:
    model = gmwm.Model.parse("WN(sigma2=1.0)")
    robust = gmwm.wavelet_variance(model.simulate(20_000, RATE, rng=2), RATE, robust=True)
    tested = np.arange(len(robust)) < 3
    plain = ratio_errors(robust, tested, model)
    outcome = ["mad", *robust.diagnostics["robust"]["outcome"][1:]]
    fallen = replace(robust, diagnostics={"robust": robust.diagnostics["robust"] | {"outcome": outcome}})
    assert ratio_errors(fallen, tested, model) / plain == pytest.approx([1.607, 1.0, 1.0], rel=1e-3)
    bound = ratio_errors(robust, tested, "DR(omega=1.0)")
    assert np.all(bound > plain)
    assert np.all(bound < 3 * plain)


@pytest.mark.parametrize("text", ["WN(sigma2=1.0)", "GM(beta=0.5, sigma2=1.0) + WN(sigma2=1.0) + RW(gamma2=1e-8)"])
def test_levels_of_which_not_all_coefficients_are_taken_have_the_same_errors(text: str) -> None:
    model = gmwm.Model.parse(text)
    x = model.simulate(200_000, RATE, 1)
    live = gmwm.WaveletAccumulator(RATE, exact=6, robust=True)
    live.update(x)
    pair = live.result(), live.result(robust=True)
    whole, some = gmwm.contamination(x, RATE), gmwm.contamination(pair)
    assert max(pair[0].strides) > 1
    np.testing.assert_array_equal(some.tested, whole.tested)
    np.testing.assert_allclose(some.standard_errors[some.tested], whole.standard_errors[some.tested], rtol=0.02)
    # A level that is left out leaves the strides of the others theirs.
    all_levels = Design.of(pair[0])
    fewer = all_levels.only(all_levels.levels > 3)
    assert fewer.strides == all_levels.strides[3:]
    np.testing.assert_allclose(covariance(model, fewer), covariance(model, all_levels)[3:, 3:], rtol=1e-9)
