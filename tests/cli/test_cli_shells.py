"""Completion in shells, and the manual page."""

import re

import pytest

from gmwm.cli.main import NAMES
from gmwm.showing.exporters import export_formats


@pytest.fixture
def completed(forks, tmp_path):
    """A function: what a shell proposes for the last word of a line."""

    def proposed(shell, line):
        words = line.split(" ")
        variables = {
            "_GMWM_COMPLETE": f"complete_{shell}", "_TYPER_COMPLETE_ARGS": line, "COMP_WORDS": line,
            "COMP_CWORD": str(len(words) - 1), "_TYPER_COMPLETE_WORD_TO_COMPLETE": words[-1],
            "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        }  # fmt: skip
        done = forks.run("tests.forked:gmwm", folder=tmp_path, **variables)
        assert done.stderr == ""
        return done.stdout

    return proposed


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish", "powershell"])
def test_a_shell_completes_commands_and_options(completed, shell):
    proposed = completed(shell, "gmwm ca")
    assert "calibrate" in proposed
    assert "simulate" not in proposed
    assert "keep" in completed(shell, "gmwm calibrate --warmup k")


@pytest.mark.slow
def test_names_of_formats_and_messages_are_completed(completed):
    formats = [name for name in export_formats() if name.startswith("k")]
    assert completed("bash", "gmwm export --format k").split() == formats
    assert "warm-up" in completed("bash", "gmwm explain warm").split()


def test_the_manual_page_has_every_command_and_option(gmwm):
    page = gmwm("--man").out
    assert {line.split()[0] for line in page.splitlines() if line.startswith(".")} == {
        ".TH", ".SH", ".SS", ".PP", ".TP", ".B", ".nf", ".fi",
    }  # fmt: skip
    sections = re.split(r"^\.SS gmwm (\S+)", page, flags=re.MULTILINE)
    assert sections[1::2] == list(NAMES)
    text = dict(zip(sections[1::2], sections[2::2], strict=True))["calibrate"]
    text = re.sub(r"\\f[BIR]|\\", " ", text.replace(r"\-", "-"))
    options = set(re.findall(r"(--[a-z][a-z-]+)", gmwm("calibrate", "--help").out))
    assert options <= set(re.findall(r"(--[a-z][a-z-]+)", text))
