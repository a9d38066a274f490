"""README's commands of gmwm run as printed, in their order, with the recordings that its reader would have."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from gmwm.simulation import reference_imu, simulate
from tests.docs import pages

README = pages.DOCS.parent / "README.md"


def test_the_commands_of_readme_run(tmp_path):
    # What is his: a recording, another of the same unit, a log that no longer grows, a folder with two units.
    simulate(reference_imu(), rate=100.0, duration=600.0, rng=7).write(tmp_path / "static.csv")
    shutil.copy(tmp_path / "static.csv", tmp_path / "log.csv")
    (tmp_path / "recordings").mkdir()
    for seed, day in enumerate(("monday", "tuesday")):
        simulate(reference_imu(), rate=100.0, duration=300.0, rng=seed).write(tmp_path / f"recordings/{day}.csv")
        run(f"gmwm calibrate recordings/{day}.csv --within 'GM + WN + RW' --output {day}", tmp_path)
    commands = [line for _, language, code in pages.blocks(README) if language == "sh" for line in pages.commands(code)]
    assert len(commands) > 15
    for command in commands:
        # A watch ends with Ctrl-C; nobody is here to press it.
        run(f"{command} --idle 1s" if command.startswith("gmwm watch") else command, tmp_path)
    for file in (
        "results/report.html",
        "results/fits.json",
        "plan.png",
        "exported",
        "bias.csv",
        "results/fleet.parquet",
    ):
        assert (tmp_path / file).exists(), file


def run(command: str, folder: Path) -> None:
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    settings = {**os.environ, "PATH": path, "MPLBACKEND": "Agg"}
    done = subprocess.run(["bash", "-c", command], cwd=folder, env=settings, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, f"{command}\n{done.stdout[-1000:]}\n{done.stderr[-2000:]}"
