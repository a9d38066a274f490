"""The covariance that heavy tails and a varying variance add to a wavelet variance, measured from the data."""

import numpy as np
import pytest

from gmwm import Signal, wavelet_variance
from gmwm.measuring.covariance.tails import UNKNOWN, TailSums, excess_covariance, with_tails

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
    assert 3.0 < excess[0, 0] < 9.0  # a short recording does not exclude that the fourth moment is infinite


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


@pytest.mark.parametrize(("freedom", "unknown"), [(2.1, (5, 20)), (2.5, (0, 2)), (3.0, (0, 0))])
def test_the_covariance_covers_the_variance_if_the_fourth_moment_is_infinite(freedom, unknown):
    errors, truth = [], freedom / (freedom - 2)
    for seed in range(20):
        values = student(freedom, seed, 60_000 + 12_000 * seed) * np.sqrt(truth)
        wv = wavelet_variance(values, rate=1.0)
        errors.append((np.log(2 * wv.variance[0] / truth), np.sqrt(excess_covariance(Signal(values, 1.0), wv)[0, 0])))
    known = [(error, sigma) for error, sigma in errors if sigma < 0.99 * UNKNOWN]
    assert unknown[0] <= 20 - len(known) <= unknown[1]
    assert sum(abs(error) < 2 * sigma for error, sigma in known) >= 0.8 * len(known)


def test_rare_loud_samples_with_a_finite_fourth_moment_are_no_power_law():
    for seed in range(8):
        rng = np.random.default_rng(seed)
        loud = np.where(rng.random(N) < 0.01, 10.0, 1.0)
        assert measured(loud * rng.standard_normal(N))[0, 0] < 0.08**2


def test_equal_extremes_have_no_tail():
    for share in (0.02, 0.5):  # the logarithm of differences of 1 is exactly 0
        excess = measured(np.random.default_rng(1).choice([0.0, 1.0], N, p=[1 - share, share]))
        assert excess is None or np.all(np.isfinite(excess))


@pytest.mark.parametrize("size", [127_488, 127_615])
def test_every_length_can_be_measured(size):
    assert measured(np.random.default_rng(1).standard_normal(size)) is None


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
