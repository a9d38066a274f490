"""The list of systems, and what is said of a run: `release/systems.py`."""

import re
import shlex
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from release import systems
from release.systems import System
from tests.helpers import each, tomllib

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def output(tmp_path, monkeypatch):
    monkeypatch.setattr(systems, "OUTPUT", tmp_path)
    return tmp_path


def stands_in(output, monkeypatch, code, name="here"):
    """A system whose only command is this Python with this code."""
    system = System(name=name, needs=(sys.executable,), compiler=(sys.executable,))
    monkeypatch.setattr(System, "commands", lambda _: [[sys.executable, "-c", code]])
    monkeypatch.setattr(systems, "SYSTEMS", (system, System(name="gone", needs=("no-such-compiler",))))
    return system


def test_names_of_systems_differ_and_each_can_be_chosen():
    names = [system.name for system in systems.SYSTEMS]
    assert len(set(names)) == len(names)
    assert [system.name for system in systems.chosen(names[::-1])] == names[::-1]
    with pytest.raises(SystemExit, match="unknown systems: g\\+\\+-3"):
        systems.chosen(["g++-3"])


@each("system", systems.SYSTEMS)
def test_each_system_builds_in_a_folder_of_its_own_and_runs_tests(system):
    version, first, *_, last = system.commands()
    assert version[-1] == "--version"
    assert str(systems.OUTPUT / system.name) in first
    if system.compiler:
        assert ("--no-tests=error" in last or "tests.fuzz.kernels" in last) == system.runs
        assert ("-DGMWM_PYTHON=ON" if system.libraries else "-DGMWM_TESTS=ON") in first
    else:
        assert "pytest" in last


def test_the_systems_that_ci_names_are_there():
    content = YAML(typ="safe", pure=True).load((ROOT / ".github" / "workflows" / "ci.yml").read_text(encoding="utf-8"))
    named = [
        name for row in content["jobs"]["systems"]["strategy"]["matrix"]["include"] for name in row["systems"].split()
    ]
    assert len(systems.chosen(named)) == len(named) > 8
    # The oldest compiler that CMakeLists.txt accepts.
    oldest = re.search(
        r"CMAKE_CXX_COMPILER_VERSION VERSION_LESS (\d+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8")
    )
    assert f"g++-{oldest[1]}" in named


def test_a_program_that_only_says_that_it_is_not_there_is_missing(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    for name, status in (("real", 0), ("shim", 127)):
        (tmp_path / name).write_text(f"#!/bin/sh\nexit {status}\n", encoding="utf-8")
        (tmp_path / name).chmod(0o755)
    assert System(name="", needs=("real", "shim", str(tmp_path), "-m re", "-m no_such_module")).missing() == [
        "shim",
        "-m no_such_module",
    ]


def test_every_supported_python_is_a_system():
    with (ROOT / "pyproject.toml").open("rb") as file:
        built = tomllib.load(file)["tool"]["cibuildwheel"]["build"].split()
    pythons = [system.needs[0] for system in systems.SYSTEMS if not system.compiler]
    assert [f"cp{name.removeprefix('python').replace('.', '')}-*" for name in pythons] == built


def test_the_fast_tests_are_those_of_make_quick():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert f'$(PYTEST) {shlex.join(systems.PYTHON_TESTS[2:4])} "{systems.PYTHON_TESTS[4]}"' in makefile


@pytest.mark.parametrize(
    ("log", "count"),
    [
        ("100% tests passed, 0 tests failed out of 19", "100% tests passed, 0 tests failed out of 19"),
        ("100% tests passed out of 19\n\nTotal Test time", "100% tests passed out of 19"),
        ("===== 1 failed, 4 passed, 2 skipped in 3.21s =====", "1 failed, 4 passed, 2 skipped in 3.21s"),
        ("4312 passed, 2 skipped in 321.50s (0:05:21)", "4312 passed, 2 skipped in 321.50s (0:05:21)"),
        ("89% tests passed, 2 tests failed out of 19", "89% tests passed, 2 tests failed out of 19"),
        ("error: no such header", None),
    ],
)
def test_the_count_of_tests_is_read_from_the_log(log, count):
    assert systems.counted(f"$ a command\n{log}\n") == count


def test_a_system_that_is_not_here_is_listed_and_fails_only_if_it_is_named(output, monkeypatch, capsys):
    stands_in(output, monkeypatch, "print('100% tests passed out of 3')")
    assert systems.main([]) == 0
    assert "100% tests passed out of 3" in (output / "here.log").read_text(encoding="utf-8")
    here, gone = (output / "summary.txt").read_text(encoding="utf-8").splitlines()
    assert here.split()[:2] == ["here", "passed"]
    assert gone.split()[:2] == ["gone", "-"]
    assert "no-such-compiler" in gone
    assert systems.main(["gone"]) == 1


@pytest.mark.parametrize("code", ["print('100% tests passed out of 3'); raise SystemExit(1)", "print('built')"])
def test_a_command_that_fails_or_runs_no_test_is_a_failure(output, monkeypatch, capsys, code):
    stands_in(output, monkeypatch, code)
    assert systems.main([]) == 1
    assert "FAILED" in (output / "summary.txt").read_text(encoding="utf-8")
