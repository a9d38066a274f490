"""What time stamps say: exact where they are exact, never glued, never believed against a declared rate."""

from __future__ import annotations

import warnings

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.base.errors import OptionError, ReadError, TimeBaseWarning, UnitError
from gmwm.base.remarks import Quantity, Remark
from gmwm.files.clock.clock import clock_of
from gmwm.files.clock.running_clock import Pace, RunningClock
from gmwm.files.clock.time_stamps import as_stamps
from gmwm.files.readers import read
from tests.helpers import code_of, only, raises

FIXED = settings(derandomize=True, max_examples=60, deadline=None)


def base(values, unit="s", rate=None):
    return clock_of([np.asarray(values)], unit, rate)[0]


def jittered(samples, share, seed=3):
    return np.arange(samples) + np.random.default_rng(seed).uniform(-share, share, samples)


@pytest.mark.slow
@FIXED
@given(
    rate=st.sampled_from([0.5, 1, 9.6, 50, 62.5, 99.9, 100, 123.456, 200, 400, 1000, 8000]),
    start=st.sampled_from([0.0, 0.1, 37.25, 5e5, 1.4e9]),
    samples=st.integers(200, 3000),
)
def test_regular_stamps_give_their_rate(rate, start, samples):
    found = base(start + np.arange(samples) / rate)
    # Stamps of 1.4e9 s are known to 2.4e-7 s: the whole span bounds what can be said.
    possible = 4 * np.spacing(start + samples / rate) / (samples / rate)
    assert found.base.rate == pytest.approx(rate, rel=max(possible, 1e-15))
    assert found.segments == ((0, samples),)
    assert found.remarks == ()


@pytest.mark.slow
@FIXED
@given(step=st.integers(10_000, 10**9), start=st.integers(10**18, 2 * 10**18), samples=st.integers(8, 500))
def test_nanoseconds_are_exact(step, start, samples):
    stamps = start + step * np.arange(samples, dtype=np.int64)
    assert base(stamps, "ns").base.rate == 1e9 / step
    assert base(stamps, "ns").base.jitter == 0


@pytest.mark.slow
@FIXED
@given(st.lists(st.tuples(st.integers(20, 60), st.integers(1, 400)), min_size=1, max_size=6), st.floats(0, 0.2))
def test_every_gap_is_found_and_nothing_else(pieces, share):
    lengths = [length for length, _ in pieces]
    index = np.concatenate(
        [np.arange(n) + sum(lengths[:k]) + sum(lost for _, lost in pieces[:k]) for k, n in enumerate(lengths)]
    )
    stamps = (index + jittered(index.size, share) - np.arange(index.size)) * 0.01
    edges = np.cumsum([0, *lengths])
    found = base(stamps)
    assert found.segments == tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    np.testing.assert_allclose(found.starts, stamps[edges[:-1]], atol=0.005, rtol=0.02 * share)
    # Segments begin a whole number of samples apart: the samples between them and the lost ones.
    apart = np.diff(found.starts) * found.base.rate - lengths[:-1]
    np.testing.assert_allclose(apart, np.round(apart), atol=1e-6)
    # Jitter leaves the rate of some dozen rows uncertain by half a percent.
    assert all(abs(one - lost) < 0.6 + 0.02 * lost for one, (_, lost) in zip(apart, pieces, strict=False))
    assert [k for k, _ in found.base.gaps] == edges[1:-1].tolist()


@pytest.mark.slow
@FIXED
@given(st.sampled_from([1e-12, 1e-6, 1.0, 1e6]), st.floats(0, 0.3))
def test_no_absolute_scale(scale, share):
    one, other = base(jittered(300, share)), base(jittered(300, share) * scale)
    assert other.base.rate == pytest.approx(one.base.rate / scale, rel=1e-9)
    assert other.segments == one.segments


def test_a_late_stamp_is_no_gap_and_a_lost_sample_is():
    late = np.arange(400) * 0.01
    late[200] += 0.008
    assert base(late).segments == ((0, 400),)
    lost = np.delete(np.arange(401), 200) * 0.01
    assert base(lost).segments == ((0, 200), (200, 400))


@pytest.mark.parametrize(("every", "spread"), [(4, 1e-4), (10, 0.0), (4, 0.0)])
def test_samples_stamped_in_bursts(every, spread):
    k = np.arange(4000)
    stamps = (k // every) * every * 0.01 + (k % every) * spread
    found = base(stamps)
    assert found.base.rate == pytest.approx(100, rel=3e-3)  # the last burst has no end
    assert found.segments == ((0, 4000),)


def test_sampling_with_pauses_as_long_as_the_bursts():
    k = np.arange(1000)
    found = base((k + k // 50 * 50) * 0.01)
    assert found.base.rate == pytest.approx(100, rel=1e-9)
    assert len(found.segments) == 20


def test_a_lost_burst_is_a_gap():
    k = np.delete(np.arange(4000), slice(2000, 2012))
    assert base((k // 4) * 0.04).segments == ((0, 2000), (2000, 3988))


@pytest.mark.parametrize("loss", [0.06, 0.1, 0.3])
def test_samples_lost_at_random_are_gaps_however_many(loss):
    kept = np.flatnonzero(np.random.default_rng(1).random(20_000) > loss)
    found = base(kept * 0.005)
    assert found.base.rate == pytest.approx(200, rel=1e-12)
    assert len(found.segments) == 1 + np.count_nonzero(np.diff(kept) > 1)


@pytest.mark.parametrize("rate", [80.0, 90.0, 128.0])
@pytest.mark.parametrize("late", [0.0, 0.001])
def test_rounded_stamps_are_no_lost_samples(rate, late):
    k = np.arange(20_000)
    found = base(np.floor((k / rate + late * np.random.default_rng(2).random(k.size)) / 0.01) * 0.01)
    assert found.base.rate == pytest.approx(rate, rel=1e-3)
    assert len(found.segments) == 1


def test_rounded_stamps_use_the_mean_and_say_so():
    found = base(np.round(np.arange(3000) / 128, 2))
    assert found.base.rate == pytest.approx(128, rel=1e-3)
    assert only(found.remarks, "rate-stated:mean").facts["rate"].value == found.base.rate
    assert found.base.duplicates > 0
    assert found.segments == ((0, 3000),)


def test_one_row_written_twice_does_not_move_the_rate():
    stamps = np.insert(np.arange(100) * 0.01, 50, 0.5)
    found = base(stamps)
    assert found.base.rate == pytest.approx(100, rel=1e-12)
    assert found.base.duplicates == 1
    assert only(found.remarks, "stamps-irregular:repeated").facts == {"case": "repeated", "count": 1}


def test_a_backward_step_starts_a_segment():
    found = base(np.concatenate([np.arange(100), np.arange(60, 160)]) * 0.01)
    assert found.segments == ((0, 100), (100, 200))
    assert found.base.backward == 1
    assert found.starts == (0.0, 0.6)


def set_back(rate, unit=0.0):
    """Stamps that are rounded down to a unit (s), with three samples lost before and after the clock was set back."""
    index = np.arange(2400) + 3 * (np.arange(2400) >= 600) + 3 * (np.arange(2400) >= 1800)
    stamps = np.floor(index / rate / unit) * unit if unit else index / rate
    stamps[1201:] -= stamps[1201] - stamps[1200] + 3.0
    return stamps


def samples_per_gap(clock):
    return [(row, round(seconds * clock.rate - 1)) for row, seconds in clock.gaps]


def test_no_sample_is_lost_where_the_clock_is_set_back():
    stamps = set_back(1 / 0.0073, 0.01)
    clock = base(stamps)
    assert samples_per_gap(clock.base) == [(600, 3), (1800, 3)]
    assert [first for first, _ in clock.segments] == [0, 600, 1201, 1800]
    # Within a part between two settings of the clock, lost samples are counted; at the setting the time stamp counts.
    begin, lost = stamps[0], [0, 3, 0, 3]
    for first, start, count in zip((0, 600, 1201, 1800), clock.starts, lost, strict=True):
        begin, row = (stamps[1201], 1201) if first >= 1201 else (begin, 0)
        assert start == pytest.approx(begin + (first - row + count) / clock.base.rate, abs=1e-9)


def test_a_live_stream_loses_the_same_samples_when_its_clock_is_set_back():
    stamps = set_back(100.0)
    timing = base(stamps)
    live = RunningClock(Pace.of(stamps[:500], "s", timing))
    parts = [live.take(part) for part in np.split(stamps, [500, 1100, 1202, 1250])] + [live.end()]
    assert [row for part in parts for row in part.firsts] == [0, 600, 1201, 1800]
    starts = [start for part in parts for start in part.starts]
    assert starts == pytest.approx(timing.starts, abs=1e-9)
    assert live.base().gaps == timing.base.gaps


def test_jitter_is_measured_and_told():
    found = base(jittered(5000, 0.45))
    expected = np.sqrt(2) * 0.9 / np.sqrt(12)
    assert found.base.jitter == pytest.approx(expected, rel=0.05)
    assert found.base.rate == pytest.approx(1, rel=1e-3)
    assert [code_of(one) for one in base(jittered(5000, 0.2)).remarks] == ["rate-stated:mean"]
    strong = np.arange(5000) + np.random.default_rng(1).normal(0, 0.45, 5000)
    assert only(base(np.sort(strong)).remarks, "stamps-irregular:jitter").facts["share"] > 0.5


def test_declared_rate_against_the_stamps():
    stamps = np.arange(500) * 0.01
    assert base(stamps, rate=100).remarks == ()
    near = base(stamps, rate=100.5)
    assert near.base.rate == 100.5
    (remark,) = near.remarks
    assert (remark.code, remark.facts["source"]) == ("rate-contradicted", "declared")
    assert remark.facts["rate"] == Quantity(100.5, "Hz")
    assert (remark.facts["stamps"].value, remark.facts["percent"]) == pytest.approx((100, 0.4975), rel=1e-3)
    for rate, grave in ((100.05, False), (99.95, False), (100.2, False), (100.3, True), (99.1, True)):
        # 0.2 % of 500 samples is one sample, which the first or the last stamp may be off by.
        found = base(stamps, rate=rate)
        assert [code_of(one) for one in found.remarks] == ["rate-contradicted" if grave else "rate-stated:declared"]
    long = np.arange(5000) * 0.01
    assert [one.code for one in base(long, rate=100.2).remarks] == ["rate-contradicted"]
    assert [code_of(one) for one in base(long, rate=100.05).remarks] == ["rate-stated:declared"]
    with raises(ReadError, "200 Hz", "100 Hz", argument="rate", advises=["rate=", "None"]):
        base(stamps, rate=200)
    with raises(ReadError, "0.0001 Hz", argument="rate", advises=["'time'", "'us'"]):
        base(stamps * 1e6, rate=100)


@pytest.mark.parametrize(
    ("first", "step", "unit"),
    [
        (0, 0.01, "s"), (0.0, 0.02, "s"), (1.7e9, 0.005, "s"), (17 * 10**11, 10, "ms"), (17 * 10**14, 2500, "us"),
        (17 * 10**17, 2_500_000, "ns"), (1.7e12, 10.0, "ms"), (0, 1e-4, "s"), (0, 5e-5, "s"),
        (0, 2, "ms"), (0, 10, "ms"), (0, 2500, "us"), (0, 5_000_000, "ns"),
    ],
)  # fmt: skip
def test_unit_by_size_and_interval(first, step, unit):
    found, remark = as_stamps(first + step * np.arange(100), "", None)
    assert found.unit == unit
    assert remark == Remark.of("time-read", case="unit", unit=unit)


@pytest.mark.parametrize("step", [1, 0.5, 1000, 1e6])
def test_unclear_units_are_asked_for_unless_the_rate_tells(step):
    stamps = step * np.arange(100)
    with raises(UnitError, "Hz in s", "Hz in ms", "Hz in us", "Hz in ns", advises=["units=", "rate="]):
        as_stamps(stamps, "", None)
    assert as_stamps(stamps, "", 1e3 / step)[0].unit == "ms"


def saved(folder, stamps, name="time [s]"):
    path = folder / "static.csv"
    pl.DataFrame({name: stamps, "gyro_x [rad/s]": np.sin(np.arange(len(stamps)))}).write_csv(path)
    return path


def test_read_warns_keeps_segments_and_cuts_on_request(tmp_path):
    gap = np.delete(np.arange(120), slice(30, 50)) * 0.01
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        imu = read(saved(tmp_path, gap))
    assert imu.segments == ((0, 30), (30, 100))
    cut = read(saved(tmp_path, gap), gaps="longest")
    assert cut.segments == ((0, 70),)
    assert cut["gyro_x"].start == pytest.approx(0.5, abs=1e-12)
    assert cut.remarks[-1] == Remark.of("cut", case="segment", segments=2, first=30, last=99)
    with pytest.warns(TimeBaseWarning) as warned:
        read(saved(tmp_path, np.concatenate([np.arange(50), np.arange(50)]) * 0.01))
    assert only([one.message.remark for one in warned], "stamps-irregular:backward").facts == {
        "case": "backward",
        "count": 1,
    }


@pytest.mark.parametrize(("name", "factor"), [("time_us", 1e6), ("t (ms)", 1e3), ("timestamp [ns]", 1e9), ("time", 1)])
def test_unit_in_the_name(tmp_path, name, factor):
    assert read(saved(tmp_path, np.arange(100) * 0.01 * factor, name)).rate == pytest.approx(100, rel=1e-12)


def test_declared_time_unit(tmp_path):
    path = saved(tmp_path, np.arange(100) * 5, "time")
    assert read(path, units={"time": "ms"}).rate == 200
    assert read(path, rate=200).rate == 200
    with raises(UnitError, "'fortnight'", advises=["s, ms, us, ns"]):
        read(path, units={"time": "fortnight"})
    with pytest.raises(OptionError):
        read(path, units={"clock": "s"})


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        ("time [min]", 60), ("Time (min)", 60), ("time_min", 60), ("time [h]", 3600), ("t (hours)", 3600),
        ("time [days]", 86400), ("time (s since boot)", 1), ("Time [seconds since 2020-01-01]", 1),
    ],
)  # fmt: skip
def test_named_units_of_time_are_taken_at_their_word(tmp_path, name, seconds):
    path = tmp_path / "a.csv"
    path.write_text(f"{name},gx [rad/s]\n" + "".join(f"{7 + k / 100 / seconds!r},{k % 3}\n" for k in range(50)))
    imu = read(path)
    assert imu.rate == pytest.approx(100, rel=1e-6)
    assert imu["gyro_x"].start == pytest.approx(7 * seconds, rel=1e-12)
    assert not any(code_of(remark) == "time-read:unit" for remark in imu.remarks)


def test_long_units_of_time_declared_or_in_a_comment(tmp_path):
    rows = "".join(f"{k / 6000!r},{k % 3}\n" for k in range(50))
    path = tmp_path / "a.csv"
    path.write_text("# time in minutes\ntime,gx [rad/s]\n" + rows)
    assert read(path).rate == pytest.approx(100, rel=1e-9)
    path.write_text("# recorded for 10 minutes\ntime [s],gx [rad/s]\n" + rows)
    assert read(path).rate == pytest.approx(6000, rel=1e-9)
    imu = read(path, units={"time": "min"})
    assert imu.rate == pytest.approx(100, rel=1e-9)
    assert only(imu.remarks, "unit-contradicted:declared").facts == {"case": "declared", "unit": "min", "stated": "s"}
    with raises(ReadError, argument="rate", advises=["'time'", "'min'"]):
        read(path, rate=100)


@pytest.mark.parametrize("unit", ["samples", "ticks", "10 ns", "-", "m"])
def test_a_time_unit_that_is_named_but_not_known_is_an_error(tmp_path, unit):
    path = tmp_path / "a.csv"
    path.write_text(f"time [{unit}],gx [rad/s]\n" + "".join(f"{k / 100},{k % 3}\n" for k in range(50)))
    with raises(UnitError, f"'{unit}' of the time column", advises=["units=", "columns={'time': None}", "rate="]):
        read(path)
    imu = read(path, units={"time": "s"})
    assert imu.rate == 100
    assert only(imu.remarks, "unit-contradicted:declared", "time").facts == {
        "case": "declared",
        "unit": "s",
        "stated": unit,
    }
    assert read(path, columns={"time": None}, rate=50).rate == 50


def test_a_clock_in_brackets_is_no_unit(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time (UTC),gx [rad/s]\n" + "".join(f"{k / 100},{k % 3}\n" for k in range(50)))
    assert read(path).rate == 100


def test_losses_at_regular_distances_are_ambiguous_and_the_rate_decides():
    k = np.delete(np.arange(20_000), np.arange(9, 20_000, 10))
    stamps = (k + np.random.default_rng(1).normal(0, 0.1, k.size)) * 0.01
    found = base(stamps)
    assert found.base.rate == pytest.approx(100, rel=1e-5)
    assert len(found.segments) == 2000
    facts = only(found.remarks, "rate-ambiguous:losses").facts
    assert (facts["every"], facts["other"].value) == (10, pytest.approx(90, rel=1e-3))
    assert len(base(stamps, rate=100).segments) == 2000
    lower = base(stamps, rate=90)
    assert (lower.segments, lower.base.rate) == (((0, 18_000),), 90)


@pytest.mark.parametrize(("rate", "start"), [(119.0, 1e5), (100.0, 1e5), (2000.0, 5000.3), (4000.0, 3000.2)])
def test_the_steps_of_float32_are_no_lost_samples(rate, start):
    """The interval is one to three steps of float32 at this time, so the rounded intervals look like lost samples."""
    for stamps in (start + np.arange(8000) / rate, start + np.delete(np.arange(8000), [900, 4000, 6001]) / rate):
        for stored in (stamps.astype(np.float32), stamps.astype(np.float32).astype(np.float64)):
            found = base(stored)
            assert found.base.rate == pytest.approx(rate, rel=1e-4)
            assert not [remark for remark in found.remarks if remark.code == "rate-ambiguous"]
            assert len(found.segments) - 1 == 8000 - stamps.size


def test_a_counter_of_32_bits_and_summer_time_are_no_gaps():
    found = base((np.arange(5000) * 4000 + 2**32 - 10_000_000) % 2**32, "us")
    assert (found.base.rate, found.segments, found.base.backward) == (250, ((0, 5000),), 0)
    assert only(found.remarks, "time-read:wrapped").facts["length"].value == pytest.approx(2**32 / 1e6)
    for sign, direction in ((1, "forward"), (-1, "back")):
        leaps = base(1.7e9 + np.arange(5000) * 0.01 + sign * 3600 * (np.arange(5000) > 2000))
        assert leaps.segments == ((0, 5000),)
        assert only(leaps.remarks, "time-read:hour").facts == {"case": "hour", "count": 1, "direction": direction}


def test_one_stamp_out_of_order_is_no_gap():
    for shift in (-0.034, 0.5, 1e6):
        stamps = np.arange(3000) * 0.01
        stamps[1500] += shift
        found = base(stamps)
        assert found.segments == ((0, 3000),)
        assert found.base.rate == pytest.approx(100, rel=1e-5)
        assert found.base.backward == 1


def test_time_stamps_of_no_recording():
    with raises(ReadError, "e+300", advises=["columns="], code="time-implausible"):
        base(np.sort(np.random.default_rng(1).normal(size=500)) * 1e300)


@pytest.mark.slow
def test_a_rate_that_changes_can_be_cut(tmp_path):
    stamps = np.cumsum(np.repeat([0.0, 0.01, 0.02], [1, 5000, 4999])) + 100
    path = saved(tmp_path, stamps)
    with raises(ReadError, "50 s from the start", advises=["stop=50", "start=50"]):
        read(path)
    assert read(path, stop=50).rate == pytest.approx(100, rel=1e-9)
    second = read(path, start=50.5)
    assert second.rate == pytest.approx(50, rel=1e-9)
    assert second.time_base.left == pytest.approx(50.5, abs=0.02)
    assert second["gyro_x"].start == pytest.approx(150.5, abs=0.02)
    middle = read(path, start=60, stop=80, skip=[(65, 70)])
    assert [last - first for first, last in middle.segments] == [250, 500]
