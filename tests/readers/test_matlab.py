from __future__ import annotations

import struct
import zlib

import h5py
import numpy as np
import pytest
import scipy.io

from gmwm.base.errors import GmwmError, ReadError, UnitError
from gmwm.base.units import AXES
from gmwm.files.formats.byte_sources import PackedError
from gmwm.files.readers import find_reader, read
from tests.helpers import device, only, raises, table

VALUES = np.random.default_rng(8).normal(size=(60, 6)) * 0.01 + [0, 0, 0, 0, 0, 9.81]
TIME = np.arange(60) / 200
UNITS = {"gyro": "rad/s", "accel": "m/s2"}


def newer(path, content):
    """A file as MATLAB writes version 7.3: HDF5 behind 512 bytes, arrays on their side."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in content.items():
            if isinstance(value, str):
                node = file.create_dataset(name, data=np.frombuffer(value.encode("utf-16-le"), np.uint16)[:, None])
                node.attrs["MATLAB_class"] = np.bytes_("char")
                continue
            node = file.create_dataset(name, data=np.atleast_2d(value).T)
            node.attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\x02IM")


def saved(folder, kind, **content):
    path = folder / "a.mat"
    if kind == "7.3":
        newer(path, content)
    else:
        scipy.io.savemat(path, content, do_compression=kind == "7")
    return path


@pytest.mark.parametrize("kind", ["5", "7", "7.3"])
def test_named_arrays(tmp_path, kind):
    path = saved(tmp_path, kind, gyro=VALUES[:, :3], accel=VALUES[:, 3:], t=TIME[:, None], note="unit 7", fs=200.0)
    imu = read(path, units=UNITS)
    assert find_reader(path).name == "matlab"
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == pytest.approx(200, rel=1e-12)


@pytest.mark.parametrize("kind", ["5", "7"])
@pytest.mark.parametrize("order", ["gyr first", "acc first"])
def test_units_that_a_description_states(tmp_path, kind, order):
    said = ["`imu_gyr` in deg/s", "imu_acc is given in g"]
    info = f"Recorded in rad/s rooms with {' and '.join(said if order == 'gyr first' else said[::-1])}. Für Tests."
    path = saved(tmp_path, kind, imu_gyr=VALUES[:, :3], imu_acc=VALUES[:, 3:] / 10, sampling_rate=200.0, info=info)
    imu = read(path)
    np.testing.assert_allclose(table(imu), VALUES * np.repeat([np.pi / 180, 0.980665], 3), rtol=1e-12)
    assert only(imu.remarks, "unit-named:unit", "gyro").facts == {"case": "unit", "unit": "deg/s", "source": "file"}
    with raises(UnitError):
        read(saved(tmp_path, kind, imu_gyr=VALUES[:, :3], sampling_rate=200.0, info="imu_gyr in 2021, gyr in deg/s"))


@pytest.mark.parametrize("kind", ["5", "7", "7.3"])
def test_the_table_of_kalibr_allan(tmp_path, kind):
    content = np.column_stack([1.5e9 + TIME, VALUES[:, 3:], VALUES[:, :3]])
    imu = read(saved(tmp_path, kind, data_imu=content))
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == pytest.approx(200, rel=1e-6)
    assert only(imu.remarks, "file-content:layout").facts["format"] in ("NaveGo", "kalibr_allan")


def test_the_structure_of_navego(tmp_path):
    imu = {"t": TIME[:, None], "wb": VALUES[:, :3], "fb": VALUES[:, 3:], "freq": 200.0, "arw": np.ones(3)}
    found = read(saved(tmp_path, "7", imu=imu))
    assert table(found).tolist() == VALUES.tolist()
    assert found.axes == AXES


def test_integers_and_singles(tmp_path):
    counts = np.arange(60, dtype=np.int16)[:, None] - 30
    imu = read(saved(tmp_path, "5", gx=counts, ax=VALUES[:, 3].astype(np.float32)), rate=10, units=UNITS)
    assert imu["gyro_x"].values.tolist() == counts[:, 0].astype(float).tolist()
    assert imu["accel_x"].values.tolist() == VALUES[:, 3].astype(np.float32).astype(float).tolist()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["5", "7", "7.3"])
def test_cut_anywhere(tmp_path, kind):
    path = saved(tmp_path, kind, gyro=VALUES[:, :3], accel=VALUES[:, 3:])
    whole = path.read_bytes()
    for size in range(0, len(whole) - 1, max(1, len(whole) // 40)):
        path.write_bytes(whole[:size])
        # A cut between two variables leaves a file that is whole, with one of them.
        try:
            imu = read(path, rate=1, units=UNITS)
        except GmwmError:
            continue
        assert kind != "7.3"
        assert imu.axes == AXES[:3]
        assert table(imu).tolist() == VALUES[:, :3].tolist()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_flipped_bytes_are_errors_or_numbers(tmp_path):
    path = saved(tmp_path, "5", gyro=VALUES[:, :3])
    whole = path.read_bytes()
    for at in range(120, 300):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        try:
            read(path, rate=1, units=UNITS)
        except GmwmError:
            continue


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, 1e300, 0.5])
def test_numbers_that_their_type_cannot_hold_are_refused(tmp_path, value):
    values = np.full((100, 1), 3.0)
    values[40] = value
    scipy.io.savemat(path := tmp_path / "static.mat", {"gyro_x": values})
    path.write_bytes(path.read_bytes().replace(struct.pack("<4I", 6, 8, 6, 0), struct.pack("<4I", 6, 8, 12, 0)))
    with raises(ReadError, "gyro_x", "its type", code="damaged"):
        read(path, 100.0)


@pytest.mark.slow
def test_a_bomb_is_not_unpacked(tmp_path):
    packed = zlib.compress(bytes(256 << 20), 9)
    path = saved(tmp_path, "5", gyro=VALUES[:, :3])
    path.write_bytes(path.read_bytes()[:128] + struct.pack("<II", 15, len(packed)) + packed)
    with raises(PackedError, "67 MB", code="too-large"):
        read(path, rate=1)


def test_nothing_in_it_and_mislabelled(tmp_path):
    with raises(ReadError, "a.mat", "k 1×1"):
        read(saved(tmp_path, "5", note="a", k=np.array(3.0), cells=np.array([1, "a"], object)), rate=1)
    path = tmp_path / "b.mat"
    path.write_text("time [s],gx [rad/s]\n" + "".join(f"{k},{k % 3}\n" for k in range(20)))
    assert len(read(path)) == 20
    with raises(ReadError, code="incomplete"):
        read(path, format="matlab")


@pytest.mark.parametrize("suffix", ["mat", "hdf5"])
def test_a_recording_of_a_device_is_read_as_its_library_does(suffix):
    path = device(f"dlaidig_24_disturbed_tapping_A.{suffix}")
    if suffix == "mat":
        content = scipy.io.loadmat(path)
    else:
        with h5py.File(path) as file:
            content = {name: np.asarray(file[name]) for name in ("imu_gyr", "imu_acc")}
    imu = read(path)
    assert only(imu.remarks, "unit-named:unit", "gyro").facts == {"case": "unit", "unit": "rad/s", "source": "file"}
    assert imu.rate == pytest.approx(2000 / 7)
    for sensor, array in (("gyro", content["imu_gyr"]), ("accel", content["imu_acc"])):
        for k, axis in enumerate("xyz"):
            np.testing.assert_array_equal(imu[f"{sensor}_{axis}"].values, array[:, k])
