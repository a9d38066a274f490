"""The effect of conditions: coefficients, what they remove from the noise, and covariates that are poorly known."""

from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.regression.against import Asked, CovariateTerm
from gmwm.measuring.regression.conditions import Conditions
from tests.helpers import codes, only, raises

N = 1 << 14
T = np.arange(N) / N
TEMPERATURE = 25 + 15 * (1 - np.exp(-5 * T)) + 1.5 * np.sin(6 * np.pi * T)
LATER = 500
EARLIER = T - LATER / N
FELT = 25 + 15 * (1 - np.exp(-5 * EARLIER)) + 1.5 * np.sin(6 * np.pi * EARLIER)
"""The temperature of `LATER` samples before."""
HELD = np.repeat((TEMPERATURE + 0.1 * np.random.default_rng(0).normal(size=N))[::64], 64)


def noise(rng, walk=4e-3, n=N):
    return rng.normal(size=n) + walk * np.cumsum(rng.normal(size=n))


def recording(arrays, temperature):
    imu = gmwm.Imu.from_arrays(arrays, rate=100)
    return replace(imu, temperature=temperature)


def fitted(x, against, model="WN + RW"):
    return gmwm.fit(model, gmwm.Signal(x, 100.0, unit="rad/s", axis="gyro_x"), against=against, certify=False)


@pytest.fixture(scope="module")
def followed():
    x = noise(np.random.default_rng(1)) + 0.1 * (TEMPERATURE - 30) + 0.004 * (TEMPERATURE - 30) ** 2
    return x, fitted(x, {"temperature:2": TEMPERATURE})


def test_slope_and_curvature_are_found(followed):
    found = followed[1].regression
    low, high = found["temperature^2"].interval()
    assert low < 0.004 < high
    assert found["temperature"].unit == "(rad/s)/°C"
    assert found["temperature^2"].unit == "(rad/s)/°C²"
    # The slope at the reference is that of the parabola there.
    slope = 0.1 + 2 * 0.004 * (found.references["temperature"] - 30)
    low, high = found["temperature"].interval()
    assert low < slope < high
    assert found.pvalue < 1e-4


def test_the_effect_at_a_point_and_the_polynomial_agree(followed):
    found = followed[1].regression
    at = np.array([27.0, 33.0, 38.0])
    effect = found.curve(at)
    own = found.polynomial(20.0)
    assert np.allclose(np.polynomial.Polynomial(own)(at - 20.0), found.mean + effect.value)
    assert np.allclose(np.polynomial.Polynomial(found.polynomial(0.0))(at), found.mean + effect.value)
    assert np.all(effect.lower < effect.value)
    assert np.all(effect.value < effect.upper)
    assert found.curve([found.references["temperature"]]).value == pytest.approx([0.0])
    with raises(OptionError, argument="at"):
        found.curve([100.0])


def test_a_fit_comes_back_with_its_regression(followed):
    fit = followed[1]
    again = gmwm.estimation.Fit.from_dict(fit.to_dict())
    assert again.to_dict() == fit.to_dict()
    assert again.regression.summary() == fit.regression.summary()
    assert fit.summary().endswith(fit.regression.summary())


def test_the_first_level_is_that_of_the_noise_alone(followed):
    x, fit = followed
    rest = x - 0.1 * (TEMPERATURE - 30) - 0.004 * (TEMPERATURE - 30) ** 2
    clean = gmwm.wavelet_variance(rest, 100.0)
    wv = fit.wavelet_variance
    assert np.allclose(wv.variance[:8], clean.variance[:8], rtol=0.01)
    assert len(wv) <= len(clean)


@pytest.mark.slow
def test_the_corrected_curve_has_no_bias():
    rng = np.random.default_rng(5)
    ratios = []
    truth = gmwm.Model.parse("WN(sigma2=1) + RW(gamma2=1.6e-5)").wavelet_variance(14, 100.0)
    for _ in range(40):
        wv = fitted(noise(rng), {"temperature": TEMPERATURE}).wavelet_variance
        ratios.append(wv.variance[10:12] / truth[10:12])
    mean, error = np.mean(ratios, axis=0), np.std(ratios, axis=0) / np.sqrt(40)
    assert np.all(np.abs(mean - 1) < 3 * error)


@pytest.mark.slow
def test_two_walks_follow_each_other_only_by_chance():
    rng = np.random.default_rng(6)
    found = 0
    for _ in range(40):
        x = gmwm.Signal(noise(rng, 0.05), 100.0)
        other = np.cumsum(rng.normal(size=N))
        conditions = Conditions.of({"x": x}, Asked.of({"other": other}), None)
        found += conditions.found["x"].pvalue < 0.05
    assert found <= 6  # probability 0.7 % at a size of 5 %


def test_a_lag_is_found():
    rng = np.random.default_rng(7)
    fit = fitted(noise(rng, 0.0) + 0.3 * FELT, {"temperature:lag": TEMPERATURE}, "WN")
    assert fit.regression.lag["temperature"] == pytest.approx(LATER / 100.0, rel=0.25)


@pytest.mark.slow
def test_a_warm_up_has_its_time_constant():
    rng = np.random.default_rng(8)
    x = noise(rng, 0.0) + 5 * np.exp(-np.arange(N) / 100 / 30)
    found = fitted(x, "warmup", "WN").regression
    assert found.tau == pytest.approx(30, abs=4 * found.tau_error)
    assert found["warmup"].value == pytest.approx(5, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seen", "expected"),
    [
        pytest.param(np.round(TEMPERATURE), 1.0, id="whole degrees"),
        pytest.param(TEMPERATURE + 0.5 * np.random.default_rng(0).normal(size=N), 1.0, id="noise"),
        # The readings are late by 32 samples in the mean, so that the exponential has a larger amplitude.
        pytest.param(HELD, np.exp(-5 * 32 / N), id="held"),
    ],
)
def test_a_reading_error_does_not_make_the_slope_smaller(seen, expected):
    rng = np.random.default_rng(9)
    slopes = []
    for _ in range(8):
        x = rng.normal(size=N) + 3.0 * TEMPERATURE
        slopes.append(fitted(x, {"temperature": seen}, "WN").regression["temperature"].value / 3.0)
    assert np.mean(slopes) == pytest.approx(expected, abs=0.01)


def test_a_temperature_below_its_reading_error_is_refused():
    rng = np.random.default_rng(10)
    seen = 25 + 0.5 * rng.normal(size=N)
    with raises(DataError, "temperature", argument="against", advises=["none"]):
        fitted(noise(rng), {"temperature": seen})
    found = gmwm.inspect(recording({"gyro_x": 1e-3 * noise(rng)}, seen))
    assert only(found.remarks, "conditions:unknown").facts["reason"]


def test_a_constant_temperature_needs_no_remark():
    imu = recording({"gyro_x": 1e-3 * noise(np.random.default_rng(16))}, np.full(N, 25.0))
    found = gmwm.inspect(imu)
    assert not {"conditions:unknown", "conditions:removed", "conditions:none"} & set(codes(found.remarks))
    assert found.regressions == {}


@pytest.mark.slow
def test_inspect_tests_each_axis():
    rng = np.random.default_rng(11)
    imu = recording(
        {"gyro_x": 1e-3 * (noise(rng, 0.0) + 0.5 * TEMPERATURE), "gyro_y": 1e-3 * noise(rng, 0.0)}, TEMPERATURE
    )
    found = gmwm.inspect(imu)
    assert [one.applied for one in found.regressions.values()] == [True, False]
    assert only(found.remarks, "conditions:removed").subject == "gyro_x"
    assert only(found.remarks, "conditions:none").subject == "gyro_y"
    assert found.trends == ()
    left = gmwm.inspect(imu, against="none")
    assert [trend.axis for trend in left.trends] == ["gyro_x"]
    assert only(left.remarks, "warm-up:large").subject == "gyro_x"
    assert left.regressions == {}


@pytest.mark.slow
def test_calibrate_removes_the_temperature_and_keeps_the_regression():
    rng = np.random.default_rng(12)
    imu = recording({"gyro_x": 1e-3 * (noise(rng, 0.0) + 2.0 * TEMPERATURE)}, TEMPERATURE)
    found = gmwm.calibrate(imu, "WN + RW")
    left = gmwm.calibrate(imu, "WN + RW", against="none")
    assert found["gyro_x"].parameters.get("RW.gamma2", 0.0) < 1e-3 * left["gyro_x"].parameters["RW.gamma2"]
    assert found["gyro_x"].regression["temperature"].value == pytest.approx(2e-3, rel=0.02)
    assert found.axes["gyro_x"].left_in > 0
    assert "K would be" in only(found.remarks, "conditions:removed").facts["left_in"]
    assert gmwm.Calibration.from_dict(found.to_dict()).to_dict() == found.to_dict()
    assert left["gyro_x"].regression is None
    assert left.axes["gyro_x"].regression is None
    assert found.settings.to_dict()["against"] == "auto"


@pytest.mark.slow
def test_a_gap_changes_little():
    rng = np.random.default_rng(13)
    x = noise(rng) + 0.3 * TEMPERATURE
    whole = fitted(x, {"temperature": TEMPERATURE}).regression["temperature"]
    missing = np.zeros(N, dtype=bool)
    missing[3000:3100] = missing[9000:9777] = True
    signal = gmwm.Signal.from_missing(np.where(missing, np.nan, x), 100.0, unit="rad/s", axis="gyro_x")
    fit = gmwm.fit("WN + RW", signal, against={"temperature": TEMPERATURE[~missing]}, certify=False)
    own = fit.regression["temperature"]
    assert own.value == pytest.approx(whole.value, abs=2 * whole.error)
    assert own.error == pytest.approx(whole.error, rel=0.3)


def series_with_gaps(rng, walk=0.1):
    """Ten years of daily values with 18 % of the days missing, and the regressors of a trend and a step in a gap."""
    days, present = np.arange(3650), np.ones(3650, dtype=bool)
    for day in days[1:]:
        present[day] = rng.random() > 0.02 if present[day - 1] else rng.random() < 0.09
    present[1990:2020] = False
    columns = {"trend:exact": days / 365.25, "step:exact": 1.0 * (days > 2000)}
    values = 2.0 * rng.normal(size=days.size) + walk * rng.normal(size=days.size).cumsum()
    values += 3.65 * columns["trend:exact"] + 5.0 * columns["step:exact"]
    return gmwm.Signal.from_missing(np.where(present, values, np.nan), 1.0), columns, present


@pytest.mark.slow
def test_a_series_with_gaps_has_one_offset_and_the_precision_of_maximum_likelihood():
    signal, columns, present = series_with_gaps(np.random.default_rng(7))
    against = {name: column[present] for name, column in columns.items()}
    regression = gmwm.fit("WN + RW", signal, against=against, certify=False).regression
    likeliest = gmwm.fit_ml("WN + RW", signal, against=against).regression
    for name, truth in (("trend", 3.65), ("step", 5.0)):
        entry = regression[name]
        assert entry.error < 1.3 * likeliest[name].error
        assert entry.value == pytest.approx(likeliest[name].value, abs=0.5 * entry.error)
        assert entry.value == pytest.approx(truth, abs=3 * entry.error)


def test_a_restart_in_a_gap_gets_an_offset_of_its_own():
    rng = np.random.default_rng(13)
    x = rng.normal(size=N) + 0.1 * TEMPERATURE
    missing = (np.arange(N) >= 6000) & (np.arange(N) < 6400)
    fits = []
    for jump in (0.0, 10.0):
        signal = gmwm.Signal.from_missing(np.where(missing, np.nan, x + jump * (np.arange(N) > 6200)), 100.0)
        against = {"temperature:exact": TEMPERATURE[~missing]}
        fits.append(gmwm.fit("WN", signal, against=against, certify=False).regression["temperature"])
    assert fits[1].error < 3 * fits[0].error
    assert fits[1].value == pytest.approx(0.1, abs=3 * fits[1].error)


def test_every_segment_can_have_an_offset_of_its_own():
    signal, columns, present = series_with_gaps(np.random.default_rng(7), walk=0.0)
    signal = replace(signal, values=signal.values - 5.0 * columns["step:exact"][present])
    trend = columns["trend:exact"][present]
    joint = gmwm.fit("WN", signal, against={"trend:exact": trend}, certify=False).regression
    apart = gmwm.fit("WN", signal, against={"trend:exact": trend, "offsets": None}, certify=False).regression
    assert apart["trend"].error > 3 * joint["trend"].error
    assert apart.against == "trend:exact + offsets"
    assert list(apart) == ["trend"]
    assert gmwm.regression.Regression.from_dict(apart.to_dict()).summary() == apart.summary()
    with raises(DataError, "step", argument="against"):
        gmwm.fit("WN", signal, against={"step:exact": columns["step:exact"][present], "offsets": None})


@pytest.mark.parametrize(
    ("against", "kind"),
    [
        ({"temperature": None}, OptionError),
        ("offsets:2", OptionError),
        ({"temperature": np.full(N, 25.0)}, DataError),
        ({"temperature": TEMPERATURE[:-1]}, DataError),
        ({"a": TEMPERATURE, "b": 2 * TEMPERATURE + 1}, DataError),
        ("temperature", OptionError),
        ("temperature:9", OptionError),
        ("time:2 + warmup", OptionError),
        ("temperature + temperature:2", OptionError),
        ({"time": TEMPERATURE}, OptionError),
        ({}, OptionError),
    ],
)
def test_what_cannot_be_used_is_one_error(against, kind):
    with raises(kind, argument="against"):
        fitted(noise(np.random.default_rng(14)), against)


def test_missing_values_of_a_covariate_are_named():
    with raises(DataError, "temperature", count=N // 2 - 1):
        fitted(noise(np.random.default_rng(14)), {"temperature": np.where(T > 0.5, np.nan, TEMPERATURE)})


def test_a_wavelet_variance_has_no_samples():
    wv = gmwm.wavelet_variance(noise(np.random.default_rng(15)), 100.0)
    with raises(OptionError, argument="against"):
        gmwm.fit("WN + RW", wv, against={"temperature": TEMPERATURE})
    with raises(OptionError, argument="against"):
        gmwm.calibrate({"gyro_x": wv}, "WN + RW", against="time")


@pytest.mark.parametrize("text", ["temperature:2,lag", "rate:exact", "time:knots=3", "warmup"])
def test_a_term_is_written_as_it_is_read(text):
    assert str(CovariateTerm.parse(text)) == text
