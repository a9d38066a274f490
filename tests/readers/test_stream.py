"""`stream` gives what `read` gives, a chunk at a time."""

import os
import subprocess
import sys
import tracemalloc
import warnings

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError, ReadError, TimeBaseWarning, UnitError
from gmwm.base.remarks import Remark
from gmwm.files.formats import arrays, parquet, text
from gmwm.files.readers import interpretation, stream
from tests.helpers import only, raises

ROWS = 20_000


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks and heads so small that a file of some thousand rows has many of them."""
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 3000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 60_000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 1500)
    monkeypatch.setattr(arrays, "ARRAY_ROWS", 1500)


FORMATS_AND_STAMPS = [
    *[(".csv", kind) for kind in ("even", "gaps", "one lost", "set back", "nanoseconds", "jitter", "late", "bursts")],
    *[(suffix, kind) for suffix in (".parquet", ".npy") for kind in ("gaps", "set back", "nanoseconds", "bursts")],
]
"""Stamps are interpreted alike in all formats."""


def columns(seed=1, rows=ROWS):
    rng = np.random.default_rng(seed)
    out = {f"gyro_{a}": rng.normal(scale=0.05, size=rows) for a in "xyz"}
    return out | {f"accel_{a}": rng.normal(scale=0.01, size=rows) + (a == "z") for a in "xyz"}


def stamps(kind, rng, rows=ROWS):
    """Stamps of 100 Hz, each kind with what makes segments hard to find."""
    k = np.arange(rows, dtype=np.int64)
    if kind == "gaps":
        k = k + np.searchsorted(np.array([2000, 2004, 2999, 3000, 9000, 15_000, rows - 3]), k, side="right") * 7
    if kind == "one lost":
        k = k + (k >= 7777)
    if kind == "set back":
        return np.round(np.where(k < 12_345, k, k - 5000) * 0.01, 4)
    if kind == "nanoseconds":
        return 1_600_000_000_000_000_000 + (k + 40 * (k > 5000)) * 10_000_000
    if kind == "jitter":
        return (k + 500 * (k > 8000)) * 0.01 + rng.normal(scale=0.0012, size=rows)
    if kind == "late":
        return k * 0.01 + np.where(rng.uniform(size=rows) < 0.01, 0.009, 0.0)
    if kind == "bursts":
        lost = 40 * (k >= 6000)
        return ((k // 10) * 10 + lost) * 0.01 + (k % 10) * 1e-4
    return k * 0.01


def written(path, table):
    frame = pl.DataFrame(table)
    if path.suffix == ".csv":
        frame.write_csv(path)
    elif path.suffix == ".parquet":
        frame.write_parquet(path, row_group_size=4000)
    else:
        record = np.zeros(frame.height, dtype=[(name, frame[name].to_numpy().dtype) for name in frame.columns])
        for name in frame.columns:
            record[name] = frame[name].to_numpy()
        np.save(path, record)
    return path


def same(path, *, chunk=777, apart=0.0, **options):
    """Whether the chunks together are the recording as `read` has it; the chunks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        imu = gmwm.read(path, **options)
        source = stream(path, chunk=chunk, **options)
        found = list(source)
    assert source.axes == imu.axes
    assert source.rate == pytest.approx(imu.rate, rel=apart)
    assert all(0 < len(one) <= chunk for one in found)
    assert [one.first for one in found] == [0, *np.cumsum([len(p) for p in found])[:-1]]
    for axis in imu.axes:
        assert np.array_equal(np.concatenate([one[axis] for one in found]), imu[axis].values)
    firsts = [p.first for k, p in enumerate(found) if k == 0 or p.segment != found[k - 1].segment]
    assert firsts == [first for first, _ in imu.segments]
    signal = imu[imu.axes[0]]
    times = [p.start for k, p in enumerate(found) if k == 0 or p.segment != found[k - 1].segment]
    cut = {"start", "stop", "skip"} & set(options)
    assert times == pytest.approx(list(signal.starts), rel=1e-13 if cut else 0, abs=0)
    assert [p.segment for p in found] == sorted(p.segment for p in found)
    return imu, found


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "kind"), FORMATS_AND_STAMPS)
def test_chunks_are_what_is_read(tmp_path, suffix, kind):
    time = stamps(kind, np.random.default_rng(3))
    name = "timestamp_ns" if kind == "nanoseconds" else "time_s"
    path = written(tmp_path / f"a{suffix}", {name: time} | columns())
    options = {"units": {"gyro": "deg/s", "accel": "g"}}
    imu, _ = same(path, **options)
    assert len(imu.segments) == {
        "gaps": 8,
        "one lost": 2,
        "set back": 2,
        "nanoseconds": 2,
        "jitter": 2,
        "bursts": 2,
    }.get(kind, 1)


@pytest.mark.slow
def test_gap_in_the_first_rows_is_found_too(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("gaps", None)} | columns())
    imu, _ = same(path, units={"gyro": "rad/s"}, chunk=10**6)
    assert imu.segments[0] == (0, 2000)


@pytest.mark.slow
@pytest.mark.parametrize("rows", [8, 9, 31, 64, 2999, 3000, 3001])
def test_short_files(tmp_path, rows):
    path = written(tmp_path / "a.csv", {"time": np.arange(rows) * 0.01} | columns(rows=rows))
    same(path, units={"gyro": "rad/s"}, chunk=5)


@pytest.mark.slow
def test_without_stamps_with_factors_and_increments(tmp_path):
    path = written(tmp_path / "a.parquet", columns())
    units = {"gyro": "deg/s", "accel": "mg"}
    scale = {"gyro": 1 / 131, "accel_x": 6.1e-5}
    same(path, rate=125.0, units=units, scale=scale, increments=["accel"])
    numbered = tmp_path / "b.csv"
    np.savetxt(numbered, np.column_stack(list(columns().values())[:2]), delimiter=",")
    same(numbered, rate=50.0, units={"gyro": "deg/s"}, columns=["gyro_x", "gyro_y"])


@pytest.mark.slow
def test_bare_records(tmp_path):
    imu = gmwm.simulate({"gyro": "WN(sigma2=1e-6)", "accel": "WN(sigma2=1e-4)"}, rate=100.0, samples=4000, rng=2)
    path = tmp_path / "a.imr"
    imu.write(tmp_path / "a.csv")
    same(tmp_path / "a.csv")
    records = np.zeros((4000, 7))
    records[:, 0] = np.arange(4000) * 0.01
    records[:, 1:] = np.column_stack([imu[axis].values for axis in imu.axes])
    path = tmp_path / "a.npy"
    np.save(path, records)
    same(path, columns=["time", *imu.axes], units={"gyro": "rad/s", "accel": "m/s2", "time": "s"})


@pytest.mark.slow
def test_temperature_is_beside_the_axes(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("even", None), "temperature": np.arange(ROWS) * 1.0} | columns())
    imu, found = same(path, units={"gyro": "deg/s"})
    assert "temperature" not in found[0].values
    assert np.array_equal(np.concatenate([chunk.temperature for chunk in found]), imu.temperature)


@pytest.mark.slow
def test_it_can_be_read_again(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("even", None)} | columns())
    source = stream(path, units={"gyro": "deg/s", "accel": "g"})
    assert "gyro_x" in repr(source)
    assert only(source.remarks, "unit-named:unit", "gyro").facts == {
        "case": "unit",
        "unit": "deg/s",
        "source": "declared",
    }
    sums = [sum(float(chunk["gyro_x"].sum()) for chunk in source) for _ in range(2)]
    assert sums[0] == sums[1] != 0


def drained(path, **options):
    return [len(chunk) for chunk in stream(path, **{"units": {"gyro": "deg/s", "accel": "g"}} | options)]


@pytest.mark.slow
def test_bad_lines_behind_the_first_rows_are_refused_with_their_number(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("even", None)} | columns())
    path.write_text(path.read_text() + "200.01,1,2\n")
    with raises(ReadError, "line 20002", "3 values", "expected 7"):
        drained(path)


def test_a_rate_that_changes_behind_the_first_rows(tmp_path):
    k = np.arange(ROWS)
    for change in (9000, 9100):
        time = np.where(k < change, k * 0.01, change * 0.01 + (k - change) * 0.02)
        with raises(ReadError, "100 Hz"):
            drained(written(tmp_path / "a.parquet", {"time": time} | columns()))


@pytest.mark.slow
def test_a_clock_that_slowly_leaves_the_rate_of_the_first_rows(tmp_path):
    k = np.arange(ROWS)
    time = np.where(k < 5000, k * 0.01, 50 + (k - 5000) * 0.01003)
    same(written(tmp_path / "a.parquet", {"time": time} | columns()), apart=0, units={"gyro": "rad/s"})


@pytest.mark.slow
def test_repeated_stamps_are_counted_over_all_blocks(tmp_path):
    time = stamps("even", None)
    time[[2500, 12_000]] = time[[2499, 11_999]]
    path = written(tmp_path / "a.parquet", {"time": time} | columns())
    with pytest.warns(TimeBaseWarning) as streamed:
        drained(path)
    with pytest.warns(TimeBaseWarning) as at_once:
        gmwm.read(path, units={"gyro": "deg/s", "accel": "g"})
    repeated = Remark.of("stamps-irregular", str(path), case="repeated", count=2)
    assert [one.message.remark for one in (*streamed, *at_once)] == [repeated, repeated]


def test_stamps_in_no_order(tmp_path):
    time = stamps("even", None)
    time[10_000:12_000] = np.random.default_rng(1).permutation(time[10_000:12_000])
    with raises(ReadError, "row 1000", code="time-order"):
        drained(written(tmp_path / "a.parquet", {"time": time} | columns()))


@pytest.mark.slow
def test_options_are_checked_at_the_door(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("even", None)} | columns())
    for chunk in (0, 1.5, True, "many"):
        with raises(OptionError, argument="chunk"):
            stream(path, chunk=chunk)
    with raises(UnitError, "gyro_x"):
        stream(path)
    with raises(OptionError, "gyro_x", "accel_y", argument="increments"):
        stream(path, units={"gyro": "deg/s"}, columns={"gyro_x": "gyro_x"}, increments=["accel_y"])
    with raises(ReadError, argument="path"):
        stream(tmp_path / "none.csv")
    with raises(ReadError, argument="rate"):
        stream(path, rate=50.0, units={"gyro": "deg/s"})


def test_memory_does_not_grow_with_an_array_on_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(arrays, "ARRAY_ROWS", 20_000)
    peaks = []
    for rows in (40_000, 800_000):
        path = tmp_path / f"{rows}.npy"
        np.save(path, np.random.default_rng(1).normal(size=(rows, 3)))
        source = stream(path, 100.0, ["gyro_x", "gyro_y", "gyro_z"], {"gyro": "deg/s"}, chunk=20_000)
        tracemalloc.start()
        assert sum(len(chunk) for chunk in source) == rows
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] < 800_000 * 8


PEAK = """
import resource, sys, gmwm
before = None
for path in sys.argv[1:]:
    for chunk in gmwm.stream(path, units={"gyro": "deg/s"}):
        pass
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is counted in other units elsewhere")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_memory_does_not_grow_with_a_table(tmp_path, suffix):
    """What the process needs at most for a file and then for one three times as long (kB)."""
    paths, most = [], 1_200_000 if suffix == ".csv" else 1_500_000
    for rows in (most, 3 * most):
        noise = np.round(np.random.default_rng(1).normal(size=rows), 2)
        frame = pl.DataFrame({"time": np.arange(rows) * 0.01, "gyro_x": noise, "gyro_y": noise[::-1], "gyro_z": noise})
        paths.append(tmp_path / f"{rows}{suffix}")
        frame.write_csv(paths[-1]) if suffix == ".csv" else frame.write_parquet(paths[-1], row_group_size=200_000)
    environment = os.environ | {"POLARS_MAX_THREADS": "1"}
    run = subprocess.run(
        [sys.executable, "-c", PEAK, *map(str, paths)], capture_output=True, text=True, check=True, env=environment
    )
    short, long = (int(line) for line in run.stdout.split())
    assert long - short < 0.4 * (2 * most * 4 * 8 / 1024)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["even", "gaps", "set back"])
@pytest.mark.parametrize(
    "cut",
    [
        {"start": 10.0},
        {"start": 0.005, "stop": 71.234},
        {"skip": [(20.0, 30.0), (25.5, 31.001), (90.0, 91.0)]},
        {"start": 3.0, "stop": 100.0, "skip": [(0.0, 4.0), (50.0, 50.001)]},
    ],
)
def test_parts_between_times(tmp_path, kind, cut):
    # Chunks of one file are shorter than its segments and than its cuts, those of another longer than the file.
    chunk = 100_000 if kind == "even" else 777
    axes = {name: values for name, values in columns().items() if name in ("gyro_x", "gyro_y")}
    path = written(tmp_path / "a.csv", {"time": stamps(kind, np.random.default_rng(3))} | axes)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rate = gmwm.read(path, units={"gyro": "rad/s"}).rate
    imu, found = same(path, units={"gyro": "rad/s"}, rate=rate, chunk=chunk, **cut)
    assert len(imu) == sum(map(len, found))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        source = stream(path, units={"gyro": "rad/s"}, rate=rate, **cut)
        for _ in range(2):
            list(source)
            assert [gap for gap, _ in source.time_base.gaps] == [gap for gap, _ in imu.time_base.gaps]
        assert only(source.remarks, "cut:cut").facts["known"] == "no"
        with raises(OptionError, advises=["start=", "stop=", "skip="]):
            source.parts(2)


@pytest.mark.slow
def test_nothing_left_between_times(tmp_path):
    path = written(tmp_path / "a.csv", {"time": np.arange(3000) * 0.01} | columns(rows=3000))
    for cut in ({"start": 40.0}, {"stop": 0.05}, {"skip": [(0.0, 99.0)]}):
        source = stream(path, units={"gyro": "rad/s", "accel": "g"}, **cut)
        with raises(DataError, "8 samples", "which lasts", advises=["start=", "stop=", "skip="]):
            list(source)
