"""Residuals: limits that hold what they say, tests in the titles, and nothing bridged or lost."""

import math

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.fitting.likelihood.innovations import Residuals
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.likelihood import (
    LIMIT_LEVEL,
    correlation_panel,
    order_limits,
    plot_residuals,
    quantile_panel,
    time_panel,
)
from tests.helpers import raises

MODEL = gmwm.Model.parse("WN(sigma2=1.0) + RW(gamma2=1e-4)")
RATE = 100.0


def of(values, estimated=0):
    values = np.asarray(values, dtype=np.float64)
    return Residuals(
        model=MODEL, values=values, rate=RATE, times=np.arange(values.size) / RATE, axis="gyro_x", estimated=estimated
    )


@pytest.fixture(scope="module")
def noise():
    return np.random.default_rng(8).normal(size=20_000)


@pytest.fixture(scope="module")
def good():
    return MODEL.residuals(MODEL.simulate(20_000, RATE, rng=3), RATE)


@pytest.fixture(scope="module")
def bad():
    """A Gauss-Markov process taken for white noise."""
    x = gmwm.Model.parse("GM(beta=20.0, sigma2=1.0) + WN(sigma2=1.0)").simulate(20_000, RATE, rng=3)
    return gmwm.Model.parse("WN(sigma2=2.0)").residuals(x, RATE)


def test_the_limits_of_each_quantile_hold_so_many():
    n, count = 500, 2000
    drawn = np.sort(np.random.default_rng(1).normal(size=(count, n)))
    normal, _ = of(drawn[0]).quantiles()
    place = np.searchsorted(np.sort(drawn[0]), of(drawn[0]).quantiles()[1])
    low, high = order_limits(normal, n)
    inside = np.mean((drawn[:, place] >= low) & (drawn[:, place] <= high), axis=0)
    # A share of 95 % of 2000 scatters by 0.5 %; the largest deviation of 400 of them is below 4.
    assert np.max(np.abs(inside - LIMIT_LEVEL)) < 4 * math.sqrt(LIMIT_LEVEL * (1 - LIMIT_LEVEL) / count)
    np.testing.assert_allclose(low, -high[::-1], rtol=1e-9)


def test_limits_of_quantiles_in_ten_millions_are_finite_and_narrow():
    normal = np.linspace(-5.3, 5.3, 301)
    low, high = order_limits(normal, 10_000_000)
    assert np.all(np.isfinite(low) & np.isfinite(high) & (low < normal) & (normal < high))
    assert high[150] - low[150] == pytest.approx(2 * 1.96 * math.sqrt(math.pi / 2 / 1e7), rel=0.01)


def test_the_limit_of_the_largest_is_passed_in_one_of_twenty():
    passed = 0
    for seed in range(400):
        z = np.random.default_rng(seed).normal(size=200)
        passed += "0 beyond the limit" not in time_panel(of(z)).title
    assert abs(passed / 400 - 0.05) < 4 * math.sqrt(0.05 * 0.95 / 400)


def test_a_spike_is_drawn_and_counted(noise):
    z = noise.copy()
    z[7777] = -30.0
    panel = time_panel(of(z))
    line = panel.lines[0]
    assert line.y.min() == -30.0
    assert line.x[np.argmin(line.y)] == pytest.approx(77.77)
    assert panel.title.endswith(", 1 beyond the limit")
    assert panel.title.startswith("Gyroscope X, WN + RW: mean ")
    assert panel.y.limits[0] < -30.0
    panel = quantile_panel(of(z))
    assert panel["Observed"].y.min() == -30.0
    assert panel.y.limits[0] < -30.0
    assert panel.title == "Jarque-Bera: p < 0.001"


def test_gaps_are_not_bridged(noise):
    z = noise.copy()
    z[5000:9000] = math.nan
    z[12_000:12_500:2] = math.nan
    line, *rest = time_panel(of(z)).lines
    inside = (line.x > 50.0) & (line.x < 90.0)
    assert np.all(np.isnan(line.y[inside]))
    assert np.count_nonzero(inside)
    few = of([*noise[:50], math.nan, 2.5, math.nan, *noise[:50]])
    _, dot, _ = time_panel(few).lines
    assert (dot.x.tolist(), dot.y.tolist()) == ([0.51], [2.5])
    assert len(rest) == 1


def test_correlations_are_drawn_with_their_limits(bad, good):
    for residuals in (bad, good):
        panel = correlation_panel(residuals, 30)
        points, band = panel["Observed"], panel.bands[0]
        np.testing.assert_array_equal(points.x, np.arange(1.0, 31))
        np.testing.assert_array_equal(points.y, residuals.acf(30)[1:])
        np.testing.assert_allclose(band.upper, 1.959964 / math.sqrt(20_000), rtol=1e-3)
        assert panel.y.limits[1] > max(np.abs(points.y).max(), band.upper[0])
    assert np.mean(np.abs(correlation_panel(good).lines[-1].y) < band.upper[0]) > 0.8
    assert correlation_panel(bad).lines[-1].y[0] > 20 * band.upper[0]
    many = correlation_panel(good, 5000)
    assert "Observed" not in many.labels
    assert np.nanmax(many.lines[1].y) == good.acf(5000)[1:].max()


@pytest.mark.slow
def test_limits_of_correlations_hold_so_many_where_samples_are_missing():
    inside = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        panel = correlation_panel(of(np.where(rng.random(2000) < 0.6, math.nan, rng.normal(size=2000))), 20)
        inside.append(np.abs(panel["Observed"].y) < panel.bands[0].upper)
    assert abs(np.mean(inside) - LIMIT_LEVEL) < 4 * math.sqrt(LIMIT_LEVEL * (1 - LIMIT_LEVEL) / np.size(inside))


def test_titles_tell_the_tests(good, bad):
    time, quantiles, correlations = description(plot_residuals)(good).panels
    assert f"standard deviation {np.std(good.observed):.3f}" in time.title
    assert quantiles.title == f"Jarque-Bera: p = {good.normality().p_value:.3f}"
    test = good.ljung_box()
    assert correlations.title == f"Ljung-Box, {test.lags} lags: p = {test.p_value:.3f}"
    assert description(plot_residuals)(bad).panels[2].title == "Ljung-Box, 43 lags: p < 0.001"
    assert description(plot_residuals)(good, 7).panels[2].title.startswith("Ljung-Box, 7 lags: p = ")


def test_few_samples_have_no_test(noise):
    panel = correlation_panel(of(noise[:10], estimated=9))
    assert panel.title == "No Ljung-Box test: 9 parameters were estimated"
    assert len(description(plot_residuals)(of(noise[:8], estimated=6)).panels) == 3


def test_units_are_none_and_times_have_theirs(good):
    time, quantiles, correlations = description(plot_residuals)(good).panels
    assert time.x.label == "Time since the first sample (s)"
    assert time.y.label == "Standardised innovation"
    assert (quantiles.x.label, correlations.x.label) == ("Normal quantile", "Lag (samples)")


@pytest.mark.slow
def test_pictures_are_written(good, tmp_path):
    for name in ("a.png", "b.pdf", "c.svg"):
        good.plot(path=tmp_path / name)
    starts = [path.read_bytes()[:4] for path in sorted(tmp_path.iterdir())]
    assert starts == [b"\x89PNG", b"%PDF", b"<?xm"]
    assert plot_residuals(good, 12).legends


def test_options_that_cannot_be(good, tmp_path):
    for lags in (0, 2.5):
        with raises(OptionError, argument="lags", got=lags):
            good.plot(lags=lags)
    with raises(OptionError, argument="path", got=str(tmp_path / "x.bmp")):
        good.plot(path=tmp_path / "x.bmp")
