"""`gmwm info --noise-against`."""

from dataclasses import replace

import numpy as np
import pytest

import gmwm as package


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    rng = np.random.default_rng(1)
    temperature = np.linspace(20.0, 40.0, 20_000)
    imu = package.Imu.from_arrays({"gyro_x": 1e-3 * np.exp(0.02 * temperature) * rng.normal(size=20_000)}, rate=100)
    path = tmp_path_factory.mktemp("warm") / "warm.csv"
    replace(imu, temperature=temperature).write(path)
    return path


@pytest.mark.slow
def test_the_table_follows_the_inspection(gmwm, warm):
    shown = gmwm("info", warm, "--noise-against", "temperature")
    assert shown.code == 0
    assert "The noise of gyro_x changes with temperature from 20" in shown.out
    found = gmwm("info", warm, "--noise-against", "temperature", "--json").json["noise_against"]["gyro_x"]
    assert found["terms"]["WN"]["value"] == pytest.approx(0.02, abs=4 * found["terms"]["WN"]["error"])


@pytest.mark.slow
def test_a_recording_without_a_temperature_has_time(gmwm, recording):
    failed = gmwm("info", recording, "--noise-against", "temperature")
    assert failed.code != 0
    assert "--noise-against time" in failed.err
    assert gmwm("info", recording, "--noise-against", "time").out.count("with time from 0") == 6


@pytest.mark.slow
def test_without_the_option_nothing_is_tested(gmwm, warm):
    assert "noise_against" not in gmwm("info", warm, "--json").json
