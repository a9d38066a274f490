"""The covariance of the wavelet variance under any filter, against matrices of filter rows."""

from dataclasses import dataclass

import numpy as np
import pytest

from gmwm import AR1, DR, GM, QN, RW, WN
from gmwm.measuring.covariance import covariance, filtered, gaussian, variances
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.robust import hermite_weights
from gmwm.measuring.variance.transform import deepest_level
from gmwm.theory.filters import find_filter
from gmwm.theory.processes import Parameter, Process
from gmwm.theory.processes.model import as_model
from gmwm.theory.processes.parameter import Value
from tests.covariance.filter_rows import rows
from tests.helpers import each

RATE = 100.0
MODELS = {
    "white noise": WN(2.0),
    "quantization": QN(1.5),
    "random walk": RW(1e-3),
    "Gauss-Markov": GM(3.0, 2.0),
    "slow Gauss-Markov": GM(1e-3, 2.0),
    "AR1": AR1(0.95, 1.0),
    "negative AR1": AR1(-0.9, 1.0),
    "sum with a drift": WN(1.0) + RW(1e-3) + GM(3.0, 1.0) + QN(2.0) + DR(0.01),
}


def design(filter, transform="modwt", samples=130, efficiency=None, levels=None):
    found = find_filter(filter)
    levels = np.arange(1, deepest_level(samples, found, transform) + 1) if levels is None else levels
    return Design(levels, samples, RATE, found, transform, efficiency)


def signal_covariance(model, samples):
    t, total = np.arange(samples), np.zeros((samples, samples))
    for process in model.processes:
        if isinstance(process, RW):
            total += process.scale * np.minimum.outer(t + 1, t + 1)
        elif not isinstance(process, DR):
            total += process.autocovariance(t, RATE)[np.abs(np.subtract.outer(t, t))]
    return total


def by_matrices(model, at, joined):
    """V with joined(Cov(W_j, W_k), ν_j², ν_k²) in the place of twice the square."""
    filters, signal = rows(at), signal_covariance(model, at.samples)
    cumulant = sum(-1.2 * p.scale**2 for p in model.processes if isinstance(p, QN)) if at.efficiency is None else 0.0
    errors = np.diff(np.eye(at.samples + 1), axis=0)
    slope, size = model.mean(np.arange(at.samples)), len(filters)
    v = np.zeros((size, size))
    for a, first in enumerate(filters):
        for b, second in enumerate(filters):
            c = first @ signal @ second.T
            own = [row[0] @ signal @ row[0] for row in (first, second)]
            terms = joined(c, *own) + 4 * np.outer(first @ slope, second @ slope) * c
            terms += cumulant * (first @ errors) ** 2 @ ((second @ errors) ** 2).T
            v[a, b] = terms.mean()
    return v


def classical(c, own, other):
    return 2 * c * c


def assert_close(found, expected, tolerance):
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=tolerance, rtol=0)


@pytest.mark.slow
@each("name", MODELS)
@each(
    ("filter", "transform"),
    [("haar", "dwt"), ("d4", "modwt"), ("d4", "dwt"), ("la8", "modwt"), ("bl14", "dwt"), ("fk4", "modwt")],
)
def test_against_matrices(name, filter, transform):
    model, at = as_model(MODELS[name]), design(filter, transform)
    assert_close(covariance(model, at), by_matrices(model, at, classical), 1e-8)


@pytest.mark.parametrize("transform", ["modwt", "dwt"])
def test_robust_against_matrices(transform):
    # No level here has so few coefficients that its robust estimate is the classical one.
    at = design("la8", transform, efficiency=0.6, levels=np.arange(1, 4))
    weights = hermite_weights(0.6)

    def hermite(c, own, other):
        rho2 = c * c / (own * other)
        return own * other * sum(weight * rho2 ** (q + 1) for q, weight in enumerate(weights))

    for model in (as_model(MODELS["Gauss-Markov"]), as_model(MODELS["sum with a drift"])):
        assert_close(covariance(model, at), by_matrices(model, at, hermite), 1e-6)


@pytest.mark.parametrize("efficiency", [None, 0.8])
def test_haar_is_that_of_the_closed_forms(efficiency):
    at = design("haar", samples=1000, efficiency=efficiency)
    model = as_model(WN(1.0) + RW(1e-3) + GM(0.3, 1.0) + DR(0.01) + QN(3.0))
    assert_close(filtered.covariance(model, at), gaussian.covariance(model, at), 1e-6 if efficiency else 1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("filter", ["haar", "d4", "la8", "fk8"])
def test_lags_apart_will_do(name, filter, monkeypatch):
    model, at = as_model(MODELS[name]), design(filter, samples=3000)
    exact = filtered.covariance(model, at)
    monkeypatch.setattr(filtered, "LEAST_LAGS", 1)
    found = filtered.covariance(model, at)
    # Spikes are found to need all lags; the others are not.
    assert name in ("quantization", "negative AR1") or not np.array_equal(found, exact)
    # An alternating process has two scales, and is worst.
    assert_close(found, exact, 5e-4 if name == "negative AR1" else 5e-5)
    np.testing.assert_allclose(filtered.variances(model, at), np.diag(found), rtol=1e-12)


def test_is_a_covariance_at_any_length_and_scale():
    at = design("d4", samples=20_000)
    model = as_model(GM(0.3, 1.0) + WN(4.0) + RW(1e-7) + QN(1.0))
    v = covariance(model, at)
    size = np.sqrt(np.diag(v))
    assert np.linalg.eigvalsh(v / np.outer(size, size))[0] > 1e-3
    s = 1e-12
    small = as_model(GM(0.3, s) + WN(4.0 * s) + RW(1e-7 * s) + QN(1.0 * s))
    np.testing.assert_allclose(covariance(small, at), s * s * v, rtol=1e-9)
    np.testing.assert_allclose(variances(model, at), np.diag(v), rtol=1e-12)
    some = design("d4", samples=20_000, levels=np.array([2, 5, 9]))
    np.testing.assert_allclose(covariance(model, some), v[np.ix_([1, 4, 8], [1, 4, 8])], rtol=1e-12)


@dataclass(frozen=True, repr=False)
class Own(Process, register=False):
    """A moving average that gives the covariance of its running sum, and nothing else."""

    name, title = "Own", "A process of one's own"
    parameters = (Parameter("sigma2", "σ²", "variance", signal_power=2, scale_power=1),)
    sigma2: Value = None

    def running_sum_covariance(self, lags, rate):
        m = np.abs(np.asarray(lags))
        return -0.5 * self.scale * np.where(m == 0, 0.0, 2.25 * m - 1.0)


def test_a_process_of_ones_own():
    # σ²(1 + θ²) = 1.25 and σ²θ = 0.5 are those of X_t = ε_t + ε_{t−1}/2.
    own = Own(sigma2=2.0)
    np.testing.assert_allclose(
        own.generalised_covariance([0, 1, -1, 2, 9], RATE), [2.5, 1.0, 1.0, 0.0, 0.0], atol=1e-12
    )
    at = design("haar", samples=100)
    assert np.all(variances(as_model(own), at) > 0)


@pytest.mark.parametrize("process", [WN(2.0), QN(1.5), GM(3.0, 2.0), GM(1e-3, 2.0), AR1(-0.9, 1.0), RW(1e-3)])
def test_generalised_covariance_is_that_of_the_running_sum(process):
    m = np.arange(-40, 41)
    k = process.running_sum_covariance(np.arange(-41, 42), RATE)
    apart = process.generalised_covariance(m, RATE) - (2 * k[1:-1] - k[:-2] - k[2:])
    np.testing.assert_allclose(apart - apart[0], 0.0, atol=1e-9 * process.scale)
