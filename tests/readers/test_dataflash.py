"""ArduPilot's logs, made with struct by the published format."""

import struct

import numpy as np
import pytest

from gmwm.base.errors import ReadError
from gmwm.base.units import AXES
from gmwm.files.formats import dataflash
from gmwm.files.readers import find_reader, read, stream
from tests.helpers import only, raises

IMU = (162, "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz")
ATT = (163, "ATT", "Qff", "TimeUS,Roll,Pitch")
ACC, GYR = (
    (164, "ACC", "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
    (165, "GYR", "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
)
ROWS, BEGIN, STEP = 3000, 65_000_000, 2500
VALUES = (np.random.default_rng(1).normal(size=(ROWS, 6)) * 0.01 + np.array([0, 0, 0, 0, 0, -9.8])).astype(np.float32)


def sizes(fields):
    return struct.calcsize("<" + fields.replace("n", "4s").replace("N", "16s").replace("Z", "64s"))


def defined(number, name, fields, labels):
    body = struct.pack("<BB4s16s64s", number, 3 + sizes(fields), name.encode(), fields.encode(), labels.encode())
    return b"\xa3\x95\x80" + body


def message(kind, *values):
    return b"\xa3\x95" + bytes([kind[0]]) + struct.pack("<" + kind[2], *values)


def imu(k, instance=0, shift=0.0, temperature=30.0):
    stamp = BEGIN + STEP * k + instance * 100
    row = VALUES[k] + np.float32(shift)
    return message(IMU, stamp, instance, *row.tolist(), 0, 0, temperature + k / 1000, 1, 1, 1000, 1000)


def log(parts, kinds=(IMU, ATT)):
    formats = [defined(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"), *(defined(*kind) for kind in kinds)]
    return b"".join([*formats, *parts])


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setattr(dataflash, "_BLOCK", 10_007)
    return tmp_path / "00000012.BIN"


def table(imu):
    return np.column_stack([imu[axis].values for axis in imu.axes])


def test_one_sensor_among_other_messages(file):
    parts = [imu(k) + (message(ATT, BEGIN + STEP * k, 0.1, 0.2) if k % 3 == 0 else b"") for k in range(ROWS)]
    file.write_bytes(log(parts))
    assert find_reader(file).name == "ardupilot"
    found = read(file)
    assert (found.axes, found.rate, len(found.segments)) == (AXES, 400, 1)
    np.testing.assert_array_equal(table(found), VALUES)
    assert found["gyro_x"].start == BEGIN / 1e6
    assert found.temperature == pytest.approx(30 + np.arange(ROWS) / 1000, abs=1e-5)
    assert sum(map(len, stream(file))) == ROWS


@pytest.mark.slow
def test_several_sensors_and_raw_samples(file):
    parts = [imu(k) + imu(k, 1, shift=0.5, temperature=0.0) for k in range(ROWS)]
    for k in range(ROWS):
        stamp = BEGIN + STEP * k
        parts.append(message(GYR, stamp + 900, 0, stamp, *VALUES[k, :3].tolist()))
        parts.append(message(ACC, stamp + 900, 0, stamp, *VALUES[k, 3:].tolist()))
    file.write_bytes(log(parts, (IMU, ACC, GYR)))
    found = read(file)
    np.testing.assert_array_equal(table(found), VALUES)
    chosen = only(found.remarks, "topic-chosen:chosen")
    assert "IMU_0 (" in chosen.facts["topic"]
    assert [name.partition(" ")[0] for name in chosen.facts["others"]] == ["IMU_1", "ACC_0", "GYR_0"]
    np.testing.assert_array_equal(table(read(file, topic="IMU_1")), VALUES + np.float32(0.5))
    raw = read(file, topic="GYR")
    assert raw.axes == AXES[:3]
    # When the sample was taken, not when it was logged.
    assert raw["gyro_x"].start == BEGIN / 1e6
    np.testing.assert_array_equal(table(raw), VALUES[:, :3])


def test_old_logs_have_a_message_for_each_sensor(file):
    old = [(130 + k, f"IMU{k or ''}", "Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ") for k in (0, 2)]
    parts = [message(kind, BEGIN + STEP * k, *VALUES[k].tolist()) for k in range(500) for kind in old]
    file.write_bytes(log(parts, old))
    np.testing.assert_array_equal(table(read(file)), VALUES[:500])
    np.testing.assert_array_equal(table(read(file, topic="IMU2")), VALUES[:500])


@pytest.mark.parametrize("cut", [1, 20, 50])
def test_a_log_ends_where_the_power_ended(file, cut):
    file.write_bytes(log([imu(k) for k in range(ROWS)])[:-cut])
    np.testing.assert_array_equal(table(read(file)), VALUES[:-1])


def test_damaged_places_are_gaps(file):
    content = bytearray(log([imu(k) for k in range(ROWS)]))
    size = 3 + sizes(IMU[2])
    begin = len(content) - ROWS * size
    content[begin + 1000 * size : begin + 1003 * size + 9] = b"\0" * (3 * size + 9)
    file.write_bytes(bytes(content))
    found = read(file)
    assert "log-dropouts" in [remark.code for remark in found.remarks]
    assert found["gyro_x"].starts == pytest.approx((BEGIN / 1e6, (BEGIN + 1004 * STEP) / 1e6))
    np.testing.assert_array_equal(table(found), VALUES[np.r_[:1000, 1004:ROWS]])


def test_a_log_without_inertial_messages(file):
    file.write_bytes(log([message(ATT, BEGIN, 0.1, 0.2)] * 9, (ATT,)))
    with raises(ReadError, "IMU, ACC and GYR", code="no-inertial-data", advises=["LOG_BITMASK"]):
        read(file)
