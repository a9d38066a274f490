"""gmwm calibrate, fit and select with several recordings of one unit."""

import json
from pathlib import Path

import pytest

from gmwm.simulation import simulate

DAYS = ("monday", "tuesday", "wednesday")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("days")
    for k, (day, sigma2) in enumerate(zip(DAYS, (1e-6, 1.3e-6, 0.8e-6), strict=True)):
        truth = {"gyro_x": f"WN(sigma2={sigma2}) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5)"}
        simulate(truth, rate=50.0, samples=8000, rng=k).write(folder / f"{day}.csv")
    return [str(folder / f"{day}.csv") for day in DAYS]


@pytest.mark.slow
def test_calibrate_says_first_whether_they_differ(gmwm, files, tmp_path):
    found = gmwm("calibrate", *files, "--within", "WN + RW", "--output", tmp_path / "results")
    assert found.code == 0
    parts = found.out.split("\n\n")
    assert parts[0].startswith("Calibration of 3 recordings: monday, tuesday, wednesday")
    assert "differ in gyro_x (N by" in " ".join(parts[2].split())
    assert "agree in accel_x (N within" in " ".join(parts[3].split())
    document = json.loads((tmp_path / "results" / "calibration.json").read_text(encoding="utf-8"))
    assert [one["file"] for one in document["recordings"].values()] == [f"{day}.csv" for day in DAYS]
    assert document["recording"] is None
    assert (tmp_path / "results" / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_fit_and_select(gmwm, files):
    found = gmwm("fit", *files, "--axis", "gyro_x", "--model", "WN", "--json")
    document = json.loads(found.out)
    assert document["files"] == files
    assert document["axes"]["gyro_x"]["replicates"]["recordings"] == list(DAYS)
    text = gmwm("fit", *files, "--axis", "gyro_x", "--model", "WN").out
    assert text.index("The 3 recordings differ") < text.index("N (deg/√h)") < text.index("WN.sigma2")
    ranking = json.loads(gmwm("select", *files[:2], "--axis", "accel_x", "--within", "WN + RW", "--json").out)
    assert ranking["axes"]["accel_x"]["recordings"] == 2
    one = json.loads(gmwm("fit", files[0], "--axis", "gyro_x", "--model", "WN", "--json").out)
    assert one["file"] == files[0]
    assert "replicates" not in one["axes"]["gyro_x"]


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("calibrate", "{0}", "{1}", "--workers", "2"), "--workers"),
        (("calibrate", "{0}", "{1}", "--all-topics"), "--all-topics"),
        (("fit", "{0}", "{1}", "--model", "WN", "--likelihood"), "--likelihood"),
        (("fit", "{0}", "{1}", "--model", "WN", "--conditions", "table.csv"), "--conditions"),
        (("calibrate", "{0}", "{0}"), "given twice"),
    ],
)
def test_what_is_refused_has_one_line(gmwm, files, arguments, word):
    found = gmwm(*(argument.format(*files) for argument in arguments))
    assert found.code != 0
    (line,) = found.err.strip().splitlines()
    assert line.startswith("error: ")
    assert word in line


@pytest.mark.slow
def test_files_of_one_name_have_the_names_of_their_folders(gmwm, files, tmp_path):
    for day, file in zip(("cold", "warm"), files, strict=False):
        (tmp_path / day).mkdir()
        (tmp_path / day / "static.csv").write_bytes(Path(file).read_bytes())
    found = gmwm("calibrate", tmp_path / "cold/static.csv", tmp_path / "warm/static.csv", "--within", "WN", "--json")
    assert list(json.loads(found.out)["recordings"]) == ["cold", "warm"]
