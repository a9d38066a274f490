"""The gmwm commands of README run as printed, in their order, in an empty folder."""

import shlex

import pytest
from typer.testing import CliRunner

from gmwm.cli.main import app
from tests.docs import pages, shown

pytestmark = pytest.mark.docs

README = pages.DOCS.parent / "README.md"


def test_the_commands_of_readme_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = [line for _, language, code in pages.blocks(README) if language == "sh" for line in pages.commands(code)]
    assert len(commands) >= 3
    for command in commands:
        printed(command)
    for file in ("results/report.html", "results/calibration.json", "imu.yaml"):
        assert (tmp_path / file).exists(), file


def test_readme_shows_what_the_demo_prints(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ((_, _, shows),) = [block for block in pages.fenced(README) if block[1] == "text"]
    assert shown.missing(shows, printed("gmwm demo")) == ""


def printed(command: str) -> str:
    """What a command prints, run in this process and in the folder that it stands in."""
    program, *arguments = shlex.split(command)
    assert program == "gmwm"
    outcome = CliRunner().invoke(app, arguments, prog_name="gmwm")
    assert outcome.exit_code == 0, f"{command}\n{outcome.output[-3000:]}\n{outcome.exception!r}"
    return outcome.stdout
