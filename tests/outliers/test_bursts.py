"""Bursts: knocks and motion are found, and heavy tails, changes of the variance, jumps and warm-up are none."""

import numpy as np
import pytest

from gmwm import Signal
from gmwm.measuring.outliers import Bursts, bursts, find_bursts
from gmwm.measuring.outliers.bursts import BurstFinder

N, RATE = 50_000, 100.0


def noise(seed=1, n=N):
    return np.random.default_rng(seed).standard_normal(n)


def student(freedom, seed):
    return np.random.default_rng(seed).standard_t(freedom, N)


def loud(factor, seed):
    return np.repeat(np.where(np.arange(10) % 2, factor, 1.0), N // 10) * noise(seed)


QUIET = {
    "Gaussian": lambda seed: noise(seed),
    "t5": lambda seed: student(5, seed),
    "t10": lambda seed: student(10, seed),
    "Laplace": lambda seed: np.random.default_rng(seed).laplace(size=N),
    "sd 1.5 times": lambda seed: loud(1.5, seed),
    "sd 3 times": lambda seed: loud(3.0, seed),
    "rounded": lambda seed: 3 * np.rint(noise(seed) / 3 + seed / 7),
    "averaged": lambda seed: np.convolve(noise(seed), np.ones(5) / 5, mode="valid"),
    "walk": lambda seed: np.cumsum(noise(seed)),
    "jump": lambda seed: noise(seed) + 50 * (np.arange(N) > N / 3),
    "warm-up": lambda seed: noise(seed) + 500 * np.exp(-np.arange(N) / 3000),
    "spikes": lambda seed: noise(seed) + 12 * (np.arange(N) % 997 == seed),
}


@pytest.mark.parametrize("kind", QUIET)
def test_what_lasts_or_does_not_return_is_no_burst(kind):
    assert not any(find_bursts(QUIET[kind](seed), RATE).found for seed in range(6))


def ringing(x, start, size):
    x[start : start + 100] += size * np.exp(-np.arange(100) / 25) * noise(5, 100)


def moved(x, start, size):
    x[start : start + 400] += size * np.sin(np.arange(400) / 20) * np.hanning(400)


@pytest.mark.parametrize(("spoil", "size"), [(ringing, 30.0), (ringing, 200.0), (moved, 10.0)])
@pytest.mark.parametrize("white", [noise, lambda seed: student(5, seed)], ids=["Gaussian", "t5"])
def test_knocks_and_motion_are_found(spoil, size, white):
    x = white(3)
    for start in (7_000, 31_000):
        spoil(x, start, size)
    found = find_bursts(x, RATE)
    assert found.found
    assert found.energy.max() > 0.01
    assert found.time[found.material].max() < 0.1
    assert found.count <= 4


def test_a_pulse_without_structure_is_a_burst_if_it_is_huge():
    x = noise()
    x[7000:7010] += 300.0
    assert find_bursts(x, RATE).found


def test_a_state_that_lasts_is_no_burst():
    x = noise()
    x[: N // 3] *= 12.0
    x[: N // 3 : 2] *= 0.1
    assert not find_bursts(x, RATE).found


def test_chunks_change_nothing_and_gaps_are_respected():
    x = np.concatenate([noise(n=300_000), noise(2)])
    ringing(x, 280_000, 100.0)
    whole = find_bursts(Signal(x, RATE, segments=((0, 300_000), (300_000, x.size))))
    finder = BurstFinder(RATE)
    for first, last in ((0, 10), (10, 131_072), (131_072, 299_999), (299_999, 300_000)):
        finder.update(x[first:last])
    finder.gap()
    finder.update(x[300_000:])
    pieces = finder.result()
    assert pieces.to_dict() == whole.to_dict()
    assert Bursts.from_dict(whole.to_dict()).to_dict() == whole.to_dict()


def test_short_segments_share_the_quantization_step(monkeypatch):
    samples = []
    monkeypatch.setattr(bursts, "step_of", samples.append)
    finder = BurstFinder(RATE)
    for part in np.split(noise(n=8000), 1000):
        finder.update(part)
        finder.gap()
    assert 10 < len(samples) < 60
    assert samples[-1].size > 7000


def test_few_samples_have_no_bursts():
    few = find_bursts(noise(n=8), RATE)
    assert (few.tau.size, few.found, few.count) == (0, False, 0)
    assert not find_bursts(np.zeros(5000), RATE).found
