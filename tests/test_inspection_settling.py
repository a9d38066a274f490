"""A level that settles is reported as a warm-up, and a level that wanders is not."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.inspection import inspect
from gmwm.remarks import Severity
from gmwm.signals import Imu, Signal
from tests.helpers import only

RATE = 20.0
NOISE = "WN(sigma2=1e-6) + GM(beta=0.01, sigma2=1e-9) + RW(gamma2=1e-14)"


def made(model, samples, seed, added=0.0):
    x = gmwm.Model.parse(model).simulate(samples, RATE, rng=seed) + added
    return Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")})


def settling(samples, size, time):
    return size * np.exp(-np.arange(samples) / RATE / time)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("size", [3e-3, -3e-3])
@pytest.mark.parametrize("time", [60.0, 200.0, 400.0])
def test_a_warm_up_is_told_with_its_size_and_length(time, size, scale):
    samples = 144_000  # two hours
    x = made(NOISE, samples, 4, settling(samples, size, time))["gyro_x"].values * scale
    (found,) = inspect(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")})).warm_ups
    assert found.axis == "gyro_x"
    assert found.size == pytest.approx(size * scale, rel=0.15)
    assert 3 * time < found.duration < 5 * time


@pytest.mark.parametrize("samples", [7000, 30_000])
@pytest.mark.parametrize(
    "model",
    [
        "RW(gamma2=1e-10)",
        "WN(sigma2=1e-6) + GM(beta=0.002, sigma2=1e-6) + RW(gamma2=1e-11)",
        "GM(beta=0.0005, sigma2=1e-6) + WN(sigma2=1e-7)",
        "WN(sigma2=1e-6) + RW(gamma2=1e-13) + DR(omega=1e-8)",
    ],
)
def test_what_wanders_all_the_time_is_no_warm_up(model, samples):
    # One in 11 200 was found; of these 60 one would be more than chance.
    assert [seed for seed in range(60) if inspect(made(model, samples, seed)).warm_ups] == []


def test_a_step_is_no_warm_up():
    samples = 144_000
    for place in (2000, 2880, 5000, 20_000):
        for seed in range(3):
            assert inspect(made(NOISE, samples, seed, 3e-3 * (np.arange(samples) > place))).warm_ups == ()


def test_the_remark_has_the_axis_the_duration_and_what_to_leave_out():
    samples = 144_000
    found = inspect(made(NOISE, samples, 1, settling(samples, 3e-3, 200.0)))
    (remark,) = found.remarks
    assert (remark.code, remark.subject, remark.severity) == ("warm-up", "gyro_x", Severity.BIASED)
    assert remark.facts["duration"].value == found.warm_ups[0].duration
    assert remark.facts["cut"] == "no"
    start = remark.facts["first"].value
    assert start >= found.warm_ups[0].duration
    assert f"start={start:g}" in remark.text()
    assert "warm-up of gyro_x over the first 1" in found.summary()
    assert found.to_dict()["warm_ups"][0]["axis"] == "gyro_x"
    # Leaving out this beginning is enough.
    kept = made(NOISE, samples, 1, settling(samples, 3e-3, 200.0)).between(start)
    assert inspect(kept).warm_ups == ()
    # After a cut that is too short, the remark counts from the new beginning.
    again = only(inspect(made(NOISE, samples, 1, settling(samples, 9e-3, 200.0)).between(200.0)).remarks, "warm-up")
    assert (again.facts["cut"], again.facts["first"].unit) == ("yes", "s")
    assert again.facts["first"].value == pytest.approx(900, rel=0.15)


def test_gaps():
    samples = 144_000
    x = made(NOISE, samples, 1, settling(samples, 3e-3, 200.0))["gyro_x"].values
    # 28 s is a block: a short gap in the warm-up hides nothing, and what follows a long one is another recording.
    for lost, found in ((2.0, 1), (3000.0, 0)):
        starts = (0.0, 3000 / RATE + lost)
        signal = Signal(x, RATE, "rad/s", "gyro_x", segments=((0, 3000), (3000, samples)), starts=starts)
        assert len(inspect(Imu({"gyro_x": signal})).warm_ups) == found


def test_a_stream_says_the_same(tmp_path):
    samples = 40_000
    path = tmp_path / "warm.csv"
    made(NOISE, samples, 2, settling(samples, 5e-3, 60.0)).write(path)
    whole, chunked = inspect(gmwm.read(path)), inspect(gmwm.stream(path, chunk=997))
    assert len(whole.warm_ups) == 1
    assert whole.warm_ups == chunked.warm_ups
    assert whole.remarks == chunked.remarks
    assert whole.remarks


@pytest.mark.parametrize("values", [np.full(20_000, 0.3), np.round(np.linspace(0, 3, 20_000))])
def test_levels_without_noise(values):
    assert inspect(Imu({"gyro_x": Signal(values, RATE, "rad/s", "gyro_x")})).warm_ups == ()
