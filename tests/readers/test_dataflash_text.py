"""ArduPilot's logs as text, as Mission Planner writes them."""

import warnings

import numpy as np
import pytest

from gmwm.base.errors import ReadError
from gmwm.base.units import AXES
from gmwm.files.formats import dataflash
from gmwm.files.readers import find_reader, read, stream
from tests.helpers import only, raises

ROWS = 400
VALUES = np.random.default_rng(1).normal(size=(ROWS, 6)).round(6) * 0.01 + np.array([0, 0, 0, 0, 0, -9.8])
BEGIN = [
    "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
    "FMT, 131, 55, IMU, QBffffffIIfBBHH, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
    "FMT, 140, 20, ATT, Qccc, TimeUS,Roll,Pitch,Yaw",
    "PARM, 100, LOG_BITMASK, 176126",
]


def line(k, instance=0, temperature=31.5):
    numbers = ", ".join(f"{value:.8f}" for value in VALUES[k] * (1 + instance))
    return f"IMU, {5_000_000 + 2500 * k}, {instance}, {numbers}, 0, 0, {temperature}, 1, 1, 1000, 1000"


def written(folder, lines):
    path = folder / "2024-05-01 12-00-00.log"
    path.write_text("\n".join([*BEGIN, *lines]) + "\n")
    return path


def test_two_sensors_among_other_messages(tmp_path, monkeypatch):
    monkeypatch.setattr(dataflash, "CHUNK_ROWS", 90)
    lines = [text for k in range(ROWS) for text in (line(k), f"ATT, {k}, 0.1, 0.2, 0.3", line(k, 1))]
    path = written(tmp_path, lines)
    assert find_reader(path).name == "ardupilot text"
    imu = read(path)
    assert imu.axes == AXES
    assert imu.rate == pytest.approx(400.0, rel=1e-12)
    np.testing.assert_allclose(np.column_stack([imu[axis].values for axis in AXES]), VALUES, atol=1e-8)
    assert np.all(imu.temperature == 31.5)
    assert imu.time_base.start == 5.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        second = read(path, topic="IMU_1")
        parts = list(stream(path, topic="IMU_1").samples())
    np.testing.assert_allclose(second["gyro_x"].values, 2 * VALUES[:, 0], atol=2e-8)
    assert len(parts) > 1
    assert np.array_equal(np.concatenate([part.values["gyro_x"] for part in parts]), second["gyro_x"].values)


def test_damaged_lines_are_gaps(tmp_path):
    lines = [line(k, temperature=0) for k in range(ROWS)]
    lines[100], lines[200] = lines[100][:30], lines[200].replace("-9", "-x9")
    path = written(tmp_path, [*lines, "IMU, 60"])
    imu = read(path)
    assert imu.segments == ((0, 100), (100, 199), (199, ROWS - 2))
    assert only(imu.remarks, "log-dropouts:dropouts").facts == {"case": "dropouts", "count": 3}
    assert imu.temperature is None


def test_a_log_without_inertial_messages(tmp_path):
    with raises(ReadError, code="no-inertial-data"):
        read(written(tmp_path, ["ATT, 1, 0.1, 0.2, 0.3"]))
