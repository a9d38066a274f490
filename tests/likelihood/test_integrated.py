"""ARIMA models: fits of differences, and forecasts of the series."""

from __future__ import annotations

import numpy as np
import pytest
from gmwm.errors import DataError, ModelError, OptionError
from gmwm.likelihood import fit_arima
from scipy.signal import lfilter

import gmwm

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")


def arima(theta: float, samples: int, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(samples)
    return np.cumsum(lfilter([1.0, theta], [1.0], noise)) + 50.0


def airline(samples: int, seed: int) -> np.ndarray:
    """(1 − B)(1 − B^12) X_t = (1 − 0.4 B)(1 − 0.6 B^12) ε_t."""
    noise = 2.0 * np.random.default_rng(seed).standard_normal(samples)
    average = np.convolve([1.0, -0.4], np.r_[1.0, np.zeros(11), -0.6])
    operator = np.convolve([1.0, -1.0], np.r_[1.0, np.zeros(11), -1.0])
    return lfilter(average, operator, noise)


def test_the_summary_states_the_differences():
    assert fit_arima("MA(1)", arima(0.5, 200, 2)).summary().startswith("1 differences of 200 samples\nMA(1) by")


def test_the_fit_is_that_of_the_differences_and_the_forecast_that_of_the_recursion():
    x = arima(0.5, 600, 1)
    result = fit_arima("MA(1)", x, 1.0)
    direct = gmwm.fit_ml("MA(1)", np.diff(x), 1.0, mean=0.0)
    assert result.fit.parameters == pytest.approx(direct.parameters)
    theta, sigma2 = direct.parameters["MA(1).theta1"], direct.parameters["MA(1).sigma2"]
    last = lfilter([1.0], [1.0, theta], np.diff(x))[-1]
    forecast = result.predict(4)
    assert forecast.mean == pytest.approx(np.full(4, x[-1] + theta * last), abs=1e-9)
    assert forecast.error**2 == pytest.approx(sigma2 * (1 + np.arange(4) * (1 + theta) ** 2))
    low, high = forecast.band(0.9)
    assert high - low == pytest.approx(2 * 1.6449 * forecast.error, rel=1e-4)


@pytest.mark.slow
def test_intervals_of_a_seasonal_forecast_contain_the_series():
    inside = []
    for seed in range(10):
        x = airline(348, seed)
        result = fit_arima("SARMA(0, 1, 0, 1, 12)", x[:324], 1.0, seasonal=(1, 12))
        low, high = result.predict(24).band()
        inside.append((low <= x[324:]) & (x[324:] <= high))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.08)
    assert result.fit.parameters["SARMA(0,1,0,1,12).theta1"] == pytest.approx(-0.4, abs=0.2)


@pytest.mark.slow
def test_a_seasonal_difference_misses_only_what_it_needs():
    x = airline(200, 1)
    x[60] = np.nan
    result = fit_arima("SARMA(0, 1, 0, 1, 12)", x, 1.0, seasonal=(1, 12))
    assert np.flatnonzero(np.isnan(result.differences)).tolist() == [60 - 13, 61 - 13, 72 - 13, 73 - 13]
    x[-1] = np.nan
    with pytest.raises(DataError, match="last 13"):
        fit_arima("SARMA(0, 1, 0, 1, 12)", x, 1.0, seasonal=(1, 12)).predict(1)


def test_a_drift_continues():
    x = arima(0.3, 2000, 2) + 0.5 * np.arange(2000)
    steps = fit_arima("MA(1)", gmwm.Signal(x, rate=1.0), drift=True).predict(100).mean
    assert np.diff(steps[5:]) == pytest.approx(0.5, abs=0.1)
    assert np.diff(fit_arima("MA(1)", x, 1.0).predict(100).mean[5:]) == pytest.approx(0.0, abs=1e-9)


def test_without_differences_the_forecast_is_that_of_the_model():
    x = gmwm.AR(phi=[0.8], sigma2=1.0).simulate(500, 1.0, rng=1)
    forecast = fit_arima("AR(1)", x, 1.0, integrated=0).predict(5)
    phi = fit_arima("AR(1)", x, 1.0, integrated=0).fit.parameters["AR(1).phi1"]
    assert forecast.mean == pytest.approx(x[-1] * phi ** np.arange(1, 6))


def test_other_models_and_orders_are_refused():
    x = arima(0.5, 100, 1)
    for model in ("WN", "AR(1) + WN"):
        with pytest.raises(ModelError, match="one autoregressive"):
            fit_arima(model, x, 1.0)
    for options in ({"integrated": -1}, {"seasonal": (1,)}, {"seasonal": (1, 0)}):
        with pytest.raises(OptionError):
            fit_arima("MA(1)", x, 1.0, **options)
    with pytest.raises(DataError, match="too few"):
        fit_arima("MA(1)", x[:20], 1.0, seasonal=(1, 12))
