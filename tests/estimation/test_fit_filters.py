"""Wavelet variances and fits with other filters than Haar's, and with the decimated transform."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.measuring.variance import WaveletVariance, wavelet_variance
from gmwm.measuring.variance.transform import dwt, modwt
from gmwm.theory.filters import FILTERS, find_filter
from gmwm.theory.processes import DR, GM, QN, RW, WN
from tests.helpers import each, raises

RATE = 100.0
TRUTH = GM(beta=0.5, sigma2=2e-6) + WN(sigma2=4e-6) + RW(gamma2=1e-11) + QN(q2=3e-6)
every_filter = each("name", FILTERS)
transforms = pytest.mark.parametrize("transform", ["modwt", "dwt"])
loop_over_transforms = each("transform", ["modwt", "dwt"])


@loop_over_transforms
@every_filter
def test_the_estimate_is_the_mean_square_of_the_interior(name, transform):
    x = np.random.default_rng(4).normal(size=777).cumsum() + 9.8
    f, wv = find_filter(name), wavelet_variance(x, RATE, filter=name, transform=transform)
    transformed = (modwt if transform == "modwt" else dwt)(x - x.mean(), name)
    sizes = {}
    for j, inside in transformed.interior.items():
        values = transformed.details[j][inside]
        sizes[j] = values.size
        if values.size:
            factor = 1.0 if transform == "modwt" else 2.0**-j
            assert wv.variance[j - 1] == pytest.approx(factor * np.mean(values**2), rel=1e-9)
    present = {j: m for j, m in sizes.items() if m}
    assert dict(zip(wv.levels.tolist(), wv.counts.tolist(), strict=True)) == present
    eta = wv.counts if transform == "dwt" else np.maximum(wv.counts / wv.scales, 1.0)
    np.testing.assert_array_equal(wv.degrees_of_freedom, eta)
    assert (wv.filter, wv.transform) == (f.name, transform)
    assert np.all((wv.lower < wv.variance) & (wv.variance < wv.upper))


@pytest.mark.slow
@transforms
@pytest.mark.parametrize("name", ["d4", "fk8"])
def test_limits_cover_as_often_as_they_say(name, transform):
    rng, hits = np.random.default_rng(8), []
    truth = WN(sigma2=1.0)
    for _ in range(400):
        wv = wavelet_variance(rng.normal(size=400), RATE, filter=name, transform=transform, levels=4)
        exact = truth.wavelet_variance(4, RATE, name)
        hits.append((wv.lower <= exact) & (exact <= wv.upper))
    coverage = np.mean(hits, axis=0)
    # The rule of thumb for η covers more than it says, never much less.
    assert np.all(coverage > 0.92)
    if transform == "dwt":  # independent coefficients of white noise: the law is exact
        assert np.all(np.abs(coverage - 0.95) <= 4 * np.sqrt(0.95 * 0.05 / 400))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["haar", "la8", "mb8"])
def test_a_fit_to_exact_theory_finds_the_truth(name):
    wv = WaveletVariance.from_values(TRUTH.wavelet_variance(13, RATE, name), samples=10**6, rate=RATE, filter=name)
    found = gmwm.fit("GM + WN + RW + QN", wv)
    for label, value in TRUTH.parameters.items():
        assert found.parameters[label] == pytest.approx(value, rel=1e-8)
    np.testing.assert_allclose(found.implied, wv.variance, rtol=1e-10)
    np.testing.assert_allclose(sum(found.decomposition.values()), found.implied, rtol=1e-13)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@transforms
@pytest.mark.parametrize("name", ["haar", "d4", "la8", "fk8"])
def test_a_fit_to_data_finds_the_truth_within_its_scatter(name, transform):
    truth = WN(sigma2=4e-6) + RW(gamma2=1e-9)
    estimates = []
    for seed in range(16):
        x = truth.simulate(6000, RATE, seed)
        found = gmwm.fit("WN + RW", wavelet_variance(x, RATE, filter=name, transform=transform))
        estimates.append(list(found.parameters.values()))
        assert found.gap == 0
    mean, error = np.mean(estimates, axis=0), np.std(estimates, axis=0, ddof=1) / np.sqrt(len(estimates))
    # ν̂² of the deepest levels is skewed and weighs by itself, which draws the walk's variance down.
    assert abs(mean[0] - 4e-6) <= 4 * error[0]
    assert 0.5e-9 <= mean[1] <= 1e-9 + 4 * error[1]


def test_a_drift_is_seen_by_one_vanishing_moment_only():
    x = (WN(sigma2=1e-6) + DR(omega=-1e-5)).simulate(20_000, RATE, 3)
    found = gmwm.fit("WN + DR", wavelet_variance(x, RATE, filter="fk4"))
    assert found.parameters["DR.omega"] == pytest.approx(-1e-5, rel=0.05)
    with raises(ModelError, "DR (drift)", "100 Hz", "d4", "2 vanishing moments", advises=["filter='haar'"]):
        gmwm.fit("WN + DR", wavelet_variance(x, RATE, filter="d4"))
    alone = gmwm.fit("WN", wavelet_variance(x, RATE, filter="d4"))
    assert alone.parameters["WN.sigma2"] == pytest.approx(1e-6, rel=0.05)


def test_names_travel_with_the_result():
    wv = wavelet_variance(np.random.default_rng(1).normal(size=500), RATE, filter=" LA8", transform="dwt")
    assert WaveletVariance.from_dict(wv.to_dict()).degrees_of_freedom.tolist() == wv.degrees_of_freedom.tolist()
    assert wv.summary().startswith("LA8 DWT wavelet variance: 500 samples")
    given = WaveletVariance.from_values(wv.variance, 500, RATE, filter="la8", transform="dwt")
    np.testing.assert_allclose(given.lower, wv.lower)
    np.testing.assert_array_equal(given.counts, wv.counts)


def test_bad_options_are_named():
    x = np.random.default_rng(1).normal(size=20)
    with raises(OptionError, "filter", "haar, d4", "d5"):
        wavelet_variance(x, RATE, filter="d5")
    with raises(OptionError, "transform", "cwt"):
        wavelet_variance(x, RATE, transform="cwt")
    with raises(OptionError, "levels", "from 1 to 1"):
        wavelet_variance(x, RATE, filter="la8", levels=3)
    with raises(DataError, 24, "mb24", 20):
        wavelet_variance(x, RATE, filter="mb24")
    with raises(DataError, 50):
        WaveletVariance.from_values([1.0, 0.5, 0.2], samples=49, rate=RATE, filter="la8")
    with raises(OptionError, "transform", "cwt"):
        WaveletVariance.from_values([1.0], samples=49, rate=RATE, transform="cwt")  # type: ignore[arg-type]
    with raises(DataError, "finite"):
        wavelet_variance([*x, np.nan], RATE, filter="d4")


@loop_over_transforms
@every_filter
def test_scaling_by_a_power_of_two_is_exact_and_a_constant_is_zero(name, transform):
    x = np.random.default_rng(2).normal(size=300)
    plain = wavelet_variance(x, RATE, filter=name, transform=transform).variance
    for power in (-40, 40):
        scaled = wavelet_variance(np.ldexp(x, power), RATE, filter=name, transform=transform).variance
        np.testing.assert_array_equal(scaled, np.ldexp(plain, 2 * power))
    assert not np.any(wavelet_variance(np.full(300, 0.1), RATE, filter=name, transform=transform).variance)


@pytest.mark.parametrize("transform", ["modwt", "dwt"])
@pytest.mark.parametrize("name", ["haar", "d4", "la8", "fk8", "bl14", "mb16"])
def test_robust_under_every_filter_and_transform(name, transform):
    rng = np.random.default_rng(11)
    x = rng.normal(size=40_000)
    classical, robust = (wavelet_variance(x, RATE, filter=name, transform=transform, robust=r) for r in (False, True))
    scatter = np.sqrt(2 / classical.degrees_of_freedom) * classical.variance
    assert np.all(np.abs(robust.variance - classical.variance)[:6] < 4 * scatter[:6])
    spoilt = x.copy()
    spoilt[rng.choice(x.size, 20, replace=False)] = 1e6
    again = wavelet_variance(spoilt, RATE, filter=name, transform=transform, robust=True)
    np.testing.assert_allclose(again.variance[:2], robust.variance[:2], rtol=0.05)
