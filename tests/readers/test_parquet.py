from __future__ import annotations

import contextlib
from datetime import datetime, timedelta, timezone

import numpy as np
import polars as pl
import pytest

from gmwm.base.errors import GmwmError, ReadError
from gmwm.files.formats import parquet
from gmwm.files.readers import read
from tests.helpers import raises

NOISE = np.random.default_rng(2).normal(size=50)


def saved(folder, **columns):
    path = folder / "static.parquet"
    pl.DataFrame(columns).write_parquet(path)
    return path


def test_arrow_files_are_read_as_parquet_files_are(tmp_path, monkeypatch):
    for compression in ("uncompressed", "lz4", "zstd"):
        path = tmp_path / f"static[{compression}].feather"
        pl.DataFrame({"gyro_x [rad/s]": NOISE}).write_ipc(path, compression=compression)
        for rows in (7, 51):
            monkeypatch.setattr(parquet, "TABLE_ROWS", rows)
            assert read(path, rate=10)["gyro_x"].values.tolist() == NOISE.tolist()
    path.write_bytes(path.read_bytes()[:500])
    with raises(ReadError, str(path)):
        read(path, rate=10)


def test_slices_of_any_size_give_the_same(tmp_path, monkeypatch):
    path = saved(tmp_path, **{"gyro_x [rad/s]": NOISE})
    for rows in (1, 7, 50, 51):
        monkeypatch.setattr(parquet, "TABLE_ROWS", rows)
        assert read(path, rate=10)["gyro_x"].values.tolist() == NOISE.tolist()


def test_dates_are_a_time_base(tmp_path):
    start = datetime(2026, 11, 21, tzinfo=timezone.utc)
    dates = [start + timedelta(microseconds=2500 * k) for k in range(50)]
    for unit in ("ms", "us", "ns"):
        stamps = pl.Series(dates).dt.cast_time_unit(unit)
        imu = read(saved(tmp_path, **{"when": stamps, "gyro_x [rad/s]": NOISE}))
        assert imu.rate == pytest.approx(400, rel=0.02 if unit == "ms" else 1e-15)
        assert imu["gyro_x"].start == start.timestamp()


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
@pytest.mark.parametrize("first", [-(1 << 63) + 1, -(10**17), 0, 289_918_339_200_000, 10**18, (1 << 63) - 10**12])
def test_dates_beyond_the_calendar_are_counted(tmp_path, unit, first):
    step = {"ms": 10, "us": 10_000, "ns": 10_000_000}[unit]
    stamps = pl.Series(first + step * np.arange(50)).cast(pl.Datetime(unit))
    imu = read(saved(tmp_path, when=stamps, **{"gyro_x [rad/s]": NOISE}))
    assert imu.rate == pytest.approx(100, rel=1e-9)


@pytest.mark.parametrize("kind", [pl.Date(), pl.Duration("ms"), pl.Duration("us"), pl.Duration("ns")])
@pytest.mark.parametrize("value", [-(1 << 31), 0, (1 << 31) - 1, 1 << 62])
def test_other_types_of_time_are_told(tmp_path, kind, value):
    width = pl.Int32 if kind == pl.Date else pl.Int64
    stamps = pl.Series([min(value, (1 << 31) - 1) if width == pl.Int32 else value] * 50, dtype=width).cast(kind)
    path = saved(tmp_path, when=stamps, **{"gyro_x [rad/s]": NOISE})
    assert read(path, rate=100, columns={"gyro_x": "gyro_x [rad/s]"}).rate == 100
    with contextlib.suppress(GmwmError):
        read(path, columns={"time": "when", "gyro_x": "gyro_x [rad/s]"})


def test_integer_nanoseconds(tmp_path):
    stamps = 10**18 + 2_500_000 * np.arange(50)
    imu = read(saved(tmp_path, timestamp=stamps, **{"gyro_x [rad/s]": NOISE.astype(np.float32)}))
    assert imu.rate == 400
    assert imu["gyro_x"].values.tolist() == NOISE.astype(np.float32).astype(float).tolist()


def test_errors(tmp_path):
    with raises(ReadError, "'gyro_x [rad/s]'", "String", code="column-not-numbers"):
        read(saved(tmp_path, **{"gyro_x [rad/s]": ["a"] * 9}), rate=1)
    with raises(ReadError, code="empty"):
        read(saved(tmp_path, **{"gyro_x [rad/s]": np.empty(0)}), rate=1)
    whole = saved(tmp_path, **{"gyro_x [rad/s]": NOISE}).read_bytes()
    (tmp_path / "cut.parquet").write_bytes(whole[:-30])
    with raises(ReadError, "cut.parquet", code="incomplete"):
        read(tmp_path / "cut.parquet", rate=1)


def test_numbers_beyond_int64_are_told(tmp_path):
    frame = pl.DataFrame({"time": pl.Series([1, 2, 2**63 + 5], dtype=pl.UInt64), "gyro_x": [0.1, 0.2, 0.3]})
    frame.write_parquet(tmp_path / "big.parquet")
    with raises(ReadError, "'time'", "2⁶³"):
        read(tmp_path / "big.parquet", units={"gyro": "rad/s"})


@pytest.mark.slow
def test_a_broken_footer_is_told(tmp_path):
    # Polars panics, which is no ordinary exception.
    pl.DataFrame({"time": [0.0, 0.1, 0.2], "gyro_x": [0.1, 0.2, 0.3]}).write_parquet(tmp_path / "good.parquet")
    data = (tmp_path / "good.parquet").read_bytes()
    broken = tmp_path / "broken.parquet"
    for place in range(len(data) - 60, len(data) - 8):
        broken.write_bytes(data[:place] + bytes([data[place] ^ 0x55]) + data[place + 1 :])
        with contextlib.suppress(GmwmError):
            read(broken, units={"gyro": "rad/s"})
