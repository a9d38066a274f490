"""The gmwm commands of README run as printed, in their order, in an empty folder.

What README shows of the demo is held against the demo in tests/cli/test_cli_results.py.
"""

import shlex

import pytest
from typer.testing import CliRunner

from gmwm.cli.main import app
from tests.docs import pages

pytestmark = pytest.mark.docs

README = pages.DOCS.parent / "README.md"


def test_the_commands_of_readme_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    commands = [line for _, language, code in pages.blocks(README) if language == "sh" for line in pages.commands(code)]
    assert len(commands) >= 3
    for command in commands:
        run(command)
    for file in ("results/report.html", "results/calibration.json", "imu.yaml"):
        assert (tmp_path / file).exists(), file


def run(command: str) -> None:
    """Run a command in this process, in the folder that it stands in."""
    program, *arguments = shlex.split(command)
    assert program == "gmwm"
    outcome = CliRunner().invoke(app, arguments, prog_name="gmwm")
    assert outcome.exit_code == 0, f"{command}\n{outcome.output[-3000:]}\n{outcome.exception!r}"
