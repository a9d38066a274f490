"""The Kalman smoother of several signals, against dense matrices, and against the smoother of one signal."""

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import Imu, Signal
from gmwm.base.errors import DataError, OptionError
from tests.helpers import raises

RATE = 100.0
AXES = ("gyro_x", "gyro_y", "gyro_z")


def recorded(seed, n):
    rng = np.random.default_rng(seed)
    root = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0], [-0.3, 0.2, 0.9]])
    x = rng.normal(size=(3, n)) + np.cumsum(0.1 * root @ rng.normal(size=(3, n)), axis=1) + [[5.0], [-2.0], [0.0]]
    phi, shocks = np.exp(-2.0 / RATE), rng.normal(size=n)
    shocks[1:] *= np.sqrt(1 - phi**2)
    slow = lfilter([1.0], [1.0, -phi], shocks)
    return dict(zip(AXES, x + np.outer([1.0, -0.5, 0.8], slow), strict=True))


def dense(fit, values):
    """Mean and variance of term tracks, by the covariance matrix of all samples, with a flat prior of each level.

    Returns a function of the cross-covariance of a latent process (N, N d) and of its share of the levels (N, d).
    """
    n, d = values.shape
    present = np.isfinite(values).ravel()
    y = values.ravel()[present]
    levels = np.tile(np.eye(d), (n, 1))[present]
    inverse = np.linalg.inv(_covariance(fit, n)[np.ix_(present, present)])
    spread = np.linalg.inv(levels.T @ inverse @ levels)
    beta = spread @ levels.T @ inverse @ y

    def of(prior, cross, share):
        weights = cross[:, present] @ inverse
        slopes = share - weights @ levels
        mean = weights @ y + slopes @ beta
        variance = prior - np.einsum("ta,ta->t", weights, cross[:, present])
        return mean, variance + np.einsum("ta,ab,tb->t", slopes, spread, slopes)

    return of


def _kernel(fit, term, n):
    """Covariance in time (N, N) of a term of scale 1; a random walk starts at 0 before the first sample."""
    t = np.arange(n)
    if term == "RW":
        return 1.0 + np.minimum.outer(t, t)
    if term == "GM":
        return np.exp(-fit.parameters["GM.beta"] * np.abs(np.subtract.outer(t, t)) / RATE)
    return np.eye(n)


def _covariance(fit, n):
    return sum(np.kron(_kernel(fit, term, n), fit.covariances[term]) for term in fit.terms)


@pytest.fixture(scope="module")
def fitted():
    return gmwm.fit_joint("common(GM(beta=fixed(2.0))) + shared(RW) + WN", recorded(1, 6000), RATE)


@pytest.mark.parametrize("lost", [(), ((20, 25), (40, 41))])
def test_dense_matrices(fitted, lost):
    n = 70
    values = np.column_stack(list(recorded(2, n).values()))
    for first, last in lost:
        values[first:last] = np.nan
    if lost:
        values[50, 1] = values[60, [0, 2]] = np.nan  # a sample of some axes only
    found = fitted.smooth(dict(zip(AXES, values.T, strict=True)))
    of = dense(fitted, values)
    d = len(AXES)
    for k, axis in enumerate(AXES):
        share = np.tile(np.eye(d)[k], (n, 1))
        for term, level in (("GM", 0.0), ("RW", 1.0)):
            sigma, kernel = fitted.covariances[term], _kernel(fitted, term, n)
            cross = np.kron(kernel, sigma[k])
            mean, variance = of(np.diag(kernel) * sigma[k, k], cross, level * share)
            np.testing.assert_allclose(found[axis].mean[term], mean, rtol=0, atol=1e-8)
            np.testing.assert_allclose(found[axis].error[term], np.sqrt(variance), rtol=0, atol=1e-8)
        both = sum(np.kron(_kernel(fitted, term, n), fitted.covariances[term][k]) for term in ("GM", "RW"))
        prior = sum(np.diag(_kernel(fitted, term, n)) * fitted.covariances[term][k, k] for term in ("GM", "RW"))
        mean, variance = of(prior, both, share)
        np.testing.assert_allclose(found[axis].mean["bias"], mean, rtol=0, atol=1e-8)
        np.testing.assert_allclose(found[axis].error["bias"], np.sqrt(variance), rtol=0, atol=1e-8)
        there = np.isfinite(values[:, k])
        total = found[axis].mean["WN"] + found[axis].mean["GM"] + found[axis].mean["RW"]
        np.testing.assert_allclose(total[there], values[there, k], rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["RW + WN", "GM(beta=fixed(2.0)) + WN", "GM(beta=fixed(2.0)) + QN + RW + WN"])
def test_signals_that_share_nothing_are_smoothed_one_by_one(model):
    x = recorded(3, 3000)
    fit = gmwm.fit_joint(model, x, RATE)
    lossy = {axis: np.where(np.arange(3000) % 97 < 3, np.nan, values) for axis, values in x.items()}
    found = fit.smooth(lossy)
    for axis, own in fit.models.items():
        single = own.smooth(lossy[axis], RATE)
        assert found[axis].labels == single.labels
        for label in single.labels:
            scale = float(np.nanmax(single.error[label]))
            np.testing.assert_allclose(found[axis].mean[label], single.mean[label], rtol=0, atol=1e-7 * (1 + scale))
            np.testing.assert_allclose(found[axis].error[label], single.error[label], rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_bands_contain_the_truth_and_sharing_helps(fitted):
    """A shared walk is known better with the other signals; 95 % of the samples are in the 95 % band."""
    inside, gain = [], []
    for seed in range(4):
        rng = np.random.default_rng([5, seed])
        walk = np.cumsum(0.1 * rng.normal(size=4000))
        x = {axis: share * walk + rng.normal(size=4000) for axis, share in zip(AXES, (1.0, 1.0, -1.0), strict=True)}
        fit = gmwm.fit_joint("common(RW) + WN", x, RATE)
        tracks = fit.smooth(x)
        rest = tracks["gyro_x"].mean["RW"] - walk
        low, high = tracks["gyro_x"].band("RW")
        inside.append(np.mean((low < walk) & (walk < high)))
        single = fit.models["gyro_x"].smooth(x["gyro_x"], RATE)
        gain.append(np.std(rest) / np.std(single.mean["RW"] - walk))
    assert 0.88 < np.mean(inside) < 0.99
    assert np.mean(gain) < 0.85


def test_a_recording_with_a_gap_and_what_is_refused(fitted):
    x = recorded(6, 900)
    segments, starts = ((0, 400), (400, 900)), (10.0, 14.5)
    imu = Imu(
        {axis: Signal(values, RATE, "rad/s", axis, segments=segments, starts=starts) for axis, values in x.items()}
    )
    found = fitted.smooth(imu)["gyro_y"]
    assert (len(found), found.unit, found.axis, found.times[0]) == (950, "rad/s", "gyro_y", 10.0)
    assert np.count_nonzero(np.isnan(found.data)) == 50
    assert np.all(found.error["RW"][420:430] > found.error["RW"][300])
    found.plot()
    with raises(DataError, "gyro_z", argument="x"):
        fitted.smooth({axis: x[axis] for axis in AXES[:2]})
    with raises(OptionError, argument="rate"):
        fitted.smooth(x, rate=50.0)
    with raises(DataError, argument="x"):
        fitted.smooth({**x, "gyro_z": x["gyro_z"][:-1]})
