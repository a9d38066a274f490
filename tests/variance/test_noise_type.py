"""The noise that rules: pure noises are recognised at every cluster size that has enough values."""

import numpy as np
import pytest

from gmwm.measuring.variance.allan import allan_variance, hadamard_variance
from gmwm.measuring.variance.noise_type import AUTOCORRELATION, NOISE_TYPES, b1_ratio, noise_type


def flicker(size, generator, warm_up=8192):
    """Fractional noise (1 - B)^(-1/2) of white noise, by its moving average."""
    n = size + warm_up
    k = np.arange(1, n)
    weights = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    length = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(weights, length) * np.fft.rfft(generator.normal(size=n), length)
    return np.fft.irfft(spectrum, length)[warm_up:n]


def phase_of(alpha, size, seed):
    """A record of the phase of noise of exponent α."""
    generator = np.random.default_rng(seed)
    x = flicker(size, generator) if alpha % 2 else generator.normal(size=size)
    for _ in range((1 - alpha) // 2 if alpha % 2 else (2 - alpha) // 2):
        x = np.cumsum(x)
    return x


@pytest.mark.parametrize(
    ("estimate", "alpha", "least"),
    [(allan_variance, alpha, 0.9) for alpha in (2, 1, 0, -1, -2)] + [(hadamard_variance, a, 0.85) for a in (0, -2, -4)],
)
def test_noises(estimate, alpha, least):
    name = next(noise.name for noise in NOISE_TYPES if noise.exponent == alpha)
    right = total = 0
    for seed in range(6):
        result = estimate(phase_of(alpha, 4096, seed), rate=1.0, data="phase")
        enough = result.clusters <= 4096 // 60
        right += sum(np.array(result.noise)[enough] == name)
        total += np.count_nonzero(enough)
    assert right / total > least


@pytest.mark.parametrize("alpha", [2, 1, 0, -2])
def test_few_clusters_are_judged_by_the_ratio(alpha):
    # Ten to twenty-nine values of the phase: the type is right or its neighbour, nearly always.
    near = 0
    for seed in range(40):
        result = allan_variance(phase_of(alpha, 20 * 64 + 1, 1000 + seed), rate=1.0, data="phase", clusters=[64])
        near += abs(noise_type(result.noise[0]).exponent - alpha) <= 1
    assert near >= 34


def test_where_data_are_too_few_the_last_type_stands():
    result = allan_variance(phase_of(0, 2048, 3), rate=1.0, data="phase")
    few = 2048 // result.clusters < 10
    assert few.sum() >= 2
    assert len(set(np.array(result.noise)[few])) == 1
    assert result.noise[-1] == np.array(result.noise)[~few][-1]


def test_a_ramp_is_told_from_a_random_walk():
    generator = np.random.default_rng(8)
    noisy = generator.normal(size=20_000) + 0.003 * np.arange(20_000)
    result = allan_variance(noisy, rate=1.0)
    assert result.noise[0] == "white FM"
    assert result.noise[-1] == "drift"
    assert result.noise_terms[-1] == "rate ramp"
    assert "drift" not in hadamard_variance(noisy, rate=1.0).noise
    assert set(allan_variance(np.arange(2000.0), rate=1.0).noise) == {"drift"}
    walks = [allan_variance(np.cumsum(generator.normal(size=4096)), rate=1.0).noise for _ in range(20)]
    assert sum(noise.count("drift") for noise in walks) < 0.1 * sum(map(len, walks))


def test_autocorrelations_are_those_of_the_covariance():
    from gmwm.measuring.variance.noise_type import _covariance

    for d, known in AUTOCORRELATION.items():
        for alpha, r1 in known.items():
            # White PM is uncorrelated: binomial coefficients alone.
            expected = -(d / (d + 1))
            if alpha <= 0:
                s = _covariance(np.array([[0.0, 1.0]]), np.array([[np.inf]]), alpha, d, False)[0]
                expected = s[1] / s[0]
            assert r1 == pytest.approx(expected, abs=1e-4), (d, alpha)


def test_inertial_words():
    assert noise_type("white PM").term == "quantization noise"
    assert noise_type("flicker FM").term == "bias instability"
    assert noise_type("random walk FM").term == "rate random walk"
    quantized = np.diff(np.random.default_rng(4).normal(size=3000))
    assert allan_variance(quantized, rate=1.0).noise_terms[0] == "quantization noise"


@pytest.mark.parametrize("means", [5, 12, 40])
def test_b1_ratio_is_continuous_and_known(means):
    # NIST SP 1065: 1 for white FM, N/2 for random walk FM, (N + 1)/(1.5 N) for white PM.
    assert b1_ratio(means, -1) == pytest.approx(1.0)
    assert b1_ratio(means, 1) == pytest.approx(means / 2)
    assert b1_ratio(means, -2) == pytest.approx((means + 1) / (1.5 * means))
    ratios = [b1_ratio(means, mu) for mu in (-2, -1, 0, 1, 2)]
    assert ratios == sorted(ratios)
