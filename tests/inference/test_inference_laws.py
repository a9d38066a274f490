"""Laws of intervals, covariances and tests, over models, data and weightings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm import DR, GM, QN, RW, WN, WaveletVariance
from gmwm.fitting.estimation.asymptotic import relative_covariance
from gmwm.measuring.covariance import Design

RATE = 100.0
TRUTHS = (
    "WN(sigma2=4.0) + RW(gamma2=1e-4)",
    "GM(beta=0.5, sigma2=0.2) + WN(sigma2=4.0)",
    "GM(beta=8.0, sigma2=1.0) + WN(sigma2=4.0) + RW(gamma2=4e-4)",
    "GM(beta=8.0, sigma2=0.6) + GM(beta=0.15, sigma2=0.2) + WN(sigma2=2.0) + QN(q2=1.0)",
    "DR(omega=2e-4) + WN(sigma2=4.0) + RW(gamma2=5e-5)",
)
WEIGHTINGS = ("diagonal", "optimal")

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

truths = st.sampled_from(TRUTHS)
seeds = st.integers(0, 2**32 - 1)


def recorded(truth: str, seed: int, samples: int = 50_000) -> gmwm.WaveletVariance:
    return gmwm.wavelet_variance(gmwm.Model.parse(truth).simulate(samples, RATE, seed), RATE)


def times(wv: WaveletVariance, factor: float) -> WaveletVariance:
    return WaveletVariance.from_values(wv.variance * factor**2, samples=wv.samples, rate=wv.rate)


@pytest.mark.slow
@settings(max_examples=12, derandomize=True, deadline=None)
@given(truths, seeds, st.sampled_from([1e-12, 1e-3, 7.0, 1e12]), st.sampled_from(WEIGHTINGS))
def test_scaling_the_data_scales_intervals_and_tests(truth: str, seed: int, factor: float, weighting: str) -> None:
    wv = recorded(truth, seed)
    model = gmwm.Model.parse(truth).structure
    one, other = (
        gmwm.fit(model, data, weighting=weighting, certify=False) for data in (times(wv, 1), times(wv, factor))
    )
    powers = {name: p.signal_power for name, p in _parameters(one).items()}
    for method in ("confidence_intervals", "standard_errors"):
        first, second = (getattr(f, method) for f in (one, other))
        if callable(first):
            first, second = first(), second()
        for name, values in first.items():
            expected = np.array(values) * factor ** powers[name]
            np.testing.assert_allclose(second[name], expected, rtol=1e-9, err_msg=f"{method} {name}")
    np.testing.assert_allclose(other.sandwich.wavelet, one.sandwich.wavelet * factor**4, rtol=1e-9)
    tests = [f.goodness_of_fit() for f in (one, other)]
    assert tests[1].statistic == pytest.approx(tests[0].statistic, rel=1e-8)
    assert tests[1].df == tests[0].df


def _parameters(fit):
    from gmwm.fitting.estimation.intervals import parameters_by_name

    return parameters_by_name(fit.model)


@pytest.mark.slow
@settings(max_examples=10, derandomize=True, deadline=None)
@given(truths, seeds)
def test_intervals_hold_the_estimate_and_widen_with_the_level(truth: str, seed: int) -> None:
    fit = gmwm.fit(gmwm.Model.parse(truth).structure, recorded(truth, seed), certify=False)
    narrow, wide = fit.confidence_intervals(0.8), fit.confidence_intervals(0.99)
    assert list(narrow) == list(fit.parameters)
    for name, value in fit.parameters.items():
        assert wide[name][0] <= narrow[name][0] <= value <= narrow[name][1] <= wide[name][1]
        assert narrow[name][1] > value


@pytest.mark.slow
@settings(max_examples=6, derandomize=True, deadline=None)
@given(truths, seeds)
def test_the_covariance_is_that_of_the_standard_errors(truth: str, seed: int) -> None:
    fit = gmwm.fit(gmwm.Model.parse(truth).structure, recorded(truth, seed), certify=False)
    errors = fit.standard_errors
    np.testing.assert_allclose(np.sqrt(np.diag(fit.covariance)), list(errors.values()), rtol=1e-12)
    correlations = fit.covariance / np.outer(list(errors.values()), list(errors.values()))
    assert np.linalg.eigvalsh(correlations)[0] > -1e-9
    np.testing.assert_array_equal(fit.covariance, fit.covariance.T)


@settings(max_examples=20, derandomize=True, deadline=None)
@given(seeds)
def test_no_weighting_beats_the_inverse_covariance(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slopes = rng.normal(size=(9, 3))
    root = rng.normal(size=(9, 9)) * np.exp(rng.normal(size=9))
    wavelet = root @ root.T
    best = relative_covariance(slopes, np.linalg.inv(wavelet), wavelet)
    other = relative_covariance(slopes, np.diag(np.exp(rng.normal(size=9))), wavelet)
    assert np.linalg.eigvalsh(other - best)[0] >= -1e-9 * np.trace(other)
    np.testing.assert_allclose(best, np.linalg.inv(slopes.T @ np.linalg.inv(wavelet) @ slopes), rtol=1e-6)


def test_what_the_slopes_do_not_tell_apart_is_infinite() -> None:
    slopes = np.column_stack([np.ones(5), np.arange(1.0, 6), np.ones(5)])
    found = relative_covariance(slopes, np.eye(5), np.eye(5))
    assert np.isinf(found[0, 0])
    assert np.isinf(found[2, 2])
    assert found[1, 1] == pytest.approx(0.1)


@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_the_weights_are_those_of_the_estimate(weighting: str) -> None:
    # A fixed point: fitting once more with the weights that the estimate implies changes nothing.
    from gmwm.fitting.estimation.reweighting import implied_weights

    wv = recorded(TRUTHS[2], 1)
    fit = gmwm.fit("GM + WN + RW", wv, weighting=weighting)
    omega = implied_weights(weighting, fit.model, Design.of(wv), wv.variance)
    scale = np.sqrt(np.diag(omega))
    np.testing.assert_allclose(
        fit.weighting_matrix / scale[:, None] / scale, omega / scale[:, None] / scale, rtol=1e-8, atol=1e-8
    )
    again = gmwm.fit("GM + WN + RW", wv, weighting=omega)
    for name, value in fit.parameters.items():
        assert again.parameters[name] == pytest.approx(value, rel=1e-8)


@pytest.mark.slow
def test_weights_do_not_pull_the_estimates_down() -> None:
    # Weights 1/ν̂⁴ alone pull a random walk down by 6 to 14 %; these leave less than four standard errors of the mean.
    truth = WN(sigma2=4.0) + RW(gamma2=1e-3)
    found = [gmwm.fit("WN + RW", truth.simulate(8192, RATE, seed), RATE, certify=False) for seed in range(300)]
    ratio = np.array([f.parameters["RW.gamma2"] / 1e-3 for f in found])
    assert abs(ratio.mean() - 1) < 4 * ratio.std() / np.sqrt(ratio.size)
    errors = np.array([f.standard_errors["RW.gamma2"] for f in found]) / 1e-3
    assert errors.mean() == pytest.approx(ratio.std(), rel=0.15)


@pytest.mark.parametrize(
    ("model", "data"),
    [(WN() + RW(), 0.0), (GM() + WN() + RW(), 0.0), (WN() + QN() + RW(), 0.0), (DR() + WN(), 0.0)],
)
def test_what_is_not_there_has_an_upper_limit(model, data) -> None:
    x = WN(sigma2=4.0).simulate(30_000, RATE, 3) + data
    fit = gmwm.fit(model, x, RATE)
    intervals = fit.confidence_intervals()
    low, high = intervals["WN.sigma2"]
    assert low < 4.0 < high or fit.parameters["WN.sigma2"] == 0
    for name, value in fit.parameters.items():
        if name in ("RW.gamma2", "QN.q2", "DR.omega"):
            assert intervals[name][0] in (0.0, -intervals[name][1])
            assert value < intervals[name][1] < np.inf


@pytest.mark.slow
def test_an_upper_limit_is_where_so_small_an_estimate_is_rare() -> None:
    # Records of a random walk as strong as the limit say: about one in twenty has so small an estimate.
    fit = gmwm.fit(WN() + RW(), gmwm.wavelet_variance(WN(sigma2=4.0).simulate(20_000, RATE, 5), RATE))
    assert fit.parameters["RW.gamma2"] == 0
    limit = fit.confidence_intervals()["RW.gamma2"][1]
    truth = WN(sigma2=4.0) + RW(gamma2=limit)
    zero = [
        gmwm.fit("WN + RW", truth.simulate(20_000, RATE, seed), RATE, certify=False).parameters["RW.gamma2"] == 0
        for seed in range(200)
    ]
    assert np.mean(zero) <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 200)


def test_a_held_parameter_has_no_interval_and_is_not_counted() -> None:
    wv = recorded(TRUTHS[1], 2)
    held = gmwm.fit(GM(beta=gmwm.fixed(0.5)) + WN(), wv)
    assert list(held.confidence_intervals()) == ["GM.sigma2", "WN.sigma2"]
    free = gmwm.fit(GM() + WN(), wv)
    assert held.goodness_of_fit().df == free.goodness_of_fit().df + 1
    assert held.standard_errors["GM.sigma2"] <= free.standard_errors["GM.sigma2"] * 1.2


def test_the_sign_of_a_drift_comes_from_the_data() -> None:
    for sign in (-1.0, 1.0):
        x = (DR(omega=sign * 2e-4) + WN(sigma2=4.0)).simulate(50_000, RATE, 4)
        fit = gmwm.fit(DR() + WN(), x, RATE)
        low, high = fit.confidence_intervals()["DR.omega"]
        assert low < sign * 2e-4 < high
        assert np.sign(low) == np.sign(high) == sign
