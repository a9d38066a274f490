"""The command as a program: pipes, signals, terminals, start-up."""

import json
import os
import signal
import subprocess
import sys

import pytest
from rich.text import Text
from typer.main import get_command

import gmwm as library
from gmwm.cli.main import NAMES, accept_all_characters, app
from gmwm.theory.processes import registry
from tests.helpers import each

pytestmark = pytest.mark.slow

POSIX = pytest.mark.skipif(os.name != "posix", reason="needs POSIX pipes and signals")


def start(*arguments, **options):
    command = [sys.executable, "-m", "gmwm", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def run(*arguments, **options):
    process = start(*arguments, text=True, encoding="utf-8", **options)
    out, err = process.communicate(timeout=120)
    return process.returncode, out, err


def test_version():
    assert run("--version") == (0, f"gmwm {library.__version__}\n", "")


@pytest.mark.parametrize("arguments", [[], ["--help"], ["-h"]])
def test_help_names_every_command(gmwm, arguments):
    outcome = gmwm(*arguments)
    assert (outcome.code, outcome.err) == (0, "")
    assert all(name in outcome.out for name in ("calibrate", "info", "wv", "fit", "select", "simulate", "demo"))
    assert "\x1b" not in outcome.out


COMMANDS = get_command(app).commands


@pytest.mark.parametrize("command", COMMANDS)
def test_help_of_a_command_fits_eighty_columns(command, gmwm, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    outcome = gmwm(command, "--help")
    assert outcome.code == 0
    assert "--json" in outcome.out
    lines = outcome.out.splitlines()
    assert max(map(len, lines)) <= 80
    # An example that is broken in two cannot be pasted.
    _, *examples = COMMANDS[command].epilog.split("\n\n")
    assert examples
    for example in examples:
        assert f"gmwm {command}" in example
        assert example in [line.strip() for line in lines]


@each("command", COMMANDS)
def test_help_texts_contain_no_markup(command):
    found = COMMANDS[command]
    texts = [found.help, found.epilog, *(parameter.help for parameter in found.params)]
    assert all(texts)
    for text in texts:
        assert Text.from_markup(text).plain == text.replace(r"\[", "[")


def test_help_shows_brackets(gmwm):
    assert "'gyro_x WN [rad/s]'" in " ".join(gmwm("simulate", "--help").out.replace("│", " ").split())


def test_help_of_fit_knows_every_process(gmwm):
    words = " ".join(gmwm("fit", "--help").out.replace("│", " ").split())
    for name, process in registry.items():
        assert f"{name} {process.title}" in words


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        (["gmwm.cli.main"], ["numpy", "gmwm.calibration", "gmwm.cli.calibrate"]),
        (
            [f"gmwm.cli.{name}" for name in NAMES],
            ["polars", "matplotlib", "scipy.optimize", "scipy.stats", "scipy.signal", "rich.progress", "dash"],
        ),
    ],
)
def test_start_up_is_light(modules, heavy):
    code = f"import sys, {', '.join(modules)}; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_spared_parts_of_libraries_can_be_used():
    code = """
from gmwm.cli.command import _spare_libraries
_spare_libraries()
import numpy, scipy.signal, scipy.stats
print(numpy.ma.masked_equal([1, 2], 2).sum(), scipy.stats.ttest_1samp([1.0, 3.0], 2.0).pvalue)
print(scipy.signal.lfilter([1.0], [1.0, -0.5], [1.0, 0.0]), scipy.spatial.KDTree([[0.0], [1.0]]).query([0.8])[1])
"""
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert process.stdout == "1 1.0\n[1.  0.5] 1\n"


def test_json_stands_alone_on_stdout(recording, forks, tmp_path):
    code, out, err = forks.run(
        "tests.forked:gmwm", "fit", str(recording), "--model", "WN + QN", "--json", folder=tmp_path
    )
    assert code == 0
    assert json.loads(out)["command"] == "fit"
    assert all(line.startswith("warning: ") for line in err.splitlines())


def test_tables_in_a_pipe_are_plain_and_narrow(recording, forks, tmp_path):
    words = ("fit", str(recording), "--model", "2*GM + WN + RW")
    code, out, err = forks.run("tests.forked:gmwm", *words, folder=tmp_path, COLUMNS="40")
    assert (code, err) == (0, "")
    assert "\x1b" not in out
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 80


@pytest.fixture
def in_a_code_page(forks, tmp_path):
    """A function that runs the command with streams in a code page, and returns what they got."""

    def run(*arguments, **asked):
        files = [tmp_path / name for name in ("stdout", "stderr")]
        environment = {"PYTHONIOENCODING": "", "PYTHONUTF8": "", **asked}
        words = ("tests.forked:gmwm_in_a_code_page", *map(str, arguments))
        assert forks.write_to([str(file) for file in files], *words, folder=tmp_path, **environment) == 0
        out, err = (file.read_bytes() for file in files)
        for file in files:
            file.unlink()
        return out, err

    return run


def test_pipes_and_files_are_utf_8_on_every_system(recording, in_a_code_page):
    table, _ = in_a_code_page("calibrate", recording, "--axis", "gyro_x", "--within", "WN + RW")
    assert "deg/√h" in table.decode("utf-8")
    result, warnings = in_a_code_page("wv", recording, "--skip", "1s-2s", "--json")
    assert json.loads(result.decode("utf-8"))["command"] == "wv"
    assert warnings.decode("utf-8").startswith("warning: ")


@pytest.mark.parametrize("asked", [{"PYTHONIOENCODING": "cp1252"}, {"PYTHONUTF8": "0"}], ids=str)
def test_an_encoding_that_is_asked_for_stays_and_json_is_whole_in_it(recording, in_a_code_page, asked):
    table, _ = in_a_code_page("fit", recording, "--axis", "gyro_x", "--model", "WN", **asked)
    assert "²".encode("cp1252") in table
    result, _ = in_a_code_page("fit", recording, "--axis", "gyro_x", "--model", "WN", "--json", **asked)
    assert result.isascii()
    assert "(rad/s)²" in json.loads(result)["axes"]["gyro_x"]["units"].values()


@POSIX
def test_a_terminal_keeps_its_encoding():
    leader, follower = os.openpty()
    try:
        with open(follower, "w", encoding="ascii") as terminal:
            accept_all_characters(terminal)
            terminal.write("σ²")
        assert (terminal.encoding, os.read(leader, 8)) == ("ascii", b"??")
    finally:
        os.close(leader)


def test_an_ascii_terminal_is_no_obstacle(recording):
    code, out, err = run("fit", recording, "--model", "WN", env={**os.environ, "PYTHONIOENCODING": "ascii"})
    assert (code, err) == (0, "")
    assert "WN.sigma2" in out


def test_an_error_is_no_traceback(folder):
    code, out, err = run("info", folder / "none.csv")
    assert (code, out) == (2, "")
    assert err.startswith("error: ")
    assert err.count("\n") == 1


@POSIX
def test_a_closed_pipe_ends_quietly(recording):
    process = start("wv", "--json", recording)
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert process.stderr.read() == b""
    process.stderr.close()
    assert process.wait(timeout=300) == 0


@POSIX
@pytest.mark.parametrize("after", [b"Simulated", b"accel_z"])  # the demo prints the inspection before the calibration
def test_ctrl_c(tmp_path, after):
    def let_signals_in():
        signal.signal(signal.SIGINT, signal.default_int_handler)

    process = start(
        "demo", "--output", tmp_path, env={**os.environ, "PYTHONUNBUFFERED": "1"}, preexec_fn=let_signals_in
    )
    assert process.stdout is not None
    assert any(after in line for line in iter(process.stdout.readline, b""))
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=300)
    assert (process.returncode, err) == (130, b"interrupted\n")
    assert b"Calibration of" not in out
    assert [path.name for path in tmp_path.iterdir()] == ["imu.csv"]
