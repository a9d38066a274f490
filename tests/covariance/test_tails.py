"""The covariance that heavy tails and a varying variance add to a wavelet variance, measured from the data."""

import numpy as np
import pytest

from gmwm import Signal, wavelet_variance
from gmwm.measuring.covariance.tails import TailSums, excess_covariance, with_tails

N, RATE = 100_000, 100.0


def measured(x, **options):
    signal = Signal(x, RATE, **options)
    return excess_covariance(signal, wavelet_variance(signal))


def student(freedom, seed, n=N):
    return np.random.default_rng(seed).standard_t(freedom, n) * np.sqrt((freedom - 2) / freedom)


def averaged(seed):
    return np.convolve(np.random.default_rng(seed).standard_normal(N), np.ones(3) / 3, mode="valid")


@pytest.mark.parametrize(
    "signal",
    [
        lambda seed: np.random.default_rng(seed).standard_normal(N),
        lambda seed: np.random.default_rng(seed).standard_normal(4000),
        lambda seed: np.cumsum(np.random.default_rng(seed).standard_normal(N)),
        lambda seed: np.diff(np.random.default_rng(seed).standard_normal(N)),
        averaged,
    ],
    ids=["white", "short", "walk", "difference", "averaged"],
)
def test_a_gaussian_signal_has_none(signal):
    assert all(measured(signal(seed)) is None for seed in range(8))


def test_light_tails_have_none():
    assert measured(np.random.default_rng(1).uniform(size=N)) is None


@pytest.mark.parametrize(("freedom", "kurtosis"), [(7.0, 2.0), (10.0, 1.0)])
def test_independent_samples_add_their_kurtosis_at_every_level(freedom, kurtosis):
    found = [measured(student(freedom, seed)) for seed in range(8)]
    assert all(one is not None for one in found)
    mean = N * np.mean(found, axis=0)
    assert mean[0, 0] == pytest.approx(kurtosis, rel=0.2)
    # White noise at every level: the factor is common to all, as far as the curve is known.
    assert mean[0, 5] == pytest.approx(kurtosis, rel=0.25)
    assert np.linalg.eigvalsh(found[0]).min() > -1e-12


@pytest.mark.slow
def test_it_is_the_scatter_of_the_estimates():
    curves = np.array([wavelet_variance(student(5, seed, 20_000), RATE).variance[:3] for seed in range(400)])
    scatter = 20_000 * np.cov((curves / curves.mean(axis=0)).T)
    excess = 20_000 * np.mean([measured(student(5, seed, 20_000))[:3, :3] for seed in range(40)], axis=0)
    gaussian = np.array([[3.0, 3.5 / 2, 3.75 / 4]])  # V_11 of white noise; the others only need the right order
    assert scatter[0, 0] == pytest.approx(gaussian[0, 0] + excess[0, 0], rel=0.3)
    assert 3.0 < excess[0, 0] < 7.0


def test_levels_of_another_process_have_a_smaller_loading():
    x = student(5, 1) + np.cumsum(0.03 * np.random.default_rng(2).standard_normal(N))
    excess = measured(x)
    loading = np.sqrt(np.diag(excess) / excess[0, 0])
    assert loading[0] > 0.98
    assert loading[12] < 0.1
    assert np.all(np.diff(loading) < 0.02)


def test_a_varying_variance_adds_more_than_its_kurtosis():
    rng = np.random.default_rng(3)
    scale = np.repeat(np.where(rng.random(50) < 0.5, 1.0, 1.5), N // 50)
    x = scale * rng.standard_normal(N)
    kurtosis = np.mean(x**4) / np.mean(x**2) ** 2 - 3
    assert N * measured(x)[0, 0] > 100 * kurtosis


def test_chunks_change_nothing_and_gaps_are_respected():
    x = student(5, 1, 300_000)
    signal = Signal(x, RATE, segments=((0, 200_000), (200_000, 300_000)))
    wv = wavelet_variance(signal)
    sums = TailSums()
    for first, last in ((0, 7), (7, 150_000), (150_000, 200_000)):
        sums.update(x[first:last])
    sums.gap()
    sums.update(x[200_000:])
    assert np.array_equal(sums.excess(wv), excess_covariance(signal, wv))


def test_the_covariance_is_wider_if_the_fourth_moment_is_infinite():
    """The mean square of Student noise with 2.5 degrees of freedom is within two standard errors of the variance."""
    n, inside, usual = 120_000, 0, 0
    for seed in range(20):
        values = np.random.default_rng(seed).standard_t(2.5, size=n) / np.sqrt(5)
        wv = wavelet_variance(values, rate=1.0)
        excess = excess_covariance(Signal(values, rate=1.0), wv)
        if excess is not None:
            inside += abs(wv.variance[0] / 0.5 - 1) < 2 * np.sqrt(excess[0, 0])
            usual += 1
    assert usual >= 15
    assert inside >= 0.85 * usual


def test_lags_share_the_tails_of_the_first_level_and_short_series_have_short_blocks():
    found = []
    for seed in range(12):
        x = Signal(np.random.default_rng(seed).standard_t(5, size=2000), 1.0)
        excess = with_tails(wavelet_variance(x, filter="haar + lags:2"), x).excess
        if excess is not None:
            np.testing.assert_array_equal(excess[:2, :2], excess[2, 2])
            np.testing.assert_array_equal(excess[:2, 3:], excess[[2, 2], 3:])
            found.append(excess[2, 2] * 2000)
    assert len(found) >= 6
    assert 2.0 < np.median(found) < 12.0  # the excess kurtosis is 6
    clean = [Signal(np.random.default_rng(seed).normal(size=2000), 1.0) for seed in range(20)]
    assert sum(with_tails(wavelet_variance(x, filter="haar + lags:2"), x).excess is not None for x in clean) <= 1
    assert with_tails(wavelet_variance(clean[0]), clean[0]).excess is None
