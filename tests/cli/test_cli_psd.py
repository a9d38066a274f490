"""gmwm psd: the library's numbers, in every form."""

import csv

import numpy as np
import pytest

import gmwm as library
from gmwm.files.readers import read, stream


@pytest.fixture(scope="module")
def vibrating(tmp_path_factory):
    rng, t = np.random.default_rng(1), np.arange(30_000) / 100.0
    x = 1e-3 * rng.normal(size=t.size)
    path = tmp_path_factory.mktemp("psd") / "vibrating.csv"
    arrays = {"gyro_x": x + 4e-4 * np.sin(2 * np.pi * 7.3 * t), "gyro_y": x[::-1]}
    library.Imu.from_arrays(arrays, 100.0).write(path)
    return path


@pytest.mark.slow
def test_json_is_the_library_s(gmwm, vibrating):
    content = gmwm("psd", vibrating, "--axis", "gyro_x", "--json").json
    assert list(content["axes"]) == ["gyro_x"]
    assert content["axes"]["gyro_x"] == library.psd(read(vibrating)["gyro_x"]).to_dict()
    other = gmwm("psd", vibrating, "--length", "512", "--detrend", "linear", "--json").json["axes"]["gyro_y"]
    assert other == library.psd(read(vibrating)["gyro_y"], length=512, detrend="linear").to_dict()


@pytest.mark.slow
def test_tables(gmwm, vibrating):
    outcome = gmwm("psd", vibrating)
    assert outcome.code == 0
    assert "29 blocks of 2048 samples" in outcome.out or "blocks of" in outcome.out
    (row,) = [line for line in outcome.out.splitlines() if "gyro_x" in line]
    assert float(row.split()[1]) == pytest.approx(7.3, abs=0.01)
    assert "gyro_y" not in outcome.out
    assert "No broad peaks" in outcome.out


@pytest.mark.slow
def test_csv_and_plot(gmwm, vibrating, tmp_path):
    table, picture = tmp_path / "psd.csv", tmp_path / "psd.png"
    assert gmwm("psd", vibrating, "--csv", table, "--plot", picture, "--datasheet").code == 0
    with table.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["axis"] == "gyro_y"]
    found = library.psd(read(vibrating)["gyro_y"])
    assert [float(row["density"]) for row in rows] == found.density.tolist()
    assert [float(row["upper"]) for row in rows] == found.upper.tolist()
    assert picture.stat().st_size > 5_000
    one = tmp_path / "one.svg"
    assert gmwm("psd", vibrating, "--axis", "gyro_x", "--plot", one).code == 0
    assert one.exists()


@pytest.mark.slow
def test_chunks_give_the_same(gmwm, vibrating):
    content = gmwm("psd", vibrating, "--chunked", "yes", "--axis", "gyro_x", "--json").json["axes"]
    whole = library.psd(read(vibrating))
    np.testing.assert_allclose(content["gyro_x"]["density"], whole["gyro_x"].density, rtol=1e-11)
    pieces = stream(vibrating, chunk=1000).psd()
    assert list(pieces) == list(whole)
    np.testing.assert_allclose(pieces["gyro_y"].density, whole["gyro_y"].density, rtol=1e-11)


def test_a_wrong_length_is_an_error(gmwm, vibrating):
    gmwm("psd", vibrating, "--length", "9").require_refusal("--length")
