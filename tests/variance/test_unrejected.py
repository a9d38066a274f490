"""Outliers that a robust wavelet variance does not reject beside strong quantization: intervals and remark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import gmwm
from gmwm.measuring.variance.robust import LARGE_SHARE, RobustVariances, unrejected

N = 200_000
Array = NDArray[np.float64]


def quantized(rng: np.random.Generator, share: float = 0.0, size: float = 0.0) -> Array:
    """Quantization noise 5 times as large as the white noise of variance 1, and outliers in a share of the samples."""
    x = np.diff(5.0 * rng.normal(size=N + 1)) + rng.normal(size=N)
    hit = rng.random(N) < share
    x[hit] += size * np.std(x) * rng.normal(size=int(hit.sum()))
    return x


def test_clean_noise_is_not_changed() -> None:
    curves = [gmwm.wavelet_variance(quantized(np.random.default_rng(k)), 100.0, robust=True) for k in range(8)]
    assert sum(curve.excess is not None for curve in curves) <= 1
    knocked = quantized(np.random.default_rng(9))
    for start in range(5000, N, 20_000):
        ring = np.exp(-np.arange(100) / 25) * np.random.default_rng(start).normal(size=100)
        knocked[start : start + 100] += 200.0 * ring
    assert gmwm.wavelet_variance(knocked, 100.0, robust=True).excess is None
    tails = np.random.default_rng(1).standard_t(3, size=N)
    assert gmwm.wavelet_variance(tails, 100.0, robust=True).excess is None


@pytest.mark.slow
@pytest.mark.parametrize(("share", "size"), [(0.001, 5.0), (0.003, 5.0), (0.01, 5.0)])
def test_intervals_contain_the_bias(share: float, size: float) -> None:
    """Without the bias, intervals of the variance of the white noise contain it in none of these recordings."""
    inside = []
    for seed in range(6):
        curve = gmwm.wavelet_variance(quantized(np.random.default_rng(seed), share, size), 100.0, robust=True)
        ends = []
        for measured in (curve, replace(curve, excess=None)):
            low, high = gmwm.fit("QN + WN", measured, certify=False).confidence_intervals()["WN.sigma2"]
            ends.append(low <= 1.0 <= high)
        inside.append(ends)
    assert np.mean(inside, axis=0)[0] >= 0.8
    assert np.mean(inside, axis=0)[1] == 0.0


def test_a_remark_refuses_the_curve() -> None:
    signal = gmwm.Signal(quantized(np.random.default_rng(1), 0.01, 20.0), 100.0, axis="gyro_x")
    curve = gmwm.wavelet_variance(signal, robust=True)
    assert max(curve.diagnostics["robust"]["unrejected"]) > LARGE_SHARE
    remark = next(remark for remark in curve.remarks if remark.code == "outliers-found")
    assert remark.facts["case"] == "unrejected"
    assert "of the robust variance of gyro_x at" in str(remark)
    accumulator = gmwm.WaveletAccumulator(100.0, axis="gyro_x", robust=True)
    accumulator.update(signal.values)
    streamed = accumulator.result(robust=True).diagnostics["robust"]["unrejected"]
    np.testing.assert_allclose(streamed, curve.diagnostics["robust"]["unrejected"], atol=0.05)
    restored = gmwm.WaveletVariance.from_dict(curve.to_dict())
    assert restored.remarks == curve.remarks


def test_shares() -> None:
    """A robust curve twice the quantization noise at level 4 beside outliers of a tenth of it at level 1."""
    clean = np.array([4.0**-k for k in range(5)])
    outliers = np.array([0.1 * 2.0**-k for k in range(5)])
    robust = clean.copy()
    robust[4] += outliers[4] / 2
    result = unrejected(RobustVariances(robust, {}, isolated=True), clean + outliers, np.full(5, 1e6), 0.6)
    assert result is not None
    shares, covariance = result
    assert shares[4] == pytest.approx(outliers[4] / 2 / robust[4], rel=0.01)
    assert shares[:4] == [0.0] * 4
    assert covariance[4, 4] == pytest.approx(np.log1p(-shares[4]) ** 2, rel=0.05)
    assert unrejected(RobustVariances(robust, {}, isolated=True), clean, np.full(5, 1e6), 0.6) is None
    assert unrejected(RobustVariances(robust, {}), clean + outliers, np.full(5, 1e6), 0.6) is None
