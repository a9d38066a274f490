"""Parts of a recording: warm-up and handling left out."""

import json

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from gmwm.base.errors import DataError, GmwmWarning, OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.text import moment
from gmwm.base.time_base import TimeBase
from tests.helpers import only, raises


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
    facts = only(part.remarks, "cut:cut").facts
    assert (facts["kept"], facts["whole"], facts["ranges"]) == (
        Quantity(40, "s"),
        Quantity(100, "s"),
        ("10 s to 50 s",),
    )


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
        start, stop = sorted(rng.uniform(0, 128, size=2).tolist())
        skip = [tuple(sorted(rng.uniform(0, 128, size=2).tolist())) for _ in range(3)]
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
    assert imu.between(0.0, 100.0, skip=[(20.01, 20.09)]) is imu  # between two samples


@pytest.mark.parametrize(
    ("arguments", "argument"),
    [
        ({"start": -1.0}, "start"), ({"stop": float("nan")}, "stop"), ({"start": "10"}, "start"),
        ({"start": 5.0, "stop": 5.0}, "stop"), ({"skip": [(5.0, 2.0)]}, "skip"), ({"skip": [3.0]}, "skip"),
        ({"skip": ["ab"]}, "skip"),
    ],
)  # fmt: skip
def test_times_that_are_none(arguments, argument):
    with raises(OptionError, argument=argument):
        recording().between(**arguments)


@pytest.mark.parametrize("arguments", [{"start": 100.0}, {"start": 99.5}, {"skip": [(0.0, 200.0)]}])
def test_nothing_left_is_an_error(arguments):
    with raises(DataError, "8 samples", "100 s", advises=["start=", "stop=", "skip="]):
        recording().between(**arguments)


@pytest.mark.parametrize("skip", [(5003.0, 5004.0), (100.0, 101.0), (1.718e9, 1.718e9 + 60)])
def test_to_skip_what_lies_outside_is_an_error(skip):
    with raises(DataError, "lasts 100 s", moment(skip[0]), moment(skip[1]), advises=["first sample", "skip="]):
        recording().between(skip=[(20.0, 30.0), skip])
    assert len(recording().between(skip=[(99.0, 1e4)])) == 990  # a part of it lies inside
    assert len(recording().between(stop=50.0, skip=[skip])) == 500  # what is behind stop is not looked at


def test_a_stop_that_lies_outside_is_told():
    with pytest.warns(GmwmWarning) as warned:
        assert len(recording().between(stop=5000.0)) == 1000
    assert [one.message.remark for one in warned] == [
        Remark.of("cut", case="stop", stop=Quantity(5000.0, "s"), end=Quantity(100.0, "s"))
    ]
    assert len(recording().between(stop=100.05)) == 1000  # the end, but for rounding


def test_what_was_cut_off_before_the_first_sample_is_known():
    imu = recording(((0, 300), (300, 1000)), (1000.0, 0.0))  # set back: time goes on
    part = imu.between(20.0)
    assert (imu.time_base.left, part.time_base.left) == (0.0, 20.0)
    assert part.longest().time_base.left == part.between(10.0).time_base.left == 30.0
    assert recording().between(20.0, skip=[(22.0, 80.0)]).longest().time_base.left == pytest.approx(80.0)
    assert imu.longest().time_base.left == 30.0


def written(path, clock):
    x = np.random.default_rng(5).normal(size=6000)
    x[[1000, 4500]] += 50.0
    times = [clock + k / 10 + 7 * (k >= 3000) for k in range(6000)]
    path.write_text("time [s],gyro_x [rad/s]\n" + "".join(f"{t:.1f},{v}\n" for t, v in zip(times, x, strict=True)))
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("clock", "how"), [(0.0, gmwm.read), (1.718e9, gmwm.stream)])
def test_times_of_knocks_are_those_of_skip(tmp_path, clock, how):
    path = written(tmp_path / "static.csv", clock)
    cuts = [{}, {"start": 50.0}, {"start": 99.0, "stop": 500.0}, {"skip": [(10.0, 20.0), (250.0, 260.0)]}]
    for cut in cuts:
        found = gmwm.inspect(how(path, **cut))
        times = [knock.time for knock in found.knocks]
        assert times == pytest.approx([100.0, 457.0], rel=1e-6)
        assert "knock at 100 s of one sample" in found.summary()
        assert only(found.remarks, "knocks").facts["first"].value == pytest.approx(100.0)
        skip = [*cut.get("skip", ()), *((time - 1, time + 1) for time in times)]
        assert gmwm.inspect(how(path, **cut | {"skip": skip})).knocks == ()


def test_times_of_knocks_in_the_longest_segment(tmp_path):
    path = written(tmp_path / "static.csv", 1.718e9)
    (knock,) = gmwm.inspect(gmwm.read(path, start=50.0, gaps="longest")).knocks
    assert knock.time == pytest.approx(457.0, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("clock", [0.0, 1.718e9])
def test_streams_refuse_what_lies_outside_as_well(tmp_path, clock):
    path = written(tmp_path / "static.csv", clock)
    for how in (gmwm.read, gmwm.stream):
        with raises(DataError, "607 s", "5003 s", "5004 s"):
            gmwm.inspect(how(path, skip=[(5003.0, 5004.0)]))
        with pytest.warns(GmwmWarning, match="5000 s .*607 s"):
            assert gmwm.inspect(how(path, stop=5000.0)).samples == 6000


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


@pytest.mark.parametrize("cut", [{"start": 50.0}, {"start": 99.0, "stop": 500.0}])
def test_each_reading_of_a_stream_has_the_same_times(tmp_path, cut):
    stream = gmwm.stream(written(tmp_path / "static.csv", 0.0), **cut)
    lefts = []
    for _ in range(3):
        list(stream.samples())
        lefts.append(stream.time_base.left)
    assert lefts == [cut["start"]] * 3
