"""A mean that follows a smooth course is reported as a trend, and a mean that wanders is not."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Severity
from gmwm.measuring.inspection import inspect
from gmwm.recording.signals import Imu, Signal
from tests.helpers import each, only

RATE = 20.0
NOISE = "WN(sigma2=1e-6) + GM(beta=0.01, sigma2=1e-9) + RW(gamma2=1e-14)"


def made(model, samples, seed, added=0.0):
    x = gmwm.Model.parse(model).simulate(samples, RATE, rng=seed) + added
    return imu_of(x)


def imu_of(x):
    return Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")})


def settling(samples, size, time):
    return size * np.exp(-np.arange(samples) / RATE / time)


@pytest.mark.slow
@each("scale", [1e-9, 1.0, 1e9])
@each("size", [3e-3, -3e-3])
@each("time", [60.0, 200.0, 400.0])
def test_a_warm_up_is_told_with_its_size_and_length(time, size, scale):
    samples = 144_000  # two hours
    x = made(NOISE, samples, 4, settling(samples, size, time))["gyro_x"].values * scale
    (found,) = inspect(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")})).trends
    assert found.axis == "gyro_x"
    assert (found.kind, found.settles) == ("exponential", True)
    assert found.size == pytest.approx(size * scale, rel=0.15)
    assert found.tau == pytest.approx(time, rel=0.15)
    assert 3 * time < found.until < 6 * time
    # The walk of 1e-7·√20 per √s is near its 95 % limit beside the warm-up, which alone looks like a larger walk.
    assert 0.8 * np.sqrt(20) * 1e-7 * scale < found.walk_limit
    assert found.walk_with_trend > 3 * found.walk_limit
    assert found.pvalue < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize(("samples", "seeds", "most"), [(7000, 60, 3), (30_000, 15, 2)])
@pytest.mark.parametrize(
    "model",
    [
        "RW(gamma2=1e-10)",
        "WN(sigma2=1e-6) + GM(beta=0.002, sigma2=1e-6) + RW(gamma2=1e-11)",
        "GM(beta=0.0005, sigma2=1e-6) + WN(sigma2=1e-7)",
        "WN(sigma2=1e-6) + FN(b2=1e-6)",
    ],
)
def test_what_wanders_all_the_time_is_no_trend(model, samples, seeds, most):
    # docs/validation/trends.md: at most 2 %; more than 3 of 60, or 2 of 15, then have a probability below 3 %.
    found = [seed for seed in range(seeds) if inspect(made(model, samples, seed)).trends]
    assert len(found) <= most


def test_a_large_random_walk_keeps_its_size_beside_a_warm_up():
    rng, samples = np.random.default_rng(3), 144_000
    walk = np.cumsum(rng.normal(size=samples)) * 2e-6
    white = rng.normal(size=samples) * 1e-3
    (found,) = inspect(imu_of(white + walk + settling(samples, 3e-3, 400.0))).trends
    assert found.walk == pytest.approx(2e-6 * np.sqrt(RATE), rel=0.2)
    assert found.walk < found.walk_with_trend
    assert found.walk_limit > 2e-6 * np.sqrt(RATE) * 0.8


@pytest.mark.parametrize(("kind", "code"), [("linear", "linear-trend"), ("quadratic", "trend:curve")])
def test_a_line_and_a_parabola(kind, code):
    samples = 144_000
    at = np.arange(samples) / samples
    course = 1e-3 * at if kind == "linear" else 4e-3 * at * (1 - at)
    found = inspect(made(NOISE, samples, 5, course))
    (trend,) = found.trends
    assert (trend.kind, trend.tau, trend.until, trend.settles) == (kind, None, None, False)
    assert trend.size == pytest.approx(-1e-3 if kind == "linear" else 0, abs=2e-4)
    remark = only(found.remarks, code)
    assert remark.facts["size"].unit == "deg/h"
    assert 0.0 <= remark.facts["left"] < 90.0
    assert f"{kind} trend of gyro_x" in found.summary()


@pytest.mark.slow
def test_a_step_is_no_warm_up():
    samples = 144_000
    for place in (2000, 2880, 5000, 20_000):
        for seed in range(3):
            assert inspect(made(NOISE, samples, seed, 3e-3 * (np.arange(samples) > place))).trends == ()


@pytest.mark.slow
def test_the_remark_has_the_axis_the_duration_and_what_to_leave_out():
    samples = 144_000
    found = inspect(made(NOISE, samples, 1, settling(samples, 3e-3, 200.0)))
    (remark,) = found.remarks
    assert (remark.code, remark.subject, remark.severity) == ("warm-up", "gyro_x", Severity.WRONG)
    assert remark.facts["duration"].value == found.trends[0].until
    assert remark.facts["way"] == "start"
    assert remark.facts["size"].value == pytest.approx(3e-3 * 180 / np.pi * 3600, rel=0.15)
    assert remark.facts["numbers"] == ("B", "K", "R")
    start = remark.facts["first"].value
    assert start >= found.trends[0].until
    assert f"start={start:g}" in remark.text()
    assert "settling of gyro_x over the first 1" in found.summary()
    assert max(map(len, found.summary().splitlines())) <= 80
    assert found.to_dict()["trends"][0]["axis"] == "gyro_x"
    # Leaving out this beginning is enough.
    kept = made(NOISE, samples, 1, settling(samples, 3e-3, 200.0)).between(start)
    assert inspect(kept).trends == ()
    # After a cut that is too short, the remark counts from the new beginning.
    cut = made(NOISE, samples, 1, settling(samples, 9e-3, 200.0)).between(200.0)
    again = only(inspect(cut).remarks, "warm-up:large")
    assert (again.facts["way"], again.facts["first"].unit) == ("again", "s")
    assert again.facts["first"].value == pytest.approx(900, rel=0.3)
    # A warm-up that takes most of the recording leaves nothing to calibrate.
    late = only(inspect(made(NOISE, samples, 1, settling(samples, 5e-2, 1500.0))).remarks, "warm-up:large")
    assert late.facts["way"] == "late"


def test_gaps():
    samples = 144_000
    x = made(NOISE, samples, 1, settling(samples, 3e-3, 200.0))["gyro_x"].values
    # 28 s is a block. A gap that is longer than that separates the warm-up from the longest part, which still settles.
    for lost, start in ((2.0, 0.0), (3000.0, 3150.0)):
        starts = (0.0, 3000 / RATE + lost)
        signal = Signal(x, RATE, "rad/s", "gyro_x", segments=((0, 3000), (3000, samples)), starts=starts)
        (found,) = inspect(Imu({"gyro_x": signal})).trends
        assert found.tau == pytest.approx(200, rel=0.2)
        assert start < found.until < start + 1200


@pytest.mark.slow
def test_a_stream_says_the_same(tmp_path):
    samples = 40_000
    path = tmp_path / "warm.csv"
    made(NOISE, samples, 2, settling(samples, 5e-3, 60.0)).write(path)
    whole, chunked = inspect(gmwm.read(path)), inspect(gmwm.stream(path, chunk=997))
    assert len(whole.trends) == 1
    assert whole.trends == chunked.trends
    assert whole.remarks == chunked.remarks
    assert whole.remarks


@pytest.mark.slow
@pytest.mark.parametrize("values", [np.full(20_000, 0.3), np.round(np.linspace(0, 3, 20_000))])
def test_levels_without_noise(values):
    assert inspect(Imu({"gyro_x": Signal(values, RATE, "rad/s", "gyro_x")})).trends == ()
