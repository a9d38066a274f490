from __future__ import annotations

import io
import pickle
import zipfile

import numpy as np
import pytest

from gmwm.base.errors import GmwmError, ReadError, TimeBaseWarning
from gmwm.base.remarks import Quantity
from gmwm.base.units import AXES
from gmwm.files.formats import arrays
from gmwm.files.formats.byte_sources import PackedError
from gmwm.files.formats.npy import PicklesError
from gmwm.files.readers import find_reader, read
from tests.helpers import only, raises, table

VALUES = np.random.default_rng(3).normal(size=(60, 6)) * 0.01 + [0, 0, 0, 0, 0, 9.81]
TIME = 10**18 + 5_000_000 * np.arange(60)
UNITS = {"gyro": "rad/s", "accel": "m/s2"}


def npz(folder, name="a.npz", packed=False, **content):
    path = folder / name
    (np.savez_compressed if packed else np.savez)(path, **content)
    return path


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("sideways", [False, True])
def test_a_bare_matrix_is_named_in_order(tmp_path, order, sideways, monkeypatch):
    monkeypatch.setattr(arrays, "ARRAY_ROWS", 7)
    path = tmp_path / "a.npy"
    np.save(path, np.asarray(VALUES.T if sideways else VALUES, order=order))
    with raises(ReadError, "6 columns", 0.02):
        read(path, rate=10, units=UNITS)
    imu = read(path, rate=10, units=UNITS, columns=list(AXES))
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == 10


def test_one_axis_alone(tmp_path):
    for shape in ((60,), (60, 1), (1, 60)):
        np.save(tmp_path / "a.npy", VALUES[:, 0].reshape(shape))
        imu = read(tmp_path / "a.npy", rate=10, units=UNITS, columns={"gyro_y": 0})
        assert imu["gyro_y"].values.tolist() == VALUES[:, 0].tolist()


def test_records_have_names_and_dates_are_time(tmp_path):
    kind = [("when", "M8[ns]"), ("gyro", "f4", 3), ("ax [g]", ">i2")]
    rows = np.zeros(60, kind)
    rows["when"], rows["gyro"], rows["ax [g]"] = TIME.astype("M8[ns]"), VALUES[:, :3], np.arange(60) - 8
    np.save(tmp_path / "a.npy", rows)
    imu = read(tmp_path / "a.npy", units={"gyro": "rad/s"})
    assert imu.axes == ("gyro_x", "gyro_y", "gyro_z", "accel_x")
    assert imu.rate == 200
    assert imu["gyro_z"].values.tolist() == VALUES[:, 2].astype("f4").astype(float).tolist()
    assert imu["accel_x"].values[0] == pytest.approx(-8 * 9.80665, rel=1e-15)


@pytest.mark.parametrize("packed", [False, True])
def test_triads_and_time_by_their_names(tmp_path, packed):
    path = npz(tmp_path, packed=packed, **{"gyro [rad/s]": VALUES[:, :3]}, accel=VALUES[:, 3:].T, t=TIME)
    imu = read(path, units={"accel": "m/s²"})
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == 200
    assert imu.time_base.jitter == 0


def test_single_columns_a_rate_and_what_is_left_out(tmp_path):
    path = npz(tmp_path, gx=VALUES[:, 0], az=VALUES[:, 5], fs=250, serial=np.array([7, 8, 9]), seen=np.ones(60, bool))
    imu = read(path, units=UNITS)
    assert (imu.axes, imu.rate) == (("gyro_x", "accel_z"), 250)
    assert only(imu.remarks, "rate-stated:stated").facts == {
        "case": "stated",
        "rate": Quantity(250.0, "Hz"),
        "used": "yes",
    }
    assert only(imu.remarks, "left-out:names").facts == {"case": "names", "kind": "arrays", "names": ("serial",)}


def test_sensors_at_two_rates_are_two_recordings(tmp_path):
    path = npz(tmp_path, gyro=VALUES[:, :3], gyro_time=TIME, accel=VALUES[:30, 3:], accel_time=TIME[:30])
    with raises(ReadError, "gyro, accel", code="several-recordings"):
        read(path, units=UNITS)
    accelerometers = read(path, units=UNITS, topic="accel")
    assert (accelerometers.axes, accelerometers.rate) == (AXES[3:], pytest.approx(200))


def test_pickles_are_not_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    np.save(tmp_path / "a.npy", np.array([Trap()], object), allow_pickle=True)
    with raises(PicklesError, code="python-objects"):
        read(tmp_path / "a.npy", rate=1)
    (tmp_path / "b.npy").write_bytes(pickle.dumps(Trap()))
    with raises(ReadError, code="unknown-format"):
        read(tmp_path / "b.npy", rate=1)
    path = npz(tmp_path, gx=VALUES[:, 0], settings=np.array([Trap()], object))
    assert len(read(path, rate=1, units=UNITS)) == 60


def test_a_header_that_promises_more_than_there_is(tmp_path):
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**14, 6)})
    (tmp_path / "a.npy").write_bytes(head.getvalue() + bytes(480))
    with raises(ReadError, "480 bytes", "expected 4800000000000000"):
        read(tmp_path / "a.npy", rate=1)
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("gyro.npy", head.getvalue() + bytes(480))
    with raises(ReadError, "expected 4800000000000000"):
        read(tmp_path / "a.npz", rate=1)


@pytest.mark.parametrize("suffix", [".npy", ".npz"])
def test_cut_anywhere(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    np.save(path, VALUES) if suffix == ".npy" else np.savez(path, gyro=VALUES[:, :3])
    whole = path.read_bytes()
    for size in range(0, len(whole), 97):
        path.write_bytes(whole[:size])
        with pytest.raises(GmwmError):
            read(path, rate=1, units=UNITS, columns=list(AXES) if suffix == ".npy" else None)


@pytest.mark.parametrize(
    "content", [np.zeros((0, 6)), np.float64(3.0), np.array(["a"]), np.zeros((9, 9, 9)), np.ones((9, 3)) * 1j]
)
def test_what_is_no_recording(tmp_path, content):
    np.save(tmp_path / "a.npy", content)
    with raises(ReadError, code="no-numbers"):
        read(tmp_path / "a.npy", rate=1)


def test_the_content_decides_and_a_wrong_name_is_told(tmp_path):
    npz(tmp_path, gx=VALUES[:, 0])
    (tmp_path / "a.npz").rename(tmp_path / "a.csv")
    assert find_reader(tmp_path / "a.csv").name == "npz"
    assert len(read(tmp_path / "a.csv", rate=1, units=UNITS)) == 60
    (tmp_path / "b.npy").write_text("time [s],gx [rad/s]\n" + "".join(f"{k},{k % 3}\n" for k in range(20)))
    assert len(read(tmp_path / "b.npy")) == 20
    for format, kind in (("npy", ReadError), ("npz", PackedError)):
        with raises(kind, "b.npy", code="incomplete"):
            read(tmp_path / "b.npy", format=format)


def test_a_stated_rate_that_the_stamps_contradict_is_warned_of(tmp_path):
    content = {"gyro": VALUES[:, :3], "t": 0.01 * np.arange(60)}
    assert read(npz(tmp_path, **content, fs=100.5), units=UNITS).rate == 100
    path = npz(tmp_path, **content, fs=200.0)
    with pytest.warns(TimeBaseWarning) as warned:
        imu = read(path, units=UNITS)
    assert imu.rate == 100
    remark = only(imu.remarks, "rate-contradicted", str(path))
    assert remark.facts["source"] == "file"
    assert (remark.facts["rate"].value, remark.facts["stamps"].value) == pytest.approx((200, 100))
    assert [one.message.remark for one in warned] == [remark]
    assert read(path, units=UNITS, rate=200, columns={"time": None}).rate == 200


def test_stamps_of_another_length(tmp_path):
    content = {"gyro": VALUES[:, :3], "fs": 100.0}
    with raises(ReadError, "59 time stamps of t", "60 samples of gyro", advises=["rate="]):
        read(npz(tmp_path, **content, t=np.arange(59.0)), units=UNITS)
    assert read(npz(tmp_path, **content, time=np.arange(9.0), height=np.arange(9.0)), units=UNITS).rate == 100
