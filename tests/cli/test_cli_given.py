"""Noise without a recording, in every command that accepts it."""

import json
import re

import pytest

from gmwm.files.importers import given_noise

DATASHEET = "gyro: N=0.15deg/√h, B=3deg/h over 100s; accel: N=60µg/√Hz, B=20µg"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    from gmwm.showing.exporters.given import given_calibration

    path = tmp_path_factory.mktemp("given") / "imu.yaml"
    path.write_text(given_calibration(given_noise(DATASHEET, 200.0)).export(), encoding="utf-8")
    return path


@pytest.mark.slow
def test_export_of_a_datasheet_and_of_its_file(gmwm, file, tmp_path):
    text = gmwm("export", "--from", DATASHEET, "--rate", "200", "--format", "kalibr").out
    assert text == file.read_text(encoding="utf-8")
    again = gmwm("export", "--from", file, "--format", "kfgins")
    assert again.code == 0
    # The Gauss-Markov state of this format takes the place of a random walk, with N fitted beside it.
    assert float(re.search(r"arw: \[([^,]+),", again.out)[1]) == pytest.approx(0.15, rel=5e-3)
    outcome = gmwm("export", "--from", DATASHEET, "--rate", "200", "--format", "kfgins")
    assert outcome.code == 0
    assert gmwm("export", "--from", file, "--all", tmp_path / "all").code == 0
    assert (tmp_path / "all" / "px4.params").is_file()


@pytest.mark.slow
def test_plan_takes_the_axis_or_the_only_model(gmwm, file):
    found = gmwm(
        "plan", "--from", "gyro: N=0.15deg/√h, K=2deg/h/√h", "--rate", "100", "--duration", "2h", "--json"
    ).json
    assert found["axis"] == "gyro_x"
    assert gmwm("plan", "--from", file, "--axis", "accel_y", "--duration", "1h").code == 0
    outcome = gmwm("plan", "--from", file, "--duration", "1h")
    assert (outcome.code, "--axis" in outcome.err) == (2, True)


def test_simulate_and_monitor(gmwm, file, tmp_path):
    out = tmp_path / "rest.csv"
    made = gmwm("simulate", "--from", file, "--duration", "20s", "-o", out, "--json").json
    assert made["rate"] == 200.0
    assert made["axes"]["gyro_x"]["model"] == str(given_noise(file).models["gyro_x"])
    assert (
        gmwm("simulate", "--from", "gyro: N=0.15deg/√h", "--duration", "20s", "-o", tmp_path / "b.csv", "--json").json[
            "rate"
        ]
        == 100.0
    )
    watched = gmwm("monitor", out, "--from", file)
    assert watched.code == 0
    assert "no event" in watched.out


def test_budget(gmwm, file):
    found = gmwm("budget", file, "--duration", "10s", "--json").json
    assert set(found["growth"]) >= {"tilt_x", "position_y"}
    text = gmwm("budget", DATASHEET, "--rate", "200", "--duration", "10s", "--against", file).out
    assert "ratio" in text
    assert json.dumps(found)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["export"], "CALIBRATION"),
        (["export", "{file}", "--from", "{file}"], "--from"),
        (["export", "--from", "nothing.yaml"], "--from"),
        (["export", "--from", "gyro: N=0.15deg/√h; accel: N=60µg/√Hz", "--rate", "100"], "random walk"),
        (["export", "--from", "gyro: N=0.15deg/√h"], "--rate"),
        (["plan", "--from", "{file}", "--from-fits", "{file}", "--duration", "1h"], "--from-fits"),
        (["simulate", "--from", "{file}", "--reference", "--duration", "1s", "-o", "x.csv"], "--from"),
        (["monitor", "{file}"], "--from"),
        (["budget", "gyro: N=0.15", "--rate", "100", "--duration", "60s"], "SOURCE"),
    ],
)
def test_errors_are_one_line(gmwm, file, arguments, said):
    gmwm(*[part.format(file=file) for part in arguments]).require_refusal(said)
