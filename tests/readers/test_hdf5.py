from __future__ import annotations

import sys

import h5py
import numpy as np
import pytest

from gmwm.base.errors import GmwmError, MissingDependencyError, ReadError, UnitError
from gmwm.base.units import AXES
from gmwm.files.formats import arrays
from gmwm.files.formats.byte_sources import PackedError
from gmwm.files.readers import find_reader, read
from tests.helpers import only, raises, table

VALUES = np.random.default_rng(9).normal(size=(60, 6)) * 0.01 + [0, 0, 0, 0, 0, 9.81]
TIME = 10**18 + 5_000_000 * np.arange(60)
UNITS = {"gyro": "rad/s", "accel": "m/s2"}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.h5"


@pytest.mark.parametrize("rows", [7, 60, 1 << 20])
def test_data_sets_with_units_in_attributes(path, monkeypatch, rows):
    monkeypatch.setattr(arrays, "ARRAY_ROWS", rows)
    with h5py.File(path, "w") as file:
        group = file.create_group("imu0")
        group.create_dataset("gyro", data=VALUES[:, :3], chunks=(8, 3), compression="gzip").attrs["units"] = "deg/s"
        group.create_dataset("accel", data=VALUES[:, 3:].T).attrs["unit"] = np.bytes_("m/s^2")
        group["timestamp"] = TIME
        file["serial"] = "A7"
    imu = read(path)
    assert find_reader(path).name == "hdf5"
    np.testing.assert_allclose(table(imu)[:, :3], np.radians(VALUES[:, :3]), rtol=1e-15)
    assert table(imu)[:, 3:].tolist() == VALUES[:, 3:].tolist()
    assert (imu.rate, imu.time_base.jitter) == (200, 0)


def test_a_table_of_records_and_a_rate_in_an_attribute(path):
    kind = [("gx", "f4"), ("az", "f8"), ("state", "u1")]
    rows = np.zeros(60, kind)
    rows["gx"], rows["az"] = VALUES[:, 0], VALUES[:, 5]
    with h5py.File(path, "w") as file:
        file.create_dataset("log", data=rows).attrs["sample_rate"] = 125.0
    imu = read(path, units=UNITS)
    assert (imu.rate, imu.axes) == (125, ("gyro_x", "accel_z"))
    assert imu["gyro_x"].values.tolist() == rows["gx"].astype(float).tolist()


def test_columns_below_a_group_for_each_sensor(path):
    with h5py.File(path, "w") as file:
        for k, axis in enumerate(AXES):
            file[axis.replace("_", "/")] = VALUES[:, k]
    assert table(read(path, rate=1, units=UNITS)).tolist() == VALUES.tolist()


def test_two_units_are_two_recordings(path):
    with h5py.File(path, "w") as file:
        for unit in ("left", "right"):
            file[f"{unit}/gyro"], file[f"{unit}/t"] = VALUES[:, :3] * (1 + (unit == "left")), TIME
    with raises(ReadError, "left, right", code="several-recordings"):
        read(path, units=UNITS)
    assert table(read(path, units=UNITS, topic="right")).tolist() == VALUES[:, :3].tolist()


def test_nothing_outside_the_file_is_followed(path, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["gx"] = VALUES[:, 0]
    with h5py.File(path, "w") as file:
        file["gx"] = h5py.ExternalLink("other.h5", "gx")
        file["gy"] = h5py.SoftLink("/gx")
        layout = h5py.VirtualLayout((60,), "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "gx", (60,))
        file.create_virtual_dataset("gz", layout)
        file.create_dataset("ax", (60,), "f8", external=[(str(tmp_path / "raw"), 0, 480)])[:] = VALUES[:, 0]
        file["ring/again"] = file["/"]
    with pytest.raises(ReadError) as caught:
        read(path, rate=1, units=UNITS)
    assert caught.value.code in ("no-numbers", "too-many")


def test_a_promise_of_numbers_that_are_not_there(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("gyro", (10**9, 3), "f8", chunks=(1000, 3), compression="gzip")[:5] = 1.0
    with raises(PackedError, "a.h5:gyro", "24000 MB", code="too-large"):
        read(path, rate=1)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_cut_anywhere_and_flipped(path):
    with h5py.File(path, "w") as file:
        file["gyro"], file["t"] = VALUES[:, :3], TIME
    whole = path.read_bytes()
    for size in range(0, len(whole) - 1, 97):
        path.write_bytes(whole[:size])
        with pytest.raises(GmwmError):
            read(path, units=UNITS)
    for at in range(0, len(whole), 29):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            read(path, units=UNITS)
        except GmwmError:
            continue


def test_mislabelled_and_without_the_library(path, monkeypatch):
    path.write_text("time [s],gx [rad/s]\n" + "".join(f"{k},{k % 3}\n" for k in range(20)))
    assert len(read(path)) == 20
    with raises(ReadError, code="incomplete"):
        read(path, format="hdf5")
    monkeypatch.setitem(sys.modules, "h5py", None)
    with raises(MissingDependencyError, advises=['"gmwm[hdf5]"']):
        read(path, format="hdf5")


def test_the_unit_of_the_stamps_in_an_attribute(path):
    for unit, interval in (("min", 1 / 6000), ("seconds since 2020-01-01 00:00:00", 0.01)):
        with h5py.File(path, "w") as file:
            file["gyro"] = VALUES[:, :3]
            file.create_dataset("time", data=interval * np.arange(60)).attrs["units"] = unit
        assert read(path, units=UNITS).rate == pytest.approx(100, rel=1e-9)
    with h5py.File(path, "w") as file:
        file.create_dataset("gyro", data=VALUES[:, :3]).attrs["unit"] = "mrad/ms"
        file.create_dataset("time", data=0.01 * np.arange(60)).attrs["units"] = "samples"
    with raises(UnitError, "'samples'"):
        read(path, units=UNITS)
    with raises(UnitError, "'mrad/ms'"):
        read(path, units={"time": "s"})


def test_stamps_of_another_length_are_told_with_both(path):
    with h5py.File(path, "w") as file:
        file["imu/gyro"], file["imu/time"] = VALUES[:, :3], 0.01 * np.arange(61)
        file["imu"].attrs["fs"] = 100.0
        file["gps/time"], file["gps/height"] = np.arange(20.0), np.arange(20.0)
    with raises(ReadError, "a.h5", "61", "imu/time", "60", "imu/gyro", advises=["rate="]):
        read(path, units=UNITS)
    imu = read(path, units=UNITS, rate=100)
    assert only(imu.remarks, "left-out:names").facts == {
        "case": "names",
        "kind": "arrays",
        "names": ("gps/height", "gps/time", "imu/time"),
    }
    with h5py.File(path, "a") as file:
        del file["imu/time"]
    assert read(path, units=UNITS).rate == 100


def test_units_that_a_description_states(tmp_path):
    values = np.random.default_rng(4).normal(size=(60, 3))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["imu_gyr"] = values
        file.attrs["sampling_rate"] = 100.0
        file.attrs["info"] = "A device at rest: `imu_gyr` in deg/s, and opt_pos in m."
    imu = read(tmp_path / "a.h5")
    assert only(imu.remarks, "unit-named:unit", "gyro").facts == {"case": "unit", "unit": "deg/s", "source": "file"}
    np.testing.assert_allclose(imu["gyro_y"].values, np.radians(values[:, 1]))
