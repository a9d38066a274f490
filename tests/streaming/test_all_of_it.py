"""Whatever is done with the curve of a recording in memory is done with that of one in chunks."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm

MODEL = "GM(beta=0.05, sigma2=4e-9) + WN(sigma2=1e-6) + RW(gamma2=1e-12)"


@pytest.fixture(scope="module")
def curves():
    x = gmwm.Model.parse(MODEL).simulate(300_000, 100.0, 1)
    live = gmwm.WaveletAccumulator(100.0, exact=6, robust=True, unit="rad/s", axis="gyro_x")
    live.update(x)
    signal = gmwm.Signal(x, 100.0, "rad/s", "gyro_x")
    return signal, live.result(), live.result(robust=True)


@pytest.mark.slow
@pytest.mark.parametrize("weighting", ["diagonal", "optimal"])
def test_fits_intervals_and_tests(curves, weighting):
    signal, some, robust = curves
    assert max(some.strides) == 1 << (len(some) - 6)
    whole = gmwm.fit("GM + WN + RW", signal, weighting=weighting)
    for curve in (some, robust):
        found = gmwm.fit("GM + WN + RW", curve, weighting=weighting)
        other = whole if curve is some else gmwm.fit("GM + WN + RW", signal, robust=True, weighting=weighting)
        for name, error in zip(found.sandwich.names, np.sqrt(np.diag(found.covariance)), strict=True):
            assert abs(found.parameters[name] - other.parameters[name]) < 0.2 * error
        np.testing.assert_allclose(found.covariance, other.covariance, rtol=0.15)
        assert found.goodness_of_fit().pvalue == pytest.approx(other.goodness_of_fit().pvalue, abs=0.1)
        assert found.confidence_intervals().keys() == other.confidence_intervals().keys()
        assert found.wic().loss + found.wic().optimism == pytest.approx(
            other.wic().loss + other.wic().optimism, rel=0.1
        )
        assert "N" in found.datasheet().summary()


@pytest.mark.slow
def test_choice_verdict_and_calibration(curves):
    _, some, robust = curves
    assert gmwm.select("2*GM + WN + QN + RW", some).recommended.model.structure == "GM + WN + RW"
    assert not gmwm.contamination((some, robust)).contaminated
    found = gmwm.calibrate({"gyro_x": some}, within="GM + WN + RW")
    again = gmwm.Calibration.from_dict(found.to_dict())
    assert again["gyro_x"].wavelet_variance.strides == some.strides
