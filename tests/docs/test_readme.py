"""README's commands of gmwm run as printed, in their order, with the recordings that its reader would have."""

import shlex
import shutil

import pytest
from typer.testing import CliRunner

from gmwm.cli.main import app
from gmwm.simulation import reference_imu, simulate
from gmwm.writers import write
from tests.docs import pages

pytestmark = [pytest.mark.docs, pytest.mark.slow]

README = pages.DOCS.parent / "README.md"


def test_the_commands_of_readme_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # What is his: a recording, another of the same unit, a log that no longer grows, a folder with two units.
    write(simulate(reference_imu(), rate=100.0, duration=600.0, seed=7), tmp_path / "static.csv")
    shutil.copy(tmp_path / "static.csv", tmp_path / "log.csv")
    (tmp_path / "recordings").mkdir()
    for seed, day in enumerate(("monday", "tuesday")):
        write(simulate(reference_imu(), rate=100.0, duration=300.0, seed=seed), tmp_path / f"recordings/{day}.csv")
        run(f"gmwm calibrate recordings/{day}.csv --within 'GM + WN + RW' --output {day}")
    commands = [line for _, language, code in pages.blocks(README) if language == "sh" for line in pages.commands(code)]
    assert len(commands) > 15
    for command in commands:
        # A watch ends with Ctrl-C; nobody is here to press it.
        run(f"{command} --idle 1s" if command.startswith("gmwm watch") else command)
    for file in (
        "results/report.html",
        "results/fits.json",
        "plan.png",
        "exported",
        "bias.csv",
        "results/fleet.parquet",
    ):
        assert (tmp_path / file).exists(), file


def run(command: str) -> None:
    """A command, in this process and in the folder that it stands in."""
    program, *arguments = shlex.split(command)
    assert program == "gmwm"
    outcome = CliRunner().invoke(app, arguments, prog_name="gmwm")
    assert outcome.exit_code == 0, f"{command}\n{outcome.output[-3000:]}\n{outcome.exception!r}"
