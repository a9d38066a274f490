"""Knocks are replaced from their begin to their end, and the curve is that of the sensor at rest."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import gmwm
from gmwm import Signal
from gmwm.measuring.outliers import cleaned, find_bursts

N, RATE = 200_000, 100.0


def white(rng):
    return rng.standard_normal(N)


def tailed(rng):
    return rng.standard_t(5, N)


def filtered(rng):
    return lfilter(*butter(2, 0.25), rng.standard_normal(N))


def slow(rng):
    return white(rng) + lfilter([0.02], [1, -0.998], white(rng)) + 0.001 * np.cumsum(white(rng))


def stepped(rng):
    return 3.0 * np.rint(white(rng) / 3.0)


KINDS = [white, tailed, filtered, slow, stepped]


def knock(x, at, size, fade, frequency):
    """Add a decaying oscillation: size in standard deviations, fade (s), frequency (Hz)."""
    t = np.arange(min(round(10 * fade * RATE), x.size - at)) / RATE
    x[at : at + t.size] += size * np.std(x[:2000]) * np.exp(-t / fade) * np.sin(2 * np.pi * frequency * t)


def curve(values):
    return gmwm.wavelet_variance(values, RATE).variance[:10]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "size", "fade", "frequency"),
    [(kind, *((200.0, 0.1, 30.0), (3000.0, 0.3, 12.0))[number % 2]) for number, kind in enumerate(KINDS)],
)
def test_the_curve_is_that_of_the_sensor_at_rest(kind, size, fade, frequency):
    rng = np.random.default_rng(3)
    x = kind(rng)
    disturbed = x.copy()
    places = [12_000, 61_000, 67_000, 140_000, N - 90]
    for at in places:
        knock(disturbed, at, size, fade, frequency)
    if kind is stepped:
        disturbed = 3.0 * np.rint(disturbed / 3.0)
    found = cleaned(Signal(disturbed, RATE))
    assert len(found.replaced.knocks) == len(places)
    assert all(np.any((found.knocks[:, 0] <= at + 1) & (found.knocks[:, 1] > at + 5)) for at in places)
    assert found.replaced.spikes == 0
    assert curve(disturbed)[0] > 1.5 * curve(x)[0]
    np.testing.assert_allclose(curve(found.signal.values)[:5], curve(x)[:5], rtol=0.003)
    np.testing.assert_allclose(curve(found.signal.values), curve(x), rtol=0.03)
    assert not find_bursts(found.signal).found


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_noise_without_knocks_is_not_changed(kind):
    for seed in range(3):
        signal = Signal(kind(np.random.default_rng(seed)), RATE)
        found = cleaned(signal)
        assert found.signal is signal
        assert not found.knocks.size


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 3, 6])
@pytest.mark.parametrize("samples", [5_000, 20_000])
def test_short_pulses_are_replaced(samples, count):
    x = np.random.default_rng(4).standard_normal(samples)
    places = np.arange(1, count + 1) * samples // (count + 1)
    for at in places:
        x[at : at + 10] += 300.0
    found = cleaned(Signal(x, RATE))
    assert len(found.knocks) == count
    assert all(np.any((found.knocks[:, 0] <= at) & (found.knocks[:, 1] >= at + 10)) for at in places)


def test_heavy_tails_are_not_knocks():
    for seed in range(5):
        x = np.random.default_rng(seed).standard_t(3, 20_000)
        assert not cleaned(Signal(x, RATE)).knocks.size


@pytest.mark.slow
def test_what_is_outside_of_knocks_is_not_changed():
    x = white(np.random.default_rng(1))
    knock(x, 50_000, 100.0, 0.1, 20.0)
    found = cleaned(Signal(x, RATE))
    outside = np.ones(N, dtype=bool)
    for first, last in found.knocks.tolist():
        outside[first:last] = False
    assert np.array_equal(found.signal.values[outside], x[outside])
    assert not np.any(found.signal.values[~outside] == x[~outside])
    assert found.replaced.in_knocks == np.count_nonzero(~outside)


@pytest.mark.slow
def test_the_place_is_wider_than_the_large_samples():
    x = white(np.random.default_rng(1))
    x[50_000:50_040] += 100.0 * np.where(np.arange(40) % 2, 1, -1)
    ((first, last),) = cleaned(Signal(x, RATE)).knocks.tolist()
    assert 50_000 - first == pytest.approx(40, abs=8)
    assert last - 50_040 == pytest.approx(40, abs=8)


@pytest.mark.slow
def test_a_short_knock_has_a_margin_of_some_samples():
    x = white(np.random.default_rng(1))
    x[50_000:50_004] += [50.0, -50.0, 50.0, -50.0]
    ((first, last),) = cleaned(Signal(x, RATE)).knocks.tolist()
    assert first <= 50_000 - 8
    assert last >= 50_004 + 8


@pytest.mark.slow
def test_motion_that_lasts_is_kept():
    rng = np.random.default_rng(2)
    for seconds, count in ((9.0, 1), (36.0, 0)):
        x, size = white(rng), round(seconds * RATE)
        x[80_000 : 80_000 + size] += 40.0 * np.sin(0.3 * np.arange(size))
        assert len(cleaned(Signal(x, RATE)).knocks) == count


@pytest.mark.slow
def test_too_many_knocks_are_kept():
    for share, kept in ((0.08, False), (0.3, True)):
        x = white(np.random.default_rng(4))
        for at in np.linspace(1000, N - 1000, round(share * N / 120)).astype(int):
            x[at : at + 40] += 60.0 * np.where(np.arange(40) % 2, 1, -1)
        assert find_bursts(cleaned(Signal(x, RATE)).signal).found is kept


@pytest.mark.slow
def test_spikes_are_found_beside_knocks():
    x = tailed(np.random.default_rng(6))
    x[::2000] += 60.0
    knock(x, 100_500, 3000.0, 0.3, 12.0)
    found = cleaned(Signal(x, RATE))
    assert len(found.knocks) == 1
    assert abs(found.replaced.spikes - N // 2000) <= 4


@pytest.mark.slow
def test_the_mean_may_differ_before_and_after():
    x = white(np.random.default_rng(7)) + 30.0 * (np.arange(N) > 90_000)
    knock(x, 90_000, 200.0, 0.1, 30.0)
    values = cleaned(Signal(x, RATE)).signal.values
    assert abs(np.mean(values[91_000:]) - np.mean(values[:89_000]) - 30.0) < 0.1
    assert np.max(np.abs(np.diff(values))) < 12
