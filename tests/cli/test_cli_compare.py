"""`gmwm compare`, and --robust of the other commands."""

import numpy as np
import pytest

import gmwm as library
from gmwm.files.readers import read
from gmwm.theory.simulation import simulate


@pytest.mark.slow
def test_compare_json_is_the_library_s(gmwm, recording):
    content = gmwm("compare", recording, "--axis", "gyro_y", "--json").json
    signal = read(recording)["gyro_y"]
    assert list(content["axes"]["gyro_y"]) == ["classical", "robust"]
    assert content["axes"]["gyro_y"]["classical"] == library.wavelet_variance(signal).to_dict()
    assert content["axes"]["gyro_y"]["robust"] == library.wavelet_variance(signal, robust=True).to_dict()


@pytest.mark.slow
def test_compare_prints_the_curves(gmwm, recording):
    outcome = gmwm("compare", recording, "--axis", "gyro_x", "--efficiency", "0.9")
    signal = read(recording)["gyro_x"]
    assert outcome.code == 0
    for wv in (
        library.wavelet_variance(signal),
        library.wavelet_variance(signal, robust=True, efficiency=0.9),
    ):
        assert all(f"{value:.4e}" in outcome.out for value in wv.variance)


@pytest.mark.slow
@pytest.mark.parametrize("extra", [[], ["--axis", "gyro_x"], ["--axis", "accel", "--view", "allan", "--datasheet"]])
def test_compare_plot(gmwm, recording, tmp_path, extra):
    target = tmp_path / "compare.png"
    outcome = gmwm("compare", recording, "--plot", target, *extra)
    assert outcome.code == 0
    assert str(target) in outcome.out
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_compare_recordings(gmwm, recording, tmp_path):
    other = tmp_path / "the_other_recording.csv"
    simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=5000, rng=9).write(other)
    both = gmwm("compare", recording, other, "--axis", "gyro_x", "--robust", "--json").json
    assert list(both["axes"]["gyro_x"]) == ["six", "the_other_recording"]
    assert all(wv["robust"] for wv in both["axes"]["gyro_x"].values())
    four = gmwm("compare", recording, other, "--axis", "gyro_x", "--plot", tmp_path / "x.svg")
    assert "six, classical" in four.out
    assert "the_other_recording, robust" in four.out
    assert max(len(line) for line in four.out.splitlines() if "x.svg" not in line) <= 80
    assert (tmp_path / "x.svg").exists()


def test_compare_needs_different_files(gmwm, recording):
    gmwm("compare", recording, recording).require_refusal(f"{recording}, {recording}")


@pytest.fixture(scope="module")
def coarse(tmp_path_factory):
    """One gyroscope axis in steps of three standard deviations."""
    path = tmp_path_factory.mktemp("coarse") / "coarse.csv"
    values = 1e-3 * np.round(np.random.default_rng(1).normal(0, 0.3, size=20_000))
    library.Imu.from_arrays({"gyro_x": values}, 100.0).write(path)
    return path


@pytest.mark.slow
def test_wv_robust(gmwm, recording):
    content = gmwm("wv", recording, "--axis", "accel_x", "--robust", "--efficiency", "0.8", "--json").json
    expected = library.wavelet_variance(read(recording)["accel_x"], robust=True, efficiency=0.8)
    assert content["axes"]["accel_x"] == expected.to_dict()
    assert "robust with efficiency 0.6" in gmwm("wv", recording, "--axis", "accel_x", "--robust").out


@pytest.mark.slow
def test_zeros_are_remarked(gmwm, coarse):
    outcome = gmwm("wv", coarse, "--robust", "--json")
    assert outcome.json["axes"]["gyro_x"]["variance"][0] == 0
    (remark,) = (one for one in outcome.json["remarks"] if one["code"] == "robust-too-large")
    assert remark["subject"] == "gyro_x"
    assert 1 in remark["facts"]["levels"]
    assert f"warning: {remark['text']} [robust-too-large]" in outcome.err.splitlines()
    assert "[robust-too-large]" in gmwm("compare", coarse).err
    gmwm("fit", coarse, "--model", "WN", "--robust").require_refusal("error: gyro_x: ", "level 1")


@pytest.mark.slow
def test_fit_robust(gmwm, recording):
    content = gmwm("fit", recording, "--axis", "gyro_z", "--model", "WN + RW", "--robust", "--json").json
    found = library.fit("WN + RW", read(recording)["gyro_z"], robust=True)
    assert content["axes"]["gyro_z"]["parameters"] == dict(found.parameters)
    assert content["axes"]["gyro_z"]["wavelet_variance"]["robust"] is True
    assert "robust" in gmwm("fit", recording, "--axis", "gyro", "--model", "WN + RW", "--robust").out


@pytest.mark.parametrize(
    "arguments",
    [
        ("wv", "--efficiency", "0.8"),
        ("fit", "--model", "WN", "--efficiency", "0.8"),
        ("compare", "--classical", "--efficiency", "0.8"),
        ("wv", "--robust", "--efficiency", "1.5"),
    ],
)
def test_efficiency_that_cannot_be(gmwm, recording, arguments):
    command, *rest = arguments
    gmwm(command, recording, *rest).require_refusal("efficiency")
