"""A log whose noise passed a steep filter is averaged, and other logs are not."""

import numpy as np
import pytest
import scipy.signal

import gmwm
from gmwm import Imu, Signal
from gmwm.recording.batches import batches
from gmwm.recording.repairs import repaired
from gmwm.recording.repairs.averages import averaged, steep_filters
from tests.helpers import only
from validation import faults

RATE = 100.0


def _imu(x, **more):
    return Imu({"gyro_x": Signal(x, RATE, "rad/s", axis="gyro_x", **more)})


def _cic(length, size, seed=0):
    rng = np.random.default_rng(seed)
    x = faults.WHITE * rng.normal(size=size + 3 * length)
    for _ in range(3):
        x = np.convolve(x, np.ones(length) / length, "valid")
    return x[:size] + np.cumsum(faults.WALK * rng.normal(size=size))


@pytest.mark.slow
@pytest.mark.parametrize("length", [8, 16, 32])
def test_the_noise_behind_a_steep_filter_is_averaged(length):
    x = _cic(length, 120_000)
    (part,) = repaired(_imu(x))
    count = round(RATE / part.rate)
    assert 2 * length <= count <= 10 * length
    means = x[: len(part) * count].reshape(-1, count).mean(axis=1)
    assert np.corrcoef(part["gyro_x"].values, means)[0, 1] > 0.99
    verdict = gmwm.calibrate(_imu(x)).number_verdicts["gyro_x"]["N"]
    assert verdict.usability.value == "use"


@pytest.mark.slow
def test_a_filter_with_a_memory_of_seconds_is_averaged_to_its_rate():
    x = _cic(128, 600_000)
    calibration = gmwm.calibrate(_imu(x))
    remark = only(calibration.remarks, "fault-undone:filtered")
    assert 250 <= remark.facts["count"] <= 1000
    number = calibration.datasheets["gyro_x"]["N"]
    assert number.low < faults.WHITE / RATE**0.5 < number.high


@pytest.mark.slow
@pytest.mark.parametrize("length", [32, 64])
def test_means_of_filtered_noise_are_white(length, tmp_path):
    recording = _imu(_cic(length, 600_000, seed=3))
    before, (after,) = averaged(recording, 5 * length, {}), repaired(recording)
    shares = [float(np.mean(np.diff(part["gyro_x"].values) ** 2)) * RATE / part.rate for part in (before, after)]
    ratios = np.array(shares) / (2 * faults.WHITE**2)
    assert ratios[0] < 0.87
    assert ratios[1] == pytest.approx(1, abs=0.1)
    recording.write(tmp_path / "log.csv")
    (stream,) = repaired(gmwm.stream(tmp_path / "log.csv", chunk=7_000))
    assert np.allclose(np.concatenate([p.values["gyro_x"] for p in stream.samples()]), after["gyro_x"].values)


@pytest.mark.parametrize("kind", ["averages", "window", "sharp", "butterworth_2", "butterworth_4", "three_poles"])
def test_the_memory_of_a_filter_is_known_within_7_percent(kind):
    impulse, order = np.eye(1, 4000)[0], int(kind[-1]) if kind[-1].isdigit() else 2
    taps = {
        "averages": np.convolve(np.convolve(np.ones(32), np.ones(32)), np.ones(32)),
        "window": np.hamming(121),
        "sharp": scipy.signal.firwin(401, 0.01, fs=1, window=("kaiser", 8)),
        "three_poles": scipy.signal.lfilter([1], np.poly([0.96] * 3), impulse),
    }.get(kind, scipy.signal.sosfilt(scipy.signal.butter(order, 0.02, output="sos"), impulse))
    covariance = scipy.signal.fftconvolve(taps, taps[::-1]) / taps.sum() ** 2
    memory = float(np.abs(np.arange(covariance.size) - taps.size + 1) @ covariance)
    shares = []
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(size=120_000 + taps.size - 1)
        (part,) = batches(_imu(scipy.signal.fftconvolve(noise, taps, "valid")))
        shares.append(steep_filters(part)["gyro_x"].memory / memory)
    assert np.mean(shares) == pytest.approx(1, abs=0.07)
    assert np.std(shares) < 0.18


def test_a_random_walk_and_one_pole_are_not_averaged():
    rng = np.random.default_rng(1)
    walk = np.cumsum(rng.normal(size=60_000))
    pole = faults.low_pass(rng.normal(size=60_000), 2 * np.pi * 0.005)
    for x in (walk, pole, rng.normal(size=60_000), rng.normal(size=500)):
        recording = _imu(x)
        assert repaired(recording) == (recording,)


@pytest.mark.slow
def test_a_strong_motion_is_no_filter():
    x = np.random.default_rng(5).normal(size=400_000)
    radius = np.exp(-2 * np.pi * 0.01 / 4)  # 1 Hz
    sway = scipy.signal.lfilter([1.0], [1, -2 * radius * np.cos(2 * np.pi * 0.01), radius**2], x[:6_000])
    x[100_000:106_000] += 300 * sway / np.std(sway)
    (part,) = repaired(_imu(1e-3 * x))
    assert part.rate == RATE


def test_means_do_not_extend_across_gaps_and_do_not_depend_on_chunks(tmp_path):
    x = np.random.default_rng(2).normal(size=600_000)
    recording = _imu(x, segments=((0, 250_005), (250_005, 600_000)), starts=(0.0, 3000.0))
    whole = averaged(recording, 10, {})
    assert whole.segments == ((0, 25_000), (25_000, 59_999))
    assert whole["gyro_x"].starts == pytest.approx((0.045, 3000.045))
    assert np.allclose(whole["gyro_x"].values[25_000:], x[250_005:599_995].reshape(-1, 10).mean(axis=1))
    recording.write(tmp_path / "log.csv")
    stream = averaged(gmwm.stream(tmp_path / "log.csv", chunk=1000), 10, {})
    parts = list(stream.samples())
    assert len(parts) > 1
    assert np.allclose(np.concatenate([part.values["gyro_x"] for part in parts]), whole["gyro_x"].values)
    assert [len(part.runs) for part in parts].count(2) <= 1


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.1, 0.4, 1.0])
def test_rounding_does_not_hide_a_steep_filter(step):
    x = _cic(64, 240_000, seed=4)
    unit = step * float(np.std(x))
    calibration = gmwm.calibrate(_imu(np.round(x / unit) * unit))
    assert only(calibration.remarks, "fault-undone:filtered")
    # The rounding error adds up to 8 % to N² of the output.
    assert calibration.datasheets["gyro_x"]["N"].value * RATE**0.5 / faults.WHITE == pytest.approx(1, abs=0.1)


def test_a_rounded_random_walk_is_not_averaged():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        walk = np.cumsum(rng.normal(size=120_000)) + rng.uniform(0, 10) * rng.normal(size=120_000)
        step = 10 ** rng.uniform(-1, 1)
        (part,) = repaired(_imu(np.round(walk / step) * step))
        assert part.rate == RATE


def test_a_slow_rounded_signal_is_not_interpolated():
    x = _cic(64, 120_000, seed=5)
    step = 0.05 * float(np.std(x))
    (part,) = repaired(_imu(np.round(x / step) * step))
    assert [remark.facts["case"] for remark in part.remarks] == ["filtered"]
