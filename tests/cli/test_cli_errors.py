"""Every error of a user is one line on stderr with exit code 2, and names the option to change."""

import inspect
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.main import get_command

from gmwm.base.atomic_files import written_together
from gmwm.base.errors import OptionError
from gmwm.base.template import Dialect
from gmwm.cli import main
from gmwm.cli.command import _named_by, _shell_name
from tests.helpers import each

CASES = {
    "no such file": (["info", "{folder}/none.csv"], ["{folder}/none.csv"]),
    "a file whose name looks like an option": (["info", "rate=100/none.csv"], ["error: rate=100/none.csv "]),
    "directory": (["wv", "{folder}"], ["{folder}"]),
    "empty file": (["info", "{empty}"], ["{empty}"]),
    "foreign file": (["info", "{foreign}"], ["{foreign}"]),
    "no command of this name": (["ranking"], ["'ranking'", "gmwm --help"]),
    "no option of this name": (["wv", "{file}", "--bad"], ["--bad", "gmwm wv --help"]),
    "missing file": (["fit", "--model", "WN"], ["'FILE…'", "gmwm fit --help"]),
    "missing model": (["fit", "{file}"], ["'--model'", "gmwm fit --help"]),
    "two units in two options": (
        ["wv", "{unlabelled}", "--units", "gyro=deg/s", "--units", "accel=g"],
        ["--units is given 2 times", "--units gyro=deg/s,accel=g", "gmwm wv --help"],
    ),
    "two rates": (["wv", "{file}", "--rate", "50", "--rate", "100"], ["--rate is given 2 times", "gmwm wv --help"]),
    "rate is no number": (["wv", "{file}", "--rate", "fast"], ["--rate must be ", "; got 'fast'", "gmwm wv --help"]),
    "seed is no number": (["demo", "--seed", "1.5"], ["--seed must be ", "; got '1.5'", "gmwm demo --help"]),
    "rate is negative": (["wv", "{file}", "--rate=-1"], ["--rate must be ", "; got -1"]),
    "rate contradicts the stamps": (["wv", "{file}", "--rate", "50"], ["50 Hz", "100 Hz", "--rate", "--columns time="]),
    "unknown choice": (["fit", "{file}", "-m", "WN", "--weighting", "best"], ["--weighting", "'best'", "'optimal'"]),
    "unknown process": (["fit", "{file}", "-m", "WN + VN"], ["VN"]),
    "empty model": (["fit", "{file}", "-m", ""], ["model"]),
    "too large a model": (["fit", "{file}", "-m", "12*GM"], ["gyro_x"]),
    "nothing to estimate": (["fit", "{file}", "-m", "WN(sigma2=fixed(1.0))", "--axis", "gyro_x"], ["gyro_x"]),
    "unknown axis": (["wv", "{file}", "--axis", "gyro_w"], ["--axis must be ", "gyro_x, ", "; got 'gyro_w'"]),
    "slopes of another variance": (
        ["allan", "{file}", "--kind", "hadamard", "--slopes"],
        ["--slopes", "hadamard", "--kind overlapping"],
    ),
    "nothing left": (["info", "{file}", "--start", "10min"], ["--start", "--stop", "--skip"]),
    "a start without a length": (["info", "{file}", "--start", "later"], ["--start must be ", "; got 'later'"]),
    "stop before start": (["info", "{file}", "--start", "1min", "--stop", "5s"], ["--stop must be ", "60", "; got 5"]),
    "half a skip": (["info", "{file}", "--skip", "20s"], ["--skip must be ", "; got '20s'"]),
    "no rate": (["wv", "{unlabelled}", "--units", "gyro=rad/s"], ["{unlabelled}", "--rate"]),
    "no unit": (["wv", "{unlabelled}", "--rate", "100"], ["--units gyro=deg/s", "--units gyro=rad/s"]),
    "units without a sensor": (["wv", "{file}", "--units", "deg/s"], ["--units must be ", "; got 'deg/s'"]),
    "unknown unit": (["wv", "{unlabelled}", "--rate", "100", "--units", "gyro=furlong"], ["furlong"]),
    "columns without an axis": (["wv", "{file}", "--columns", "gyro_x=a,b"], ["--columns must be ", "; got 'b'"]),
    "columns by a lone name": (["wv", "{file}", "--columns", "gyro_x"], ["{file}", "columns"]),
    "columns by an unknown name": (["wv", "{file}", "--columns", "foo"], ["--columns must be ", "; got 'foo'"]),
    "column of no axis": (["wv", "{file}", "--columns", "foo=1"], ["--columns must be ", "; got 'foo'"]),
    "names that repeat": (["info", "{repeated}"], ["--columns time=0,gyro_x=1"]),
    "a unit of time that is not clear": (
        ["info", "{unclear}"],
        ["interval of 1 ", "1 Hz in s", "1000 Hz in ms", "--units time=s", "--units time=ms"],
    ),
    "a pipe": (["info", "/dev/null"], ["/dev/null"]),
    "stamps out of order": (["wv", "{disorder}"], ["--columns time=", "--rate"]),
    "output is a file": (["fit", "{file}", "-m", "WN", "--output", "{file}"], ["--output must be ", "'{file}'"]),
    "demo into a file": (["demo", "--output", "{file}"], ["--output must be ", "'{file}'"]),
    "simulate an axis that is none": (
        ["simulate", "-m", "foo=WN(sigma2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        ["--model must be ", "; got 'foo'"],
    ),
    "simulate without one value": (
        ["simulate", "-m", "GM(sigma2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        ["GM.beta", "sigma2=1"],
    ),
    "columns that are not there": (["wv", "{file}", "--columns", "gyro_x=wx"], ["wx"]),
    "plot of unknown kind": (["wv", "{file}", "--plot", "{folder}/wv.foo"], ["wv.foo"]),
    "output in a file": (["fit", "{file}", "-m", "WN", "--output", "{file}/out"], ["{file}"]),
    "csv in a file": (["wv", "{file}", "--csv", "{file}/out.csv"], ["{file}"]),
    "simulate nothing": (["simulate", "--duration", "1", "--output", "{folder}/x.csv"], ["--model", "--reference"]),
    "simulate both": (
        ["simulate", "--reference", "-m", "WN(sigma2=1)", "--duration", "1", "--output", "{folder}/x.csv"],
        ["--model", "--reference"],
    ),
    "simulate without values": (
        ["simulate", "-m", "WN", "--duration", "1", "--output", "{folder}/x.csv"],
        ["WN.sigma2"],
    ),
    "simulate an axis twice": (
        ["simulate", "-m", "gyro=WN(sigma2=1)", "-m", "gyro=QN(q2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        ["gyro"],
    ),
    "simulate several without axes": (
        ["simulate", "-m", "WN(sigma2=1)", "-m", "QN(q2=1)", "--duration", "1", "-o", "{folder}/x.csv"],
        ["--model must be ", "gyro='WN(sigma2=1)'", "; got 'WN(sigma2=1)'"],
    ),
    "simulate too short": (["simulate", "--reference", "--duration", "0", "-o", "{folder}/x.csv"], ["duration"]),
    "simulate without end": (
        ["simulate", "--reference", "--duration", "inf", "-o", "{folder}/x.csv"],
        ["--duration must be ", "; got 'inf'"],
    ),
    "simulate for no length": (
        ["simulate", "--reference", "--duration", "long", "-o", "{folder}/x.csv"],
        ["--duration must be ", "1h30m", "; got 'long'"],
    ),
    "a horizon without a length": (["export", "{file}", "--horizon", "near"], ["--horizon must be ", "; got 'near'"]),
    "simulate more than memory": (
        ["simulate", "--reference", "--duration", "1e13", "-o", "{folder}/x.csv"],
        ["memory"],
    ),
    "simulate to an unknown format": (
        ["simulate", "--reference", "--duration", "1", "-o", "{folder}/x.foo"],
        ["x.foo", ".csv", ".parquet"],
    ),
    "negative seed": (
        ["simulate", "--reference", "--duration", "1", "--seed=-1", "-o", "{folder}/x.csv"],
        ["--seed must be ", "; got -1"],
    ),
}


@pytest.fixture(scope="session")
def places(folder, recording, unlabelled, broken):
    empty, foreign = folder / "empty.csv", folder / "foreign.bin"
    empty.touch()
    foreign.write_bytes(bytes(range(256)) * 8)
    texts = {
        "repeated": "time [s],gx [rad/s],gx [rad/s]\n" + "".join(f"{k / 100},{k % 7},{k % 3}\n" for k in range(50)),
        "unclear": "t,gx [rad/s]\n" + "".join(f"{k},{k % 7}\n" for k in range(50)),
        "disorder": "t [s],gx [rad/s]\n" + "".join(f"{(k ^ 3) / 100},{k % 7}\n" for k in range(50)),
    }
    for name, text in texts.items():
        (folder / f"{name}.csv").write_text(text)
    return {
        "folder": folder, "file": recording, "unlabelled": unlabelled, "broken": broken,
        "empty": empty, "foreign": foreign, **{name: folder / f"{name}.csv" for name in texts},
    }  # fmt: skip


@pytest.mark.slow
@each(("case", "json"), [*((case, False) for case in CASES), *((case, True) for case in list(CASES)[::5])])
def test_one_readable_line(gmwm, places, case, json):
    arguments, facts = ([text.format(**places) for text in texts] for texts in CASES[case])
    outcome = gmwm(*arguments, *(["--json"] if json else []))
    assert outcome.code == 2
    assert outcome.out == ""
    lines = outcome.err.splitlines()
    assert [line for line in lines if not line.startswith("warning: ")] == lines[-1:]
    assert lines[-1].startswith("error: ")
    assert all(fact in lines[-1] for fact in facts), lines[-1]
    assert "Traceback" not in outcome.err


def test_a_failed_command_leaves_no_file(gmwm, folder):
    before = sorted(folder.iterdir())
    gmwm("simulate", "-m", "WN", "--duration", "1", "--output", folder / "x.csv")
    assert sorted(folder.iterdir()) == before


def test_a_bug_is_not_hidden(gmwm, recording, monkeypatch):
    def fall(*_, **__):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("gmwm.inspect", fall)
    with pytest.raises(ZeroDivisionError):
        gmwm("info", recording)


def test_an_interrupt_ends_with_130(gmwm, recording, monkeypatch):
    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("gmwm.inspect", press)
    outcome = gmwm("info", recording)
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")


def test_a_warning_is_one_line(gmwm, folder):
    path = folder / "plain.csv"
    noise = np.random.default_rng(1).normal(0, 1e-3, (200, 3))
    rows = [f"{k / 100},{x},{y},{1 + z}\n" for k, (x, y, z) in enumerate(noise)]
    path.write_text("time [s],accel_x,accel_y,accel_z\n" + "".join(rows))
    outcome = gmwm("wv", path, "--json")
    (line,) = outcome.err.splitlines()
    (remark,) = (one for one in outcome.json["remarks"] if one["code"] == "unit-inferred")
    assert line == f"warning: {remark['text']} [unit-inferred]"
    assert "--units accel=g" in line
    assert remark["facts"]["unit"] == "g"


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of the address space")
def test_too_small_an_address_space_is_one_line(recording):
    command = f"ulimit -v 400000; exec {shlex.quote(sys.executable)} -m gmwm info {shlex.quote(str(recording))}"
    run = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert run.stderr.startswith("error: the address space is limited to 0.38 GiB")
    assert run.stderr.count("\n") == 1


def test_every_command_names_its_options_and_arguments_in_errors():
    group = get_command(main.app)
    context = typer.Context(group)
    for name in main.NAMES:
        command = group.get_command(context, name)
        shown = {
            parameter.name: (*parameter.opts, parameter.metavar or parameter.name.upper())
            for parameter in command.params
        }
        run = getattr(import_module(f"gmwm.cli.{name}"), name)
        options = {p.name: _shell_name(p) for p in inspect.signature(run).parameters.values()}
        for parameter, option in options.items():
            assert any(option == text.strip("[].") for text in shown[parameter]), (name, parameter)
            with pytest.raises(OptionError) as caught, _named_by(options, {parameter: [Path("a/x.gif")]}):
                raise OptionError(argument="no_option_of_any_command", expected="a file", got="x.gif")
            assert caught.value.text(Dialect.SHELL) == f"{option} must be a file; got 'x.gif'"
        with pytest.raises(OptionError) as caught, _named_by(options, {}):
            raise OptionError(argument="no_option_of_any_command", expected="a file")
        assert caught.value.text(Dialect.SHELL) == "no_option_of_any_command must be a file"


@each(
    "arguments, option",
    [
        (("simulate", "--reference", "--duration", "10s", "-o", "o.txt"), "--output"),
        (
            ("simulate", "--reference", "--duration", "1s", "-o", "{folder}/o.csv", "--components", "o.txt"),
            "--components",
        ),
        (("convert", "{file}", "o.xyz"), "OUT"),
        (("wv", "{file}", "--axis", "gyro_x", "--plot", "o.gif"), "--plot"),
        (("fleet", "nosuch", "--output", "o"), "DIR"),
        (("fleet", "{folder}", "--output", "{folder}"), "--output"),
        (("app", "nosuch.csv"), "FILE"),
    ],
)
def test_an_error_about_a_path_names_the_argument_that_has_it(gmwm, recording, tmp_path, arguments, option):
    gmwm(*(text.format(file=recording, folder=tmp_path) for text in arguments)).require_refusal(
        f"error: {option} must be "
    )


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_a_pipe_as_output_stays_and_gets_the_content(gmwm, recording, tmp_path):
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as pool:
        content = pool.submit(pipe.read_bytes)
        assert gmwm("wv", recording, "--axis", "gyro_x", "--csv", pipe).code == 0
        assert content.result().startswith(b"axis,unit,level")
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]
    other = tmp_path / "other.txt"
    with ThreadPoolExecutor() as pool, written_together(tmp_path) as folder:
        content = pool.submit(pipe.read_bytes)
        (folder / pipe.name).write_text("new")
        other.write_text("")
    assert content.result() == b"new"
    assert pipe.is_fifo()
