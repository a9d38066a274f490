"""A calibration names the numbers that a trend or a coarse output affects."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.base.units import STANDARD_GRAVITY
from gmwm.calibration.number_verdicts import Usability
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.reports.verdict import recording_facts
from tests.helpers import code_of, only

RATE, SAMPLES = 20.0, 40_000
AT = np.arange(SAMPLES) / RATE


def recording(course, step=0.0):
    x = np.random.default_rng(1).normal(size=SAMPLES) * 1e-3 + course
    x = np.round(x / step) * step if step else x
    return Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")})


def calibrated(course, within, step=0.0):
    return gmwm.calibrate(recording(course, step), within=within, warmup="keep")


@pytest.mark.slow
@pytest.mark.parametrize("within", ["WN + RW", "WN + RW + DR", "WN + DR"])
def test_a_line_makes_k_a_limit_whether_the_model_has_a_drift_or_not(within):
    """A filter has no drift, so that its K contains the line of a model with a drift too."""
    walk = np.cumsum(np.random.default_rng(5).normal(size=SAMPLES)) * 2e-6
    found = calibrated(walk + 2e-2 * AT / AT[-1], within)
    assert only(found.remarks, "linear-trend").facts["numbers"] == ("K",)
    assert found.number_verdicts["gyro_x"]["K"].usability is not Usability.USE


@pytest.mark.slow
@pytest.mark.parametrize(("size", "refused"), [(0.1, True), (0.01, False)])
def test_a_fast_warm_up_of_a_short_recording_refuses_n(size, refused):
    """It hides the white noise at 1 s, and 600 s leave too little behind 100 s of warm-up: N was 17 % too small."""
    x = recording(0.0)["gyro_x"].values[:6000] + size * np.exp(-AT[:6000] / 60.0)
    found = gmwm.calibrate(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")}), within="2*GM + WN + RW", warmup="keep")
    assert (found.number_verdicts["gyro_x"]["N"].usability is Usability.DO_NOT_USE) is refused
    assert ("too-short" in {remark.code for remark in found.remarks}) is refused


def test_a_drift_that_raises_k_beyond_its_interval_makes_k_a_limit():
    """The remark on a line may be missing, because the line is not significant beside the walk."""
    walk = np.cumsum(np.random.default_rng(5).normal(size=SAMPLES)) * 2e-6
    found = calibrated(walk + 2e-2 * AT / AT[-1], "WN + RW + DR")
    assert [r.facts["numbers"] for r in found.remarks if code_of(r) == "drift:drift"] == [("K",)]


@pytest.mark.slow
def test_the_numbers_are_those_of_the_datasheet():
    found = calibrated(2e-3 * np.exp(-AT / 300.0), "WN + RW")
    numbers = only(found.remarks, "warm-up:large").facts["numbers"]
    assert "K" in numbers
    assert set(numbers) <= set(found.datasheets["gyro_x"])
    assert found.number_verdicts["gyro_x"]["K"].usability is Usability.BOUND
    assert (code_of(found.verdict), found.verdict.facts["reasons"]) == ("verdict:usable", ("warm-up",))


@pytest.mark.slow
def test_a_large_warm_up_is_left_out(tmp_path):
    imu = recording(2e-3 * np.exp(-AT / 100.0))
    found = gmwm.calibrate(imu, within="WN + RW")
    first = only(found.remarks, "warm-up:omitted").facts["first"].value
    assert found["gyro_x"].wavelet_variance.samples == SAMPLES - first * RATE
    assert f"without the first {first / 60:g} min (settling)" in found.summary()
    assert found["gyro_x"].objective == gmwm.calibrate(imu.between(first), within="WN + RW")["gyro_x"].objective
    path = tmp_path / "warm.csv"
    imu.write(path)
    streamed = gmwm.calibrate(gmwm.stream(path, chunk=997), within="WN + RW")
    assert streamed["gyro_x"].objective == gmwm.calibrate(gmwm.read(path), within="WN + RW")["gyro_x"].objective
    assert "warm-up" not in {remark.code for remark in calibrated(0.0, "WN + RW").remarks}


@pytest.mark.slow
def test_axes_of_different_length_are_named_alike_in_every_document():
    rng = np.random.default_rng(8)
    lost = rng.random(SAMPLES) < 0.01
    lost[0] = False
    values = {"gyro_x": 2e-3 * np.exp(-AT / 100.0), "gyro_y": np.zeros(SAMPLES)}
    imu = Imu({
        axis: Signal.from_missing(np.where(lost, np.nan, x + 1e-3 * rng.normal(size=SAMPLES)), RATE, "rad/s", axis)
        for axis, x in values.items()
    })  # fmt: skip
    found = gmwm.calibrate(imu, within="WN + RW")
    short, long = (wv.samples - wv.filled for wv in (found[axis].wavelet_variance for axis in values))
    assert short < long
    assert f"{short} to {long} samples" in found.summary()
    assert "on 1 of 2 axes (settling)" in " ".join(found.summary().split())
    assert dict(recording_facts(found)["facts"])["Length"].startswith(f"{short} to {long} samples")
    assert f"{short} to {long} samples" in found.export(format="csv")
    filled = {remark.subject: remark.facts["count"] for remark in found.remarks if remark.code == "gaps-filled"}
    assert filled["gyro_x"] < filled["gyro_y"]


def test_a_slow_warm_up_limits_k():
    # 300 s is longer than the scales at which a misfit affects K, but the warm-up also raises K at shorter scales.
    found = calibrated(5e-2 * np.exp(-AT / 600.0), "WN + RW")
    assert found.number_verdicts["gyro_x"]["K"].usability is not Usability.USE


@pytest.mark.slow
def test_an_offset_of_an_accelerometer_is_a_bias():
    rng = np.random.default_rng(2)
    means = np.array([0.08, -0.06, 0.9]) * STANDARD_GRAVITY
    signals = {f"accel_{axis}": 1e-2 * rng.normal(size=20_000) + mean for axis, mean in zip("xyz", means, strict=True)}
    found = gmwm.calibrate(Imu.from_arrays(signals, rate=RATE), within="WN + RW")
    assert "unit-contradicted" in {remark.code for remark in found.remarks}
    assert all(of_axis["N"].usability is Usability.USE for of_axis in found.number_verdicts.values())


@pytest.mark.slow
def test_a_dithered_gyroscope_has_a_right_unit():
    # The dither of a laser gyroscope gives 1.6 deg/s/√Hz in first differences; N of the noise is 0.0084 deg/s/√Hz.
    rate, samples = 1000.0, 100_000
    at = np.arange(samples) / rate
    noise = np.radians(8.4e-3) * np.sqrt(rate) * np.random.default_rng(3).normal(size=samples)
    imu = Imu.from_arrays({"gyro_x": noise + np.radians(50.0) * np.sin(2 * np.pi * 413.7 * at)}, rate=rate)
    assert "unit-doubtful" not in {remark.code for remark in gmwm.inspect(imu).remarks}
    assert "unit-doubtful" not in {remark.code for remark in gmwm.calibrate(imu).remarks}


@pytest.mark.slow
def test_a_coarse_output_is_not_a_usable_calibration():
    found = calibrated(0.0, "WN + RW", step=3e-3)
    numbers = only(found.remarks, "coarse-output").facts["numbers"]
    assert {"N", "B"} <= set(numbers)
    assert code_of(found.verdict) == "verdict:unusable"


@pytest.mark.slow
def test_a_model_without_such_numbers_has_its_terms_named():
    found = calibrated(2e-3 * np.exp(-AT / 300.0), "GM + WN")
    assert only(found.remarks, "warm-up:large").facts["numbers"]


def test_parts_with_an_offset_of_20_sd_do_not_end_in_advice_that_does_not_fit():
    """The full weights of a robust curve of such parts lead to a model without noise; see `_nearly_settled`."""
    rng, samples = np.random.default_rng(6), 100_000
    x, moved = rng.standard_normal(samples) * 1e-3, rng.random(samples) < 0
    while moved.mean() < 0.2:
        start = rng.integers(0, samples - 2500)
        moved[start : start + 2500] = True
    x[moved] += 2e-2
    found = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"), within="WN + RW", robust=True)
    assert code_of(found.verdict) == "verdict:unusable"
    assert {"recording-moved", "no-test"} <= {remark.code for remark in found.remarks}


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["decay", "sine"])
def test_signals_without_noise_are_calibrated_and_not_to_be_used(shape):
    t = np.arange(100_000) / 100.0
    x = 1e-3 * (np.exp(-t / 100) if shape == "decay" else np.sin(2 * np.pi * t))
    found = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"), within="WN + RW")
    assert found.verdict.severity < gmwm.base.remarks.Severity.INFO
