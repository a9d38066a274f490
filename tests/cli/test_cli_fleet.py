"""gmwm fleet: a folder of recordings, each calibrated, printed and written."""

import polars as pl
import pytest

import gmwm as library
from gmwm.applications.fleets import Fleet

WITHIN = "WN + RW"
FILES = ["fleet.json", "fleet.parquet", "fleet.png", "summary.txt", "units"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Eight units with two axes, one that is cut off, and a picture."""
    folder = tmp_path_factory.mktemp("recordings")
    models = {"gyro_x": "WN(sigma2=4e-7)", "accel_z": "WN(sigma2=2e-5)"}
    for k in range(8):
        library.simulate(models, rate=100.0, samples=2000, rng=k).write(folder / f"unit {k}.parquet")
    (folder / "broken.parquet").write_bytes((folder / "unit 0.parquet").read_bytes()[:500])
    (folder / "photo.jpg").write_bytes(b"\xff\xd8\xff\xe0" + bytes(range(64)))
    return folder


@pytest.fixture(scope="module")
def run(gmwm, folder, tmp_path_factory):
    target = tmp_path_factory.mktemp("fleet") / "new" / "results"
    return target, gmwm("fleet", folder, "--within", WITHIN, "--output", target, "--workers", 0)


@pytest.mark.slow
def test_it_prints_the_summary_and_what_it_wrote(run):
    target, outcome = run
    assert outcome.code == 0
    found = Fleet.load(target)
    assert (len(found), list(found.failed)) == (8, ["broken.parquet"])
    # Of a fleet that was loaded nothing was done now; the rest is the same.
    assert outcome.out.startswith(found.summary())
    assert (target / "summary.txt").read_text(encoding="utf-8") == found.summary() + "\n"
    assert sorted(path.name for path in target.iterdir()) == FILES
    assert (target / "fleet.png").read_bytes().startswith(b"\x89PNG")
    assert all(name in outcome.out for name in (str(target), *FILES[1:4]))
    assert max(map(len, outcome.out.partition("\nWrote")[0].splitlines())) <= 80


@pytest.mark.slow
def test_a_unit_that_failed_is_a_warning(run):
    _, outcome = run
    (line,) = outcome.err.splitlines()
    assert line.startswith("warning: ")
    assert "broken.parquet" in line
    assert line.endswith(" [not-calibrated]")


@pytest.mark.slow
def test_a_unit_s_file_is_its_calibration(gmwm, run, folder):
    target, _ = run
    alone = gmwm("calibrate", folder / "unit 3.parquet", "--within", WITHIN, "--json").json
    found = library.Calibration.load(target / "units" / "unit 3.parquet.json").to_dict()
    assert found["axes"] == alone["axes"]
    assert found["settings"] == alone["settings"]


@pytest.mark.slow
def test_the_same_again_does_nothing_anew_and_json_says_so(gmwm, run, folder):
    target, _ = run
    outcome = gmwm("fleet", folder, "--within", WITHIN, "--output", target, "--workers", 0, "--json")
    content = outcome.json
    assert (content["command"], content["done"], content["kept"]) == ("fleet", 0, 8)
    assert content["units"] == ["broken.parquet", *(f"unit {k}.parquet" for k in range(8))]
    assert list(content["failed"]) == ["broken.parquet"]
    assert content["left_out"] == ["photo.jpg"]
    names = ("fleet.json", "fleet.parquet", "summary.txt", "fleet.png")
    assert content["written"] == [str(target / name) for name in names]
    assert content["statistics"]["units"] == 8
    remarks = {one["code"]: one for one in content["remarks"]}
    assert list(remarks) == ["not-calibrated", "left-out"]
    assert remarks["not-calibrated"]["subject"] == "broken.parquet"
    assert remarks["not-calibrated"]["facts"]["reason"] == content["failed"]["broken.parquet"]
    assert remarks["left-out"]["facts"]["files"] == ["photo.jpg"]


@pytest.mark.slow
def test_options_reach_every_unit(gmwm, folder, tmp_path):
    arguments = ("--axis", "gyro", "--robust", "yes", "--confidence", 0.9, "--stop", "15s", "--pattern", "unit [0-3]*")
    outcome = gmwm("fleet", folder, "--within", "WN", "--output", tmp_path, "--workers", 0, *arguments)
    assert (outcome.code, outcome.err) == (0, "")
    found = Fleet.load(tmp_path)
    assert found.settings.confidence == 0.9
    assert found.reading == {"stop": 15.0}
    rows = found.table.select("unit", "axis", "samples", "robust").rows()
    assert rows == [(f"unit {k}.parquet", "gyro_x", 1500, True) for k in range(4)]


def test_none_that_can_be_calibrated_is_an_error_and_the_table_says_why(gmwm, tmp_path):
    (tmp_path / "in").mkdir()
    for k in range(12):
        rows = "".join(f"{i / 100},{(i * 7) % 5}\n" for i in range(9))
        (tmp_path / "in" / f"{k:02d}.csv").write_text("time,accel_x [m/s^2]\n" + rows)
    gmwm("fleet", tmp_path / "in", "--axis", "gyro_x", "--output", tmp_path / "out", "--workers", 0).require_refusal(
        "error: none of 12 units ", "00.csv"
    )
    assert pl.read_parquet(tmp_path / "out" / "fleet.parquet")["status"].to_list() == ["failed"] * 12


@pytest.mark.slow
def test_a_unit_that_is_too_short_fails_with_the_reason(gmwm, folder, tmp_path):
    (tmp_path / "in").mkdir()
    library.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=9, rng=1).write(tmp_path / "in" / "nine.csv")
    library.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=2000, rng=1).write(tmp_path / "in" / "long.csv")
    outcome = gmwm("fleet", tmp_path / "in", "--within", "WN", "--output", tmp_path / "out", "--workers", 0)
    assert outcome.code == 0
    rows = Fleet.load(tmp_path / "out").table.select("unit", "status", "reason").rows()
    assert [row[:2] for row in rows] == [("long.csv", "calibrated"), ("nine.csv", "failed")]
    assert "9 samples" in rows[1][2]


@pytest.mark.slow
def test_many_failures_with_one_reason_are_one_warning(gmwm, folder, tmp_path):
    (tmp_path / "in").mkdir()
    for k in range(12):
        rows = "".join(f"{i / 100},{(i * 7) % 5}\n" for i in range(9))
        (tmp_path / "in" / f"{k:02d}.csv").write_text("time,accel_x [m/s^2]\n" + rows)
    (tmp_path / "in" / "good.parquet").write_bytes((folder / "unit 1.parquet").read_bytes())
    outcome = gmwm(
        "fleet", tmp_path / "in", "--axis", "gyro_x", "--within", "WN", "--output", tmp_path / "out", "--workers", 0
    )
    assert outcome.code == 0
    (line,) = outcome.err.splitlines()
    assert all(f"{k:02d}.csv" in line for k in range(8))
    assert "4 others" in line
    assert line.endswith(" [not-calibrated]")


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (("--robust", "no", "--efficiency", 0.8), "--efficiency"),
        (("--workers", 2, "--scheduler", "tcp://127.0.0.1:9"), "--scheduler"),
        (("--within", "WN + XX"), "--within"),
        (("--units", "gyro"), "--units"),
        (("--pattern", "*.mat"), "*.mat"),
        (("--axis", "gyro_w"), "gyro_w"),
    ],
)
def test_contradicting_options_are_refused_before_the_work(arguments, facts, gmwm, folder, tmp_path):
    gmwm("fleet", folder, "--output", tmp_path / "out", *arguments).require_refusal(facts)


def test_a_scheduler_that_is_not_there_is_told(gmwm, folder, tmp_path):
    pytest.importorskip("distributed")
    gmwm("fleet", folder, "--output", tmp_path, "--scheduler", "127.0.0.1").require_refusal(
        "error: --scheduler ", "127.0.0.1"
    )
