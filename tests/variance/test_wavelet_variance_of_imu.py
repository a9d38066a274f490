"""`wavelet_variance` of a recording: a curve of each axis, in one mapping that prints, draws and travels."""

import json
import pickle
from collections.abc import Mapping

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.variance import WaveletVariances
from tests.helpers import raises

IMU = gmwm.simulate("WN(sigma2=4e-8) + RW(gamma2=1e-13)", rate=100.0, samples=2000, rng=1)
CURVES = gmwm.wavelet_variance(IMU)


@pytest.mark.parametrize(
    "options", [{}, {"robust": True, "efficiency": 0.8}, {"filter": "d4", "transform": "dwt", "levels": 5}]
)
def test_each_curve_is_that_of_its_axis(options):
    curves = gmwm.wavelet_variance(IMU, confidence=0.9, **options)
    assert isinstance(curves, Mapping)
    assert tuple(curves) == IMU.axes
    assert len(curves) == 6
    for axis in IMU:
        alone = gmwm.wavelet_variance(IMU[axis], confidence=0.9, **options)
        assert curves[axis].to_dict() == alone.to_dict()
    assert curves.to_dict() == {axis: wv.to_dict() for axis, wv in curves.items()}
    json.dumps(curves.to_dict())


def test_a_sensor_alone_and_a_rate_that_contradicts():
    assert tuple(gmwm.wavelet_variance(IMU["accel"])) == ("accel_x", "accel_y", "accel_z")
    with raises(OptionError, "100 Hz", argument="rate"):
        gmwm.wavelet_variance(IMU, rate=50.0)


def test_an_axis_that_is_not_there():
    gyro = gmwm.wavelet_variance(IMU["gyro"])
    with raises(DataError, argument="axis", expected="one of gyro_x, gyro_y, gyro_z", got="accel_x"):
        gyro["accel_x"]
    assert "accel_x" not in gyro
    assert gyro.get("accel_x") is None
    with raises(DataError, argument="curves", got={}):
        WaveletVariances(curves={})


def test_the_summary_has_every_number_of_every_axis():
    text = CURVES.summary()
    assert text.startswith("Haar MODWT wavelet variance: 2000 samples at 100 Hz\n")
    assert text.count("variance in (rad/s)²") == text.count("variance in (m/s²)²") == 1
    for wv in CURVES.values():
        assert all(f"{value:.6e}" in text for value in wv.variance)
    assert "robust with efficiency 0.6" in gmwm.wavelet_variance(IMU["gyro"], robust=True).summary()


@pytest.mark.slow
def test_the_plot_has_a_panel_for_each_axis(tmp_path):
    path = tmp_path / "unit.png"
    figure = CURVES.plot(path=path)
    assert [axes.get_title() for axes in figure.axes][:2] == ["Gyroscope X", "Gyroscope Y"]
    assert len(figure.axes) == 6
    assert path.read_bytes().startswith(b"\x89PNG")
    assert len(CURVES.plot(split=False, units="datasheet").axes) == 2


def test_it_travels():
    again = pickle.loads(pickle.dumps(CURVES))
    assert again.to_dict() == CURVES.to_dict()
    assert repr(again) == repr(CURVES)


@pytest.mark.slow
def test_a_calibration_takes_it():
    found = gmwm.calibrate(CURVES, "WN + RW")
    assert tuple(found) == IMU.axes
    np.testing.assert_array_equal(found["gyro_x"].wavelet_variance.variance, CURVES["gyro_x"].variance)


def test_a_stream_gives_the_same_kind_of_result(tmp_path):
    path = tmp_path / "static.csv"
    IMU.write(path)
    streamed = gmwm.stream(path).wavelet_variance()
    assert isinstance(streamed, WaveletVariances)
    for axis, wv in streamed.items():
        np.testing.assert_allclose(wv.variance, CURVES[axis].variance, rtol=1e-9)
