"""`gmwm agree`: what the library finds in the calibrations of several recordings, printed."""

import json

import pytest

import gmwm as library
from gmwm import Calibration
from gmwm.cli.agree import names_of
from gmwm.files.importers.values import parse_reference
from gmwm.files.readers import read

TRUTH = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("days")
    made = []
    for seed in (1, 2, 3):
        recording = folder / f"day_{seed}.csv"
        library.simulate(TRUTH, rate=100.0, samples=20_000, rng=seed).write(recording)
        target = folder / f"results_{seed}" / "calibration.json"
        target.parent.mkdir()
        library.calibrate(read(recording), "WN + RW").of_file(recording).save(target)
        made.append(target)
    return made


@pytest.mark.slow
def test_it_prints_the_library_s_summary(gmwm, files):
    outcome = gmwm("agree", *files, "--reference", "gyro.N=0.2°/√h", "--size", 0.1)
    found = library.agree([Calibration.load(file) for file in files], size=0.1, reference={"gyro.N": (0.2, "°/√h")})
    assert outcome.code == 0
    assert outcome.out == found.summary() + "\n"
    assert "day_2" in outcome.out


def test_json_is_the_library_s(gmwm, files):
    content = gmwm("agree", *files[:2], "--label", "a", "--label", "b", "--json").json
    found = library.agree([Calibration.load(file) for file in files[:2]], labels=["a", "b"])
    expected = json.loads(json.dumps(found.to_dict()))
    assert content["command"] == "agree"
    assert {name: content[name] for name in expected} == expected
    assert content["files"] == list(map(str, files[:2]))


def test_recordings_without_names_are_called_as_their_files(gmwm, files, tmp_path):
    folders = [tmp_path / name for name in ("monday", "tuesday")]
    for folder, file in zip(folders, files, strict=False):
        folder.mkdir()
        content = json.loads(file.read_text(encoding="utf-8"))
        (folder / "calibration.json").write_text(json.dumps({**content, "source": ""}), encoding="utf-8")
    outcome = gmwm("agree", *(folder / "calibration.json" for folder in folders), "--json")
    assert outcome.json["labels"] == ["monday", "tuesday"]


def test_names_are_as_short_as_possible(tmp_path):
    assert names_of([tmp_path / "a.json", tmp_path / "b.json"]) == ["a", "b"]
    paths = [tmp_path / "x" / "1" / "c.json", tmp_path / "y" / "1" / "c.json"]
    assert names_of(paths) == [str(path) for path in paths]


@pytest.mark.parametrize("text", ["gyro.N=2deg/√h", " gyro.N = 2.0 deg/√h ", "gyro.N=2e0deg/√h"])
def test_references_are_read(text):
    assert parse_reference(text) == ("gyro.N", (2.0, "deg/√h"))


@pytest.mark.slow
def test_a_folder_stands_for_the_calibration_in_it(gmwm, files):
    folders = [file.parent for file in files]
    assert gmwm("agree", *folders).out == gmwm("agree", *files).out


@pytest.mark.slow
def test_errors_take_one_line(gmwm, files, tmp_path):
    none = tmp_path / "none.json"
    broken = tmp_path / "broken.json"
    broken.write_text("{}", encoding="utf-8")
    content = json.loads(files[0].read_text(encoding="utf-8"))
    del content["axes"]["gyro_x"]["fit"]
    cut = tmp_path / "cut.json"
    cut.write_text(json.dumps(content), encoding="utf-8")
    for arguments, facts in (
        ((files[0],), ["one calibration", "--reference"]),
        ((files[0], files[0]), [f"{files[0]}, {files[0]}"]),
        ((files[0], none), [str(none)]),
        ((files[0], broken), [str(broken)]),
        ((files[0], cut), [str(cut), "gyro_x", "'fit'"]),
        ((*files, "--reference", "gyro.N=2.0"), ["--reference", "gyro.N", "2.0"]),
        ((*files, "--reference", "gyro.N"), ["--reference must be ", "'gyro.N'"]),
        ((*files, "--reference", "gyro.N=2,0deg/√h"), ["--reference must be ", "'gyro.N=2,0deg/√h'", " 2.0,"]),
        ((*files, "--reference", "gyro.N=1.2.3deg/√h"), ["--reference must be ", "'gyro.N=1.2.3deg/√h'"]),
        ((*files, "--reference", "gyro.N=2mg"), ["gyro.N", "mg", "deg/√h"]),
        ((*files, "--reference", "gyro.N=2deg/√h", "--reference", "gyro.N=3deg/√h"), ["--reference", "3deg/√h"]),
        ((*files, "--size", 2), ["size", "2"]),
    ):
        gmwm("agree", *arguments).require_refusal(*facts)


@pytest.mark.slow
def test_plan_takes_a_calibration(gmwm, files):
    fit = Calibration.load(files[0])["gyro_x"]
    content = gmwm("plan", "--from-fits", files[0], "--axis", "gyro_x", "--duration", "1d", "--json").json
    assert content["axis"] == "gyro_x"
    assert content["rate"] == 100.0
    assert content["parameters"] == pytest.approx(dict(fit.parameters), rel=1e-12)
    outcome = gmwm("plan", "--from-fits", files[0], "--axis", "gyro_z", "--duration", "1d")
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.startswith("error: --axis must be one of gyro_x")
    assert outcome.err.endswith("; got 'gyro_z'\n")


@pytest.mark.slow
def test_one_calibration_against_a_file(gmwm, tmp_path):
    imu = library.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=20_000, rng=1)
    library.calibrate(imu, within="WN + RW").save(tmp_path / "calibration.json")
    (tmp_path / "old.yaml").write_text("gyr_n: 2.0e-3\ngyr_w: 1.0e-3\nacc_n: 0.02\nacc_w: 1.0e-4\n")
    outcome = gmwm("agree", tmp_path, "--reference", tmp_path / "old.yaml")
    assert outcome.code == 0
    assert "gyr_n 0.002" in outcome.out
    assert "reference larger" in outcome.out
    content = gmwm("agree", tmp_path, "--reference", "gyro.N=0.34deg/√h", "--json").json
    assert content["rows"][0]["ratio"] == pytest.approx(1.0, rel=0.05)
    assert "--reference" in gmwm("agree", tmp_path).err
    assert "gmwm agree" in gmwm("compare", tmp_path / "calibration.json").err
