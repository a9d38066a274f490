"""A change of the rate and stamps out of order are errors; jitter, rounding, bursts, gaps and drift are neither."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.base.errors import ReadError
from gmwm.files.clock.clock import clock_of
from gmwm.files.clock.rate_check import rate_change
from gmwm.files.clock.running_clock import Pace, RunningClock
from tests.helpers import each, raises

FIXED = settings(derandomize=True, max_examples=50, deadline=None)


def base(values, unit="s", rate=None):
    return clock_of([np.asarray(values)], unit, rate)[0]


def two_rates(first, second, samples, share):
    cut = int(share * samples)
    return np.cumsum(np.repeat([0.0, 1 / first, 1 / second], [1, cut, samples - cut - 1])), cut


@pytest.mark.slow
@FIXED
@given(
    first=st.sampled_from([1.0, 50.0, 100.0, 833.0]),
    factor=st.sampled_from([0.3, 0.5, 0.9, 1.1, 2.0, 3.0]),
    share=st.floats(0.2, 0.8),
    jitter=st.floats(0, 0.2),
    scale=st.sampled_from([1e-12, 1.0, 1e12]),
    samples=st.integers(2000, 20_000),
)
def test_a_change_is_found_where_it_is(first, factor, share, jitter, scale, samples):
    stamps, cut = two_rates(first, first * factor, samples, share)
    # A change by a tenth is lost in more jitter than an eighth of that, where few samples show it.
    jitter = min(jitter, abs(factor - 1) / 8)
    noise = np.random.default_rng(samples).uniform(-jitter, jitter, samples) / (first * max(1, factor))
    found = rate_change((stamps + noise) * scale)
    assert found is not None
    assert found.after / found.before == pytest.approx(1 / factor, rel=0.1)
    assert abs(found.index - cut) <= (0 if jitter == 0 else samples // 64)


@pytest.mark.parametrize("factor", [0.1, 10.0, 100.0])
def test_a_change_by_an_order_of_magnitude_is_found(factor):
    stamps, cut = two_rates(100, 100 * factor, 4000, 0.4)
    assert rate_change(stamps).index == cut


def rounded(rate, step):
    return lambda n, _: np.round(np.arange(n) / rate / step) * step


def bursts(size):
    return lambda n, _: np.arange(n) // size * size * 0.01 + np.arange(n) % size * 1e-4


def with_gaps(lost):
    return lambda n, rng: (np.arange(n) + np.cumsum((rng.random(n) < 0.02) * lost(rng, n))) * 0.01


STEADY = {
    "exact": lambda n, _: np.arange(n) * 0.01,
    "jitter of the stamps": lambda n, rng: (np.arange(n) + rng.uniform(-0.49, 0.49, n)) * 0.01,
    "jitter sorted": lambda n, rng: np.sort(np.arange(n) + rng.normal(0, 0.6, n)) * 0.01,
    "rounded to more than an interval": rounded(200, 0.01),
    "rounded to less": rounded(128, 0.01),
    "rounded a little": rounded(90, 0.01),
    "bursts of 4": bursts(4),
    "bursts of 40": bursts(40),
    "bursts at one stamp": lambda n, _: np.arange(n) // 10 * 0.1,
    "single samples lost": with_gaps(lambda *_: 1),
    "long gaps": with_gaps(lambda rng, n: rng.integers(1, 500, n)),
    "losses from the middle on": lambda n, rng: np.delete(
        np.arange(2 * n), n + np.flatnonzero(rng.random(n) < 0.3)
    ) * 0.01,
    "pauses as long as the bursts": lambda n, _: (np.arange(n) + np.arange(n) // 50 * 50) * 0.01,
    "a crystal that drifts": lambda n, _: np.arange(n) * 0.01 * (1 + 0.01 * np.arange(n) / n),
    "a day between two parts": lambda n, _: np.arange(n) * 0.01 + (np.arange(n) > n // 2) * 86400,
    "a clock set back": lambda n, _: np.arange(n) * 0.01 - (np.arange(n) > n // 3) * 5,
}  # fmt: skip


@each("name", STEADY)
@each("samples", [60, 500, 2000, 20_000])
def test_no_change_where_there_is_none(name, samples):
    for seed in range(5):
        stamps = STEADY[name](samples, np.random.default_rng(seed))
        assert rate_change(stamps) is None, seed


def test_reading_says_both_rates_when_and_the_way_out():
    stamps, _ = two_rates(100, 50, 20_000, 0.5)
    with raises(ReadError, "100 Hz", "50 Hz", "100 s", "row 10001"):
        base(stamps)
    with raises(ReadError, "100 Hz", "50 Hz"):
        base(stamps, rate=100)


@pytest.mark.parametrize("spread", [0.3, 0.6, 2.0])
def test_stamps_out_of_order(spread):
    stamps = (np.arange(20_000) + np.random.default_rng(5).normal(0, spread, 20_000)) * 0.01
    back = np.count_nonzero(np.diff(stamps) < 0)
    with raises(ReadError, back, 20000, advises=["'time'"]):
        base(stamps)


def test_the_rate_is_told_though_the_stamps_are_not_in_order():
    stamps = (np.arange(20_000) + np.random.default_rng(5).normal(0, 0.6, 20_000)) * 0.01
    with raises(ReadError, advises=["100 Hz"]):
        base(stamps)


def test_a_few_backward_steps_split():
    swapped = np.arange(20_000) * 0.01
    swapped[[700, 701]] = swapped[[701, 700]]
    assert base(swapped).base.backward == 1
    wrapped = np.arange(60_000) % 6553 * 0.01  # a counter of 16 bits
    assert base(wrapped).base.backward == 9


def test_a_clock_that_is_set_back_all_the_time_is_no_time():
    with raises(ReadError, code="time-order"):
        base(np.arange(20_000) % 50 * 0.01)


COURSES = {
    "steady": lambda x: 0 * x,
    "1 % along the recording": lambda x: 0.01 * x,
    "4 % along the recording": lambda x: 0.04 * x,
    "4 % at the beginning": lambda x: 0.04 * np.exp(-5 * x),
    "up and down by 2 %": lambda x: 0.02 * np.sin(2 * np.pi * x),
}


@pytest.mark.parametrize("jitter", [0.0, 0.2])
@pytest.mark.parametrize("course", COURSES)
def test_a_rate_that_drifts_is_stated_with_its_course(course, jitter):
    size, rng = 20_000, np.random.default_rng(3)
    rates = 100 / (1 + COURSES[course](np.arange(size) / size))
    stamps = np.cumsum(1 / rates) + jitter * 0.01 * rng.uniform(-1, 1, size)
    drifts = [remark for remark in clock_of([stamps], "s", None)[0].remarks if remark.facts.get("case") == "drift"]
    assert bool(drifts) == (np.ptp(rates) > 1.5)
    for remark in drifts:
        assert remark.facts["first"].value == pytest.approx(rates[: size // 8].mean(), rel=1e-3)
        assert remark.facts["last"].value == pytest.approx(rates[-size // 8 :].mean(), rel=1e-3)
        assert remark.facts["low"].value >= rates.min() * 0.999
        assert remark.facts["high"].value <= rates.max() * 1.001


@pytest.mark.parametrize("jitter", [0.0, 0.05, 0.3])
@pytest.mark.parametrize("course", COURSES)
def test_lost_samples_of_a_rate_that_drifts_are_found(course, jitter):
    size, rng = 20_000, np.random.default_rng(5)
    stamps = np.cumsum(0.01 * (1 + COURSES[course](np.arange(size) / size))) + jitter * 0.01 * rng.uniform(-1, 1, size)
    lost = np.sort(rng.choice(np.arange(100, size - 100, 3), 20, replace=False))
    stamps = np.delete(stamps, lost)
    gaps = dict(clock_of([stamps], "s", None)[0].base.gaps)
    assert list(gaps) == pytest.approx(lost - np.arange(20), abs=1 + 100 * jitter)
    assert len(gaps) == 20


@pytest.mark.slow
@each("size", [100, 1000, 20_000])
@each("name", [name for name in STEADY if name not in ("a crystal that drifts", "jitter sorted")])
def test_a_steady_rate_does_not_drift(name, size):
    for seed in range(2):
        stamps = STEADY[name](size, np.random.default_rng(seed))
        remarks = clock_of([stamps], "s", None)[0].remarks
        assert not any(remark.facts.get("case") == "drift" for remark in remarks), seed


def test_jitter_is_not_called_rounding():
    rng = np.random.default_rng(4)
    jitter = np.arange(20_000) * 0.01 + 0.005 * rng.uniform(-1, 1, 20_000)
    rounding = np.floor(np.arange(20_000) / 137 / 0.01) * 0.01
    causes = {
        remark.facts["cause"]
        for stamps in (jitter, rounding)
        for remark in clock_of([stamps], "s", None)[0].remarks
        if remark.facts.get("case") == "mean"
    }
    assert causes == {"free", "spaced"}


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.005, 0.01])
def test_a_live_clock_takes_rounded_stamps_row_by_row(step):
    stamps = np.round(np.floor((np.arange(900) / 137 + 0.0031) / step) * step, 3)
    timing = base(stamps[:100])
    clock = RunningClock(Pace.of(stamps[:100], "s", timing))
    for row in range(stamps.size):
        clock.take(stamps[row : row + 1])
    clock.end()
    assert clock.base().gaps == ()
    assert clock.rows == stamps.size
