from __future__ import annotations

import errno
import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from gmwm.base import atomic_files
from gmwm.base.atomic_files import write_text
from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import AXES
from gmwm.files.readers import read
from gmwm.recording.signals import Imu, Signal
from gmwm.recording.writers import SUFFIXES, write
from tests.helpers import raises

FIXED = settings(
    derandomize=True, max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
FINITE = st.floats(-1e11, 1e11)  # the reader treats values from 1e12 on as lost


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@FIXED
@given(
    values=arrays(np.float64, st.tuples(st.integers(8, 30), st.just(3)), elements=FINITE),
    rate=st.sampled_from([0.5, 62.5, 100.0, 123.456, 400.0]),
)
def test_what_is_written_is_read_bit_for_bit(tmp_path, suffix, values, rate):
    values[0] = 1.5
    values[1] = -values[0]  # not constant
    imu = Imu.from_arrays(values, rate, axes=("gyro_x", "gyro_z", "accel_y"))
    imu.write(tmp_path / f"a{suffix}")
    again = read(tmp_path / f"a{suffix}")
    assert again.axes == imu.axes
    for axis in imu:
        assert again[axis].values.tobytes() == imu[axis].values.tobytes()
        assert again[axis].unit == imu[axis].unit
    assert again.rate == pytest.approx(rate, rel=1e-14)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("starts", [(), (3.0, 700.0, 705.5), (100.0, 20.0, 60.0)])
@pytest.mark.filterwarnings("ignore::gmwm.errors.TimeBaseWarning")
def test_segments_starts_and_temperature_survive(tmp_path, suffix, starts):
    values = np.random.default_rng(0).normal(size=200)
    signal = Signal(values, 50.0, "m/s²", "accel_x", 3.0, ((0, 40), (40, 49), (49, 200)), starts)
    temperature = 20 + np.arange(200) / 7
    imu = Imu({"accel_x": signal}, temperature=temperature)
    imu.write(tmp_path / f"a{suffix}")
    again = read(tmp_path / f"a{suffix}")
    assert again.segments == signal.segments
    np.testing.assert_allclose(again["accel_x"].starts, signal.starts, rtol=1e-12)
    assert again.temperature.tolist() == temperature.tolist()


def test_header_names_units(tmp_path):
    (tmp_path / "new").mkdir()
    Imu.from_arrays(np.random.default_rng(0).normal(size=(9, 6)), 10).write(tmp_path / "a.csv")
    header = (tmp_path / "a.csv").read_text().splitlines()[0]
    assert header == ",".join(["time [s]", *(f"{axis} [{'rad/s' if 'gyro' in axis else 'm/s²'}]" for axis in AXES)])


def test_whole_or_nothing(tmp_path, monkeypatch):
    import polars as pl

    path = tmp_path / "a.csv"
    imu = Imu.from_arrays({"gyro_x": np.arange(9.0)}, 10)
    imu.write(path)
    before = path.read_bytes()

    def broken(self, file):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(pl.DataFrame, "write_csv", broken)
    with pytest.raises(OSError, match="disk full"):
        imu.write(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_suffix(tmp_path):
    with raises(OptionError, ".csv, .parquet, .mcap or .imu", "a.xlsx", argument="path"):
        Imu.from_arrays({"gyro_x": [1.0]}, 1).write(tmp_path / "a.xlsx")
    assert not list(tmp_path.iterdir())


def test_a_full_disk_is_told_by_the_name_that_was_wanted(tmp_path, monkeypatch):
    def full(self, *_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space left on device") as told:
        write_text(tmp_path / "summary.txt", "all of it")
    assert told.value.filename == str(tmp_path / "summary.txt")
    assert list(tmp_path.iterdir()) == []


def test_a_signal_is_a_recording_of_one_axis(tmp_path):
    signal = Signal([1.0, 2.0, 3.0], 10.0, "rad/s", "gyro_z", start=4.0)
    signal.write(tmp_path / "signal.csv")
    Imu({"gyro_z": signal}).write(tmp_path / "imu.csv")
    assert (tmp_path / "signal.csv").read_text() == (tmp_path / "imu.csv").read_text()


@pytest.mark.parametrize(
    ("given", "advises"),
    [(Signal([1.0, 2.0], 10.0), ["from_arrays"]), (np.zeros(5), ["Imu.from_arrays"]), ("a.csv", [])],
)
def test_what_is_no_recording_is_not_written(tmp_path, given, advises):
    with raises(OptionError, argument="imu", advises=advises) as caught:
        write(given, tmp_path / "a.csv")
    assert caught.value.got is given
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="the file system accepts UTF-8 only")
@pytest.mark.parametrize("suffix", [b".csv", b".parquet"])
def test_a_path_that_is_not_utf8(tmp_path, suffix):
    folder = tmp_path / os.fsdecode(b"out \xff")
    folder.mkdir()
    imu = Imu.from_arrays({"gyro_x": [0.1, 0.2, 0.4] * 10}, 100.0)
    write(imu, path := folder / os.fsdecode(b"unit \xfe" + suffix))
    assert read(path)["gyro_x"].values.tolist() == imu["gyro_x"].values.tolist()


def dead_process() -> int:
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_the_next_run_removes_what_killed_processes_of_this_machine_left(tmp_path):
    node, dead = platform.node() or "localhost", dead_process()
    (tmp_path / f".writing-{node}-{dead}-abc").mkdir()
    (tmp_path / f".writing-{node}-{dead}-abc" / "fit.png").write_text("half", encoding="utf-8")
    (tmp_path / f".writing-{node}-{dead}-def.csv").write_text("half", encoding="utf-8")
    others = {f".writing-{node}-{os.getpid()}-abc", f".writing-another-machine-{dead}-abc", f".writing-{node}-mine"}
    for name in others:
        (tmp_path / name).mkdir()
    write_text(tmp_path / "a.txt", "all")
    assert {path.name for path in tmp_path.iterdir()} == {*others, "a.txt"}


@pytest.mark.parametrize("refusals", [2, None])
def test_a_file_that_is_open_on_windows_is_tried_again_and_then_named(tmp_path, monkeypatch, refusals):
    calls = []
    rename = Path.replace

    def replace(source: Path, target: Path) -> Path:
        calls.append(target)
        if refusals is None or len(calls) <= refusals:
            raise PermissionError(errno.EACCES, "Permission denied", str(source))
        return rename(source, target)

    monkeypatch.setattr(atomic_files, "_WINDOWS", True)
    monkeypatch.setattr(atomic_files, "_OPEN_ELSEWHERE_S", 60.0 if refusals else 0.0)
    monkeypatch.setattr(Path, "replace", replace)
    if refusals:
        write_text(tmp_path / "a.txt", "all")
        assert len(calls) == refusals + 1
        assert (tmp_path / "a.txt").read_text(encoding="utf-8") == "all"
    else:
        with pytest.raises(PermissionError, match="open in another program") as caught:
            write_text(tmp_path / "a.txt", "all")
        assert caught.value.filename == str(tmp_path / "a.txt")
        assert list(tmp_path.iterdir()) == []


def test_an_mcap_file_is_read_back_and_by_the_library_of_ros(tmp_path):
    from rosbags.highlevel import AnyReader

    rng = np.random.default_rng(3)
    axes = {f"{sensor}_{axis}": rng.normal(size=300) for sensor in ("gyro", "accel") for axis in "xyz"}
    imu = Imu.from_arrays(axes, rate=100.0, start=1_700_000_000.0, segments=((0, 100), (100, 300)))
    path = tmp_path / "static.mcap"
    imu.write(path)
    again = read(path)
    assert again.rate == pytest.approx(100.0, rel=1e-7)  # the second segment begins within 0.2 µs
    assert again.segments == imu.segments
    assert all(np.array_equal(again[axis].values, imu[axis].values) for axis in imu)
    with AnyReader([path]) as reader:
        messages = [reader.deserialize(raw, kind.msgtype) for kind, _, raw in reader.messages()]
        stamps = [time for _, time, _ in reader.messages()]
    assert len(messages) == 300
    assert messages[7].angular_velocity.y == axes["gyro_y"][7]
    assert messages[7].header.frame_id == "imu"
    assert messages[7].orientation_covariance[0] == -1
    assert stamps[:2] == [1_700_000_000 * 10**9, 1_700_000_000 * 10**9 + 10**7]


def test_an_mcap_file_of_one_sensor(tmp_path):
    axes = {f"gyro_{axis}": np.random.default_rng(k).normal(size=50) for k, axis in enumerate("xyz")}
    Imu.from_arrays(axes, rate=100.0).write(tmp_path / "gyro.mcap")
    assert list(read(tmp_path / "gyro.mcap")) == ["gyro_x", "gyro_y", "gyro_z"]
    del axes["gyro_z"]
    with raises(DataError, "2 of gyro"):
        Imu.from_arrays(axes, rate=100.0).write(tmp_path / "two.mcap")
