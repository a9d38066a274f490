"""The covariance of the wavelet variance from the data alone."""

import numpy as np
import pytest

import gmwm
from gmwm import GM, RW, WN, Signal
from gmwm.measuring.covariance import wavelet_covariance
from gmwm.measuring.covariance.empirical import empirical_covariance
from tests.helpers import raises

RATE = 100.0
SAMPLES = 2**14


def correlations(v):
    size = np.sqrt(np.diag(v))
    return v / np.outer(size, size)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "how"),
    [
        (GM(1.0, 1.0) + WN(4.0), {}),
        (RW(1e-4) + WN(1.0), {}),
        (RW(1e-4) + WN(1.0), {"filter": "d4"}),
        (GM(1.0, 1.0) + WN(4.0), {"filter": "d4", "transform": "dwt"}),
    ],
)
def test_follows_the_truth_where_the_signal_is_gaussian(model, how):
    rng = np.random.default_rng(3)
    found = np.array([empirical_covariance(x, RATE, **how) for x in model.simulate(SAMPLES, RATE, rng, paths=12)])
    truth = wavelet_covariance(model, SAMPLES, RATE, **how)
    ratio = found[:, range(len(truth)), range(len(truth))] / np.diag(truth)
    error = ratio.std(axis=0, ddof=1) / np.sqrt(12)
    # Levels 1 … 8: at the coarser ones ν̂⁴ itself is far from ν⁴.
    assert np.all(np.abs(ratio.mean(axis=0) - 1)[:8] < 4 * error[:8] + 0.08)
    between = np.mean([correlations(v) for v in found], axis=0) - correlations(truth)
    assert np.abs(between[:8, :8]).max() < 0.15


@pytest.mark.slow
def test_follows_the_truth_where_it_is_not():
    # Laplace noise: fourth cumulant 12, against Var² = 4; with Haar's taps of equal size all of it is in closed form.
    rng, levels = np.random.default_rng(5), 8
    found = np.mean([empirical_covariance(rng.laplace(size=SAMPLES), RATE, levels=levels) for _ in range(12)], axis=0)
    gaussian = wavelet_covariance(WN(2.0), SAMPLES, RATE, levels=levels)
    j = np.arange(1, levels + 1)
    truth = gaussian + 12.0 * 2.0 ** -np.add.outer(j, j) / SAMPLES
    np.testing.assert_allclose(np.diag(found), np.diag(truth), rtol=0.2)
    assert found[0, 0] > 1.6 * gaussian[0, 0]
    assert np.abs(correlations(found) - correlations(truth)).max() < 0.15


@pytest.mark.parametrize("samples", [8, 50, 1000, 70_001])
@pytest.mark.parametrize("transform", ["modwt", "dwt"])
def test_is_a_covariance_at_any_length(samples, transform):
    x = np.random.default_rng(samples).normal(size=samples)
    v = empirical_covariance(x, RATE, transform=transform)
    np.testing.assert_array_equal(v, v.T)
    assert np.linalg.eigvalsh(correlations(v))[0] > 0


@pytest.mark.parametrize("factor", [1e-12, 2.0**40, 1e12])
def test_scales_with_the_fourth_power(factor):
    x = (GM(1.0, 1.0) + WN(1.0)).simulate(5000, RATE, 1)
    np.testing.assert_allclose(
        empirical_covariance(factor * x, RATE), factor**4 * empirical_covariance(x, RATE), rtol=1e-6
    )


def test_a_signal_is_as_its_samples():
    x = np.random.default_rng(2).normal(size=500)
    np.testing.assert_array_equal(empirical_covariance(Signal(x, RATE)), empirical_covariance(x, RATE))


@pytest.mark.parametrize(
    ("x", "how", "error", "fact"),
    [
        (np.ones(100), {}, gmwm.errors.DataError, "zero at level 1, 2"),
        (np.arange(1000.0), {"levels": 3}, gmwm.errors.DataError, "level 1, 2, 3 do not vary"),
        (9.81 + 0.1 * np.arange(1000.0), {"levels": 3}, gmwm.errors.DataError, "level 1, 2, 3 do not vary"),
        (np.arange(1000.0), {"levels": 3, "transform": "dwt"}, gmwm.errors.DataError, "do not vary"),
        ((-1.0) ** np.arange(1000), {"levels": 1}, gmwm.errors.DataError, "level 1 do not vary"),
        (np.arange(4.0), {}, gmwm.errors.DataError, "at least 8"),
        (np.random.default_rng(1).normal(size=100), {"transform": "fft"}, gmwm.errors.OptionError, "transform"),
        (np.random.default_rng(1).normal(size=100), {"levels": 9}, gmwm.errors.OptionError, "levels"),
    ],
)
def test_refused(x, how, error, fact):
    with raises(error, fact):
        empirical_covariance(x, RATE, **how)
