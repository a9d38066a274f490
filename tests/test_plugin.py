"""The package in examples/plugin adds a process, a reader, an exporter, a command and a plot to gmwm."""

import json
import os
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gmwm

PLUGIN = Path(__file__).resolve().parent.parent / "examples" / "plugin"
TRUTH = dict.fromkeys(("gyro", "accel"), "GM(beta=0.05, sigma2=1e-8) + WN(sigma2=1e-7)")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shell(tmp_path_factory):
    """Return a function that runs `gmwm` in a folder with the package installed, and returns its standard output."""
    folder = tmp_path_factory.mktemp("plugin")
    source = shutil.copytree(PLUGIN, folder / "source")
    target = folder / "installed"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", target, source]
    subprocess.run(install, check=True, capture_output=True)
    environment = {**os.environ, "PYTHONPATH": str(target)}

    def run(*words, status=0):
        command = [sys.executable, "-m", "gmwm", *map(str, words)]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        return done.stdout

    gmwm.simulate(TRUTH, rate=20.0, duration=300.0, rng=1).write(folder / "static.csv")
    return run


def test_the_process_is_known_in_the_shell(shell):
    document = json.loads(shell("fit", "static.csv", "--axis", "gyro_x", "--model", "gm2 + WN", "--json"))
    parameters = document["axes"]["gyro_x"]["parameters"]
    assert set(parameters) == {"GM2.beta", "GM2.sigma2", "WN.sigma2"}


def test_the_command_is_listed_and_draws(shell):
    assert "spread" in shell("--help")
    document = json.loads(shell("spread", "static.csv", "--axis", "gyro", "--plot", "spread.svg", "--json"))
    assert set(document["axes"]) == {"gyro_x", "gyro_y", "gyro_z"}


def test_the_reader_recognises_its_files(shell, tmp_path):
    counts = np.random.default_rng(1).integers(-100, 100, (3000, 6)).astype("<i2")
    file = tmp_path / "static.log1"
    file.write_bytes(struct.pack("<4s3f", b"LOG1", 100.0, 1 / 131, 1 / 16384) + counts.tobytes())
    assert json.loads(shell("info", file, "--json"))["rate"] == 100.0


def test_the_exporter_writes(shell):
    axes = ("--axis", "gyro_x", "--axis", "accel_x")
    shell("calibrate", "static.csv", "--within", "WN", *axes, "--output", "results")
    assert "[imu]" in shell("export", "results/calibration.json", "--format", "myfilter")
