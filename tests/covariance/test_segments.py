"""The covariance of the wavelet variance of a recording with gaps, against simulation and against its definition."""

import numpy as np
import pytest

import gmwm
from gmwm import DR, GM, QN, RW, WN
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.measuring.covariance import as_design, covariance, ratio_variances, segments, variances, wavelet_covariance
from gmwm.theory.processes.model import as_model
from tests.helpers import raises

RATE = 100.0
MODELS = {
    "white noise": WN(1.0),
    "quantization": QN(1.0),
    "random walk": RW(1.0),
    "Gauss-Markov": GM(5.0, 1.0) + WN(1.0),
    "drift": DR(0.05) + WN(1.0),
    "several": WN(1.0) + RW(0.01),
}


def design(lengths, filter="haar", transform="modwt", efficiency=None, levels=None):
    return as_design(lengths, RATE, levels, filter, transform, efficiency)


def scores(model, how, draws=6000):
    """Standard errors between the covariance of simulated recordings and the exact one, of all pairs of levels."""
    rows = simulated_variances(as_model(model), how, draws, seed=1)
    centred = rows - rows.mean(axis=0)
    products = centred[:, :, None] * centred[:, None, :]
    error = products.std(axis=0) / np.sqrt(draws)
    mean = rows.mean(axis=0) - as_model(model).wavelet_variance(how.levels, RATE, how.filter)
    return (products.mean(axis=0) - covariance(as_model(model), how)) / error, mean / rows.std(axis=0) * np.sqrt(draws)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_against_simulation(name):
    covariances, means = scores(MODELS[name], design((60, 40, 5, 3, 3, 1)))
    assert np.abs(covariances).max() < 4
    assert np.abs(means).max() < 4


@pytest.mark.slow
@pytest.mark.parametrize(("filter", "transform"), [("d4", "modwt"), ("haar", "dwt")])
def test_other_transforms_against_simulation(filter, transform):
    covariances, _ = scores(MODELS["several"], design((60, 40), filter, transform), draws=5000)
    assert np.abs(covariances).max() < 4


@pytest.mark.slow
def test_robust_against_simulation():
    # Of many coefficients: the expansion is that of large samples.
    how = design((300, 200), efficiency=0.6, levels=4)
    rows = simulated_variances(as_model("WN(sigma2=1.0)"), how, 4000, seed=1)
    ratio = rows.var(axis=0) / np.diag(covariance(as_model("WN(sigma2=1.0)"), how))
    assert np.all(np.abs(ratio - 1) < 4 * np.sqrt(2 / 4000) + 0.02)


def test_segments_are_the_weighted_sum_of_their_own():
    lengths, model = (500, 333, 500, 70, 6, 1), MODELS["Gauss-Markov"] + RW(1e-3)
    how = design(lengths)
    total = np.zeros((how.levels.size,) * 2)
    for length in lengths:
        if length < 2:
            continue
        alone = design(length)
        own, part = alone.counts.astype(float), wavelet_covariance(model, length, RATE)
        total[: own.size, : own.size] += part * np.outer(own, own)
    counts = how.counts.astype(float)
    np.testing.assert_allclose(covariance(model, how), total / np.outer(counts, counts), rtol=1e-12)
    np.testing.assert_allclose(variances(model, how), np.diag(total) / counts**2, rtol=1e-12)
    np.testing.assert_array_equal(wavelet_covariance(model, lengths, RATE), covariance(model, how))


def test_far_apart_segments_tell_more_than_neighbours_but_less_than_a_longer_record():
    whole = np.diag(wavelet_covariance(WN(1.0), 1000, RATE, levels=6))
    halves = np.diag(wavelet_covariance(WN(1.0), (500, 500), RATE, levels=6))
    assert np.all(halves > whole)
    np.testing.assert_allclose(halves, np.diag(wavelet_covariance(WN(1.0), 500, RATE, levels=6)) / 2, rtol=1e-12)


@pytest.mark.slow
def test_many_lengths_are_interpolated(monkeypatch):
    lengths = np.random.default_rng(1).integers(1, 900, size=300).tolist()
    how, model = design(lengths), MODELS["Gauss-Markov"]
    quick = covariance(model, how)
    monkeypatch.setattr(segments, "EXACT_LENGTHS", len(lengths))
    exact = covariance(model, how)
    np.testing.assert_allclose(np.diag(quick)[:-1], np.diag(exact)[:-1], rtol=2e-3)
    assert np.diag(quick)[-1] == pytest.approx(np.diag(exact)[-1], rel=1e-2)
    assert np.linalg.eigvalsh(quick)[0] > 0


def test_the_spread_of_classical_over_robust_is_pooled_too():
    model = as_model("WN(sigma2=1.0)")
    alone = ratio_variances(model, design(4000, efficiency=0.6, levels=4))
    pooled = ratio_variances(model, design((4000, 4000), efficiency=0.6, levels=4))
    np.testing.assert_allclose(pooled, alone / 2, rtol=1e-12)


def test_the_covariance_from_the_data_of_segments():
    rng = np.random.default_rng(3)
    lengths = (30_000, 21_000, 40_000)
    edges = np.cumsum([0, *lengths])
    segments = tuple(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    x = gmwm.Signal(rng.normal(size=edges[-1]), RATE, segments=segments)
    found = gmwm.covariance.empirical_covariance(x, levels=8)
    ratio = np.diag(found) / np.diag(wavelet_covariance(WN(1.0), lengths, RATE, levels=8))
    assert np.all(np.abs(np.log(ratio)) < 0.6)


@pytest.mark.parametrize("lengths", [(), (100, 0), (100, 2.5), (1, 1)])
def test_lengths_that_are_none_are_refused(lengths):
    with raises(gmwm.errors.OptionError, "at least 2", argument="samples", got=lengths):
        wavelet_covariance(WN(1.0), lengths, RATE)
