"""A file read into memory and a stream of it have the same samples, whatever appears after the first rows."""

import warnings

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.base.errors import ReadError
from gmwm.files.formats import parquet, text
from gmwm.files.readers import builder, interpretation
from tests.helpers import code_of, only, raises

ROWS = 9000


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 1000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 20_000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 700)


def table(rows=ROWS, **other):
    rng = np.random.default_rng(5)
    axes = {f"gyro_{axis} [rad/s]": rng.normal(scale=1e-3, size=rows) for axis in "xyz"}
    return {"time [s]": np.arange(rows) / 100, **axes, **other}


def written(folder, columns, name="a.csv"):
    path, frame = folder / name, pl.DataFrame(columns)
    if path.suffix == ".csv":
        frame.write_csv(path)
    else:
        frame.write_parquet(path)
    return path


def both(path, **options):
    """The recording in memory, after a check that the stream has the same samples, clock and remarks."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        imu, source = gmwm.read(path, **options), gmwm.stream(path, **options)
        parts = list(source.samples())
    for axis in imu.axes:
        assert np.array_equal(np.concatenate([part.values[axis] for part in parts]), imu[axis].values)
    if imu.temperature is None:
        assert all(part.temperature is None for part in parts)
        assert not source.has_temperature
    else:
        assert np.array_equal(np.concatenate([part.temperature for part in parts]), imu.temperature)
    runs = dict(run for part in parts for run in part.runs)
    assert list(runs) == [first for first, _ in imu.segments]
    assert list(runs.values()) == pytest.approx(list(imu["gyro_x"].starts), rel=1e-13)
    if "stop" in options:  # a stream ends there
        return imu
    assert source.time_base == imu.time_base
    assert [repr(r) for r in source.remarks if code_of(r) != "cut:cut"] == [
        repr(r) for r in imu.remarks if code_of(r) != "cut:cut"
    ]
    return imu


def readings(kind):
    rng, t = np.random.default_rng(6), 20 + np.arange(ROWS) / 700 + np.sin(np.arange(ROWS) / 90)
    missing = {
        "everywhere": np.zeros(ROWS, dtype=bool),
        "every 50th": np.arange(ROWS) % 50 != 7,
        "some": rng.random(ROWS) < 0.2,
        "only first rows": np.arange(ROWS) > 500,
        "only last rows": np.arange(ROWS) < 8000,
        "few": ~np.isin(np.arange(ROWS), [3000, 3001, 6500]),
    }[kind]
    return np.where(missing, np.nan, t)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("kind", ["everywhere", "every 50th", "some", "only first rows", "only last rows", "few"])
def test_temperature_is_interpolated_between_its_readings(tmp_path, suffix, kind):
    values = readings(kind)
    imu = both(written(tmp_path, table(temperature=values), f"a{suffix}"))
    known = np.flatnonzero(np.isfinite(values))
    np.testing.assert_allclose(imu.temperature, np.interp(np.arange(ROWS), known, values[known]), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "readings"),
    [("temp_F", [77.0, 86.0]), ("temperature [K]", [298.15, 303.15]), ("temperature [mdegC]", [25e3, 30e3])],
)
def test_a_temperature_is_in_celsius(tmp_path, name, readings):
    values = np.repeat(readings, ROWS // 2)
    values[7] = np.nan
    imu = both(written(tmp_path, table(**{name: values})))
    np.testing.assert_allclose(imu.temperature, np.repeat([25.0, 30.0], ROWS // 2), rtol=1e-12)


@pytest.mark.slow
def test_rows_of_the_temperature_alone_are_readings(tmp_path):
    columns = table()
    alone = np.arange(ROWS) % 40 == 3
    for name in columns:
        if name != "time [s]":
            columns[name] = np.where(alone, np.nan, columns[name])
    columns["time [s]"] = np.cumsum(~alone) / 100 + 0.004 * alone
    columns["temperature"] = np.where(alone, 20 + columns["time [s]"], np.nan)
    imu = both(written(tmp_path, columns))
    assert len(imu) == np.count_nonzero(~alone)
    inside = slice(100, -100)
    np.testing.assert_allclose(imu.temperature[inside], 20 + imu["gyro_x"].times()[inside], atol=1e-9)


@pytest.mark.slow
def test_lost_samples_and_gaps_have_the_temperature_of_the_others(tmp_path):
    rng = np.random.default_rng(8)
    columns = table(temperature=readings("every 50th"))
    columns["time [s]"] += 3.0 * (np.arange(ROWS) > 4321)
    columns["gyro_y [rad/s]"] = np.where(rng.random(ROWS) < 0.05, np.nan, columns["gyro_y [rad/s]"])
    imu = both(written(tmp_path, columns))
    assert imu.time_base.lost > 300
    both(written(tmp_path, columns), start=5.0, stop=80.0, skip=[(20.0, 21.0)])


@pytest.mark.slow
def test_readings_that_are_far_apart_are_held(tmp_path, monkeypatch):
    monkeypatch.setattr(builder, "MOST_ROWS_APART", 2000)
    values = readings("few")
    imu = both(written(tmp_path, table(temperature=values)))
    assert np.all(imu.temperature[:3000] == values[3000])
    assert np.all(imu.temperature[3001:6500] == values[3001])
    assert imu.temperature[6500] == values[6500]


@pytest.mark.slow
def test_an_axis_that_is_constant_in_the_first_rows_only(tmp_path):
    columns = table()
    columns["gyro_y [rad/s]"][:5000] = 0.0
    assert both(written(tmp_path, columns)).axes == ("gyro_x", "gyro_y", "gyro_z")
    columns["gyro_y [rad/s]"][:] = 0.0
    columns["gyro_z [rad/s]"][:] = np.nan
    imu = both(written(tmp_path, columns))
    assert imu.axes == ("gyro_x",)
    assert only(imu.remarks, "axis-dead", "gyro_y").facts["rows"] == ROWS


@pytest.mark.slow
def test_rows_of_others_are_counted_in_the_whole_file(tmp_path):
    columns = table()
    other = np.arange(ROWS) % 10 == 4
    for name in columns:
        if name != "time [s]":
            columns[name] = np.where(other, np.nan, columns[name])
    columns["time [s]"] = np.cumsum(~other) / 100
    imu = both(written(tmp_path, columns))
    assert only(imu.remarks, "file-content:other-rows").facts == {"case": "other-rows", "count": 900, "rows": ROWS}


@pytest.mark.slow
def test_a_part_of_a_file_with_two_rates(tmp_path):
    columns = table()
    columns["time [s]"] = np.where(np.arange(ROWS) < 4000, np.arange(ROWS) / 100, 40 + (np.arange(ROWS) - 4000) / 50)
    path = written(tmp_path, columns)
    for open_it in (gmwm.read, gmwm.stream):
        with raises(ReadError, code="rate-changes"):
            open_it(path)
    assert both(path, stop=35.0).rate == pytest.approx(100.0)
    second = both(path, start=45.0, skip=[(60.0, 61.0)])
    assert second.rate == pytest.approx(50.0)
    assert second.time_base.left == pytest.approx(45.0)
    stream = gmwm.stream(path, start=45.0)
    list(stream)
    assert stream.time_base.left == pytest.approx(45.0)
