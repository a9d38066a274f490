"""Isolated wrong samples: the certain ones are found, and the curve after replacement is that of the clean signal."""

import numpy as np
import pytest

from gmwm import Signal, wavelet_variance
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.outliers import find_spikes, repaired
from tests.helpers import raises
from tests.outliers.test_bursts import QUIET, ringing

N, RATE = 60_000, 100.0


def clean(seed=1, n=N):
    rng = np.random.default_rng(seed)
    return rng.standard_normal(n) + np.cumsum(3e-3 * rng.standard_normal(n))


def spoilt(x, share, size, seed=9):
    rng = np.random.default_rng(seed)
    wrong = rng.random(x.size) < share
    return x + wrong * size * rng.choice([-1.0, 1.0], x.size), wrong


@pytest.mark.slow
@pytest.mark.parametrize("kind", [kind for kind in QUIET if kind != "spikes"])
def test_tails_jumps_and_steps_are_no_spikes(kind):
    assert all(len(find_spikes(Signal(QUIET[kind](seed), RATE))) == 0 for seed in range(3))


@pytest.mark.parametrize("kind", ["t3", "t2"])
def test_the_heaviest_tails_are_no_spikes(kind):
    freedom = 3.0 if kind == "t3" else 2.0
    for seed in range(4):
        x = np.random.default_rng(seed).standard_t(freedom, N)
        assert len(find_spikes(Signal(x, RATE))) == 0


@pytest.mark.slow
@pytest.mark.parametrize(("share", "size"), [(0.0001, 25.0), (0.01, 10.0), (0.05, 10.0), (0.05, 40.0)])
def test_the_wrong_samples_are_found_and_no_others(share, size):
    x, wrong = spoilt(clean(), share, size)
    found = np.zeros(N, dtype=bool)
    spikes = find_spikes(Signal(x, RATE))
    found[spikes.indices] = True
    assert np.count_nonzero(found & ~wrong) <= 1 + 0.001 * wrong.sum()
    assert np.count_nonzero(wrong & ~found) <= 0.001 * wrong.sum()
    assert 0.6 * size < spikes.largest < 1.6 * size


@pytest.mark.parametrize("step", [0.5, 1.0, 1.3, 1.5])
def test_the_wrong_samples_of_a_rounded_output_are_found(step):
    x, wrong = spoilt(np.random.default_rng(2).standard_normal(N), 0.008, 10.0)
    spikes = find_spikes(Signal(np.round(x / step) * step, RATE))
    assert np.count_nonzero(wrong[spikes.indices]) >= 0.99 * wrong.sum()
    assert len(spikes) <= 1.01 * wrong.sum()


def test_equal_sizes_leave_few_small_ones():
    x, wrong = spoilt(np.random.default_rng(2).standard_normal(N), 0.008, 8.0)
    spikes = find_spikes(Signal(x, RATE))
    missed = np.setdiff1d(np.flatnonzero(wrong), spikes.indices)
    assert spikes.left / N == pytest.approx(64.0 * missed.size / N, abs=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("share", "size"), [(0.01, 10.0), (0.05, 40.0)])
def test_the_curve_becomes_that_of_the_clean_signal(share, size):
    ratios = []
    for seed in range(6):
        x = clean(seed)
        signal = Signal(spoilt(x, share, size, seed)[0], RATE, "rad/s", "gyro_x")
        fixed = repaired(signal, find_spikes(signal))
        assert (fixed.unit, fixed.axis, len(fixed)) == ("rad/s", "gyro_x", N)
        ratios.append(wavelet_variance(fixed).variance[:12] / wavelet_variance(x, RATE).variance[:12])
    mean, error = np.mean(ratios, axis=0), np.std(ratios, axis=0) / np.sqrt(6)
    assert np.all(np.abs(mean - 1) < 5 * error + 0.003)
    # Coarse levels of a tenth of all samples at most change by the noise of the replacements.
    assert np.all(np.abs(mean[:6] - 1) < 0.01)


def test_a_wrong_angle_makes_two_wrong_rates():
    x = clean()
    at = np.arange(300, N - 300, 301)
    x[at] += 15.0
    x[at + 1] -= 15.0
    spikes = find_spikes(Signal(x, RATE))
    assert spikes.indices.tolist() == sorted([*at, *(at + 1)])


def test_a_knock_is_no_crowd_of_spikes():
    x = clean()
    for start in range(2_000, 58_000, 8_000):
        ringing(x, start, 100.0)
    assert len(find_spikes(Signal(x, RATE))) == 0


def test_the_repair_is_reproducible_and_leaves_the_others():
    x, wrong = spoilt(clean(), 0.01, 12.0)
    signal = Signal(x, RATE)
    spikes = find_spikes(signal)
    one, other = repaired(signal, spikes), repaired(signal, spikes)
    assert np.array_equal(one.values, other.values)
    kept = np.ones(N, dtype=bool)
    kept[spikes.indices] = False
    assert np.array_equal(one.values[kept], x[kept])
    assert np.abs(one.values[~kept] - x[~kept]).min() > 5.0
    assert wrong[~kept].all()


def test_what_is_no_signal_and_spikes_of_another_signal_are_errors():
    with raises(OptionError, argument="x", expected="a Signal"):
        find_spikes(clean())
    spikes = find_spikes(Signal(spoilt(clean(), 0.01, 12.0)[0], RATE))
    with raises(DataError, argument="spikes"):
        repaired(Signal(clean(n=100), RATE), spikes)


def test_without_spikes_it_is_the_same_signal():
    signal = Signal(clean(), RATE)
    assert repaired(signal, find_spikes(signal)) is signal
    for odd in (np.zeros(1000), np.arange(8.0), np.arange(1000.0)):
        assert len(find_spikes(Signal(odd, RATE))) == 0


@pytest.mark.parametrize("size", [1e13, 1e17, 3.4e38, 1e150])
def test_a_spike_of_any_size_is_found(size):
    x = clean(n=20_000)
    x[500] = size
    assert find_spikes(Signal(x, RATE)).indices.tolist() == [500]


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.003, 0.01, 0.03])
def test_the_small_ones_of_a_power_law_are_estimated_from_the_large_ones(share):
    rng, n = np.random.default_rng(4), 200_000
    x, wrong = rng.normal(size=n), rng.random(n) < share
    x[wrong] += rng.standard_cauchy(np.count_nonzero(wrong))
    spikes = find_spikes(Signal(x, rate=100.0))
    clean = np.delete(x, spikes.indices)
    assert spikes.left / n == pytest.approx(np.var(clean) - 1, abs=0.4 * (np.var(clean) - 1) + 0.005)
