"""Parts of a recording: warm-up and handling left out."""

import json

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from gmwm.errors import DataError, OptionError
from gmwm.signals import TimeBase


def recording(segments=(), starts=(), rate=10.0, size=1000):
    values = np.arange(float(size))
    signals = {
        axis: Signal(values + k, rate, "rad/s", axis, 0.0, segments, starts)
        for k, axis in enumerate(("gyro_x", "gyro_y"))
    }
    return Imu(signals, time_base=TimeBase(rate, stamped=True), temperature=20 + values / 100)


def test_the_middle_of_a_recording():
    part = recording().between(10.0, 50.0)
    assert part["gyro_y"].values.tolist() == (np.arange(100.0, 500.0) + 1).tolist()
    assert part["gyro_x"].start == 10.0
    assert part.temperature.tolist() == (20 + np.arange(100.0, 500.0) / 100).tolist()
    assert part.time_base.start == 10.0
    assert part.time_base.gaps == ()
    assert "40 s of 100 s kept, from 10 s to 50 s" in part.notes[-1]


def test_every_time_of_a_sample_keeps_that_sample():
    imu = recording(rate=128.0)
    for k in range(0, 900, 7):
        assert imu.between(k / 128.0)["gyro_x"].values[0] == k
        assert len(imu.between(stop=(k + 8) / 128.0)) == k + 8


def test_what_is_skipped_leaves_a_gap():
    part = recording().between(skip=[(60.0, 70.0), (20.0, 30.0), (25.0, 32.0)])
    assert part.segments == ((0, 200), (200, 480), (480, 780))
    assert part["gyro_x"].starts == (0.0, 32.0, 70.0)
    assert part["gyro_x"].values[[200, 480]].tolist() == [320.0, 700.0]
    assert [place for place, _ in part.time_base.gaps] == [200, 480]
    assert [length for _, length in part.time_base.gaps] == pytest.approx([12.1, 10.1])
    np.testing.assert_allclose(part["gyro_x"].times(), part["gyro_x"].values / 10)


def test_gaps_of_the_recording_stay_and_its_clock_counts():
    imu = recording(((0, 300), (300, 1000)), (5.0, 105.0))
    part = imu.between(20.0, 120.0)
    assert part.segments == ((0, 100), (100, 300))
    assert part["gyro_x"].starts == (25.0, 105.0)
    assert part.between(0.0, 9.0).segments == ((0, 90),)


def test_after_a_clock_was_set_back_time_goes_on():
    imu = recording(((0, 300), (300, 1000)), (1000.0, 0.0))
    part = imu.between(20.0, 40.0)
    assert part["gyro_x"].values.tolist() == np.arange(200.0, 400.0).tolist()
    assert part["gyro_x"].starts == (1020.0, 0.0)
    assert part.time_base.backward == 1


def test_random_cuts_keep_every_sample_where_it_was():
    rng = np.random.default_rng(4)
    imu = recording(((0, 300), (300, 420), (420, 1000)), (0.0, 40.0, 70.0))
    times = imu["gyro_x"].times()
    for _ in range(50):
        start, stop = sorted(rng.uniform(0, 130, size=2).tolist())
        skip = [tuple(sorted(rng.uniform(0, 130, size=2).tolist())) for _ in range(3)]
        kept = (times >= start) & (times < stop)
        for a, b in skip:
            kept &= (times < a) | (times >= b)
        if np.count_nonzero(kept) < 50:
            continue
        part = imu.between(start, stop, skip)
        assert part["gyro_x"].values.tolist() == np.arange(1000.0)[kept].tolist()
        np.testing.assert_allclose(part["gyro_x"].times(), times[kept], rtol=1e-12)


def test_nothing_to_cut_is_the_recording_itself():
    imu = recording()
    assert imu.between() is imu
    assert imu.between(0.0, 1e6, skip=[(20.01, 20.09)]) is imu  # between two samples


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"start": -1.0}, "start must be a time"), ({"stop": float("nan")}, "stop must be a time"),
        ({"start": "10"}, "start must be a time"), ({"start": 5.0, "stop": 5.0}, "stop must come after start=5"),
        ({"skip": [(5.0, 2.0)]}, "earlier time first"), ({"skip": [3.0]}, "pairs"), ({"skip": ["ab"]}, "pairs"),
    ],
)  # fmt: skip
def test_times_that_are_none(arguments, says):
    with pytest.raises(OptionError, match=says):
        recording().between(**arguments)


@pytest.mark.parametrize("arguments", [{"start": 100.0}, {"start": 99.5}, {"skip": [(0.0, 200.0)]}])
def test_nothing_left_is_an_error(arguments):
    with pytest.raises(DataError, match=r"nothing is left .*the recording lasts 100 s"):
        recording().between(**arguments)


def test_read_cuts(tmp_path):
    path = tmp_path / "static.csv"
    x = np.random.default_rng(5).normal(size=1000)
    path.write_text("time [s],gyro_x [rad/s]\n" + "".join(f"{7 + k / 10:.1f},{v}\n" for k, v in enumerate(x)))
    imu = gmwm.read(path, start=10, stop=90, skip=[(30, 40)])
    assert imu["gyro_x"].values.tolist() == np.concatenate([x[100:300], x[400:900]]).tolist()
    assert gmwm.read(path, start=10, skip=[(30, 40)], gaps="longest")["gyro_x"].start == 47.0


def test_the_command_line_cuts(gmwm_wv, tmp_path):
    path = tmp_path / "static.csv"
    x = np.random.default_rng(5).normal(size=6000)
    path.write_text("time [s],gyro_x [rad/s]\n" + "".join(f"{k / 10:.1f},{v}\n" for k, v in enumerate(x)))
    content = gmwm_wv(path, "--start", "1min", "--stop", "9min", "--skip", "2min-150s,5min-6min")
    curve = content["axes"]["gyro_x"]
    assert curve["segments"] == [600, 1500, 1800]
    parts = Signal(
        np.concatenate([x[600:1200], x[1500:3000], x[3600:5400]]), 10.0, segments=((0, 600), (600, 2100), (2100, 3900))
    )
    assert curve["variance"] == gmwm.wavelet_variance(parts).variance.tolist()


@pytest.fixture
def gmwm_wv():
    from typer.testing import CliRunner

    from gmwm.cli.main import app

    def run(*arguments):
        result = CliRunner().invoke(app, ["wv", *map(str, arguments), "--json"], prog_name="gmwm")
        assert result.exit_code == 0, result.stderr
        return json.loads(result.stdout)

    return run
