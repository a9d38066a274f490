"""The covariance of a wavelet variance with sinusoids, against matrices, all phases, and simulation."""

import tracemalloc

import numpy as np
import pytest

from gmwm import DR, FN, GM, RW, WN
from gmwm.base.errors import MissingTheoryError, ModelError
from gmwm.fitting.estimation.reweighting import implied_weights
from gmwm.measuring.covariance import covariance, lines, ratio_variances, variances, wavelet_covariance
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.transform import deepest_level
from gmwm.measuring.variance.transform import variances as measured
from gmwm.theory.filters import find_filter
from gmwm.theory.processes import MAT, SIN, Model
from tests.covariance.filter_rows import rows
from tests.helpers import each, raises

RATE = 100.0


def design(samples, filter="haar", transform="modwt", efficiency=None):
    found = find_filter(filter)
    return Design(
        np.arange(1, deepest_level(samples, found, transform) + 1), samples, RATE, found, transform, efficiency
    )


def added(model, at):
    """What two lines add to V: filter rows, and the mean over a grid of both phases, which is exact for such waves."""
    filters, t = rows(at), np.arange(at.samples)
    noise = np.zeros((at.samples, at.samples))
    for process in model.processes:
        if isinstance(process, RW):
            noise += process.scale * np.minimum.outer(t + 1, t + 1)
        elif isinstance(process, WN | GM):
            noise += process.autocovariance(t, RATE)[np.abs(np.subtract.outer(t, t))]
    waves = [p for p in model.processes if isinstance(p, SIN)]
    trend, grid = model.mean(t), 2 * np.pi * np.arange(8) / 8
    paths, phases = [], np.stack(np.meshgrid(*[grid] * len(waves), indexing="ij"), axis=-1).reshape(-1, len(waves))
    for phase in phases:
        turns = [2 * np.pi * p.value("frequency") * t / RATE + u for p, u in zip(waves, phase, strict=True)]
        paths.append(sum(np.sqrt(2 * p.scale) * np.sin(x) for p, x in zip(waves, turns, strict=True)))
    coefficients = [(f @ np.array(paths).T).T for f in filters]
    squares = np.array([np.mean((w + f @ trend) ** 2, axis=1) for w, f in zip(coefficients, filters, strict=True)])
    total = np.cov(squares, bias=True)
    for a, first in enumerate(filters):
        for b, second in enumerate(filters):
            shared = coefficients[a].T @ coefficients[b] / len(paths)
            total[a, b] += 4 * np.mean(shared * (first @ noise @ second.T))
    return total


MODELS = {
    "white noise": WN(1.0) + SIN(3.0, 2.0),
    "random walk": RW(1e-3) + SIN(0.7, 2.0) + WN(0.1),
    "two lines that beat, a drift": GM(3.0, 1.0) + SIN(7.1, 2.0) + SIN(6.6, 1.0) + DR(0.02) + WN(1.0),
    "an alias": WN(1.0) + SIN(110.0, 2.0) + SIN(49.9, 3.0),
    "half the rate": WN(1.0) + SIN(50.0, 2.0),
}


@pytest.mark.slow
@each("name", MODELS)
@each(("filter", "transform"), [("haar", "modwt"), ("haar", "dwt"), ("d4", "modwt"), ("la8", "dwt")])
def test_against_matrices(name, filter, transform):
    model, at = MODELS[name], design(130, filter, transform)
    noise, waves = lines.apart(model, at)
    size = np.sqrt(np.diag(covariance(model, at)))
    found = lines.excess(noise, waves, at, diagonal=False)
    np.testing.assert_allclose(found / np.outer(size, size), added(model, at) / np.outer(size, size), atol=1e-10)
    np.testing.assert_allclose(variances(model, at), np.diag(covariance(model, at)), rtol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [0.02, 0.1, 1.0, 13.0, 50.0])
@pytest.mark.parametrize("noise", [GM(2.0, 1.0) + WN(1.0), RW(1e-3) + WN(1.0), FN(1.0) + WN(1.0), DR(0.1) + RW(1e-3)])
def test_the_spectrum_and_lags_apart_will_do(noise, frequency, monkeypatch):
    model, at = noise + SIN(frequency, 20.0), design(2**13)
    exact = covariance(model, at)
    monkeypatch.setattr(lines, "ALL_LAGS", 2**11)
    size = np.sqrt(np.diag(exact))
    found, expected = (v / np.outer(size, size) for v in (covariance(model, at), exact))
    # Little: a fit asks for standard errors, the half of it, and at a record of 2^14 samples and more it is less.
    np.testing.assert_allclose(found, expected, atol=2e-2)


def test_the_spectrum_of_a_long_recording_needs_the_memory_of_its_noise_alone():
    matern = MAT(sigma2=1.0, beta=3.0, nu=1.5)
    reach = matern.memory(RATE)
    lags = np.arange(-1, 40 * reach)
    known = type(matern).standard(matern.nonlinear).generalised_covariance(lags, RATE)
    difference = (known[1:-1] - known[:-2]) - (known[2:] - known[1:-1])
    turns = np.cos(2 * np.pi * 0.1 * np.arange(difference.size))
    expected = (2 * difference @ turns - difference[0]) / (4 * np.sin(0.1 * np.pi) ** 2)
    tracemalloc.start()
    density = lines._density(matern + DR(0.02), [0.1], design(2**24))
    largest = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    np.testing.assert_allclose(density, expected, rtol=1e-9)
    assert largest < 2**23  # all lags would need 2^27 bytes


@pytest.mark.slow
@pytest.mark.parametrize("model", [GM(2.0, 1.0) + WN(1.0) + SIN(3.0, 2.0), WN(1.0) + SIN(0.05, 2.0)])
def test_against_simulation(model):
    at, rng = design(2048), np.random.default_rng(3)
    haar = find_filter("haar")
    nu = np.array(
        [measured(row, haar, "modwt", 11) for _ in range(4) for row in model.simulate(2048, RATE, rng, paths=500)]
    )
    apart = nu - model.wavelet_variance(11, RATE)
    products = apart[:, :, None] * apart[:, None, :]
    error = products.std(axis=0) / np.sqrt(len(nu))
    assert np.all(np.abs(products.mean(axis=0) - covariance(model, at)) <= 4 * error)


def test_a_line_scatters_less_than_noise_of_its_variance():
    line, noise = WN(1.0) + SIN(3.0, 50.0), WN(1.0) + GM(19.0, 50.0)
    assert np.all(variances(line, design(4096))[:6] < 0.2 * variances(noise, design(4096))[:6])


def test_scaling_and_segments():
    model, small = WN(1.0) + SIN(3.0, 2.0), WN(1e-12) + SIN(3.0, 2e-12)
    v = wavelet_covariance(model, 4096, RATE)
    np.testing.assert_allclose(wavelet_covariance(small, 4096, RATE), 1e-24 * v, rtol=1e-9)
    # Two segments of one length count as two records, phases and all.
    np.testing.assert_allclose(wavelet_covariance(model, (4096, 4096), RATE), v / 2, rtol=1e-12)


def test_a_line_of_no_power_or_of_frequency_zero_adds_nothing():
    v = wavelet_covariance(WN(1.0), 1000, RATE)
    assert np.all(wavelet_covariance(SIN(3.0, 0.0), 1000, RATE) == 0)
    for line in (SIN(3.0, 0.0), SIN(RATE, 5.0)):
        np.testing.assert_array_equal(wavelet_covariance(WN(1.0) + line, 1000, RATE), v)


def test_robust_estimates_of_lines_are_refused():
    model: Model = WN(1.0) + SIN(3.0, 2.0)
    with raises(MissingTheoryError, "SIN", advises=["robust=False"]):
        wavelet_covariance(model, 1000, RATE, robust=True)
    with raises(MissingTheoryError, "SIN", advises=["robust=False"]):
        ratio_variances(model, design(1000, efficiency=0.6))


def test_a_line_alone_is_no_noise_to_weigh_levels_by():
    # Of 25 Hz at 100 Hz nothing is left from level 3 on.
    with raises(ModelError, "no noise at some level"):
        implied_weights("diagonal", Model((SIN(25.0, 1.0),)), design(4096))
    # Its phase is the same at all levels of the Haar filter.
    assert np.linalg.matrix_rank(wavelet_covariance(SIN(0.1, 2.0), 1000, RATE)) == 1
