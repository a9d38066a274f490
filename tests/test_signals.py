from __future__ import annotations

import pickle

import numpy as np
import pytest

from gmwm.errors import DataError, OptionError, UnitError
from gmwm.signals import AXES, Imu, Signal, TimeBase


def test_from_arrays_converts_to_si():
    table = np.arange(60.0).reshape(10, 6)
    imu = Imu.from_arrays(table, 50, units={"gyro": "deg/s", "accel": "g"}, start=2.0, source="x")
    assert imu.axes == AXES
    np.testing.assert_allclose(imu["gyro_y"].values, np.radians(table[:, 1]), rtol=1e-15)
    np.testing.assert_allclose(imu["accel_x"].values, table[:, 3] * 9.80665, rtol=1e-15)
    assert (imu["accel_x"].unit, imu["gyro_x"].unit, imu["gyro_x"].start) == ("m/s²", "rad/s", 2.0)
    assert imu.time_base == TimeBase(50.0, start=2.0)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (({"gyrox": [1.0]}, 1), OptionError, "axis must be one of"),
        ((np.ones((6, 100)), 1), DataError, "pass its transpose"),
        (([1.0, 2.0], 1), DataError, r"got shape \(2,\)"),
        (({"gyro_x": [1.0, np.nan]}, 1), DataError, "gyro_x must be finite"),
        (({"gyro_x": [1.0], "gyro_y": [1.0, 2.0]}, 1), DataError, "share length"),
        (({"gyro_x": [1.0]}, 0), OptionError, "rate must be positive"),
        (({}, 1), DataError, "at least one axis"),
    ],
)
def test_from_arrays_refuses(arguments, error, message):
    with pytest.raises(error, match=message):
        Imu.from_arrays(*arguments)


def test_from_arrays_refuses_units():
    with pytest.raises(UnitError):
        Imu.from_arrays({"gyro_x": [1.0]}, 1, units={"gyro": "g"})
    with pytest.raises(OptionError, match="gyro or accel"):
        Imu.from_arrays({"gyro_x": [1.0]}, 1, units={"time": "s"})


def test_longest_starts_when_its_segment_does():
    signal = Signal(np.arange(10.0), 10.0, segments=((0, 3), (3, 10)), starts=(5.0, 99.0))
    assert signal.longest().start == 99.0
    assert signal.longest().values.tolist() == list(range(3, 10))
    np.testing.assert_allclose(signal.times([0, 2, 3, 9]), [5.0, 5.2, 99.0, 99.6], rtol=1e-15)


def test_segments_without_starts_are_never_contiguous():
    times = Signal(np.arange(6.0), 1.0, segments=((0, 2), (2, 4), (4, 6))).times()
    assert times.tolist() == [0, 1, 3, 4, 6, 7]


def test_starts_must_fit_the_segments():
    with pytest.raises(DataError, match="one time for each of 2 segments, got 1"):
        Signal(np.arange(6.0), 1.0, segments=((0, 2), (2, 6)), starts=(0.0,))


def test_pickle_keeps_everything_read_only():
    imu = Imu.from_arrays({"gyro_x": np.arange(9.0)}, 10, segments=((0, 4), (4, 9)))
    again = pickle.loads(pickle.dumps(imu))
    assert again["gyro_x"].values.tolist() == imu["gyro_x"].values.tolist()
    assert again["gyro_x"].starts == imu["gyro_x"].starts
    assert not again["gyro_x"].values.flags.writeable


def test_temperature_has_the_length_of_the_recording():
    with pytest.raises(DataError, match="temperature must hold one value"):
        Imu({"gyro_x": Signal(np.arange(9.0), 1.0)}, temperature=np.arange(8.0))
