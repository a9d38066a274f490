"""Robust curves of recordings that are read twice are those of the recordings in memory."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.streaming import measured_curves
from gmwm.recording import batches
from tests.helpers import raises

RATE = 100.0
SAMPLES = 40_000


@pytest.fixture
def spoilt(tmp_path):
    """A recording of three axes with a gap and outliers."""
    rng = np.random.default_rng(1)
    x = rng.normal(size=(SAMPLES, 3)) * 1e-3
    x[:, 1] += 2e-7 * np.arange(SAMPLES)
    x[rng.integers(0, SAMPLES, 80), rng.integers(0, 3, 80)] += 5.0
    path = tmp_path / "spoilt.csv"
    k = np.arange(SAMPLES)
    rows = np.column_stack([(k + 100 * (k >= 15_000)) / RATE, x])
    np.savetxt(path, rows, "%.9g", ",", header="time,gyro_x,gyro_y,gyro_z", comments="")
    return path


def stream(path, **options):
    return gmwm.stream(path, units={"gyro": "rad/s"}, **options)


def pairs_of(source, **options):
    """The classical and the robust curve of each axis, from the same reading."""
    measured = measured_curves(source, source.axes, **options)
    return {axis: (one.classical(), one.robust()) for axis, one in measured.items()}


def same(found, expected, rtol=1e-9):
    assert np.array_equal(found.counts, expected.counts)
    for name in ("variance", "lower", "upper"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=rtol, err_msg=name)
    for name in ("segments", "samples", "rate", "unit", "axis", "confidence", "robust", "efficiency"):
        assert getattr(found, name) == getattr(expected, name), name


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"efficiency": 0.9}, {"levels": 6, "confidence": 0.5, "threads": 1}])
def test_a_robust_curve_of_a_file_is_that_in_memory(spoilt, options):
    imu = gmwm.read(spoilt, units={"gyro": "rad/s"})
    curves = stream(spoilt, chunk=4000).wavelet_variance(robust=True, exact=15, **options)
    known = {name: value for name, value in options.items() if name != "threads"}
    for axis, found in curves.items():
        expected = gmwm.wavelet_variance(imu[axis], robust=True, **known)
        same(found, expected)
        assert (found.segments, found.filled) == ((), 100)
        assert found.variance[0] < 0.1 * gmwm.wavelet_variance(imu[axis]).variance[0]
    # Of white noise alone √(12 / n³) is 9e-10.
    assert curves["gyro_y"].slope == pytest.approx(2e-7, rel=0.05)
    assert abs(curves["gyro_x"].slope) < 1e-8


@pytest.mark.slow
def test_both_curves_from_the_same_reading(spoilt):
    told = []
    pairs = pairs_of(stream(spoilt, chunk=4000), exact=10, done=told.append)
    classical, robust = (
        stream(spoilt).wavelet_variance(exact=10),
        stream(spoilt).wavelet_variance(exact=10, robust=True),
    )
    for axis, (plain, safe) in pairs.items():
        same(plain, classical[axis], 1e-12)
        same(safe, robust[axis])
        assert plain.slope == pytest.approx(classical[axis].slope, rel=1e-9)
        assert safe.strides == plain.strides == (*(1,) * 10, *(1 << (j - 6) for j in range(11, 16)))
    assert told == sorted(told)
    assert (told.count(SAMPLES), told[-1]) == (1, 2 * SAMPLES)
    fitted = gmwm.fit("WN", pairs["gyro_x"][1])
    assert fitted.parameters["WN.sigma2"] == pytest.approx(1e-6, rel=0.05)


@pytest.mark.slow
def test_one_pass_is_enough_for_most(spoilt):
    told = []
    once = pairs_of(stream(spoilt), passes=1, exact=15, done=told.append)
    twice = pairs_of(stream(spoilt), exact=15)
    assert told[-1] == SAMPLES
    for axis, (plain, safe) in once.items():
        same(plain, twice[axis][0], 1e-12)
        rooted = np.array(twice[axis][1].diagnostics["robust"]["outcome"]) == "root"
        assert rooted.sum() > 10
        np.testing.assert_allclose(safe.variance[rooted], twice[axis][1].variance[rooted], rtol=1e-4)
        np.testing.assert_allclose(safe.variance, twice[axis][1].variance, rtol=8e-3)
        assert safe.slope is None


@pytest.mark.slow
def test_what_comes_between_the_passes_belongs_to_neither(spoilt):
    expected = stream(spoilt).wavelet_variance(robust=True, exact=12)
    told = []

    def grow(samples):
        told.append(samples)
        if samples == SAMPLES:
            with spoilt.open("a") as file:
                file.writelines(f"{(SAMPLES + 100 + k) / RATE:.9g},1,2,{k}\n" for k in range(3000))

    found = stream(spoilt, chunk=7000).wavelet_variance(robust=True, exact=12, done=grow)
    assert told[-1] == 2 * SAMPLES
    for axis, curve in found.items():
        same(curve, expected[axis])


@pytest.mark.slow
def test_a_recording_that_has_lost_samples_is_told(spoilt, monkeypatch):
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 7_000)  # a recording that is one batch is read once

    def shrink(samples):
        if samples == SAMPLES:
            lines = spoilt.read_text().splitlines(keepends=True)
            spoilt.write_text("".join(lines[:30_001]))

    with raises(DataError, "gyro_x", "40100 in 1 segments", "30100 in 1 segments"):
        stream(spoilt).wavelet_variance(robust=True, exact=12, done=shrink)


@pytest.mark.slow
def test_samples_that_fit_into_memory_are_read_once(spoilt):
    imu, told = gmwm.read(spoilt, units={"gyro": "rad/s"}), []
    found = stream(spoilt, chunk=4000).wavelet_variance(robust=True, done=told.append)
    assert told[-1] == SAMPLES
    expected = gmwm.wavelet_variance(imu, robust=True)
    assert found.to_dict() == expected.to_dict()  # to the last bit
    assert stream(spoilt, chunk=999).wavelet_variance().to_dict() == gmwm.wavelet_variance(imu).to_dict()


@pytest.mark.slow
def test_options(spoilt):
    with raises(OptionError, argument="passes", got=3):
        stream(spoilt).wavelet_variance(robust=True, passes=3)
    with raises(OptionError, argument="efficiency", got=2.0):
        stream(spoilt).wavelet_variance(robust=True, efficiency=2.0)
    with raises(OptionError, advises=["robust=True"]):
        stream(spoilt).wavelet_variance(efficiency=0.9)
