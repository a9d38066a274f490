"""`gmwm export`: what the library writes, printed or in files."""

import json

import pytest

import gmwm as library
from gmwm import Calibration
from gmwm.showing.exporters import export_formats


@pytest.fixture(scope="module")
def file(calibrated):
    return calibrated[0] / "calibration.json"


@pytest.mark.slow
def test_calibrate_writes_imu_yaml(file):
    text = (file.parent / "imu.yaml").read_text(encoding="utf-8")
    assert text == Calibration.load(file).export(format="kalibr")


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_calibrate_of_one_sensor_writes_none(gmwm, recording, tmp_path):
    outcome = gmwm("calibrate", recording, "--within", "WN + RW", "--axis", "gyro", "--output", tmp_path)
    assert outcome.code == 0
    assert "imu.yaml" not in outcome.out + outcome.err
    assert not (tmp_path / "imu.yaml").exists()


@pytest.mark.slow
def test_it_prints_the_library_s_text(gmwm, file):
    outcome = gmwm(
        "export", file, "--format", "vins", "--inflation", 2, "--horizon", "3s", "--rate", 50, "--axes", "mean"
    )
    found = Calibration.load(file)
    assert outcome.code == 0
    assert outcome.out == found.export(format="vins", inflation=2.0, horizon=3.0, rate=50.0, axes="mean")
    assert gmwm("export", file).out == gmwm("export", file.parent).out == found.export()


@pytest.mark.slow
def test_it_writes_a_file_and_says_so(gmwm, file, tmp_path):
    target = tmp_path / "noise.m"
    outcome = gmwm("export", file, "--format", "matlab", "--output", target)
    assert outcome.code == 0
    assert str(target) in outcome.out
    assert target.read_text(encoding="utf-8") == Calibration.load(file).export(format="matlab")


@pytest.mark.slow
def test_all_writes_every_format(gmwm, file, tmp_path):
    folder = tmp_path / "new" / "exported"
    outcome = gmwm("export", file, "--all", folder, "--json")
    assert outcome.code == 0
    assert len(outcome.json["written"]) == len(list(folder.iterdir())) == len(export_formats())


@pytest.mark.slow
def test_json_has_the_text(gmwm, file):
    content = gmwm("export", file, "--format", "kalibr", "--json").json
    assert content["command"] == "export"
    assert content["text"] == Calibration.load(file).export()
    assert content["written"] == []


@pytest.mark.slow
def test_errors_take_one_line(gmwm, file, tmp_path):
    gyro = tmp_path / "gyro.json"
    found = Calibration.load(file)
    axes = {axis: one for axis, one in found.axes.items() if axis.startswith("gyro")}
    Calibration(axes=axes, failed={}, settings=found.settings).save(gyro)
    for arguments, said in (
        ((file, "--format", "kalib"), "must be one of"),
        ((file, "--all", tmp_path, "--format", "kalibr"), "Leave --format and --output out"),
        ((file, "--all", file), "must be a directory"),
        ((file, "--inflation", 0), "--inflation must be"),
        ((file, "--format", "csv", "--horizon", 2), "--horizon must be left out"),
        ((file, "--format", "kalibr", "--axes", "each"), "--axes must be 'worst' or 'mean'"),
        ((gyro,), "kalibr"),
        ((tmp_path / "none.json",), "none.json does not exist"),
    ):
        gmwm("export", *arguments).require_refusal(said)
    outcome = gmwm("export", gyro, "--all", tmp_path / "some")
    assert outcome.code == 0
    assert outcome.err.count("\n") == 1
    assert outcome.err.endswith("[format-not-written]\n")
    assert "needs gyroscopes and accelerometers" in outcome.err
    assert "ros.yaml" in outcome.out
    count = len(list((tmp_path / "some").iterdir()))
    assert outcome.out.splitlines()[-1] == f"Wrote {count} of {len(export_formats())} formats."
    content = gmwm("export", gyro, "--all", tmp_path / "some", "--json").json
    assert len(content["left_out"]) == len(export_formats()) - count
    assert content["left_out"]["kalibr"].startswith("the format needs")


def test_state_space_takes_the_fits_of_gmwm_fit(gmwm, tmp_path):
    noise = library.simulate({"gyro_x": "WN(sigma2=1e-6) + RW(gamma2=1e-10)"}, rate=100.0, samples=5000, rng=1)
    fit = library.fit("WN + RW", noise["gyro_x"])
    content = {"command": "fit", "file": "x.csv", "axes": {"gyro_x": fit.to_dict()}}
    (tmp_path / "fits.json").write_text(json.dumps(content))
    outcome = gmwm("export", tmp_path / "fits.json", "--format", "state-space-json", "--rate", 50)
    assert outcome.code == 0, outcome.err
    found = json.loads(outcome.out)
    assert "Recording: x.csv, 5000 samples" in " ".join(found["gmwm"])
    space = fit.model.continuous(100.0).discrete(50.0)
    assert found["axes"]["gyro_x"]["rate"] == 50.0
    assert found["axes"]["gyro_x"]["Q"] == space.Q.tolist()
    assert found["axes"]["gyro_x"]["R"] == space.R.tolist()
    for name in ("state-space", "state-space-matlab", "state-space-cpp"):
        assert "gyro_x" in gmwm("export", tmp_path, "--format", name).out
    for wrong in (["--format", "kalibr"], ["--all", tmp_path / "all"]):
        refused = gmwm("export", tmp_path / "fits.json", *wrong)
        assert refused.code != 0
        assert "as state space" in refused.err
