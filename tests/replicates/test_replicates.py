"""Several recordings of one unit: one fit, tests of equality, the spread, and the model for a filter."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.special import stdtrit

import gmwm
from gmwm.base.errors import DataError, FitWarning, OptionError
from gmwm.fitting.estimation.recordings import deviations, half_widths, spread_of_mean
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.signals import Signal
from tests.helpers import codes, raises

RATE = 100.0


def noise(seed, samples=20_000, white=1.0, walk=1e-3):
    rng = np.random.default_rng(seed)
    return white * rng.standard_normal(samples) + np.cumsum(np.sqrt(walk) * rng.standard_normal(samples))


def signals(*recordings):
    return [Signal(x, RATE, "rad/s", "gyro_x") for x in recordings]


@pytest.fixture(scope="module")
def equal():
    return gmwm.fit("WN + RW", signals(noise(1), noise(2), noise(3, samples=30_000)), weighting="optimal")


@pytest.fixture(scope="module")
def different():
    recordings = [
        noise(k, white=white, walk=walk) for k, white, walk in ((1, 1.0, 1e-3), (2, 1.1, 4e-3), (3, 0.9, 1e-3))
    ]
    return gmwm.fit("WN + RW", signals(*recordings), weighting="optimal")


def test_one_fit_with_a_certificate(equal):
    wv = equal.wavelet_variance
    assert (wv.samples, len(wv.recordings)) == (70_000, 3)
    assert equal.gap < 1e-3
    assert equal.goodness_of_fit().pvalue > 0.01
    alone = gmwm.fit("WN + RW", signals(noise(1))[0], weighting="optimal")
    assert alone.replicates is None
    pooled = alone.standard_errors["WN.sigma2"] * np.sqrt(2 / 7)
    # Three recordings cannot rule out a spread, which widens the error to that of Student's interval.
    half = half_widths(equal.replicates.deviations.values.T, equal.replicates.deviations.variances.T)[0]
    assert half / 1.959964 > 0.9 * pooled
    assert equal.standard_errors["WN.sigma2"] == pytest.approx(half / 1.959964, rel=0.1)


def test_equal_recordings_agree(equal):
    found = equal.replicates
    assert not found.differs
    assert codes(found.remarks) == ["recordings-agree:numbers"]
    assert found["N"].apart < 0.03
    assert found["N"].spread < 0.01
    assert found.recordings == ("1", "2", "3")
    assert found.deviations.df == 4
    for name, one in found.fits.items():
        assert one.wavelet_variance.samples == equal.wavelet_variance.recordings[name].samples


def test_the_test_is_the_difference_of_objectives(equal):
    found = equal.replicates
    # Exact for white noise and a random walk, whose curves are linear in their parameters.
    apart = sum(_objective(one, equal) - one.objective for one in found.fits.values())
    assert found.deviations.statistic == pytest.approx(apart, rel=0.05, abs=0.3)


def _objective(one, pooled):
    miss = one.wavelet_variance.variance - pooled.model.wavelet_variance(one.wavelet_variance.levels, RATE)
    return miss @ one.weighting_matrix @ miss


def test_different_recordings_differ_and_the_size_is_said_first(different):
    found = different.replicates
    assert found.differs
    assert found.parameter_pvalue < 1e-6
    assert found.model_free_pvalue < 1e-6
    assert codes(found.remarks) == ["recordings-differ:numbers"]
    n = found["N"]
    assert found.spread["N"] == n.spread
    assert n.spread == pytest.approx(0.1, rel=0.2)
    assert n.spread_low < 0.1 < n.spread_high
    assert n.predicted_low < min(entry.value for entry in n.entries.values())
    text = found.remarks[0].text()
    assert text.index("N by") < text.index("p <")
    with pytest.raises(KeyError, match="Q; there are N"):
        found["Q"]


def test_intervals_include_the_spread(different, equal):
    alone = gmwm.fit("WN + RW", signals(noise(2, samples=60_000))[0], weighting="optimal")
    ratio = different.standard_errors["WN.sigma2"] / alone.standard_errors["WN.sigma2"]
    assert ratio > 10
    low, high = different.confidence_intervals()["WN.sigma2"]
    assert low < 0.9  # the mean of 1, 1.21 and 0.81 is 1.01
    assert high > 1.2
    sheet = different.datasheet()["N"]
    assert np.log(sheet.high / sheet.low) == pytest.approx(np.log(high / low) / 2, rel=1e-6)
    # The spread lies in the directions of the parameters, which the test of fit leaves out.
    assert different.goodness_of_fit().pvalue > 1e-3


def test_the_interval_of_exact_recordings_is_that_of_student():
    x = np.array([[0.1, -0.2, 0.15, 0.05]])
    half = half_widths(x, np.full((1, 4), 1e-12))
    assert half[0] == pytest.approx(3.182446 * x.std(ddof=1) / 2, rel=1e-3)
    # Without any visible spread, the interval is the normal one of the pooled recordings.
    assert half_widths(x, np.full((1, 4), 100.0))[0] == pytest.approx(1.959964 * 5, rel=1e-3)


@pytest.mark.parametrize(("count", "spread"), [(2, 2.0), (3, 1.0), (3, 2.0), (5, 1.0)])
def test_intervals_of_few_recordings_hold_for_any_spread(count, spread):
    """300 samples in plain NumPy: at 95 %, fewer than 274 intervals hold with a probability of 0.2 %."""
    rng = np.random.default_rng([7, count])
    x = np.sqrt(1 + spread**2) * rng.normal(size=(300, count))
    half = half_widths(x, np.ones_like(x))
    student = stdtrit(count - 1, 0.975) * x.std(axis=1, ddof=1) / np.sqrt(count)
    assert np.all(half > 0.999 * student)
    assert np.count_nonzero(np.abs(x.mean(axis=1)) <= half) >= 274


@pytest.mark.parametrize("error", [3.0, 100.0])
def test_a_less_precise_recording_widens_the_interval_no_more_than_an_equal_one(error):
    """300 pairs: the interval was wider by the ratio of the errors, and it still holds for a spread of one error."""
    rng = np.random.default_rng(8)
    s = np.array([1.0, error])
    widths = [half_widths(x * s, np.tile(s**2, (300, 1))) for x in (rng.normal(size=(300, 2)), np.zeros((300, 2)))]
    equal = half_widths(rng.normal(size=(300, 2)), np.ones((300, 2)))
    assert np.median(widths[0]) < 1.4 * np.median(equal)
    assert widths[1] == pytest.approx(1.959964 / np.hypot(1, 1 / error))
    x = np.hypot(1.0, s) * rng.normal(size=(300, 2))
    means = x @ (1 / s**2) / np.sum(1 / s**2)
    assert np.count_nonzero(np.abs(means) <= half_widths(x, np.tile(s**2, (300, 1)))) >= 274
    apart = np.tile([0.0, 20 * error], (1, 1))  # a significant difference widens it by itself
    assert half_widths(apart, s[None] ** 2)[0] > 6 * 0.9 * 20 * error


def test_a_short_recording_does_not_spoil_the_limits_of_a_long_one():
    """Two minutes beside an hour at 50 Hz: the limit of K was infinite or ten times K, and N was known to 10 %."""
    for seed in range(3):
        long, short = noise(seed, samples=180_000, walk=1e-6), noise(10 + seed, samples=3000, walk=1e-6)
        alone, both = (gmwm.fit("WN + RW", x) for x in (signals(long)[0], signals(long, short)))
        first, pair = alone.datasheet(), both.datasheet()
        assert pair["K"].high < 2 * first["K"].high
        assert pair["B"].high < 1.5 * first["B"].high
        assert pair["N"].high / pair["N"].low < (first["N"].high / first["N"].low) ** 8


def test_the_filter_gets_the_mean_or_the_highest_noise(different):
    found = different.replicates
    mean, high = found.for_filter(), found.for_filter("high")
    assert mean.parameters["WN.sigma2"] == pytest.approx((1.0 + 1.21 + 0.81) / 3, rel=0.03)
    assert high.parameters["WN.sigma2"] > 1.5
    assert high.parameters["RW.gamma2"] > mean.parameters["RW.gamma2"]
    assert found.for_filter("high", 0.5).parameters["WN.sigma2"] < high.parameters["WN.sigma2"]
    with raises(OptionError, argument="use"):
        found.for_filter("worst")


@pytest.mark.slow
def test_order_and_units_do_not_matter(different):
    recordings = list(different.wavelet_variance.recordings.values())
    turned = gmwm.fit("WN + RW", recordings[::-1], weighting="optimal")
    assert turned.parameters["RW.gamma2"] == pytest.approx(different.parameters["RW.gamma2"], rel=1e-9)
    assert turned.replicates.pvalue == pytest.approx(different.replicates.pvalue, rel=1e-6)
    for scale in (1e-9, 1e6):
        scaled = gmwm.fit(
            "WN + RW",
            [Signal(scale * noise(k, 5000), RATE, "rad/s", "gyro_x") for k in (1, 2)], weighting="optimal",
        )  # fmt: skip
        plain = gmwm.fit("WN + RW", signals(noise(1, 5000), noise(2, 5000)), weighting="optimal")
        assert scaled.replicates.parameter_pvalue == pytest.approx(plain.replicates.parameter_pvalue, rel=1e-6)
        assert scaled.replicates["N"].apart == pytest.approx(plain.replicates["N"].apart, rel=1e-6)


@pytest.mark.slow
def test_a_recording_that_is_too_short_for_the_model_counts_where_it_can():
    fit = gmwm.fit("GM + WN + RW", signals(noise(1), noise(2), noise(3, samples=8)))
    found = deviations(fit)
    assert found.values.shape == (3, len(found.names))
    assert np.isnan(found.values[2]).any()
    assert np.isfinite(fit.standard_errors["WN.sigma2"])
    assert fit.replicates.pvalue > 0.001
    assert fit.replicates["N"].entries["3"] is None


def test_a_parameter_that_no_recording_determines_has_no_spread():
    recordings = [np.random.default_rng(k).standard_normal(64) for k in range(4)]
    with pytest.warns(FitWarning):
        fit = gmwm.fit("GM + WN", signals(*recordings))
    assert np.all(np.isfinite(deviations(fit).of_mean))
    assert np.all(np.isfinite(fit.sandwich.wavelet))


def test_a_difference_that_no_parameter_describes_does_not_decide_about_all_numbers():
    # The noise at high frequencies differs, so that the precise first levels say little about N at 1 s.
    recordings = [noise(k, white=white) for k, white in ((1, 1.0), (2, 1.05), (3, 0.95))]
    for x, echo in zip(recordings, (0.0, 0.05, -0.05), strict=True):
        x[1:] -= echo * x[:-1]
    found = gmwm.fit("WN + RW", signals(*recordings), weighting="optimal").replicates
    assert 0.005 < found.deviations.model_error < 0.1
    assert gmwm.fit("WN + RW", signals(noise(1), noise(2))).replicates.deviations.model_error == 0.0
    assert found.differs
    assert found["N"].spread < 0.05


@pytest.mark.slow
def test_other_weights_robust_curves_and_files(different):
    for options in ({"weighting": "diagonal"}, {"weighting": "identity"}, {"robust": True}):
        fit = gmwm.fit("WN + RW", signals(noise(1), noise(2)), **options)
        assert not fit.replicates.differs
        assert fit.standard_errors["WN.sigma2"] > 0
    again = Fit.from_dict(json.loads(json.dumps(different.to_dict())))
    assert again.replicates.pvalue == different.replicates.pvalue
    assert again.confidence_intervals() == different.confidence_intervals()
    json.dumps(different.replicates.to_dict(), allow_nan=False)
    np.testing.assert_array_equal(spread_of_mean(again), spread_of_mean(different))


@pytest.mark.slow
def test_summary_and_picture(different, tmp_path):
    lines = different.replicates.summary().splitlines()
    assert any(line.split()[-2:] == ["together", "spread"] for line in lines)
    assert any(line.strip().startswith("N (deg/√h)") for line in lines)
    figure = different.replicates.plot(path=tmp_path / "recordings.png")
    assert figure.axes[0].get_legend_handles_labels()[1][-3:] == ["1", "2", "3"] or figure.legends
    assert (tmp_path / "recordings.png").stat().st_size > 10_000


def test_data_that_are_refused():
    x = signals(noise(1, 1000), noise(2, 1000))
    with raises(DataError, argument="data", got=[]):
        gmwm.fit("WN", [])
    with raises(OptionError, argument="against"):
        gmwm.fit("WN", x, against=np.arange(1000.0))
    with raises(DataError, "unit", argument="data"):
        gmwm.fit("WN", [x[0], Signal(x[1].values, RATE, "m/s²", "gyro_x")])
    assert gmwm.fit("WN", x, against="time:2").replicates is not None
