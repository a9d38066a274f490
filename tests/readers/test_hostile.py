"""Files that are made to mislead, to stop or to fill the computer: each has a right answer or one error, soon."""

import bz2
import contextlib
import re
import subprocess
import sys
import time
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import gmwm
from gmwm.base.errors import DataError, ReadError
from gmwm.files.formats import line_forms
from gmwm.files.formats.archive import MAX_TABLES
from gmwm.files.formats.byte_sources import PackedError
from tests.helpers import codes, only, raises, warns

ROWS = 20_000
AXES = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
UNITS = {"gyro": "rad/s", "accel": "m/s²"}
SOON = 5.0
"""Longest time (s) of a file of some kB: a hundred times what it needs on a quiet computer."""


def table(path, times, values=None, header="time [s],gyro_x [deg/s]"):
    values = np.random.default_rng(1).normal(size=len(times)) if values is None else values
    rows = (f"{t:.6f},{v:.6f}\n" for t, v in zip(times, values, strict=True))
    path.write_text(f"{header}\n{''.join(rows)}")
    return path


@pytest.fixture
def soon():
    """Measure the processor time of a test."""
    begin = time.process_time()
    yield
    assert time.process_time() - begin < SOON


# --- wrong answers -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(("share", "jitter"), [(0.1, 1e-3), (0.2, 1e-3), (0.3, 1e-3), (0.05, 2e-3)])
def test_random_losses_are_found_under_jitter(tmp_path, share, jitter):
    rng = np.random.default_rng(5)
    rows = np.flatnonzero(rng.random(ROWS) >= share)
    path = table(tmp_path / "static.csv", rows / 100 + rng.normal(0, jitter, rows.size))
    imu, source = gmwm.read(path), gmwm.stream(path)
    true = np.count_nonzero(np.diff(rows) > 1)
    assert imu.rate == pytest.approx(100, rel=1e-6) == source.rate
    assert len(imu.time_base.gaps) == pytest.approx(true, rel=0.01) == len(source.time_base.gaps)


def test_time_stamps_without_an_interval_leave_the_rate_open(tmp_path):
    # With a jitter of 0.3 intervals and 40 % of the rows lost, no statistic of any block finds the interval.
    rng = np.random.default_rng(1)
    stamps = np.maximum.accumulate((np.arange(40_000) + 0.3 * rng.standard_normal(40_000)) / 100)
    path = table(tmp_path / "static.csv", stamps[rng.random(40_000) > 0.4])
    with warns("rate-ambiguous:unclear"):
        remark = only(gmwm.read(path).remarks, "rate-ambiguous:unclear")
    assert remark.facts["rate"].value == pytest.approx(60, rel=0.02)
    # After delays of four intervals the time stamps return to their line, so that the mean rate is right.
    stamps = np.maximum.accumulate(np.arange(40_000) * 5 + rng.exponential(20, 40_000))
    with warns("stamps-irregular:jitter"):
        found = gmwm.read(table(tmp_path / "late.csv", stamps / 1000))
    assert "rate-ambiguous:unclear" not in codes(found.remarks)
    assert found.rate == pytest.approx(200, rel=0.01)


def test_the_declared_rate_decides_between_rounding_and_regular_losses(tmp_path):
    rows = np.delete(np.arange(ROWS), np.s_[7::10])
    path = table(tmp_path / "static.csv", rows / 100)
    with warns("rate-ambiguous:complete"):
        remark = only(gmwm.read(path).remarks, "rate-ambiguous:complete")
    assert (remark.facts["rate"].value, remark.facts["other"].value) == (pytest.approx(90), pytest.approx(100))
    assert remark.facts["every"] == 10
    assert len(gmwm.read(path, rate=100).time_base.gaps) == ROWS // 10
    assert gmwm.read(path, rate=90).time_base.gaps == ()
    assert codes(gmwm.read(path, rate=100).remarks) == ["unit-named:unit"]


@pytest.mark.slow
@pytest.mark.parametrize("jitter", [0.0, 1e-4])
@pytest.mark.parametrize("every", [3, 5, 30, 50, 99])
def test_the_declared_rate_decides_for_any_share_of_regular_losses(tmp_path, every, jitter):
    rows = np.delete(np.arange(10_000), np.s_[every - 1 :: every])
    times = rows / 100 + np.random.default_rng(1).normal(0, jitter, rows.size)
    path = table(tmp_path / "static.csv", times)
    lost = np.count_nonzero(np.diff(rows) > 1)
    assert len(gmwm.read(path, rate=100).time_base.gaps) == lost
    source = gmwm.stream(path, rate=100, chunk=97)
    assert (sum(map(len, source)), len(source.time_base.gaps)) == (rows.size, lost)


@pytest.mark.parametrize("value", [1e17, 3.4e38, -1e300])
def test_values_of_no_sensor_are_lost_samples(tmp_path, value):
    values = np.random.default_rng(1).normal(size=1000)
    values[500] = value
    path = table(tmp_path / "static.csv", np.arange(1000) / 100, values)
    with warns("samples-lost:impossible", count=1):
        imu = gmwm.read(path)
    assert imu.segments == ((0, 500), (500, 999))
    with warns("samples-lost:impossible", count=1):
        chunks = list(gmwm.stream(path, chunk=100))
    assert np.concatenate([chunk["gyro_x"] for chunk in chunks]).tolist() == imu["gyro_x"].values.tolist()


def test_a_recording_of_such_values_only_is_refused(tmp_path):
    path = table(tmp_path / "static.csv", np.arange(100) / 100, 1e20 * np.random.default_rng(1).normal(size=100))
    with raises(DataError):
        gmwm.read(path)


def test_points_in_a_file_with_decimal_commas_are_refused(tmp_path):
    rows = [f"{10 * k:,}".replace(",", ".") + f";0,{k % 7}" for k in range(300)]
    (path := tmp_path / "static.csv").write_text("time [ms];gyro_x [deg/s]\n" + "\n".join(rows) + "\n")
    with raises(ReadError, "'1.000'", "line 102", code="decimal-comma"):
        gmwm.read(path)


@pytest.mark.parametrize("stamp", [1e20, -5.9e20, -1e15])
@pytest.mark.parametrize("row", [100, 298])
def test_times_that_no_clock_shows_are_refused(tmp_path, stamp, row):
    times = np.arange(300) / 100
    times[row:] += stamp
    path = table(tmp_path / "static.csv", times)
    for act in (gmwm.read, gmwm.stream):
        with raises(ReadError, code="time-span"):
            act(path)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [50, 20_000])
@pytest.mark.parametrize("share", [0.05, 0.4])
@pytest.mark.parametrize("other", [";", "\t", " ", ",0,", ";0,"])
def test_rows_in_another_form_are_never_left_out_silently(tmp_path, other, share, rows):
    """Another delimiter, decimal sign or number of columns, above or below the other rows."""
    lines = [f"{k / 100},{np.sin(k):.5f},{np.cos(k):.5f}" for k in range(rows)]
    first = int(share * rows)
    odd = [line.replace(",", other[0] if len(other) == 1 else other) for line in lines]
    if other == ";0,":
        odd = [line.replace(",", ";").replace(".", ",") for line in lines]
    for mixed in ([*odd[:first], *lines[first:]], [*lines[first:], *odd[:first]]):
        (path := tmp_path / "static.csv").write_text("\n".join(["time [s],gyro_x [deg/s],gyro_y [deg/s]", *mixed, ""]))
        with pytest.raises(ReadError):
            gmwm.read(path)


def test_zero_bytes_of_a_lost_block_are_named(tmp_path):
    path = table(tmp_path / "static.csv", np.arange(100) / 100)
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(bytes(4096))
    with raises(ReadError, f"byte {size}", advises=["tr -d"], code="not-text"):
        gmwm.read(path)


# --- time and memory ---------------------------------------------------------------------------------


def test_blocks_that_unpack_to_gigabytes_are_refused(tmp_path, soon):
    with zipfile.ZipFile(path := tmp_path / "bomb.zip", "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("static.csv", b"0" * 10_000_000)
    assert bz2.compress(b"0")[:2] in path.read_bytes()
    with raises(PackedError, "static.csv", code="unsupported"):
        gmwm.read(path)


@pytest.mark.slow
def test_blank_lines_take_no_memory(tmp_path):
    rows = [f"{k / 100},{np.sin(k)}\n" for k in range(2000)]
    blanks = "\n" * (1 << 23)
    (path := tmp_path / "static.csv").write_text(
        "".join(["time [s],gyro_x [deg/s]\n", *rows[:1000], blanks, *rows[1000:]])
    )
    tracemalloc.start()
    assert len(gmwm.read(path)) == 2000
    assert tracemalloc.get_traced_memory()[1] < 1e8  # 8 bytes for each line would be 7e7, a list of lines 3e8
    tracemalloc.stop()


@pytest.mark.parametrize(
    "header",
    [
        f"time [s],gyro_x {'[' * 30_000}",
        f"time [s],gyro_x{'aB' * 15_000}",
        f"time [s],gyro_x [{' ' * 30_000}",
        f"# sample rate:{' ' * 60_000}\ntime [s],gyro_x [deg/s]",
        f"# gyro in {'(' * 60_000}\ntime [s],gyro_x [deg/s]",
        "a:1a" * 10 + ":\ntime [s],gyro_x [deg/s]",
        f"{'1' * 60_000}x\ntime [s],gyro_x [deg/s]",
        f"{'1,' * 30_000}\ntime [s],gyro_x [deg/s]",
        f'{chr(34) * 50_001}\ntime [s],gyro_x [deg/s]',
    ],
)  # fmt: skip
def test_long_names_and_lines_take_no_time(tmp_path, soon, header):
    path = table(tmp_path / "static.csv", np.arange(100) / 100, header=header)
    with contextlib.suppress(ReadError):
        gmwm.read(path)


def test_an_archive_of_many_tables_is_refused(tmp_path, soon):
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        for k in range(MAX_TABLES + 1):
            archive.writestr(f"table{k}.csv", "time [s],gyro_x [deg/s]\n0,1\n")
    with raises(PackedError, MAX_TABLES, code="too-many"):
        gmwm.read(path)


def test_an_archive_with_damaged_names_is_refused_or_read(tmp_path):
    rows = "time [s],gyro_x [deg/s]\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(100))
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("xstatic.csv", "no table")
        archive.writestr("static.csv", rows)
        archive.writestr("static.txt", rows)
    path.write_bytes(path.read_bytes().replace(b"xstatic.csv", b"\0static.csv"))
    with contextlib.suppress(ReadError):
        gmwm.read(path)


def test_an_archive_whose_names_are_not_text_is_an_error(tmp_path):
    rows = "time [s],gyro_x [deg/s]\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(100))
    with zipfile.ZipFile(path := tmp_path / "export.zip", "w") as archive:
        archive.writestr("stätic.csv", rows)
    path.write_bytes(path.read_bytes().replace("ä".encode(), b"\xff\xff", 1))
    with raises(PackedError, code="damaged"):
        gmwm.read(path)


# --- files that change while they are read ------------------------------------------------------------


@pytest.mark.parametrize("order", ["C", "F"])
def test_an_array_that_is_cut_while_it_is_read_is_an_error(tmp_path, order):
    np.save(path := tmp_path / "static.npy", np.asarray(np.random.default_rng(1).normal(size=(3000, 6)), order=order))
    source = gmwm.stream(path, 100.0, AXES, UNITS)
    with path.open("r+b") as file:
        file.truncate(5000)
    with raises(ReadError, path, code="changed"):
        list(source)


def test_a_matlab_file_that_is_cut_while_it_is_read_is_read_or_an_error(tmp_path):
    scipy.io.savemat(path := tmp_path / "static.mat", {"gyro": np.random.default_rng(1).normal(size=(3000, 3))})
    source = gmwm.stream(path, 100.0, units=UNITS)
    with path.open("r+b") as file:
        file.truncate(5000)
    with contextlib.suppress(ReadError):
        assert sum(map(len, source)) == 3000


def test_no_reader_maps_files():
    """The process is killed if a mapped file is cut while it is read."""
    sources = Path(gmwm.__file__).parent.rglob("*.py")
    assert [path.name for path in sources if re.search(r"\b(mmap|memmap|mmap_mode)\b", path.read_text("utf-8"))] == []


@pytest.mark.parametrize("shape", ["(True,)", "(-1, 6)", f"(0, {1 << 70})", "(3, 2.0)"])
def test_shapes_that_no_array_has_are_refused(tmp_path, shape):
    np.save(path := tmp_path / "static.npy", np.zeros((10, 6)))
    head = path.read_bytes()
    text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    path.write_bytes(head[:10] + text.encode() + head[128:])
    with pytest.raises(ReadError):
        gmwm.read(path, 100.0, AXES, UNITS)


FORK = """
import os, sys, signal, gmwm
folder = sys.argv[1]
options = {"rate": 100.0, "columns": ["gyro_x"], "units": {"gyro": "deg/s"}}
imu = gmwm.Imu.from_arrays({"gyro_x": [0.1, 0.2, 0.3, 0.1, 0.5] * 200}, 100.0)

def act(what):
    verb, _, suffix = what.partition(" ")
    if verb == "read":
        gmwm.read(f"{folder}/static{suffix}", **(options if suffix == ".npy" else {}))
    elif verb == "write":
        imu.write(f"{folder}/new{suffix}")
    elif verb == "import":
        import polars
    else:  # other code uses Polars
        import polars
        polars.DataFrame({"a": range(100_000)}).sort("a").group_by("a").len()

act(sys.argv[2])
if os.fork() == 0:
    signal.alarm(20)
    try:
        act(sys.argv[3])
    except gmwm.errors.ReadError as error:
        os._exit(7 if "spawn" in str(error) else 8)
    os._exit(0)
sys.exit(os.waitstatus_to_exitcode(os.wait()[1]))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the threads of Polars are listed on Linux only")
@pytest.mark.parametrize(
    ("before", "after", "code"),
    [
        ("read .csv", "read .parquet", 7),
        ("read .csv", "read .npy", 0),
        ("read .parquet", "write .csv", 7),
        ("write .csv", "read .csv", 7),
        ("use", "read .csv", 7),
        ("import", "read .csv", 0),
        ("read .npy", "write .csv", 0),
    ],
)
def test_a_fork_after_polars_is_refused_where_polars_would_wait(tmp_path, before, after, code):
    """In a process of its own, because the test process has used Polars."""
    imu = gmwm.read(table(tmp_path / "static.csv", np.arange(1000) / 100))
    imu.write(tmp_path / "static.parquet")
    np.save(tmp_path / "static.npy", imu["gyro_x"].values)
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", FORK, str(tmp_path), before, after], timeout=100, check=False
    )
    assert done.returncode == code


def test_the_parts_of_stamps_are_searched_in_linear_time(monkeypatch):
    calls = []
    monkeypatch.setattr(line_forms, "_may_be_seconds", lambda name: calls.append(name) or False)
    names = [f"value {k}" for k in range(3000)]
    assert line_forms.find_parts(names, [["0"] * 3000] * 3) is None
    assert len(calls) == 3000
