"""The covariance of Haar wavelet variances against double sums over all lags; robust, uniform errors, the diagonal."""

import numpy as np
import pytest

import gmwm
from gmwm import AR1, DR, GM, QN, RW, WN
from gmwm.measuring.covariance import Design, variances, wavelet_covariance
from gmwm.measuring.covariance.robust import hermite_weights
from gmwm.measuring.variance.biweight import biweight
from gmwm.theory.processes.model import as_model
from tests.helpers import raises
from tests.oracles import covariance as oracle

RATE = 10.0
MIXTURE = GM(0.3, 1.0) + GM(0.01, 2.0) + WN(4.0) + RW(1e-5) + QN(2.0) + DR(1e-3)


def random_model(seed):
    """A sum of processes drawn by lot, the covariance of its signal at all lags, and its drift."""
    rng = np.random.default_rng(seed)
    samples = int(rng.integers(300, 4097)) if seed else 1024
    size = dict(zip("wqrgh", 10 ** rng.uniform(-3, 3, 5), strict=True))
    slow, fast = np.sort(10 ** rng.uniform(-5, 1.5, 2))
    slope = float(rng.choice([0.0, 1e-4]))
    alternating = rng.random() < 0.3
    terms = [
        (WN(size["w"]), ("white", size["w"], 0.0)),
        (RW(size["r"] / samples), ("walk", size["r"] / samples, 0.0)),
    ]
    if alternating:
        # Slower ones have coefficients so much smaller than the signal that the double sum is the one to go wrong.
        decay = max(fast, 0.1) / RATE
        terms += [(AR1(-np.exp(-decay), -size["g"] * np.expm1(-2 * decay)), ("alternating", size["g"], decay))]
    else:
        terms += [
            (GM(slow, size["g"]), ("markov", size["g"], slow / RATE)),
            (GM(fast, size["h"]), ("markov", size["h"], fast / RATE)),
        ]
    chosen = [terms[k] for k in range(len(terms)) if k == len(terms) - 1 or rng.random() < 0.6]
    model = sum((process for process, _ in chosen), DR(slope))
    return model, sum(oracle.autocovariances(*theory, samples) for _, theory in chosen), samples, slope


def double_sum(covariance, levels, samples, slope, weights):
    """V from the covariance of the signal, ν_j² ν_k² Σ_q c_q Σ_u n(u) ρ^q / (M_j M_k), c = (2,) of a classical one."""
    v = np.zeros((levels, levels))
    own = []
    for j in range(1, levels + 1):
        values, _ = oracle.lagged(covariance, j, j, samples)
        own.append(values[samples - 2**j])
    for j in range(1, levels + 1):
        for k in range(j, levels + 1):
            values, pairs = oracle.lagged(covariance, j, k, samples)
            size, mean = own[j - 1] * own[k - 1], slope**2 * 2.0 ** (j + k) / 16
            squares = values**2 / size
            c = weights if samples - 2**k + 1 > 2 else weights[:1]
            terms = size * squares * np.polyval(c[::-1], squares) + 4 * mean * values
            count = (samples - 2**j + 1) * (samples - 2**k + 1)
            v[j - 1, k - 1] = v[k - 1, j - 1] = pairs @ terms / count
    return v


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_random_models_against_the_double_sum(seed):
    model, covariance, samples, slope = random_model(seed)
    levels = samples.bit_length() - 1
    expected = double_sum(covariance, levels, samples, slope, [2.0])
    np.testing.assert_allclose(wavelet_covariance(model, samples, RATE), expected, rtol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("efficiency", [0.3, 0.6, 0.95])
@pytest.mark.parametrize("seed", range(4))
def test_robust_against_the_double_sum(seed, efficiency):
    model, covariance, samples, slope = random_model(seed)
    levels = samples.bit_length() - 1
    expected = double_sum(covariance, levels, samples, slope, hermite_weights(efficiency))
    got = wavelet_covariance(model, samples, RATE, robust=True, efficiency=efficiency)
    np.testing.assert_allclose(got, expected, rtol=1e-6)


@pytest.mark.parametrize("efficiency", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("rho", [0.2, 0.6, 0.9, 1.0])
def test_hermite_weights_are_the_covariance_of_two_scores(efficiency, rho):
    # Σ c_q ρ^q = Cov(ρ(x), ρ(y)) / b_2² by its definition, a double integral over two correlated normal numbers.
    c = biweight(efficiency).c
    x, w = np.polynomial.legendre.leggauss(200)
    x, w = c * x, c * w * np.exp(-((c * x) ** 2) / 2) / np.sqrt(2 * np.pi)
    score = x**2 * (1 - (x / c) ** 2) ** 4
    mean, second = w @ score, w @ (score * (x**2 - 1)) / 2
    if rho == 1.0:
        joint = w @ score**2
    else:
        density = np.exp(-((x[None, :] - rho * x[:, None]) ** 2) / (2 * (1 - rho**2)) + x[None, :] ** 2 / 2)
        joint = (w * score) @ density @ (w * score) / np.sqrt(1 - rho**2)
    expected = (joint - mean**2) / second**2
    got = rho**2 * np.polyval(hermite_weights(efficiency)[::-1], rho**2)
    assert got == pytest.approx(expected, rel=3e-5)


def test_robust_tends_to_classical():
    model = GM(0.3, 1.0) + WN(4.0) + RW(1e-5)
    classical = wavelet_covariance(model, 3000, RATE)
    robust = wavelet_covariance(model, 3000, RATE, robust=True, efficiency=0.99)
    ratio = np.diag(robust / classical)
    assert np.all((ratio > 1.0) & (ratio < 1 / 0.99))
    inflation = wavelet_covariance(WN(1.0), 2**14, RATE, robust=True) / wavelet_covariance(WN(1.0), 2**14, RATE)
    np.testing.assert_allclose(np.diag(inflation)[[0, 2, 6]], [1.49, 1.33, 1.28], atol=0.006)


@pytest.mark.slow
def test_uniform_errors_scatter_less():
    # By simulation: 0.69 of what Gaussian errors would have, at the first levels.
    paths, samples = 20_000, 64
    x = QN(0.5).simulate(samples, RATE, np.random.default_rng(3), paths=paths)
    nu = np.array([gmwm.wavelet_variance(row, RATE, levels=3).variance for row in x])
    deviation = (nu - nu.mean(axis=0)) ** 2
    error = deviation.std(axis=0) / np.sqrt(paths)
    v = np.diag(wavelet_covariance(QN(0.5), samples, RATE, levels=3))
    assert np.all(np.abs(deviation.mean(axis=0) - v) < 4 * error)
    gaussian = v - QN(0.5).error_cumulant * np.diag(oracle.shared_errors(3, samples))
    np.testing.assert_allclose(v / gaussian, 0.69, atol=0.02)
    assert np.all(0.29 * gaussian > 8 * error)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("model", [MIXTURE, WN(1.0), AR1(-0.9, 1.0) + WN(2.0), QN(1.0)])
def test_variances_are_the_diagonal(model, robust):
    design = Design(np.array([1, 2, 5, 9]), 1000, RATE, efficiency=0.6 if robust else None)
    whole = wavelet_covariance(model, 1000, RATE, levels=design.levels, robust=robust)
    np.testing.assert_allclose(variances(as_model(model), design), np.diag(whole), rtol=1e-12)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("factor", [1e-12, 1e12])
def test_scaling_the_signal_scales_by_the_fourth_power(factor, robust):
    def model(s):
        return GM(1.0, s * s) + WN(4.0 * s * s) + RW(1e-6 * s * s) + QN(s * s) + DR(1e-3 * s)

    one, scaled = (wavelet_covariance(model(s), 3000, RATE, robust=robust) for s in (1.0, factor))
    np.testing.assert_allclose(scaled, one * factor**4, rtol=1e-9)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_is_positive_definite(seed, robust):
    model, *_ = random_model(seed)
    v = wavelet_covariance(model, 5000, RATE, robust=robust)
    scale = np.sqrt(np.diag(v))
    assert np.linalg.eigvalsh(v / np.outer(scale, scale)).min() > 0


def test_no_noise_has_no_covariance():
    for robust in (False, True):
        np.testing.assert_array_equal(wavelet_covariance(WN(0.0), 100, RATE, robust=robust), np.zeros((6, 6)))


def test_setting_of_a_wavelet_variance():
    x = np.random.default_rng(2).normal(size=500)
    wv = gmwm.wavelet_variance(x, RATE, filter="d4", transform="dwt", robust=True)
    design = Design.of(wv)
    np.testing.assert_array_equal(design.counts, wv.counts)
    assert (design.samples, design.rate, design.filter.name) == (500, RATE, "d4")
    assert (design.transform, design.efficiency) == ("dwt", 0.6)


@pytest.mark.parametrize(
    ("options", "fact"),
    [
        ({"transform": "cwt"}, "'modwt' or 'dwt'"),
        ({"robust": True, "efficiency": 2.0}, "efficiency"),
        ({"filter": "d4", "levels": 9}, "1534 samples"),
    ],
)
def test_options_are_checked(options, fact):
    with raises(gmwm.errors.OptionError, fact):
        wavelet_covariance(WN(1.0), 500, RATE, **options)
