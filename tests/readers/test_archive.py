"""Zip archives as phones export them; layouts by the applications' own headers."""

from __future__ import annotations

import struct
import zipfile

import numpy as np
import pytest

from gmwm.base.errors import GmwmError, OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.files.formats import byte_sources
from gmwm.files.formats.byte_sources import PackedError
from gmwm.files.readers import find_reader, read
from tests.helpers import only, raises, table

VALUES = np.random.default_rng(6).normal(size=(200, 6)) * 0.01 + [0, 0, 0, 0, 0, 9.81]
START = 1_718_030_736_872_695_300
HEADER = "time,seconds_elapsed,z,y,x\n"
PHYPHOX = '"Time (s)","{0} x ({1})","{0} y ({1})","{0} z ({1})"\n'


def logger(columns, first=0, step=10_000_000, late=0, rows=None, jitter=0.0):
    """A table of Sensor Logger: three columns of VALUES, x y z, from one row on."""
    rng = np.random.default_rng(1)
    lines = []
    for k in range(first, rows or len(VALUES)):
        stamp = START + late + k * step + int(rng.uniform(-jitter, jitter) * step)
        x, y, z = VALUES[k, columns]
        lines.append(f"{stamp},{(stamp - START) / 1e9},{z!r},{y!r},{x!r}\n".replace("np.float64(", "").replace(")", ""))
    return HEADER + "".join(lines)


def zipped(folder, **tables):
    path = folder / "2026-11-21.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in tables.items():
            archive.writestr(name.replace("__", "/") + ".csv", text)
    return path


GYRO, ACCEL = slice(0, 3), slice(3, 6)
METADATA = "version,device name,platform\n3,phone,android\n"


def test_sensor_logger_columns_run_backwards_and_both_sensors_are_one_recording(tmp_path):
    path = zipped(
        tmp_path,
        Metadata=METADATA,
        Accelerometer=logger(ACCEL),
        Gyroscope=logger(GYRO, jitter=0.05),
        TotalAcceleration=logger(ACCEL, first=3, late=2_000_000, rows=195, jitter=0.05),
    )
    imu = read(path)
    assert find_reader(path).name == "zip"
    assert table(imu).tolist() == VALUES[3:195].tolist()
    assert imu.rate == pytest.approx(100, rel=1e-3)
    assert imu["gyro_x"].start == pytest.approx(START / 1e9 + 0.03, abs=1e-3)
    assert only(imu.remarks, "file-content:pairs").facts["left"] == 8
    assert Remark.of("left-out", case="names", kind="tables", names=("Accelerometer",)) in imu.remarks


@pytest.mark.slow
@pytest.mark.parametrize("accel", [{"step": 20_000_000}, {"step": 10_100_000}, {"first": 100, "late": -(10**9) * 60}])
def test_tables_that_do_not_pair_off_are_two_recordings(tmp_path, accel):
    path = zipped(tmp_path, Gyroscope=logger(GYRO), TotalAcceleration=logger(ACCEL, **accel))
    with raises(ReadError, "TotalAcceleration"):
        read(path)
    assert table(read(path, topic="Gyroscope")).tolist() == VALUES[:, GYRO].tolist()
    imu = read(path, topic="TotalAcceleration")
    assert imu.rate == pytest.approx(1e9 / accel.get("step", 10_000_000), rel=1e-6)
    assert table(imu).tolist() == VALUES[accel.get("first", 0) :, ACCEL].tolist()
    with raises(OptionError, "'Location'", argument="topic"):
        read(path, topic="Location")


def test_acceleration_without_gravity_is_not_joined_and_says_so(tmp_path):
    path = zipped(tmp_path, Gyroscope=logger(GYRO), Accelerometer=logger(ACCEL))
    with raises(ReadError, "Gyroscope (", "Accelerometer (", code="several-recordings"):
        read(path)
    assert only(read(path, topic="Accelerometer").remarks, "gravity-removed").subject == "Accelerometer"


@pytest.mark.parametrize("name", ["Linear Accelerometer", "Accelerometer"])
def test_linear_acceleration_of_phyphox_is_not_joined_either(tmp_path, name):
    def rows(columns):
        return "".join(",".join(map(repr, (k / 400, *VALUES[k, columns].tolist()))) + "\n" for k in range(200))

    gyro = PHYPHOX.format("Gyroscope", "rad/s") + rows(GYRO)
    linear = PHYPHOX.format("Linear Acceleration", "m/s^2") + rows(ACCEL)
    path = zipped(tmp_path, Gyroscope=gyro, **{name: linear})
    with raises(ReadError, name):
        read(path)
    assert only(read(path, topic=name).remarks, "gravity-removed").subject == name
    own = PHYPHOX.format("Acceleration", "m/s^2") + rows(ACCEL)
    imu = read(zipped(tmp_path, Gyroscope=gyro, **{"Linear Acceleration": linear, "Raw Acceleration": own}))
    assert Remark.of("left-out", case="names", kind="tables", names=("Linear Acceleration",)) in imu.remarks
    assert table(imu).tolist() == VALUES.tolist()
    ros = linear.replace("Linear Acceleration ", "linear_acceleration.")
    assert table(read(zipped(tmp_path, gyro=gyro, accel=ros))).tolist() == VALUES.tolist()


def test_a_table_taken_out_of_the_archive_is_known_by_its_name(tmp_path):
    (tmp_path / "Gyroscope.csv").write_text(logger(GYRO))
    imu = read(tmp_path / "Gyroscope.csv")
    assert (find_reader(tmp_path / "Gyroscope.csv").name, imu.axes) == ("sensorlogger", ("gyro_x", "gyro_y", "gyro_z"))
    assert imu["gyro_x"].values.tolist() == VALUES[:, 0].tolist()
    (tmp_path / "a.csv").write_text(logger(GYRO))
    with raises(ReadError, "a.csv", "time, seconds_elapsed, z, y, x", advises=["columns="]):
        read(tmp_path / "a.csv")


@pytest.mark.parametrize("style", ["comma", "tabs", "semicolon and decimal comma"])
def test_phyphox(tmp_path, style):
    tables = {}
    for name, unit, columns in (("Gyroscope", "rad/s", GYRO), ("Acceleration", "m/s^2", ACCEL)):
        body = "".join(
            ",".join(f"{v:.9E}" for v in (k / 400 + (0.0005 if name[0] == "A" else 0), *VALUES[k, columns])) + "\n"
            for k in range(200)
        )
        text = PHYPHOX.format(name, unit) + body
        if style == "tabs":
            text = text.replace(",", "\t")
        elif style != "comma":
            text = text.replace(",", ";").replace(".", ",")
        tables[{"Acceleration": "Accelerometer"}.get(name, name)] = text
    tables["meta__device"] = '"property","value"\n"deviceModel","phone"\n'
    imu = read(zipped(tmp_path, **tables))
    np.testing.assert_allclose(table(imu), VALUES, rtol=1e-9)
    assert imu.rate == pytest.approx(400, rel=1e-9)


def test_one_text_in_an_archive(tmp_path):
    path = zipped(tmp_path, log="t [s],gx [rad/s]\n" + "".join(f"{k / 10},{k % 3}\n" for k in range(20)))
    assert (len(read(path)), read(path).rate) == (20, 10)


def test_cut_anywhere(tmp_path):
    path = zipped(tmp_path, Gyroscope=logger(GYRO), TotalAcceleration=logger(ACCEL))
    whole = path.read_bytes()
    for size in range(0, len(whole), 499):
        path.write_bytes(whole[:size])
        with pytest.raises(GmwmError):
            read(path)
    for at in (200, len(whole) // 3, 3 * len(whole) // 4):
        middle = bytearray(whole)
        middle[at : at + 10] = bytes(10)
        path.write_bytes(middle)
        with pytest.raises(GmwmError):
            read(path)


@pytest.mark.slow
def test_bombs(tmp_path, monkeypatch):
    head = "t [s],gx [rad/s]\n"
    path = zipped(tmp_path, log=head + "0,1\n" * (32 << 20))
    with raises(PackedError, "log.csv", "67 MB", code="too-large"):
        read(path)
    path = zipped(tmp_path, log=head + "1" * (80 << 20))
    monkeypatch.setattr(byte_sources, "MAX_RATIO", 10**6)
    with pytest.raises(ReadError) as caught:
        read(path)
    assert caught.value.code in ("line-too-long", "no-numbers")
    path = zipped(tmp_path, **{f"log{k}": head for k in range(byte_sources.MAX_MEMBERS + 1)})
    with raises(PackedError, 1000, code="too-many"):
        read(path)


def test_what_cannot_be_unpacked_and_what_holds_nothing(tmp_path):
    path = zipped(tmp_path, Gyroscope=logger(GYRO))
    data = bytearray(path.read_bytes())
    for mark, at in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        struct.pack_into("<H", data, data.index(mark) + at, 1)
    path.write_bytes(data)
    with raises(PackedError, code="encrypted"):
        read(path)
    with raises(ReadError, "Metadata.csv, b.csv", advises=["columns="]):
        read(zipped(tmp_path, Metadata=METADATA, b="a,b\n1,2\n"))
    workbook = path.with_suffix(".xlsx")
    workbook.write_bytes(path.read_bytes())
    with raises(ReadError, advises=["CSV"]):
        read(workbook)
    path.write_bytes(b"PK\x03\x04 and nothing else")
    with raises(PackedError, code="incomplete"):
        read(path)
