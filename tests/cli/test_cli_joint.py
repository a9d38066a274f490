"""gmwm cross and gmwm same: the library's results, in every form."""

import numpy as np
import polars
import pytest

import gmwm as library
from gmwm.files.readers import read


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("joint")
    for k, name in enumerate(("monday", "tuesday")):
        rng = np.random.default_rng(k)
        x = rng.normal(size=(3, 5000)) + 0.5 * rng.normal(size=5000)
        library.Imu.from_arrays(dict(zip(("gyro_x", "gyro_y", "gyro_z"), x, strict=True)), 100.0).write(
            folder / f"{name}.csv"
        )
    return folder


@pytest.mark.slow
def test_cross(gmwm, recordings, tmp_path):
    path, table, picture = recordings / "monday.csv", tmp_path / "cross.csv", tmp_path / "cross.png"
    outcome = gmwm("cross", path, "--json", "--csv", table, "--plot", picture)
    found = library.cross(read(path))
    assert outcome.json["pairs"] == found.to_dict()["pairs"]
    assert polars.read_csv(table).shape == found.to_polars().shape
    assert picture.stat().st_size > 10_000
    plain = gmwm("cross", path, "--axis", "gyro_x", "--axis", "gyro_z", "--robust")
    assert plain.code == 0
    assert "gyro_x, gyro_z" in plain.out
    assert "gyro_y" not in plain.out


def test_one_axis_has_no_pair(gmwm, recordings):
    assert gmwm("cross", recordings / "monday.csv", "--axis", "gyro_x").code == 2


@pytest.mark.slow
def test_same(gmwm, recordings):
    files = [recordings / f"{name}.csv" for name in ("monday", "tuesday")]
    outcome = gmwm("same", *files, "--json", "--tolerance", "0.1")
    assert (
        outcome.json["levels"]
        == library.same(*map(read, files), labels=["monday", "tuesday"], tolerance=0.1).to_dict()["levels"]
    )
    assert outcome.json["differs"] is False
    text = gmwm("same", *files, "--axis", "gyro_y")
    assert text.code == 0
    assert "gyro_y" in text.out
    gmwm("same", files[0]).require_refusal(f"pass at least two recordings; got one, {files[0]}")


def test_a_joint_model_of_one_axis_is_an_error_with_advice(gmwm, recordings):
    gmwm("joint", recordings / "monday.csv", "--axis", "gyro_y", "--model", "WN").require_refusal(
        "two or more axes; got one, gyro_y", "gmwm fit"
    )


@pytest.mark.slow
def test_fuse(gmwm, tmp_path):
    rng = np.random.default_rng(1)
    for name in ("static", "drive"):
        units = {f"gyro_x[{k}] [rad/s]": (1 + k) * rng.normal(size=4000) for k in range(3)}
        rows = np.column_stack([np.arange(4000) / 100, *units.values()])
        header = ",".join(["time", *units])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    files = [tmp_path / name for name in ("static.csv", "virtual.csv", "deviations.csv", "virtual.png")]
    outcome = gmwm(
        "fuse", files[0], "--horizon", "100ms", "--json", "--output", files[1], "--csv", files[2], "--plot", files[3]
    )
    units = library.readers.read_array(files[0])
    virtual = library.fuse(units, horizon=0.1)
    assert outcome.json["axes"] == virtual.to_dict()["axes"]
    assert np.array_equal(read(files[1])["gyro_x"].values, virtual.apply(units)["gyro_x"].values)
    assert polars.read_csv(files[2]).shape == virtual.to_polars().shape
    assert files[3].stat().st_size > 10_000
    text = gmwm("fuse", files[0], "--horizon", "1s", "--apply", tmp_path / "drive.csv", "--output", files[1])
    assert text.code == 0
    assert "gain over the average" in text.out
    drive = library.readers.read_array(tmp_path / "drive.csv")
    expected = library.fuse(units, horizon=1.0).apply(drive)["gyro_x"].values
    assert np.array_equal(read(files[1])["gyro_x"].values, expected)


@pytest.mark.slow
def test_fuse_says_what_it_needs(gmwm, recordings, tmp_path):
    files = [recordings / f"{name}.csv" for name in ("monday", "tuesday")]
    assert gmwm("fuse", files[0], "--horizon", "1s").code == 2
    assert gmwm("fuse", *files, "--horizon", "1s", "--apply", files[0]).code == 2
    both = gmwm(
        "fuse", *files, "--horizon", "1s", "--apply", files[1], "--apply", files[0], "--output", tmp_path / "v.csv"
    )
    assert both.code == 0
    assert "[monday]" in both.out


@pytest.mark.slow
def test_joint(gmwm, recordings, tmp_path):
    path, picture = recordings / "monday.csv", tmp_path / "joint.png"
    outcome = gmwm("joint", path, "--model", "shared(WN)", "--levels", "1-8", "--plot", picture, "--json")
    found = library.fit_joint("shared(WN)", read(path), levels=range(1, 9))
    assert outcome.json["terms"]["WN"]["covariance"] == found.to_dict()["terms"]["WN"]["covariance"]
    assert picture.stat().st_size > 10_000
    text = gmwm("joint", path, "--model", "shared(WN)", "--axis", "gyro_x,gyro_z")
    assert text.code == 0
    assert "WN is shared" in text.out
    assert gmwm("joint", path, "--model", "shared(WN)", "--levels", "x").code == 2
    assert gmwm("joint", path, "--model", "shared(WN").code == 2


@pytest.mark.slow
def test_cross_of_a_file_in_chunks(gmwm, recording):
    given = ("cross", recording, "--axis", "gyro", "--json")
    whole, chunked = (gmwm(*given, "--chunked", how).json for how in ("no", "yes"))
    assert whole["axes"] == chunked["axes"] == ["gyro_x", "gyro_y", "gyro_z"]
    assert whole["pairs"].keys() == chunked["pairs"].keys()
    for pair, own in whole["pairs"].items():
        assert own["correlation"] == pytest.approx(chunked["pairs"][pair]["correlation"], rel=1e-6, abs=1e-9)
