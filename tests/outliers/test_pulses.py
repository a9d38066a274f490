"""Pulses and short states in noise are replaced; popcorn noise and heavy tails are not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import gmwm
from gmwm import GM, RW, WN, Signal
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.measuring.outliers import contamination
from gmwm.measuring.outliers.cleaning import cleaned
from gmwm.recording.repairs.patterns import two_levels_of
from tests.helpers import only

RATE, SAMPLES = 100.0, 120_000
Floats = NDArray[np.float64]


def pulses(
    rng: np.random.Generator, shortest: int, longest: int, size: tuple[float, float], period: int, signs: list[int]
) -> Floats:
    x = rng.normal(size=SAMPLES)
    for start in range(period // 2, SAMPLES - period // 2, period):
        first = start + int(rng.integers(-period // 5, period // 5))
        x[first : first + int(rng.integers(shortest, longest + 1))] += rng.uniform(*size) * rng.choice(signs)
    return x


def popcorn(rng: np.random.Generator, size: float, duration: float, share: float) -> Floats:
    x, first = rng.normal(size=SAMPLES), 0
    while first < SAMPLES:
        first += int(rng.exponential(duration / share)) + 1
        last = first + int(rng.exponential(duration)) + 1
        x[first:last] += size
        first = last
    return x


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shortest", "longest", "size", "period"),
    [
        (5, 5, (30.0, 30.0), 6000), (4, 4, (60.0, 60.0), 6000), (7, 7, (30.0, 30.0), 3000), (20, 50, (5.0, 5.0), 6000),
        (20, 50, (5.0, 10.0), 6000), (20, 50, (8.0, 8.0), 1000), (5, 5, (7.0, 8.0), 6000), (8, 8, (5.0, 5.0), 3000),
        (30, 30, (3.2, 3.2), 1000), (7, 7, (5.5, 5.5), 4000), (8, 10, (4.8, 4.8), 3000),
    ],
)  # fmt: skip
@pytest.mark.parametrize("signs", [[1], [-1, 1]])
def test_pulses_are_replaced(
    shortest: int, longest: int, size: tuple[float, float], period: int, signs: list[int]
) -> None:
    x = pulses(np.random.default_rng(1), shortest, longest, size, period, signs)
    result = cleaned(Signal(x, rate=RATE))
    assert two_levels_of(x) is None
    assert len(result.knocks) == pytest.approx(SAMPLES / period, rel=0.1)
    assert np.std(result.signal.values) == pytest.approx(1.0, abs=0.01)


def test_pulses_at_both_ends_are_replaced() -> None:
    x = pulses(np.random.default_rng(4), 20, 30, (6.0, 6.0), 3000, [1])
    x[:37] += 6.0
    x[-30:] += 6.0
    result = cleaned(Signal(x, rate=RATE))
    assert result.knocks[0, 0] == 0
    assert result.knocks[-1, 1] == SAMPLES
    assert abs(result.signal.values[:30].mean()) < 0.7


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("size", "duration"), [(1.5, 300), (6.0, 30), (6.0, 300), (3.0, 100)])
def test_popcorn_noise_stays(seed: int, size: float, duration: float) -> None:
    x = popcorn(np.random.default_rng(seed), size, duration, 0.05)
    assert two_levels_of(x) is not None or not cleaned(Signal(x, rate=RATE)).knocks.size


@pytest.mark.parametrize("seed", [0, 3, 20, 27])
@pytest.mark.parametrize("width", [1, 5, 8])
def test_heavy_tails_stay(seed: int, width: int) -> None:
    x = np.convolve(np.random.default_rng(seed).standard_t(3, size=SAMPLES), np.ones(width) / width, "same")
    assert not cleaned(Signal(x, rate=RATE)).knocks.size


def weak_pulses(seed: int, size: float) -> Floats:
    """White noise and a walk, with a pulse of 2 s in each 30 s."""
    rng = np.random.default_rng(seed)
    x = pulses(rng, 150, 250, (size, size), 3000, [-1, 1])
    return x + np.cumsum(1e-3 * rng.normal(size=SAMPLES))


def noise_without_pulses(kind: str, seed: int) -> Floats:
    """Noise with a walk whose classical curve is above the robust one, if at all, most at fine levels."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=SAMPLES)
    if kind == "tails":
        white = rng.standard_t(rng.uniform(2.5, 6), size=SAMPLES)
    elif kind == "averaged tails":
        white = np.convolve(rng.standard_t(3, size=SAMPLES + 9), np.ones(10) / 10, "valid")
    elif kind == "varying":
        white *= np.exp(0.4 * np.repeat(rng.normal(size=SAMPLES // 1000), 1000))
    elif kind == "rounded":
        white = np.round(white)
    return white + np.cumsum(rng.choice([1e-3, 1e-2]) * rng.normal(size=SAMPLES))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["white", "tails", "averaged tails", "varying", "rounded"])
def test_the_excess_of_noise_without_pulses_does_not_rise(kind: str) -> None:
    for seed in range(4):
        verdict = contamination(Signal(noise_without_pulses(kind, seed), rate=RATE))
        assert not np.any(verdict.rising)


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.4, 1.0])
def test_weak_pulses_make_numbers_limits(size: float) -> None:
    x = weak_pulses(1, size)
    assert not cleaned(Signal(x, rate=RATE)).knocks.size
    found = gmwm.calibrate({"gyro_x": Signal(1e-3 * x, RATE, "rad/s", axis="gyro_x")})
    remark = only(found.remarks, "outliers-found:pulses", "gyro_x")
    assert {0.64, 1.28, 2.56, 5.12}.intersection(tau.value for tau in remark.facts["taus"])
    assert not found["gyro_x"].wavelet_variance.robust
    assert "use" not in {found.number_verdicts["gyro_x"][symbol].usability.value for symbol in "NK"}
    # N of the noise is 1e-4; K of the walk is 1e-5.
    assert found.datasheets["gyro_x"]["N"].high >= 1e-4
    assert found.datasheets["gyro_x"]["K"].high >= 1e-5


@pytest.mark.slow
def test_limits_of_popcorn_noise_include_it() -> None:
    """States of 2 s in each 22 s have the covariance of a Gauss-Markov process. The robust curve leaves them out."""
    rng, size, duration, share = np.random.default_rng(2), 0.7, 200, 0.1
    x = popcorn(rng, size, duration, share) + np.cumsum(1e-3 * rng.normal(size=SAMPLES))
    found = gmwm.calibrate({"gyro_x": Signal(1e-3 * x, RATE, "rad/s", axis="gyro_x")})
    only(found.remarks, "outliers-found:pulses", "gyro_x")
    law = GM(beta=RATE / duration * (1 + share), sigma2=1e-6 * size**2 * share / (1 + share) ** 2)
    truth = filter_numbers((WN(sigma2=1e-6), law, RW(gamma2=1e-12)), RATE)
    for symbol in "NK":
        assert found.number_verdicts["gyro_x"][symbol].usability.value == "use as a bound"
        assert 1 <= found.datasheets["gyro_x"][symbol].high / getattr(truth, symbol) < 1.5


def test_small_jumps_of_the_mean_double_the_variance_of_a_coarse_level() -> None:
    rng = np.random.default_rng(2)
    jumps = np.repeat(np.cumsum(0.25 * rng.choice([-1, 1], size=SAMPLES // 6000)), 6000)
    verdict = contamination(Signal(rng.normal(size=SAMPLES) + jumps, rate=RATE))
    assert verdict.tau[verdict.rising].tolist() == [20.48]


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_thermostat_is_no_popcorn_noise(share: float) -> None:
    rng, ends, levels = np.random.default_rng(6), np.cumsum([0.0, *[30.0] * 45]), np.zeros(SAMPLES)
    ends += 3.0 * rng.normal(size=ends.size)
    for first in ends:
        levels[int(max(first, 0) * RATE) : int((first + share * 30) * RATE)] = 2.0
    assert two_levels_of(rng.normal(size=SAMPLES) + levels) is None
    assert two_levels_of(popcorn(rng, 2.0, 30 * share * RATE, share / (1 - share))) is not None
