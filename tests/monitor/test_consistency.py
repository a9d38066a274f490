"""Claimed and real errors of filters: against a Kalman filter in plain NumPy, and on noise with known departures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

import gmwm
from gmwm.applications.monitor.consistency import PredictionError, _Innovations, consistency
from gmwm.base.errors import DataError, OptionError
from gmwm.choosing.datasheets.filter_numbers import FilterGain

RATE = 10.0
Array = NDArray[np.float64]


def noise(seed: int, samples: int, *, white: float = 1.0, walk: float = 0.01) -> Array:
    """White noise and a random walk around a level."""
    rng = np.random.default_rng(seed)
    return 20.0 + white * rng.normal(size=samples) + np.cumsum(walk * rng.normal(size=samples))


def signal(values: Array, axis: str = "gyro_x", rate: float = RATE) -> gmwm.Signal:
    return gmwm.Signal(values, rate, "rad/s", axis)


def model(white: float = 1.0, walk: float = 0.01) -> gmwm.Model:
    return gmwm.WN(sigma2=white**2) + gmwm.RW(gamma2=walk**2)


def test_errors_are_those_of_a_kalman_filter() -> None:
    """A Kalman filter of white noise and two Gauss-Markov states, sample by sample, on noise of another kind."""
    x, n, decay = noise(1, 6000), 40, np.exp(-np.array([2.0, 0.05]) / RATE)
    text = "GM(beta=2, sigma2=0.5) + GM(beta=0.05, sigma2=0.2) + WN(sigma2=0.8)"
    F, Q = np.diag([*decay, 1.0]), np.diag([0.5 * (1 - decay[0] ** 2), 0.2 * (1 - decay[1] ** 2), 0.0])
    m, P = np.array([0.0, 0.0, x[0]]), np.diag([0.5, 0.2, 1e4])
    ahead = np.mean([np.linalg.matrix_power(F, k).sum(axis=0) for k in range(1, n + 1)], axis=0)
    forecasts = []
    for value in x:
        gain = P.sum(axis=1) / (P.sum() + 0.8)
        m, P = m + gain * (value - m.sum()), P - np.outer(gain, P.sum(axis=0))
        forecasts.append(ahead @ m)
        m, P = F @ m, F @ P @ F.T + Q
    means = np.convolve(x, np.ones(n) / n, "valid")[1:]
    expected = means - np.array(forecasts)[: means.size]
    innovations = _Innovations.of(gmwm.Model.parse(text), signal(x), n)
    claimed, errors = innovations.errors(n)
    # The gain of the constant level still falls, as 1/t.
    start = 3 * n
    for k in range(4):
        wanted = expected[start - 1 + k * n // 4 :: n][: errors.size // 4]
        assert np.std(errors[k::4] * claimed - wanted) < 0.05 * np.std(expected)


def test_the_claim_is_the_closed_form() -> None:
    innovations = _Innovations.of(model(), signal(noise(2, 3000)), 600)
    for n in (1, 10, 600):
        assert innovations.errors(n)[0] ** 2 == pytest.approx(FilterGain(0.01).claim(n)[0], rel=1e-9)


def test_verdicts() -> None:
    """The filter of the simulated noise is consistent; N and K of half and of twice their size are not."""
    recording = {"gyro_x": signal(noise(3, 72_000))}
    results = {
        size: consistency({"gyro_x": model(size, 0.01 * size)}, recording, filter="model")["gyro_x"]
        for size in (0.5, 1.0, 2.0)
    }
    assert {size: result.verdict for size, result in results.items()} == {
        0.5: "overconfident", 1.0: "consistent", 2.0: "cautious",
    }  # fmt: skip
    assert results[0.5].inflation == pytest.approx(2.0, rel=0.15)
    assert results[1.0].inflation == 1.0
    low, high = results[1.0].nis_band
    assert low < results[1.0].nis < high
    for error in results[1.0].errors:
        assert error.low < 1.0 < error.high


def test_a_random_walk_that_is_missing_shows_at_the_longest_horizon() -> None:
    recording = {"gyro_x": signal(noise(4, 72_000, walk=0.03))}
    result = consistency({"gyro_x": model(1.0, 0.01)}, recording)
    assert [error.verdict for error in result["gyro_x"].errors][::2] == ["consistent", "overconfident"]
    assert "gyro_x is overconfident at 10 s, 60 s" in result.summary()


def test_a_short_recording_decides_nothing() -> None:
    result = consistency({"gyro_x": model()}, {"gyro_x": signal(noise(5, 2400))})
    assert result["gyro_x"].errors[0].verdict == "consistent"
    assert result["gyro_x"].verdict == "undecided"
    assert math.isnan(result["gyro_x"].errors[2].real)
    assert "too short" in result.summary()
    with pytest.raises(DataError, match="fewer than 5 samples"):
        consistency({"gyro_x": model()}, {"gyro_x": signal(noise(5, 7))})


def test_the_width_of_an_interval_decides() -> None:
    """An interval of twice the width hides a filter that claims half of its error."""
    wide, narrow = (
        PredictionError(horizon=1.0, claimed=1.0, real=1.0, low=low, high=1.4, independent=10.0) for low in (0.6, 0.75)
    )
    assert (wide.verdict, narrow.verdict) == ("undecided", "consistent")


def test_gaps() -> None:
    """Lost samples are filled; over a long gap, the filter starts again."""
    values = noise(6, 40_000)
    values[1000:36_000:500] = np.nan
    values[20_000:30_000] = np.nan
    result = consistency({"gyro_x": model()}, {"gyro_x": gmwm.Signal.from_missing(values, RATE, "rad/s", "gyro_x")})
    assert result["gyro_x"].verdict == "consistent"


@pytest.mark.slow
def test_intervals_cover() -> None:
    """95 % intervals of 80 recordings of Gauss-Markov noise, which N and K do not describe at 60 s."""
    rng, decay, inside, ratios = np.random.default_rng(7), math.exp(-1 / 150.0), [], []
    truth = gmwm.Model.parse(f"WN(sigma2=1) + GM(beta={1 / 15!r}, sigma2=0.2)")
    for _ in range(80):
        slow = lfilter([1.0], [1.0, -decay], math.sqrt(0.2 * (1 - decay**2)) * rng.normal(size=20_000))
        x = rng.normal(size=20_000) + slow
        inside.append(consistency({"gyro_x": truth}, {"gyro_x": signal(x)})["gyro_x"].errors)
    for k in range(3):
        real = math.sqrt(np.mean([errors[k].real ** 2 for errors in inside]))
        ratios.append(inside[0][k].claimed / real)
        assert np.mean([errors[k].low <= ratios[k] <= errors[k].high for errors in inside]) >= 0.88
    assert ratios[0] == pytest.approx(1.0, abs=0.03)
    assert ratios[2] > 1.3


@pytest.mark.slow
def test_forms_of_a_calibration() -> None:
    """N and K are those of the datasheet, and the Gauss-Markov bias that of the exported files."""
    imu = gmwm.Imu({"gyro_x": signal(noise(8, 60_000, white=1e-3, walk=2e-5))})
    calibration = gmwm.calibrate(imu, "WN + RW")
    other = {"gyro_x": signal(noise(9, 60_000, white=1e-3, walk=2e-5))}
    results = {form: consistency(calibration, other, filter=form) for form in ("N, K", "N, sigma, T", "model")}
    assert all(result["gyro_x"].verdict == "consistent" for result in results.values())
    entries = calibration.datasheets["gyro_x"]
    fields = gmwm.Model.parse(results["N, K"]["gyro_x"].model).parameters
    assert fields["WN.sigma2"] == pytest.approx(entries["N"].value ** 2 * RATE, rel=1e-4)
    assert fields["RW.gamma2"] == pytest.approx(entries["K"].value ** 2 / RATE, rel=1e-4)
    assert set(gmwm.Model.parse(results["N, sigma, T"]["gyro_x"].model).parameters) == {
        "WN.sigma2", "GM.beta", "GM.sigma2",
    }  # fmt: skip
    assert results["model"].to_dict()["axes"]["gyro_x"]["errors"][0]["verdict"] == "consistent"
    assert results["model"].plot().axes[0].get_xlabel() == "Horizon (s)"


def test_a_limit_is_cautious() -> None:
    """K of white noise is an upper limit, so that the filter claims too much over a minute."""
    first, second = (gmwm.Imu({"gyro_x": signal(noise(k, 20_000, white=1e-3, walk=0.0))}) for k in (10, 11))
    result = consistency(gmwm.calibrate(first, "WN + RW"), second)["gyro_x"]
    assert result.limits == ("K",)
    assert result.errors[2].ratio > 1.1
    assert result.verdict != "overconfident"


def test_errors_name_the_option() -> None:
    recording = {"gyro_x": signal(noise(1, 2000))}
    with pytest.raises(OptionError, match="filter"):
        consistency({"gyro_x": model()}, recording, filter="K")  # type: ignore[arg-type]
    with pytest.raises(OptionError, match="horizons"):
        consistency({"gyro_x": model()}, recording, horizons=[0.0])
    with pytest.raises(OptionError, match="no axis in common"):
        consistency({"gyro_y": model()}, recording)
    fit = gmwm.fit("WN", gmwm.Signal(noise(1, 2000), RATE, "m/s^2", "accel_x"))
    with pytest.raises(DataError, match="m/s"):
        consistency({"gyro_x": fit}, recording)
    fits, other = {"gyro_x": gmwm.fit("WN", recording["gyro_x"])}, {"gyro_x": signal(noise(1, 2000), rate=20.0)}
    for filter in ("N, K", "N, sigma, T", "model"):
        with pytest.raises(OptionError, match="rate"):
            consistency(fits, other, filter=filter)  # type: ignore[arg-type]


def test_a_horizon_that_rounds_to_a_sample_appears_once() -> None:
    slow = {"gyro_x": signal(noise(1, 2000), rate=0.1)}
    result = consistency({"gyro_x": model()}, slow, horizons=[1.0, 10.0, 60.0])["gyro_x"]
    assert [error.horizon for error in result.errors] == [10.0, 60.0]
