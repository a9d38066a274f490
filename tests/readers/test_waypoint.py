"""Bare .imu records: six types, read and written."""

import struct

import numpy as np
import pytest

from gmwm.base.errors import DataError, GmwmError, GmwmWarning, OptionError, ReadError
from gmwm.base.units import AXES
from gmwm.files.formats import waypoint
from gmwm.files.readers import find_reader, read
from gmwm.recording.imu_records import TYPES, counts
from gmwm.recording.signals import Imu, Signal
from tests.helpers import only, raises

RATE = 62.5  # no whole number: a rate that is rounded shows
BY_NAME = {kind.name: kind for kind in TYPES}
COUNTED = [kind for kind in TYPES if kind.word == "i4"]


def packed(kind, rows, order="<"):
    """Records by struct, not by what the reader uses."""
    form = order + ("d6i" if kind.word == "i4" else "7d")
    return b"".join(struct.pack(form, *row) for row in rows)


def rows_of(kind, samples=400, rate=RATE, start=345600.0):
    rng = np.random.default_rng(3)
    values = rng.normal(0, 40, (samples, 6))
    values[:, 5] += 9.81 / rate / kind.accel
    numbers = np.rint(values).astype(int).tolist() if kind.word == "i4" else values.tolist()
    return [(start + k / rate, *row) for k, row in enumerate(numbers)]


@pytest.fixture(params=TYPES, ids=lambda kind: kind.name)
def kind(request):
    return request.param


@pytest.fixture
def file(tmp_path, kind):
    path = tmp_path / "static.imu"
    path.write_bytes(packed(kind, rows_of(kind)))
    return path


def test_numbers_are_counts_times_scale_times_rate(file, kind):
    table = np.array(rows_of(kind))
    imu = read(file, format=kind.format)
    assert imu.axes == AXES
    assert imu.rate == RATE
    assert imu["gyro_x"].start == 345600.0
    for k, axis in enumerate(AXES):
        scale = kind.gyro if axis.startswith("gyro") else kind.accel
        np.testing.assert_allclose(imu[axis].values, table[:, k + 1] * scale * RATE, rtol=4e-15)
    for sensor, factor in (("gyro", kind.gyro), ("accel", kind.accel)):
        facts = only(imu.remarks, "unit-named:factor", sensor).facts
        assert (facts["factor"], facts["type"]) == (factor, kind.name)
        assert only(imu.remarks, "unit-named:increments", sensor).facts == {"case": "increments", "source": "file"}


def test_scales_of_a_data_sheet():
    # LN200 at 100 Hz: 100 counts of angle are 4.768372e-3 rad/s, 16384 of velocity 100 m/s².
    ln200 = BY_NAME["LN200"]
    assert 100 * ln200.gyro * 100 == pytest.approx(4.768372e-3, rel=1e-7)
    assert 16384 * ln200.accel * 100 == 100
    assert BY_NAME["LN200IG"].gyro == 4 * ln200.gyro
    assert BY_NAME["IMAR"].gyro == pytest.approx(np.radians(0.1 / 3600), rel=1e-15)
    assert {kind.dtype.itemsize for kind in COUNTED} == {32}
    assert BY_NAME["IXSEA"].dtype.itemsize == BY_NAME["NAVCHIP_FLT"].dtype.itemsize == 56


def test_what_is_written_is_the_file_that_was_read(file, kind, tmp_path):
    read(file, format=kind.format).write(tmp_path / "again.imu", format=kind.format)
    before, after = (np.fromfile(path, kind.dtype) for path in (file, tmp_path / "again.imu"))
    if kind.word == "i4":
        assert after.tobytes() == before.tobytes()
    for name in kind.dtype.names:
        np.testing.assert_allclose(after[name], before[name], rtol=1e-15, atol=0)


def test_chunks_of_any_size_give_the_same(file, kind, monkeypatch):
    whole = read(file, format=kind.format)
    for block in (1, 7, 399, 400):
        monkeypatch.setattr(waypoint, "RECORDS_OF_CHUNK", block)
        again = read(file, format=kind.format)
        assert all(again[axis].values.tobytes() == whole[axis].values.tobytes() for axis in AXES)


def test_an_unnamed_type_is_never_guessed(file, kind):
    assert find_reader(file).name == "imu"
    if kind.word == "f8":
        # Of 56 bytes there is one scale only, whichever of the two it is.
        imu = read(file)
        assert imu["gyro_x"].values.tolist() == read(file, format=kind.format)["gyro_x"].values.tolist()
        assert only(imu.remarks, "unit-named:factor", "gyro").facts["type"] == "IXSEA or NAVCHIP_FLT"
        return
    with raises(ReadError, "32 bytes", "IMAR", "LN200", argument="format") as error:
        read(file)
    for other in COUNTED:
        assert f"m/s² as {other.name}" in str(error.value)
    assert kind.format in error.value.facts["formats"]
    assert f"9.8{2 if 'LN200' in kind.name else 1} m/s² as {kind.name}" in str(error.value)


def test_a_name_in_any_case_and_with_any_extension(tmp_path):
    path = tmp_path / "static.dat"
    path.write_bytes(packed(BY_NAME["IMAR"], rows_of(BY_NAME["IMAR"])))
    assert read(path, format="IMU:imar").rate == RATE
    assert find_reader(path).name == "imu"
    with raises(OptionError, "LN200", "'LN2000'", argument="format"):
        read(path, format="LN2000")


def test_a_wrong_type_of_the_same_size_is_told(tmp_path):
    path = tmp_path / "static.imu"
    path.write_bytes(packed(BY_NAME["NAVCHIP_INT"], rows_of(BY_NAME["NAVCHIP_INT"])))
    with pytest.warns(GmwmWarning) as warned:
        read(path, format="imu:LN200")
    remark = warned[0].message.remark
    assert (remark.code, remark.subject) == ("record-type-doubtful", str(path))
    assert remark.facts["gravity"].value == pytest.approx(15.3, abs=0.05)
    assert (remark.facts["type"], remark.facts["formats"]) == ("LN200", ("imu:NAVCHIP_INT",))


def test_a_type_of_the_other_size_is_an_error(tmp_path):
    for wrong, right in (("LN200", "IXSEA"), ("NAVCHIP_FLT", "IMAR")):
        path = tmp_path / "static.imu"
        path.write_bytes(packed(BY_NAME[right], rows_of(BY_NAME[right])))
        with raises(ReadError, "static.imu", "its times", advises=["format=", f"imu:{right}"]):
            read(path, format=f"imu:{wrong}")


@pytest.mark.parametrize("over", [1, 8, 31])
def test_a_file_that_was_cut_off(file, kind, over):
    whole = file.read_bytes()
    file.write_bytes(whole[:-over])
    with raises(ReadError, kind.dtype.itemsize, kind.dtype.itemsize - over, "399 records"):
        read(file, format=kind.format)
    with raises(ReadError, "static.imu", code="cut-off" if kind.word == "f8" else "sensor-ambiguous"):
        read(file)


def test_empty_and_one_epoch(tmp_path, kind):
    path = tmp_path / "static.imu"
    path.write_bytes(b"")
    with raises(ReadError, code="empty"):
        read(path, format=kind.format)
    path.write_bytes(packed(kind, rows_of(kind, samples=1)))
    with raises(DataError, path, "1 sample", "at least 8"):
        read(path, format=kind.format)
    path.write_bytes(packed(kind, rows_of(kind, samples=1))[:20])
    with pytest.raises(GmwmError):
        read(path, format=kind.format)
    with raises(ReadError, "static.imu"):
        read(path)


@pytest.mark.parametrize(
    "content",
    [
        b"time,gyro_x,gyro_y\n0.01,1,2\n0.02,2,3\n" * 40,
        bytes(6400),
        b"\xff" * 6400,
        np.random.default_rng(0).bytes(6400),
        np.arange(1600, dtype="<i4").tobytes(),
        np.random.default_rng(1).normal(size=800).tobytes(),
    ],
    ids=["text", "zeros", "ones", "random", "integers", "normal"],
)
def test_foreign_content_under_the_extension(tmp_path, content):
    path = tmp_path / "static.imu"
    path.write_bytes(content)
    assert waypoint.ImuReader().sniff(path, content) == 0
    for form in ("imu", "imu:LN200", "imu:IXSEA"):
        with pytest.raises(ReadError) as caught:
            read(path, format=form)
        assert caught.value.code in ("time-implausible", "wrong-format")


def test_big_endian_is_no_record_of_ours(tmp_path):
    path = tmp_path / "static.imu"
    path.write_bytes(packed(BY_NAME["LN200"], rows_of(BY_NAME["LN200"]), ">"))
    with raises(ReadError, code="time-implausible"):
        read(path, format="imu:LN200")


def test_gaps_stay_gaps(tmp_path, kind):
    table = rows_of(kind)
    path = tmp_path / "static.imu"
    path.write_bytes(packed(kind, [*table[:150], *table[220:]]))
    imu = read(path, format=kind.format)
    assert imu.segments == ((0, 150), (150, 330))
    imu.write(tmp_path / "again.imu", format=kind.format)
    assert read(tmp_path / "again.imu", format=kind.format).segments == imu.segments


# --- writing ----------------------------------------------------------------------------------------


def noise(samples=2000, rate=100.0):
    rng = np.random.default_rng(5)
    values = rng.normal(0, 2e-4, (samples, 6))
    values[:, 5] += 9.81
    return Imu.from_arrays(values, rate, start=100.0)


def test_no_angle_is_lost_by_rounding(tmp_path, kind):
    imu = noise()
    imu.write(tmp_path / "a.imu", format=kind.format)
    again = read(tmp_path / "a.imu", format=kind.format)
    assert again.rate == 100
    for axis, scale in zip(AXES, kind.scales, strict=True):
        angles = [np.cumsum(x[axis].values) / 100 for x in (again, imu)]
        largest = 0.5001 * scale if kind.word == "i4" else 1e-13 * np.max(np.abs(angles[1]))
        assert np.max(np.abs(angles[0] - angles[1])) <= largest


def test_counts_keep_whole_numbers_whole():
    rng = np.random.default_rng(7)
    whole = rng.integers(-(2**30), 2**30, 100_000)
    np.testing.assert_array_equal(counts(whole * 4.77e-7 * 123.4, 4.77e-7 * 123.4), whole)
    values = rng.normal(size=1000)
    sums = np.cumsum(counts(values, 0.3)) * 0.3 - np.cumsum(values)
    assert np.max(np.abs(sums)) <= 0.15 * (1 + 1e-9)


def test_what_cannot_be_written(tmp_path):
    path = tmp_path / "a.imu"
    with raises(OptionError, "a.imu", "imu:IMAR", argument="format"):
        noise().write(path)
    with raises(OptionError, "IMAR", "'LN200'", argument="format"):
        noise().write(path, format="LN200")
    with raises(OptionError, ".imu", "imu:LN200", argument="format"):
        noise().write(tmp_path / "a.csv", format="imu:LN200")
    with raises(DataError, "gyro_y"):
        Imu({"gyro_x": Signal(np.arange(9.0), 10.0, "rad/s", "gyro_x")}).write(path, format="imu:LN200")
    with raises(DataError, "gyro_x", "IMAR", 2147483647, argument="imu"):
        Imu.from_arrays(np.full((9, 6), 1e5), 10.0).write(path, format="imu:IMAR")
    assert not list(tmp_path.iterdir())
