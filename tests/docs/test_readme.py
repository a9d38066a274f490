"""The gmwm commands of README run as printed, in their order, on a recording of the reader."""

import os
import subprocess
import sys
from pathlib import Path

from gmwm.simulation import reference_imu, simulate
from tests.docs import pages

README = pages.DOCS.parent / "README.md"


def test_the_commands_of_readme_run(tmp_path):
    simulate(reference_imu(), rate=100.0, duration=600.0, rng=7).write(tmp_path / "static.csv")
    commands = [line for _, language, code in pages.blocks(README) if language == "sh" for line in pages.commands(code)]
    assert len(commands) >= 7
    for command in commands:
        run(command, tmp_path)
    for file in ("results/report.html", "results/fits.json", "imu.yaml", "allan.png"):
        assert (tmp_path / file).exists(), file


def run(command: str, folder: Path) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    settings = {**os.environ, "PATH": path, "MPLBACKEND": "Agg"}
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=settings, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, f"{command}\n{done.stdout[-1000:]}\n{done.stderr[-2000:]}"
