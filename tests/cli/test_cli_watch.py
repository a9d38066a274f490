"""gmwm watch: the view of a growing file, and the end of the watch."""

import json
import os
import re
import signal
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from typer.testing import CliRunner

import gmwm as library
from gmwm.cli.main import app
from gmwm.cli.watch import one_line_of
from gmwm.files.readers import growing_files

HEAD = "time [s],gyro_x [rad/s],gyro_y [rad/s]\n"


def rows(begin=0, end=4000, seed=1):
    x = 1e-3 * np.random.default_rng(seed).normal(size=(end, 2))
    return [f"{k * 0.01:.2f},{x[k, 0]:.9e},{x[k, 1]:.9e}\n" for k in range(begin, end)]


@pytest.fixture(autouse=True)
def fast(monkeypatch):
    monkeypatch.setattr(growing_files, "POLL_S", 0.005)


class Clock:
    """A clock that only waiting moves. Each wait for new data lets the next thing happen."""

    def __init__(self):
        self.now, self.coming = 0.0, []

    def monotonic(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds
        if self.coming:
            self.coming.pop(0)()


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(growing_files, "time", clock)
    monkeypatch.setattr("gmwm.cli.watch.time", clock)
    return clock


def piped(text, *options):
    """The watch of a text on standard input."""
    return CliRunner().invoke(app, ["watch", "-", *options], input=text, prog_name="gmwm")


@pytest.mark.slow
def test_standard_input_to_its_end(tmp_path):
    text = HEAD + "".join(rows())
    found = piped(text, "--model", "WN", "--json")
    assert found.exit_code == 0
    content = json.loads(found.stdout)
    (tmp_path / "a.csv").write_text(text)
    imu = library.read(tmp_path / "a.csv")
    assert list(content["axes"]) == ["gyro_x", "gyro_y"]
    for axis, one in content["axes"].items():
        curve = library.wavelet_variance(imu[axis])
        assert np.allclose(one["wavelet_variance"]["variance"], curve.variance, rtol=1e-11, atol=0)
        fit = library.fit("WN", curve)
        assert one["fit"]["parameters"]["WN.sigma2"] == pytest.approx(fit.parameters["WN.sigma2"], rel=1e-9)
        relative = fit.standard_errors["WN.sigma2"] / fit.parameters["WN.sigma2"]
        assert one["relative_errors"]["WN.sigma2"] == pytest.approx(relative, rel=1e-6)
        # A record of N samples knows σ² of white noise to a bit more than √(2/N).
        assert 1.0 < one["relative_errors"]["WN.sigma2"] / np.sqrt(2 / 4000) < 1.6
        assert one["needed"]["WN.sigma2"] < 40.0


@pytest.mark.slow
def test_the_table_at_the_end():
    found = piped(HEAD + "".join(rows()), "--axis", "gyro_y", "--model", "WN + RW", "--accuracy", "5%", "--datasheet")
    assert found.exit_code == 0
    assert "4000 samples at 100 Hz: 40 s" in found.stdout
    assert "Allan deviation (deg/h)" in found.stdout
    assert "gyro_x" not in found.stdout
    white = next(line for line in found.stdout.splitlines() if line.strip().startswith("WN.sigma2"))
    walk = next(line for line in found.stdout.splitlines() if line.strip().startswith("RW.gamma2"))
    assert " yes " in white
    assert " yes " not in walk


@pytest.mark.slow
def test_a_growing_file_is_shown_in_lines(tmp_path, gmwm, clock):
    """A writer that leaves lines half written, and then nothing more."""
    path = tmp_path / "log.csv"
    text = HEAD + "".join(rows())
    path.write_text(text[:30_000])
    clock.coming = [partial(add, path, text[k : k + 7001]) for k in range(30_000, len(text), 7001)]
    found = gmwm("watch", path, "--every", "0.01s", "--idle", "1.5s", "--axis", "gyro_x")
    assert found.code == 0
    told = [line for line in found.out.splitlines() if " samples | gyro_x: " in line]
    counts = [int(line.split(" samples")[0].rsplit(" ", 1)[1]) for line in told]
    assert counts == sorted(set(counts))
    assert len(counts) > 1
    assert "4000 samples at 100 Hz" in found.out
    assert 1.5 < clock.now < 2.0


def add(path, text):
    with path.open("a") as file:
        file.write(text)


@pytest.mark.slow
def test_the_end_of_the_file_is_remarked(tmp_path, gmwm, clock):
    path = tmp_path / "log.csv"
    path.write_text(HEAD + "".join(rows()) + "40.00,0.0")
    found = gmwm("watch", path, "--idle", "0.2s", "--all-remarks")
    assert "[last-line]" in found.err
    assert "4000 samples" in found.out
    # The watch waits for the first time when it has read all complete lines.
    clock.coming = [lambda: path.write_text("time\n")]
    found = gmwm("watch", path, "--idle", "20s")
    (line,) = (line for line in found.err.splitlines() if line.endswith("[watch-ended]"))
    assert "5 bytes" in line
    assert "4000 samples" in found.out
    assert found.code == 0


@pytest.mark.slow
def test_a_bad_line_ends_it_with_what_came_before(tmp_path, gmwm, clock):
    path = tmp_path / "log.csv"
    path.write_text(HEAD + "".join(rows()))
    clock.coming = [partial(add, path, "40.00,a,b\n")]
    found = gmwm("watch", path, "--idle", "20s")
    assert found.code == 2
    assert all(fact in found.err for fact in ("line 4002", "gyro_x [rad/s]", "'a'"))
    assert "Allan deviation" in found.out
    early = piped(HEAD + "".join(rows(0, 300)) + "3.00,a,b\n")
    assert early.exit_code == 2
    assert "line 302" in early.stderr
    assert early.stdout == ""


@pytest.mark.slow
def test_what_is_wrong_before_anything_came(tmp_path, gmwm):
    assert gmwm("watch", tmp_path / "none.csv").err.startswith(f"error: {tmp_path / 'none.csv'} ")
    assert gmwm("watch", tmp_path).err.startswith(f"error: {tmp_path} ")
    assert "--every" in gmwm("watch", "-", "--every", "0s").err
    assert "accuracy" in gmwm("watch", "-", "--accuracy", "2").err
    assert piped("").exit_code == 2
    assert "standard input" in piped("").stderr
    assert (
        "--axis must be one of gyro_x, gyro_y; got 'accel'" in piped(HEAD + "".join(rows()), "--axis", "accel").stderr
    )
    assert "--units" in piped((HEAD + "".join(rows())).replace("[rad/s]", "")).stderr


def test_a_model_with_too_many_parameters_is_remarked_and_the_curve_shown():
    found = piped(HEAD + "".join(rows(0, 20)), "--model", "2*GM + WN + RW")
    assert found.exit_code == 0
    assert "[not-calibrated]" in found.stderr
    assert "Allan deviation" in found.stdout


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of this kind are not sent there")
def test_ctrl_c_ends_it_with_the_table(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(HEAD + "".join(rows()))
    command = [sys.executable, "-m", "gmwm", "watch", str(path), "--every", "0.2s"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        first = run.stdout.readline()
        assert " samples | gyro_x: " in first
        run.send_signal(signal.SIGINT)
        out, err = run.communicate(timeout=300)
    assert run.returncode == 0, err
    assert "4000 samples at 100 Hz" in out


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="signals of this kind are not sent there")
def test_ctrl_c_ends_it_while_standard_input_waits():
    command = [sys.executable, "-m", "gmwm", "watch", "-", "--every", "0.2s"]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **pipes) as run:
        run.stdin.write(HEAD + "".join(rows()))
        run.stdin.flush()
        assert " samples | gyro_x: " in run.stdout.readline()
        run.send_signal(signal.SIGINT)
        table, err = run.stdout.read(), run.stderr.read()
        assert run.wait(timeout=300) == 0, err
    assert err == ""
    assert " samples at 100 Hz" in table
    assert "Allan deviation" in table


def test_every_number_of_the_line_has_a_unit():
    curve = library.wavelet_variance(library.Signal(1e-3 * np.random.default_rng(1).normal(size=4000), 100.0, "rad/s"))
    line = one_line_of({"gyro_x": curve}, {}, {}, accuracy=0.1, datasheet=True)
    assert re.fullmatch(
        r"40 s, 4000 samples \| gyro_x: [\d.]+ deg/h at 0.01 s, least [\d.]+ deg/h ± \S+ % at \S+ s", line
    )
    fit = library.fit("WN", curve)
    line = one_line_of({"gyro_x": curve}, {"gyro_x": fit}, {}, accuracy=0.1, datasheet=True)
    assert re.search(r"WN.sigma2 \S+ \(rad/s\)² ± \S+ %; all within 10 %", line)
