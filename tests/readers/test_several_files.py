"""Files that continue one another are one recording."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError, ReadError
from gmwm.files.readers import read, stream
from gmwm.recording.signals import Imu
from tests.helpers import only, raises

ROWS = 1200
VALUES = np.random.default_rng(1).normal(size=ROWS).round(6)


def hours(folder, stamped=True, form="csv", lost=0):
    """Three files of 400 samples at 100 Hz; `lost` samples are missing before the last one."""
    paths = []
    for k, name in enumerate(("hour_1", "hour_2", "hour_10")):
        part = slice(400 * k, 400 * (k + 1))
        time = (np.arange(ROWS)[part] + lost * (k == 2)) / 100
        table = ({"time [s]": time} if stamped else {}) | {"gyro_x [rad/s]": VALUES[part]}
        path = folder / f"{name}.{form}"
        if form == "npz":
            np.savez(path, **table)
        else:
            rows = "".join(",".join(map(str, row)) + "\n" for row in zip(*table.values(), strict=True))
            path.write_text(",".join(table) + "\n" + rows)
        paths.append(path)
    return paths


@pytest.mark.parametrize("form", ["csv", "npz"])
@pytest.mark.parametrize("lost", [0, 50])
def test_one_recording(tmp_path, form, lost):
    paths = hours(tmp_path, form=form, lost=lost)
    imu = read(paths)
    np.testing.assert_array_equal(imu["gyro_x"].values, VALUES)
    assert imu.rate == 100
    assert imu.segments == (((0, 800), (800, ROWS)) if lost else ((0, ROWS),))
    assert only(imu.remarks, "file-content:files").facts["files"] == (
        "hour_1." + form,
        "hour_2." + form,
        "hour_10." + form,
    )
    by_pattern = read(tmp_path / f"hour_*.{form}")
    np.testing.assert_array_equal(by_pattern["gyro_x"].values, VALUES)
    assert by_pattern.source.endswith(f"hour_*.{form}")
    chunks = list(stream(paths, chunk=150))
    np.testing.assert_array_equal(np.concatenate([chunk["gyro_x"] for chunk in chunks]), VALUES)
    assert {chunk.segment for chunk in chunks} == ({0, 1} if lost else {0})


@pytest.mark.slow
def test_without_time_stamps_the_recording_is_cut_between_files(tmp_path):
    files = hours(tmp_path, stamped=False)
    imu = read(files, 100)
    assert imu.segments == ((0, 400), (400, 800), (800, ROWS))
    assert imu["gyro_x"].starts == pytest.approx((0, 4, 8))
    assert imu.time_base.lost == 0
    assert imu["gyro_x"].fill_gaps().filled == 0
    assert only(gmwm.inspect(imu).remarks, "gaps").facts["length"] == "unknown"
    for chunk in (90, 400, 5_000):
        parts = list(stream(files, 100, chunk=chunk))
        assert {part.segment for part in parts} == {0, 1, 2}
        np.testing.assert_array_equal(np.concatenate([part.values["gyro_x"] for part in parts]), imu["gyro_x"].values)


def test_files_are_not_filled_where_the_mean_differs(tmp_path):
    paths = []
    for k in range(3):
        values = np.random.default_rng(k).normal(3.0 * k, 1e-3, 3_000)
        paths.append(tmp_path / f"{k}.csv")
        np.savetxt(paths[-1], values, header="gyro_x [rad/s]", comments="")
    wv = gmwm.wavelet_variance(read(paths, 100))["gyro_x"]
    assert wv.segments == (3_000, 3_000, 3_000)
    assert wv.variance.max() < 1e-6


def test_files_of_several_formats(tmp_path):
    first = Imu.from_arrays({"gyro_x": VALUES[:400]}, 100)
    second = Imu.from_arrays({"gyro_x": VALUES[400:]}, 100, start=4.0)
    first.write(tmp_path / "a.csv")
    second.write(tmp_path / "b.parquet")
    imu = read([tmp_path / "a.csv", tmp_path / "b.parquet"])
    assert imu.segments == ((0, ROWS),)
    np.testing.assert_array_equal(imu["gyro_x"].values, VALUES)


def test_other_files_are_told(tmp_path):
    paths = hours(tmp_path)
    (tmp_path / "other.csv").write_text("time [s],gyro_y [rad/s]\n" + "".join(f"{k},{k % 3}\n" for k in range(20)))
    with raises(ReadError, "other.csv", "hour_1.csv", code="not-continued"):
        read([paths[0], tmp_path / "other.csv"])
    with raises(ReadError, code="not-found"):
        read(tmp_path / "minute_*.csv")
    with raises(OptionError, advises=["gmwm convert"]):
        stream(paths).parts(2)


@pytest.mark.slow
def test_a_pattern_on_the_command_line(tmp_path, capsys):
    from gmwm.cli.main import app

    hours(tmp_path)
    with pytest.raises(SystemExit) as done:
        app(["info", str(tmp_path / "hour_*.csv"), "--json"])
    assert done.value.code in (0, None)
    assert '"samples": 1200' in capsys.readouterr().out
    assert gmwm.inspect(read(tmp_path / "hour_*.csv")).samples == ROWS
