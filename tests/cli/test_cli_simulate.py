"""gmwm simulate with its latent processes, and the picture of a recording."""

import numpy as np
import pytest

from gmwm.files.readers import read

MODEL = ("--model", "gyro_x=2*GM(beta=1, sigma2=1e-8) + WN(sigma2=1e-6)", "--model", "accel_z=WN(sigma2=1e-4)")


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_latent_processes_are_written_beside_the_recording(gmwm, tmp_path, suffix):
    target, parts = tmp_path / f"imu{suffix}", tmp_path / f"parts{suffix}"
    options = (*MODEL, "--duration", 2, "--seed", 3)
    outcome = gmwm("simulate", *options, "--output", target, "--components", parts, "--json")
    terms = ["gyro_x GM[1] [rad/s]", "gyro_x GM[2] [rad/s]", "gyro_x WN [rad/s]"]
    assert outcome.json["components"] == {"file": str(parts), "columns": [*terms, "accel_z WN [m/s²]"]}
    whole = read(target)["gyro_x"].values
    assert np.array_equal(sum(read(parts, columns={"gyro_x": term})["gyro_x"].values for term in terms), whole)
    alone = tmp_path / f"alone{suffix}"
    assert gmwm("simulate", *options, "--output", alone, "--json").json["components"] is None
    assert alone.read_bytes() == target.read_bytes()


def test_the_text_names_the_file_of_processes(gmwm, tmp_path):
    parts = tmp_path / "parts.csv"
    says = gmwm("simulate", *MODEL, "--duration", 2, "-o", tmp_path / "imu.csv", "--components", parts).out
    assert f"Wrote {parts}: 4 columns" in says


@pytest.mark.parametrize("name", ["imu.csv", "parts.txt"])
def test_output_files_are_checked_before_any_is_written(gmwm, tmp_path, name):
    options = ("--output", tmp_path / "imu.csv", "--components", tmp_path / name)
    gmwm("simulate", *MODEL, "--duration", 2, *options).require_refusal(name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("length", ["90", "90s", "1.5min", "1 min 30 s"])
def test_a_duration_has_units_or_is_in_seconds(gmwm, tmp_path, length):
    found = gmwm("simulate", *MODEL, "--duration", length, "--output", tmp_path / "imu.csv", "--json").json
    assert (found["duration"], found["samples"]) == (90.0, 9000)


@pytest.mark.slow
def test_info_draws_the_recording(gmwm, recording, tmp_path):
    path = tmp_path / "recording.png"
    outcome = gmwm("info", recording, "--plot", path)
    assert outcome.code == 0
    assert str(path) in outcome.out
    assert path.read_bytes().startswith(b"\x89PNG")
    assert "axes" in gmwm("info", recording, "--plot", path, "--json").json
