"""The calibration of a recording in chunks equals the one of the same recording in memory."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.calibration.stream_measurement import InspectedStream, measured_and_inspected
from gmwm.errors import OptionError
from gmwm.inspection.api import FirstPass
from tests.helpers import only, raises

MODELS = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-10)", "gyro_y": "WN(sigma2=1e-7)", "accel_z": "WN(sigma2=4e-6)"}


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    imu = gmwm.simulate(MODELS, rate=100.0, samples=20_000, rng=1)
    spoilt = imu["gyro_y"].values.copy()
    spoilt[7000:7010] += 0.1
    arrays = {axis: imu[axis].values for axis in imu} | {"gyro_y": spoilt}
    file = tmp_path_factory.mktemp("streamed") / "static.csv"
    gmwm.Imu.from_arrays(arrays, 100.0, segments=((0, 6000), (6000, 20_000))).write(file)
    return file


def test_a_stream_is_calibrated_as_the_recording(path):
    calls = []
    options = {"within": "GM + WN + RW", "rng": 3}
    whole = gmwm.calibrate(gmwm.read(path), **options)
    pieces = gmwm.calibrate(gmwm.stream(path, chunk=3000), progress=lambda *step: calls.append(step), **options)
    assert list(whole) == list(pieces)
    for axis in whole:
        one, other = whole.axes[axis], pieces.axes[axis]
        assert one.fit.model.structure == other.fit.model.structure
        assert other.fit.wavelet_variance.strides == ()
        for name, value in one.fit.parameters.items():
            assert other.fit.parameters[name] == pytest.approx(value, rel=1e-6)
        np.testing.assert_allclose(other.spectrum.density, one.spectrum.density, rtol=1e-10)
        assert (other.spectrum.unit, other.spectrum.axis) == (one.spectrum.unit, axis)
        assert one.verdict.contaminated == other.verdict.contaminated == (axis == "gyro_y")
    assert whole.recording_remarks == pieces.recording_remarks
    assert whole.recording_remarks
    a, b = whole.recording.to_dict(), pieces.recording.to_dict()
    assert a.pop("jitter") == pytest.approx(b.pop("jitter"), rel=1e-6)
    assert a == b
    assert calls[0][0] == 0
    assert [text for _, _, text in calls][:2] == ["first pass: 30 s", "first pass: 60 s"]
    assert "second pass: 3.3 min of 3.3 min" in [text for _, _, text in calls]
    assert calls[-1][:2] == (12, 12)


def test_axes_of_a_stream(path):
    found = gmwm.calibrate(gmwm.stream(path), within="WN + RW", axes="accel")
    assert list(found) == ["accel_z"]
    assert only(found.recording_remarks, "knocks").facts["count"] == 1
    with raises(OptionError, argument="axes", expected="some of gyro_x, gyro_y, accel_z", got="gyro_z"):
        gmwm.calibrate(gmwm.stream(path), axes="gyro_z")


def test_rows_that_are_appended_between_the_passes_are_ignored(tmp_path, monkeypatch):
    file = tmp_path / "growing.csv"
    rows = np.random.default_rng(1).normal(size=3000)

    def add(values):
        with file.open("a") as out:
            out.writelines(f"{value}\n" for value in values)

    file.write_text("gyro_x [rad/s]\n")
    add(rows[:2000])
    second_pass = FirstPass.second_pass

    def between(first):
        add(rows[2000:])
        return second_pass(first)

    monkeypatch.setattr(FirstPass, "second_pass", between)
    stream = gmwm.stream(file, rate=100.0)
    curves, seen, _, spectra = measured_and_inspected(stream, stream.axes)
    assert sum(map(len, stream)) == 3000
    assert seen.samples == 2000 == curves["gyro_x"][1].samples == spectra["gyro_x"].samples
    assert seen.axes["gyro_x"].sd == pytest.approx(rows[:2000].std(), rel=1e-12)


def test_one_reading_is_enough_for_one_curve(path):
    stream = gmwm.stream(path)
    curves, seen, _, spectra = measured_and_inspected(stream, ["gyro_x"], pairs=False)
    assert list(curves) == ["gyro_x"]
    assert spectra == {}
    assert list(seen.axes) == ["gyro_x", "gyro_y", "accel_z"]
    three_passes = InspectedStream(stream, ["gyro_x"])
    assert [sum(map(len, three_passes)) for _ in range(3)] == [20_000] * 3
