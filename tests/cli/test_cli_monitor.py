"""gmwm monitor: events of files, growing files and standard input; exit codes; pictures; errors."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gmwm as library
from gmwm.cli.main import app
from gmwm.files.readers import growing_files

RATE = 100.0
SIGMA = 4.4e-4
MODEL = f"WN(sigma2={SIGMA**2}) + RW(gamma2=1e-14)"
AXES = ("gyro_x", "gyro_y")
HEAD = "time [s],gyro_x [rad/s],gyro_y [rad/s]\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration, a good recording, and one in which gyro_x jumps at 150 s and gyro_y gets noisier at 200 s."""
    where = tmp_path_factory.mktemp("monitor")
    imu = library.simulate(dict.fromkeys(AXES, MODEL), rate=RATE, samples=60_000, rng=1)
    library.calibrate(imu, within="WN + RW").save(where / "calibration.json")
    good = library.simulate(dict.fromkeys(AXES, MODEL), rate=RATE, samples=25_000, rng=2)
    good.write(where / "good.parquet")
    x = {axis: good[axis].values.copy() for axis in AXES}
    x["gyro_x"][15_000:] += 5 * SIGMA
    x["gyro_y"][20_000:] += 2 * SIGMA * np.random.default_rng(3).standard_normal(5000)
    library.Imu.from_arrays(x, rate=RATE).write(where / "bad.csv")
    return where


def invoke(*words, text=None):
    return CliRunner().invoke(app, ["monitor", *map(str, words)], input=text, prog_name="gmwm")


def kinds(lines):
    return [(event["kind"], event["axis"]) for event in map(json.loads, lines)]


@pytest.mark.slow
def test_a_good_recording_gives_exit_code_0(folder):
    found = invoke(folder / "good.parquet", "--from-fits", folder)
    assert found.exit_code == 0
    assert found.stdout.startswith("no event in 4.2 min (25000 samples) of gyro_x, gyro_y")


@pytest.mark.slow
def test_events_are_lines_and_give_exit_code_1(folder):
    found = invoke(folder / "bad.csv", "--from-fits", folder / "calibration.json")
    assert found.exit_code == 1
    first, second, last = found.stdout.splitlines()
    assert first.startswith("150.0 s  gyro_x  level jumped by 0.13 deg/s")
    assert "gyro_y  noise rose by a factor of 2" in second
    assert last.startswith("2 events in")


@pytest.mark.slow
def test_json_is_one_event_in_each_line_and_a_summary(folder):
    found = invoke(folder / "bad.csv", "--from-fits", folder, "--json", "--every", "3d")
    *lines, last = found.stdout.splitlines()
    assert kinds(lines) == [("jump", "gyro_x"), ("noise-up", "gyro_y")]
    event = json.loads(lines[0])
    assert event["unit"] == "rad/s"
    assert event["size"] == pytest.approx(5 * SIGMA, rel=0.2)
    assert event["began"] == pytest.approx(150.0, abs=0.1)
    summary = json.loads(last)
    assert summary["command"] == "monitor"
    assert summary["every"] == 3 * 86_400
    assert summary["samples"] == 25_000
    assert summary["events"] == [json.loads(line) for line in lines]


@pytest.mark.slow
def test_a_reference_is_measured(folder):
    found = invoke(folder / "bad.csv", "--from-fits", folder, "--reference", folder / "good.parquet", "--json")
    assert found.exit_code == 1
    assert json.loads(found.stdout.splitlines()[0])["kind"] == "jump"


@pytest.mark.slow
def test_standard_input(folder):
    text = (folder / "bad.csv").read_text()
    found = invoke("-", "--from-fits", folder, "--axis", "gyro_y", "--json", text=text)
    assert found.exit_code == 1
    *lines, last = found.stdout.splitlines()
    assert kinds(lines) == [("noise-up", "gyro_y")]
    assert json.loads(last)["axes"] == ["gyro_y"]


@pytest.mark.slow
def test_a_growing_file_with_a_fault_is_followed_and_reported(folder, tmp_path, monkeypatch):
    path = tmp_path / "log.csv"
    lines = (folder / "bad.csv").read_text().splitlines(keepends=True)
    pieces = iter(["".join(lines[k : k + 500]) for k in range(0, len(lines), 500)])

    class Clock:
        """Only waiting moves it. While the command waits, the file grows."""

        now = 0.0

        def monotonic(self):
            return self.now

        def sleep(self, seconds):
            self.now += seconds
            with path.open("a") as file:
                file.write(next(pieces, ""))

    monkeypatch.setattr(growing_files, "time", Clock())
    path.write_text("")
    found = invoke(path, "--follow", "--idle", "3s", "--from-fits", folder, "--json")
    assert found.exit_code == 1, found.stderr
    *events, last = found.stdout.splitlines()
    assert kinds(events) == [("jump", "gyro_x"), ("noise-up", "gyro_y")]
    assert json.loads(last)["samples"] == len(lines) - 1
    assert next(pieces, None) is None


@pytest.mark.slow
def test_events_are_printed_before_the_input_ends(folder, monkeypatch):
    """The command must not wait for the end of standard input."""
    monkeypatch.setattr(growing_files, "POLL_S", 0.005)
    command = [sys.executable, "-m", "gmwm", "monitor", "-", "--from-fits", str(folder), "--json"]
    lines = (folder / "bad.csv").read_text().splitlines(keepends=True)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write("".join(lines[:18_000]))
        process.stdin.flush()
        guard = threading.Timer(60.0, process.kill)
        guard.start()
        first = process.stdout.readline()
        guard.cancel()
        assert json.loads(first)["kind"] == "jump"
        process.stdin.close()
        assert json.loads(process.stdout.read().splitlines()[-1])["samples"] == 18_000 - 1
    assert process.returncode == 1


@pytest.mark.slow
def test_pictures_and_a_page_are_written(folder, tmp_path):
    picture, page = tmp_path / "soak.png", tmp_path / "soak.html"
    found = invoke(folder / "bad.csv", "--from-fits", folder, "--plot", picture, "--output", page)
    assert found.exit_code == 1
    assert picture.read_bytes()[:4] == b"\x89PNG"
    html = page.read_text(encoding="utf-8")
    assert "level jumped by 0.13 deg/s" in html
    assert "Content-Security-Policy" in html
    assert html.count("<tr>") == 3 + 3  # two events and two models, each with a heading
    assert "bad.csv" in html
    assert "<td>gyro_x</td><td>WN + RW</td>" in html


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("missing.csv", "--from-fits", "{folder}"), "missing.csv"),
        (("{folder}/bad.csv", "--from-fits", "missing"), "missing"),
        (("{folder}/bad.csv", "--from-fits", "{folder}", "--every", "soon"), "--every"),
        (("{folder}/bad.csv", "--from-fits", "{folder}", "--idle", "3s"), "--idle"),
        (("{folder}/bad.csv", "--from-fits", "{folder}", "--axis", "accel"), "--axis"),
        (("{folder}/bad.csv", "--from-fits", "{folder}", "--output", "a.txt"), ".html"),
        (("{folder}/bad.csv", "--from-fits", "{folder}", "--rate", "250", "--columns", "time="), "--rate"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(folder, words, part):
    found = invoke(*(word.format(folder=folder) for word in words))
    assert found.exit_code == 2
    assert part in found.stderr.splitlines()[-1]
    assert "Traceback" not in found.stderr


def test_a_recording_without_the_axes_of_the_calibration_is_refused(folder, tmp_path: Path):
    library.simulate({"accel_x": "WN(sigma2=1e-4)"}, rate=RATE, samples=1000, rng=1).write(tmp_path / "a.csv")
    found = invoke(tmp_path / "a.csv", "--from-fits", folder)
    assert found.exit_code == 2
    assert "accel_x" in found.stderr


@pytest.mark.slow
def test_three_units_are_compared_and_the_changed_one_is_named(folder, tmp_path):
    paths = []
    for k, name in enumerate("abc"):
        imu = library.simulate(dict.fromkeys(AXES, MODEL), rate=RATE, samples=25_000, rng=40 + k)
        x = {axis: imu[axis].values.copy() for axis in AXES}
        if name == "b":
            x["gyro_y"][20_000:] += 4 * SIGMA
        paths.append(tmp_path / f"{name}.parquet")
        library.Imu.from_arrays(x, rate=RATE).write(paths[-1])
    found = invoke(*paths, "--from-fits", folder)
    assert found.exit_code == 1
    event, last = found.stdout.splitlines()
    assert event.startswith("b: 200.1 s  gyro_y  level jumped by")
    assert last == "1 event of 3 units"
    found = invoke(*paths, "--from-fits", folder, "--json", "--axis", "gyro_x")
    assert found.exit_code == 0
    assert json.loads(found.stdout)["events"] == []
    for words in ((*paths[:2],), (*paths, "--plot", "a.png"), (*paths, "--follow")):
        assert invoke(*words, "--from-fits", folder).exit_code == 2


@pytest.mark.slow
@pytest.mark.parametrize("cut", [(), ("--start", "100s")])
def test_times_count_from_the_first_sample_of_the_recording(folder, tmp_path, cut):
    bad = library.read(folder / "bad.csv")
    arrays = {axis: bad[axis].values for axis in AXES}
    library.Imu.from_arrays(arrays, rate=RATE, start=1.7e9).write(tmp_path / "clock.csv")
    found = invoke(tmp_path / "clock.csv", "--from-fits", folder, *cut)
    assert found.stdout.startswith("150.0 s  gyro_x  level jumped")
