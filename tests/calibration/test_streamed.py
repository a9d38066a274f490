"""The calibration of a recording in chunks equals the one of the same recording in memory."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.calibration.passes import curves_and_inspection, read_recording
from gmwm.files.formats import text
from gmwm.measuring.inspection.api import FirstPass
from gmwm.measuring.streaming import passes
from gmwm.recording import batches
from tests.helpers import codes, only, raises

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


@pytest.mark.slow
def test_a_stream_is_calibrated_as_the_recording(path, monkeypatch):
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 5_000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 200_000)
    calls = []
    options = {"within": "GM + WN + RW", "rng": 3}
    whole = gmwm.calibrate(gmwm.read(path), **options)
    chunks = gmwm.calibrate(gmwm.stream(path), progress=lambda *step: calls.append(step), **options)
    assert whole.to_dict() == chunks.to_dict()
    assert only(whole.remarks, "samples-replaced:knocks", "gyro_y").facts["count"] == 1
    assert whole.recording_remarks
    assert calls[0][0] == 0
    told = [text for _, _, text in calls]
    assert len([one for one in told if one.startswith("first pass: ")]) > 2
    assert told.index("first pass: 3.3 min") > 1
    assert "second pass: 3.3 min of 3.3 min" in told
    assert calls[-1][:2] == (9, 9)


@pytest.mark.slow
def test_more_samples_than_fit_into_memory(path, monkeypatch):
    whole = gmwm.calibrate(gmwm.read(path), within="WN + RW")
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 5_000)
    monkeypatch.setattr(passes, "exact_levels", lambda axes: 10)
    monkeypatch.setattr(passes, "held_samples", lambda axes: 7_000)
    found, again = (gmwm.calibrate(data, within="WN + RW") for data in (gmwm.read(path), gmwm.stream(path)))
    assert found.to_dict() == again.to_dict()
    for axis in whole:
        wv, exact = found[axis].wavelet_variance, whole[axis].wavelet_variance
        assert (wv.robust, max(wv.strides)) == (exact.robust, 1 << (len(wv) - 6))
        # Within a batch, the samples of a knock are drawn from those of the batch.
        np.testing.assert_allclose(wv.variance[:10], exact.variance[:10], rtol=0.03 if axis == "gyro_y" else 1e-9)
        assert "approximated:levels" in codes(found.remarks)


@pytest.mark.slow
def test_axes_of_a_stream(path):
    found = gmwm.calibrate(gmwm.stream(path), within="WN + RW", axes="accel")
    assert list(found) == ["accel_z"]
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
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 1_500)
    monkeypatch.setattr(passes, "held_samples", lambda axes: 100)
    stream = gmwm.stream(file, rate=100.0)
    accumulators, seen, _ = read_recording(stream, stream.axes, 0.6)
    assert sum(map(len, stream)) == 3000
    axis = accumulators["gyro_x"]
    assert seen.samples == 2000 == axis.curves.robust().samples == axis.spectrum().samples
    assert seen.axes["gyro_x"].sd == pytest.approx(rows[:2000].std(), rel=1e-12)


@pytest.mark.slow
def test_one_reading_is_enough_for_one_curve(path):
    stream = gmwm.stream(path)
    curves, seen = curves_and_inspection(stream, ["gyro_x"], robust=False, efficiency=0.6)
    assert list(curves) == ["gyro_x"]
    assert list(seen.axes) == ["gyro_x", "gyro_y", "accel_z"]
    assert curves["gyro_x"].to_dict() == gmwm.wavelet_variance(gmwm.read(path))["gyro_x"].to_dict()
    assert seen.to_dict()["axes"] == gmwm.inspect(gmwm.read(path)).to_dict()["axes"]
