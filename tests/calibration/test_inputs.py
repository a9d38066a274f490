"""Every input of `calibrate` is inspected in the same way, whatever form the user gave."""

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from tests.helpers import codes

RATE = 100.0


def _codes(calibration, axis):
    return set(codes(remark for remark in calibration.remarks if remark.subject in ("", axis)))


def _spoilt(kind):
    """Return a recording of a gyroscope (rad/s) with one fault, and the remark that names it."""
    rng = np.random.default_rng(5)
    x = rng.normal(0, 1e-3, 60_000)
    time = np.arange(x.size) / RATE
    if kind == "coarse-output":
        return np.round(x / 4e-3) * 4e-3
    if kind == "warm-up:large":
        return x + 3e-3 * np.exp(-time / 60)
    if kind == "axis-stuck":
        return np.where(time < 300, x, x[30_000])
    return x * 180 / np.pi * 2 if kind == "unit-doubtful:density" else x + 1e-3 * (time > 200)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["coarse-output", "warm-up:large", "axis-stuck", "unit-doubtful:density", "fault-undone:jumps"]
)
def test_a_signal_is_inspected_like_a_recording(kind):
    signal = Signal(_spoilt(kind), RATE, "rad/s", axis="gyro_x")
    every = {
        "signal": gmwm.calibrate({"gyro_x": signal} if kind == "coarse-output" else signal, "WN + RW"),
        "recording": gmwm.calibrate(Imu({"gyro_x": signal}), "WN + RW"),
    }
    assert all(kind in _codes(calibration, "gyro_x") for calibration in every.values())
    documents = [calibration.to_dict() for calibration in every.values()]
    assert all(document["remarks"] == documents[0]["remarks"] for document in documents)


def test_signals_of_different_lengths_are_inspected_each_by_itself():
    short = Signal(np.random.default_rng(1).normal(0, 1e-3, 5_000), 50.0, "rad/s", axis="gyro_y")
    calibration = gmwm.calibrate(
        {"gyro_x": Signal(_spoilt("warm-up:large"), RATE, "rad/s"), "gyro_y": short}, "WN + RW"
    )
    assert "warm-up:large" in _codes(calibration, "gyro_x")
    assert "warm-up:large" not in _codes(calibration, "gyro_y")


def test_an_axis_that_is_given_as_a_curve_is_not_inspected():
    x = np.random.default_rng(1).normal(0, 1e-3, 5_000)
    calibration = gmwm.calibrate(
        {"gyro_x": gmwm.wavelet_variance(Signal(x, RATE, "rad/s")), "gyro_y": Signal(x, RATE, "rad/s")}, "WN + RW"
    )
    assert [remark.subject for remark in calibration.remarks if remark.code == "not-inspected"] == ["gyro_x"]


def test_the_unit_of_a_signal_is_doubted_in_its_own_unit():
    x = np.random.default_rng(1).normal(0, 1.0, 60_000)
    assert "unit-doubtful:density" not in _codes(
        gmwm.calibrate(Signal(x, RATE, "deg/h", axis="gyro_x"), "WN"), "gyro_x"
    )
    assert "unit-doubtful:density" in _codes(
        gmwm.calibrate(Signal(5 * x, RATE, "deg/s", axis="gyro_x"), "WN"), "gyro_x"
    )
