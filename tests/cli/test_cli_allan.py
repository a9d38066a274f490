"""gmwm allan: the library's numbers, in every form, and what it refuses."""

import csv

import numpy as np
import pytest

from gmwm.files.readers import read
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance, total_variance
from gmwm.measuring.variance.allan_regression import avlr

KINDS = {
    "overlapping": allan_variance,
    "nonoverlapping": lambda x: allan_variance(x, kind="nonoverlapping"),
    "modified": lambda x: allan_variance(x, kind="modified"),
    "hadamard": hadamard_variance,
    "nonoverlapping-hadamard": lambda x: hadamard_variance(x, kind="nonoverlapping"),
    "total": total_variance,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_json_is_the_library_s(gmwm, recording, kind):
    content = gmwm("allan", recording, "--kind", kind, "--axis", "gyro_y", "--json").json
    assert content["axes"]["gyro_y"] == KINDS[kind](read(recording)["gyro_y"]).to_dict()
    assert content["kind"] == kind


@pytest.mark.slow
def test_table_and_csv(gmwm, recording, tmp_path):
    target = tmp_path / "allan.csv"
    outcome = gmwm("allan", recording, "--csv", target, "--datasheet")
    assert outcome.code == 0
    assert "Overlapping Allan deviation (deg/h)" in outcome.out
    with target.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    expected = allan_variance(read(recording)["accel_z"])
    mine = [row for row in rows if row["axis"] == "accel_z"]
    assert [float(row["deviation"]) for row in mine] == expected.deviation.tolist()
    assert [float(row["tau_s"]) for row in mine] == expected.tau.tolist()
    assert [row["noise"] for row in mine] == list(expected.noise)
    first = allan_variance(read(recording)["gyro_x"]).deviation[0]
    assert f"{np.degrees(first) * 3600:#.5g}" in outcome.out


@pytest.mark.slow
def test_slopes(gmwm, recording, tmp_path):
    target = tmp_path / "slopes.png"
    outcome = gmwm("allan", recording, "--axis", "gyro_x", "--slopes", "--plot", target, "--datasheet")
    found = avlr(read(recording)["gyro_x"])
    assert found.summary("datasheet") in outcome.out
    assert target.read_bytes().startswith(b"\x89PNG")
    content = gmwm("allan", recording, "--axis", "gyro_x", "--slopes", "--json").json
    assert content["slopes"]["gyro_x"]["lines"] == found.to_dict()["lines"]


def test_all_cluster_sizes_say_their_cost_first_and_show_octaves(gmwm, unlabelled):
    outcome = gmwm("allan", unlabelled, "--rate", 100, "--units", "gyro=rad/s", "--clusters", "all")
    assert outcome.code == 0
    assert outcome.err.splitlines()[0].startswith("up to 250 cluster sizes")
    assert "\n250 cluster sizes" in outcome.out
    assert "--csv" in outcome.out
    rows = [line.split() for line in outcome.out.partition("───")[2].splitlines()]
    assert [int(row[0]) for row in rows if row and row[0].isdecimal()] == [2**k for k in range(8)]


@pytest.mark.slow
def test_all_axes_in_one_picture(gmwm, recording, tmp_path):
    target = tmp_path / "allan.svg"
    assert gmwm("allan", recording, "--kind", "total", "--clusters", "decade", "--plot", target).code == 0
    assert target.read_text(encoding="utf-8").startswith("<?xml")


@pytest.mark.slow
def test_what_is_refused(gmwm, recording):
    gmwm("allan", recording, "--kind", "hadamard", "--slopes").require_refusal(
        "--slopes", "hadamard", "--kind overlapping"
    )
    assert gmwm("allan", recording, "--kind", "fancy").code == 2
