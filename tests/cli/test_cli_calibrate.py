"""gmwm calibrate and gmwm select: what the library finds, printed and written."""

import json
import shutil

import numpy as np
import pytest

import gmwm as library
from gmwm import Calibration
from gmwm.base.remarks import Dialect
from gmwm.calibration.summary_text import summary
from gmwm.files.readers import read
from gmwm.showing.reports.content import report_data
from tests.helpers import only

pytestmark = pytest.mark.slow

WITHIN = "GM + WN + RW"
FILES = ["by_sensor.png", "calibration.json", "calibration.png", "imu.yaml", "report.html", "summary.txt"]


@pytest.fixture(scope="module")
def found(recording):
    return library.calibrate(read(recording), WITHIN).of_file(recording)


def test_it_prints_the_summary_and_what_it_wrote(calibrated, found):
    target, outcome = calibrated
    assert outcome.code == 0
    assert outcome.out.startswith(summary(found, Dialect.SHELL))
    assert sorted(path.name for path in target.iterdir()) == FILES
    assert str(target) in outcome.out
    assert all(name in outcome.out for name in FILES)
    assert max(map(len, found.summary().splitlines())) <= 80


def test_what_it_wrote_is_the_library_s(calibrated, found):
    target, _ = calibrated
    assert Calibration.load(target / "calibration.json").to_dict() == found.to_dict()
    assert (target / "summary.txt").read_text(encoding="utf-8") == summary(
        found, Dialect.SHELL, details=True, every=True
    ) + "\n"
    for picture in ("calibration.png", "by_sensor.png"):
        assert (target / picture).read_bytes().startswith(b"\x89PNG")


def test_json_is_the_document(gmwm, recording, found):
    outcome = gmwm("calibrate", recording, "--within", WITHIN, "--json")
    content = outcome.json
    assert (content["command"], content["file"], content["written"]) == ("calibrate", str(recording), [])
    expected = json.loads(json.dumps(found.to_dict()))
    assert {name: content[name] for name in expected} == expected
    assert Calibration.from_dict(content).summary() == found.summary()
    assert content["remarks"] == [remark.to_dict() for remark in found.remarks]
    assert outcome.err == ""  # the text of the command has the remarks


def test_axes_and_options_reach_the_library(gmwm, recording):
    arguments = ("--axis", "gyro", "--robust", "yes", "--efficiency", 0.8, "--confidence", 0.9, "--seed", 3)
    arguments += ("--model", "gyro_x=RW", "--gravity", 9.81, "--tilt", 0.5)
    content = gmwm("calibrate", recording, "--within", "WN + RW", "--weighting", "diagonal", *arguments, "--json").json
    assert list(content["axes"]) == ["gyro_x", "gyro_y", "gyro_z"]
    assert content["settings"] == {
        "within": "WN + RW", "robust": True, "weighting": "diagonal", "criterion": "asymptotic", "confidence": 0.9,
        "efficiency": 0.8, "draws": 1000, "seed": 3, "against": "auto", "gravity": 9.81, "tilt": 0.5,
        "warmup": "omit", "repeated": "auto",
        "models": {"gyro_x": "RW"},
    }  # fmt: skip
    assert {axis["fit"]["wavelet_variance"]["efficiency"] for axis in content["axes"].values()} == {0.8}
    assert (
        gmwm("calibrate", recording, "--within", "WN", "--robust", "no", "--axis", "gyro_x", "--json").json["settings"][
            "robust"
        ]
        is False
    )


def test_an_axis_that_cannot_be_calibrated_is_remarked(gmwm, folder):
    # The robust variance of a single spike is zero.
    path = folder / "lost.csv"
    values = library.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=4000, rng=6)["gyro_x"].values
    lines = [f"{v!r},{0.6 if k == 1000 else 0.5}" for k, v in enumerate(values.tolist())]
    path.write_text("gyro_x [rad/s],gyro_y [rad/s]\n" + "\n".join(lines) + "\n")
    arguments = ("--rate", 100, "--within", "WN + RW", "--robust", "yes")
    outcome = gmwm("calibrate", path, *arguments)
    assert outcome.code == 0
    assert "gyro_y" in outcome.out
    assert "[not-calibrated]" in outcome.out
    remarks = gmwm("calibrate", path, *arguments, "--json").json["remarks"]
    assert [one["subject"] for one in remarks if one["code"] == "not-calibrated"] == ["gyro_y"]
    gmwm("calibrate", path, *arguments, "--axis", "gyro_y").require_refusal("gyro_y")


def test_a_recording_that_is_too_short_is_refused(gmwm, folder):
    path = folder / "nine.csv"
    library.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=9, rng=1).write(path)
    outcome = gmwm("calibrate", path)
    assert (outcome.code, outcome.out) == (2, "")
    error = outcome.err.splitlines()[-1]
    assert error.startswith("error: ")
    for fact in ("gyro_x", "9 samples", "at least 4", "`gmwm fit`"):
        assert fact in error


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (("--within", "WN + XY"), ["--within: ", "XY"]),
        (("--robust", "no", "--efficiency", 0.8), ["--efficiency", "--robust no"]),
        (("--robust", "maybe"), ["--robust", "'maybe'", "'auto'"]),
        (("--axis", "gyro_q"), ["--axis must be ", "gyro_x", "'gyro_q'"]),
        (("--confidence", 95), ["--confidence must be ", "; got 95", " 0.95"]),
        (("--efficiency", 2), ["efficiency", "0.3", "0.99", "got 2.0"]),
    ],
)
def test_errors_take_one_line(gmwm, recording, arguments, facts):
    gmwm("calibrate", recording, *arguments).require_refusal(*facts)


@pytest.fixture(scope="module")
def doubled(recording, folder):
    """The recording with twice the specific force."""
    imu = read(recording)
    factors = {axis: 2.0 if axis.startswith("accel") else 1.0 for axis in imu}
    path = folder / "doubled.csv"
    library.Imu.from_arrays({axis: factor * imu[axis].values for axis, factor in factors.items()}, 100.0).write(path)
    return path


@pytest.mark.usefixtures("without_pictures")
def test_wrong_gravity_is_no_good_calibration(gmwm, doubled, tmp_path):
    assert gmwm("calibrate", doubled, "--within", "WN + RW", "--output", tmp_path).code == 0
    found = Calibration.load(tmp_path / "calibration.json")
    verdict = report_data(found)["verdict"]
    assert verdict["state"] == "bad"
    norm = only(found.recording_remarks, "unit-doubtful:gravity").facts["norm"]
    assert (round(norm.value, 2), norm.unit) == (19.61, "m/s²")
    (point,) = [point for point in verdict["points"] if "19.61 m/s²" in point["text"]]
    assert point["state"] == "bad"
    assert "19.61 m/s^2" in (tmp_path / "imu.yaml").read_text(encoding="utf-8")


@pytest.mark.usefixtures("without_pictures")
def test_no_imu_yaml_of_an_earlier_run_stays(gmwm, recording, calibrated, tmp_path):
    shutil.copytree(calibrated[0], tmp_path, dirs_exist_ok=True)
    assert (tmp_path / "imu.yaml").exists()
    arguments = ("--axis", "gyro", "--within", "WN", "--output", tmp_path, "--all-remarks")
    outcome = gmwm("calibrate", recording, *arguments)
    assert outcome.code == 0
    assert not (tmp_path / "imu.yaml").exists()
    assert "imu.yaml" not in outcome.out
    (line,) = (line for line in outcome.err.splitlines() if line.endswith(" [other-results]"))
    assert line.startswith("warning: imu.yaml ")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_what_stops_a_second_run_leaves_all_files_of_the_first(
    gmwm, recording, calibrated, tmp_path, monkeypatch, error
):
    shutil.copytree(calibrated[0], tmp_path, dirs_exist_ok=True)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert sorted(before) == FILES

    def stop(*_, **__):
        raise error

    monkeypatch.setattr("gmwm.showing.reports.report", stop)
    outcome = gmwm("calibrate", recording, "--axis", "gyro_x", "--within", "WN", "--output", tmp_path)
    assert outcome.code == (130 if error is KeyboardInterrupt else 2)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_gaps_are_remarked_with_options_of_the_shell(gmwm, broken):
    outcome = gmwm("calibrate", broken, "--within", "WN")
    (remark,) = (one for one in gmwm("calibrate", broken, "--within", "WN", "--json").json["remarks"]
                 if one["code"] == "gaps")  # fmt: skip
    assert (remark["facts"]["segments"], round(remark["facts"]["missing"]["value"])) == (2, 10)
    assert "--gaps longest" in remark["text"]
    assert "--gaps longest" in " ".join(outcome.out.split())
    assert "gaps=" not in outcome.out


def test_an_output_that_is_a_file_is_refused_before_the_work(gmwm, recording):
    gmwm("calibrate", recording, "--output", recording).require_refusal("--output must be a directory")


def test_select_prints_the_ranking(gmwm, recording):
    expected = library.select(WITHIN, read(recording)["gyro_x"])
    outcome = gmwm("select", recording, "--within", WITHIN, "--axis", "gyro_x")
    assert (outcome.code, outcome.out) == (0, expected.summary(10) + "\n")
    both = gmwm("select", recording, "--within", WITHIN, "--axis", "gyro_x,gyro_y", "--limit", 2)
    assert expected.summary(2) in both.out


def test_select_json_is_the_library_s(gmwm, recording):
    content = gmwm("select", recording, "--within", "WN + RW", "--axis", "accel", "--json").json
    assert content["command"] == "select"
    assert list(content["axes"]) == ["accel_x", "accel_y", "accel_z"]
    expected = library.select("WN + RW", read(recording)["accel_y"]).to_dict()
    assert content["axes"]["accel_y"] == json.loads(json.dumps(expected))


def test_select_writes_and_draws(gmwm, recording, tmp_path):
    target, picture = tmp_path / "new", tmp_path / "ranking.png"
    arguments = ("--within", "WN + RW", "--axis", "gyro_x", "--output", target, "--plot", picture)
    outcome = gmwm("select", recording, *arguments)
    assert outcome.code == 0
    assert sorted(path.name for path in target.iterdir()) == ["ranking_gyro_x.png", "rankings.json"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (picture, target / "ranking_gyro_x.png"))
    content = json.loads((target / "rankings.json").read_text(encoding="utf-8"))
    assert content["axes"]["gyro_x"]["recommended"] == "WN + RW"
    assert f"{tmp_path}: {picture.name}" in " ".join(outcome.out.split())


def test_select_plots_a_single_axis(gmwm, recording, tmp_path):
    gmwm("select", recording, "--within", "WN + RW", "--plot", tmp_path / "x.png").require_refusal(
        "error: --plot ", "--axis"
    )
    assert list(tmp_path.iterdir()) == []


def test_select_efficiency_needs_robust(gmwm, recording):
    gmwm("select", recording, "--within", "WN", "--efficiency", 0.8).require_refusal("error: --efficiency ", "--robust")


def test_a_dead_axis_does_not_fail_the_others(gmwm, recording, tmp_path):
    lines = recording.read_text(encoding="utf-8").splitlines()
    place = next(k for k, name in enumerate(lines[0].split(",")) if name.startswith("gyro_z"))
    rows = [line.split(",") for line in lines]
    for row in rows[1:]:
        row[place] = "0.0"
    dead = tmp_path / "dead.csv"
    dead.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    outcome = gmwm("calibrate", dead, "--within", "WN + RW", "--json")
    assert "leaves gyro_z out" in outcome.err
    found = outcome.json
    assert set(found["axes"]) == {"gyro_x", "gyro_y", "accel_x", "accel_y", "accel_z"}


@pytest.mark.usefixtures("without_pictures")
def test_all_topics_of_a_file(gmwm, tmp_path):
    rng = np.random.default_rng(1)
    rows = "".join(
        f"{10_000 * k},{sensor},{','.join(map(str, rng.normal(size=3)))},{','.join(map(str, rng.normal(size=3)))}\n"
        for k in range(2000)
        for sensor in (0, 1)
    )
    (tmp_path / "imu.csv").write_text("TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ\n" + rows)
    asked = ("--within", "WN + RW", "--robust", "no", "--all-topics", "--output", tmp_path / "results")
    done = gmwm("calibrate", tmp_path / "imu.csv", *asked, "--json")
    assert done.code == 0
    assert list(done.json["topics"]) == ["I=0", "I=1"]
    for topic in ("I=0", "I=1"):
        assert (tmp_path / "results" / topic / "calibration.json").is_file()
        assert len(done.json["topics"][topic]["axes"]) == 6
        assert (tmp_path / "results" / topic / "summary.txt").read_text().startswith(f"Topic {topic}\n")
    assert gmwm("calibrate", tmp_path / "imu.csv", "--all-topics", "--topic", "I=0").code == 2
