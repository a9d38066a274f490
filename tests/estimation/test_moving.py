"""Fits to recordings during which the condition moves, simulated in plain NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.fitting.estimation.conditions import Stack, _settle
from gmwm.fitting.estimation.moving_condition import _quantiles, divide
from tests.helpers import raises

N = 1 << 15
T = np.arange(N)
RAMPS = np.abs((T / 8192) % 2 - 1)
"""A triangle between 0 and 1."""
Array = NDArray[np.float64]


def white(rng: np.random.Generator, rate: Array) -> gmwm.Signal:
    """White noise of variance 1 + (rate/100)², a random walk, and the rate itself."""
    x = np.sqrt(1 + (rate / 100) ** 2) * rng.normal(size=N) + np.cumsum(3e-3 * rng.normal(size=N)) + 0.01 * rate
    return gmwm.Signal(x, 100.0, axis="gyro_z")


def recursion(rng: np.random.Generator, phi: Array, scale: Array) -> Array:
    """x_t = φ_t x_{t−1} + scale_t ε_t."""
    noise, x = (scale * rng.normal(size=N)).tolist(), [0.0]
    for factor, shock in zip(phi.tolist()[1:], noise[1:], strict=True):
        x.append(factor * x[-1] + shock)
    return np.array(x)


def covered(fit: gmwm.estimation.ConditionsFit, truth: dict[str, float]) -> list[bool]:
    """Whether 99.9 % intervals contain the true values."""
    intervals = {name: fit.estimates[name].interval(0.999) for name in truth}
    return [low <= truth[name] <= high for name, (low, high) in intervals.items()]


@pytest.mark.slow
def test_white_noise_on_ramps_of_a_turntable() -> None:
    signal = white(np.random.default_rng(1), 200 * RAMPS)
    fit = gmwm.fit("WN + RW", signal, varies={"WN": "1 + rate**2"}, against={"rate": 200 * RAMPS})
    assert all(covered(fit, {"WN.sigma2 (1)": 1.0, "WN.sigma2 (rate^2)": 1e-4, "RW.gamma2": 9e-6}))
    assert fit.lower_bound == pytest.approx(fit.objective)
    assert fit.pvalue > 1e-3
    assert fit.pvalue_constant is not None
    assert fit.pvalue_constant < 1e-6
    assert fit.at(100.0).parameters["WN.sigma2"] == pytest.approx(2.0, rel=0.05)
    assert fit.whole is not None
    assert f"scales from {fit.whole.tau[0]:.3g} s on: the whole recording" in fit.summary()
    assert fit.to_dict()["whole"]["levels"] == fit.whole.levels.tolist()


def test_no_dependence() -> None:
    signal = white(np.random.default_rng(2), np.zeros(N))
    fit = gmwm.fit("WN + RW", signal, varies={"WN": "1 + rate**2"}, against={"rate": 200 * RAMPS}, certify=False)
    assert fit.pvalue_constant is not None
    assert fit.pvalue_constant > 0.01
    assert fit.estimates["WN.sigma2 (rate^2)"].interval()[0] == 0.0


@pytest.mark.slow
def test_an_autoregression_whose_coefficient_follows_a_covariate() -> None:
    c = np.sin(2 * np.pi * T / 9000)
    signal = gmwm.Signal(recursion(np.random.default_rng(3), np.tanh(1.0 + 0.4 * c), np.ones(N)), 1.0)
    fit = gmwm.fit("AR1", signal, varies={"AR1.phi": "c"}, against={"c": c})
    assert all(covered(fit, {"AR1.sigma2": 1.0, "AR1.phi (a)": 1.0, "AR1.phi (b)": 0.4}))
    assert fit.lower_bound is None
    assert fit.at(0.5).parameters["AR1.phi"] == pytest.approx(np.tanh(1.2), abs=0.02)


@pytest.mark.slow
def test_a_correlation_time_that_follows_the_temperature() -> None:
    celsius = 20.0 + 40.0 * RAMPS
    phi = np.exp(-np.exp(-5.0 + 0.05 * celsius))
    noise = np.random.default_rng(4)
    x = recursion(noise, phi, np.sqrt(1 - phi**2)) + noise.normal(size=N)
    signal = gmwm.Signal(x, 1.0, axis="gyro_x")
    fit = gmwm.fit("GM + WN", signal, varies={"GM.beta": "celsius"}, against={"celsius": celsius})
    assert all(covered(fit, {"GM.beta (a)": -5.0, "GM.beta (b)": 0.05, "GM.sigma2": 1.0, "WN.sigma2": 1.0}))
    assert fit.pvalue > 1e-3
    table = gmwm.datasheets.numbers_at(fit, [22.0, 58.0])
    assert table.columns == ["celsius", "N", "K", "T_c of GM"]
    assert table["T_c of GM"].to_list() == pytest.approx([np.exp(3.9), np.exp(2.1)], rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [8, 9])
def test_a_term_that_does_not_exist_has_no_dependence(seed: int) -> None:
    signal = gmwm.Signal(np.random.default_rng(seed).normal(size=N), 1.0)
    fit = gmwm.fit("GM + WN", signal, varies={"GM.beta": "c"}, against={"c": RAMPS})
    low, high = fit.estimates["GM.beta (b)"].interval(0.99)
    assert low < 0 < high
    assert fit.pvalue_constant is not None
    assert fit.pvalue_constant > 0.01
    assert "GM.beta (b)" in fit.summary()


def test_bins_have_equal_shares_and_end_at_gaps() -> None:
    values = white(np.random.default_rng(5), 200 * RAMPS).values.copy()
    values[5000:5100] = np.nan
    signal = gmwm.Signal.from_missing(values, 100.0, axis="gyro_z")
    name, bins = divide(signal, {"rate": 200 * np.delete(RAMPS, np.arange(5000, 5100))}, robust=False, efficiency=0.6)
    assert name == "rate"
    np.testing.assert_allclose(bins.shares, 1 / 8, rtol=0.02)
    assert sum(wv.samples for wv in bins.curves) <= len(signal)
    # A step of 4900 samples of one ramp through a bin has 1000 samples, so that a level of 512 is measured.
    assert len(bins.curves[0]) == 9


def test_the_curve_of_a_bin_is_the_mean_over_the_conditions_of_its_coefficients() -> None:
    rng = np.random.default_rng(11)
    c = np.interp(T, np.arange(0, N + 400, 400), rng.normal(size=N // 400 + 2))
    _, bins = divide(gmwm.Signal(rng.normal(size=N), 1.0), {"c": c}, robust=False, efficiency=0.6)
    levels = np.arange(1, len(bins.curves[0]) + 1)

    def curves(values: Array) -> Array:
        phi = np.tanh(1 + 0.6 * np.atleast_1d(values))
        return np.array([gmwm.AR1(phi=p, sigma2=1).wavelet_variance(levels, 1.0) for p in phi.tolist()])

    last = bins.conditions[-1]
    exact = curves(np.sort(last)[::8]).mean(axis=0)
    assert np.max(np.abs(curves(np.array(last.mean()))[0] / exact - 1)) > 0.02
    parts = curves(bins.parts[-1, 0].mean(axis=-1))  # of level 1, which has nearly all samples
    assert np.max(np.abs(parts.mean(axis=0) / exact - 1)) < 0.006
    # Long coefficients are in long stays, which are further inside of the outermost range.
    assert bins.parts[-1, -1].mean() > bins.parts[-1, 0].mean() + 0.02


def test_conditions_count_as_often_as_coefficients_contain_their_samples() -> None:
    values = np.random.default_rng(12).normal(size=100)
    runs = [(0, 5), (10, 40), (50, 53)]
    contained = np.concatenate([values[k : k + 4] for a, b in runs for k in range(a, b - 3)])
    quantiles = _quantiles(values, runs, 4)
    expected = np.quantile(contained, (np.arange(64) + 0.5) / 64, method="inverted_cdf")
    np.testing.assert_array_equal(quantiles.ravel(), expected)


def test_the_variance_of_levels_of_the_whole_recording_under_a_variance_that_changes() -> None:
    scale = np.where(np.arange(4096) % 256 < 128, 3.0, 1.0)
    model, phi = gmwm.Model.parse("WN"), np.array([[[[9.0]], [[1.0]]]])
    curves = []
    for seed in range(400):
        signal = gmwm.Signal(scale * np.random.default_rng(seed).normal(size=4096), 1.0)
        curves.append(gmwm.wavelet_variance(signal).first(3))
    part = [gmwm.wavelet_variance(np.random.default_rng(1).normal(size=2048), 1.0).first(1)] * 2
    stack = Stack(model, tuple(part), {0: phi}, whole=curves[0], shares=np.array([0.5, 0.5]))
    solved = _settle(stack, "diagonal", certify=False)
    v = stack.covariance(replace(solved.solution, scales=np.ones(1)))
    spread = np.var([wv.variance for wv in curves], axis=0)[1:]
    np.testing.assert_allclose(np.diag(v)[2:], spread, rtol=0.25)


def test_errors() -> None:
    signal = white(np.random.default_rng(6), 200 * RAMPS)
    with raises(OptionError, argument="varies"):
        gmwm.fit("WN", signal, varies={"WN": "1 + speed**2"}, against={"rate": RAMPS})
    with raises(OptionError, argument="varies"):
        gmwm.fit("2*GM + WN", signal, varies={"GM.beta": "rate"}, against={"rate": RAMPS})
    with raises(OptionError, argument="varies"):
        gmwm.fit("GM + WN", signal, varies={"GM.beta": "1 + rate"}, against={"rate": RAMPS})
    fast = np.random.default_rng(7).normal(size=N)
    with pytest.raises(DataError):
        gmwm.fit("WN", signal, varies={"WN": "1 + rate**2"}, against={"rate:exact": fast})
