"""The exact covariance of the wavelet variance, against its definition in 40 digits and against simulation."""

from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest

import gmwm
from gmwm import AR1, DR, FN, GM, QN, RW, WN
from gmwm.measuring.covariance import nodes, wavelet_covariance
from gmwm.measuring.covariance.design import Design
from tests.helpers import each, raises
from tests.oracles import covariance as oracle

RATE = 100.0


def gauss_markov(beta, variance):
    with mp.workdps(40):
        return oracle.markov(mp.exp(-mp.mpf(beta) / mp.mpf(RATE)), variance)


CASES = {
    "white noise": (WN(1.5), [oracle.white(1.5)], 0.0),
    "quantization": (QN(0.7), [oracle.quantization(0.7)], 0.0, -1.2 * 0.7**2),
    "random walk": (RW(1e-4), [oracle.walk(1e-4)], 0.0),
    "wandering Gauss-Markov": (GM(1e-60, 2.0), [oracle.walk(4e-62)], 0.0),
    "slow Gauss-Markov": (GM(1e-6, 2.0), [gauss_markov(1e-6, 2.0)], 0.0),
    "Gauss-Markov": (GM(0.7, 2.0), [gauss_markov(0.7, 2.0)], 0.0),
    "fast Gauss-Markov": (GM(90.0, 2.0), [gauss_markov(90.0, 2.0)], 0.0),
    "white Gauss-Markov": (GM(9e3, 2.0), [gauss_markov(9e3, 2.0)], 0.0),
    "AR1": (AR1(0.9, 0.3), [oracle.markov(mp.mpf(0.9), 0.3 / (1 - 0.9**2))], 0.0),
    "negative AR1": (AR1(-0.97, 0.3), [oracle.markov(mp.mpf(-0.97), 0.3 / (1 - 0.97**2))], 0.0),
    "slow negative AR1": (
        AR1(-np.exp(-1e-4), 0.3),
        [oracle.markov(-mp.exp(mp.mpf(-1e-4)), 0.3 / -np.expm1(-2e-4))],
        0.0,
    ),
    "drift": (DR(0.01) + WN(1.0), [oracle.white(1.0)], 0.01),
    "everything": (
        GM(3.0, 1.0) + GM(0.05, 2.0) + WN(4.0) + QN(3.0) + RW(1e-4) + DR(-0.002),
        [gauss_markov(3, 1.0), gauss_markov(0.05, 2.0), oracle.white(4.0), oracle.quantization(3.0), oracle.walk(1e-4)],
        0.002,
        -1.2 * 3.0**2,
    ),
}  # fmt: skip


@pytest.mark.slow
@each("samples", [64, 200])
@each("name", CASES)
def test_against_the_definition(name, samples):
    model, parts, *rest = CASES[name]
    expected = oracle.wavelet_covariance(parts, samples.bit_length() - 1, samples, *rest)
    np.testing.assert_allclose(wavelet_covariance(model, samples, RATE), expected, rtol=1e-8)


def test_some_levels_are_those_of_all():
    model = GM(1.0, 1.0) + WN(4.0) + RW(1e-6)
    whole = wavelet_covariance(model, 5000, RATE)
    np.testing.assert_allclose(wavelet_covariance(model, 5000, RATE, levels=7), whole[:7, :7], rtol=1e-12)
    chosen = wavelet_covariance(model, 5000, RATE, levels=[2, 5, 11])
    np.testing.assert_allclose(chosen, whole[np.ix_([1, 4, 10], [1, 4, 10])], rtol=1e-12)


@pytest.mark.parametrize("factor", [2.0**-40, 2.0**40])
def test_scales_with_the_fourth_power(factor):
    def model(s):
        return GM(1.0, s * s) + WN(4.0 * s * s) + RW(1e-6 * s * s) + DR(1e-3 * s)

    one, scaled = (wavelet_covariance(model(s), 3000, RATE) for s in (1.0, factor))
    np.testing.assert_array_equal(scaled, one * factor**4)


@pytest.mark.parametrize("samples", [1000, 2**14, 10**6])
def test_is_a_covariance(samples):
    v = wavelet_covariance(GM(0.3, 1.0) + GM(5.0, 0.1) + WN(4.0) + RW(1e-7) + QN(1.0), samples, RATE)
    scale = np.sqrt(np.diag(v))
    assert np.linalg.eigvalsh(v / np.outer(scale, scale)).min() > 0


@pytest.mark.slow
def test_against_simulation():
    model, samples, paths = WN(1.0) + RW(1e-4) + GM(2.0, 0.5), 2048, 3000
    x = model.simulate(samples, RATE, np.random.default_rng(5), paths=paths)
    nu = np.array([gmwm.wavelet_variance(row, RATE).variance for row in x])
    v = np.diag(wavelet_covariance(model, samples, RATE))
    deviation = (nu - nu.mean(axis=0)) ** 2
    error = deviation.std(axis=0, ddof=1) / np.sqrt(paths)
    assert np.all(np.abs(deviation.mean(axis=0) - v) < 4 * error)


@pytest.mark.parametrize(
    ("model", "samples", "levels", "error", "fact"),
    [
        ("WN(sigma2=1.0)", 1.5, None, gmwm.errors.OptionError, "got 1.5"),
        ("WN(sigma2=1.0)", 100, 9, gmwm.errors.OptionError, "512 samples"),
        ("WN", 100, None, gmwm.errors.ModelError, "WN.sigma2"),
    ],
)
def test_refused(model, samples, levels, error, fact):
    with raises(error, fact):
        wavelet_covariance(model, samples, RATE, levels=levels)


@pytest.mark.parametrize("few_first", [False, True])
def test_the_first_levels_are_a_block_of_all_levels(few_first):
    # Both use the same nodes, of which the first levels have the first.
    nodes._grids.clear()
    for model in (GM(3.0, 1.0) + GM(0.05, 2.0) + FN(0.5) + RW(1e-4) + DR(-0.002), AR1(-0.6, 1.0) + AR1(0.9, 0.1)):
        sizes = (8, 14) if few_first else (14, 8)
        found = {levels: wavelet_covariance(model, 20_000, RATE, levels=levels) for levels in sizes}
        np.testing.assert_array_equal(found[8], found[14][:8, :8])


def test_a_root_that_rounds_to_one_has_the_nodes_of_the_others():
    def process(*decays):
        return SimpleNamespace(decays=lambda rate: decays, memory=lambda rate: 0)

    at = Design(np.arange(1, 10), samples=1024, rate=1.0)
    (_, weights, firsts), (_, expected, others) = (
        nodes.lags([process(*decays)], at, diagonal=False) for decays in ((0.0, 0.1), (0.1,))
    )
    np.testing.assert_array_equal(weights, expected)
    np.testing.assert_array_equal(firsts, others)
    assert nodes.lags([process(0.0)], at, diagonal=False)[1].size > 0
