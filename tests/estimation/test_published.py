"""The published wavelet variances of the paper's two sensors: objectives and certificates of all twelve axes."""

import json
from pathlib import Path

import numpy as np
import pytest

import gmwm

DATA = Path(__file__).parents[3] / "shared/data/wavelet_variance"
MODELS = {
    ("navchip", "gyro_x"): "2*GM + WN + DR + QN + RW",
    ("navchip", "gyro_y"): "3*GM + WN + QN + RW",
    ("navchip", "gyro_z"): "2*GM + WN + DR + QN + RW",
    ("navchip", "accel_x"): "4*GM + QN + RW",
    ("navchip", "accel_y"): "4*GM + QN + RW",
    ("navchip", "accel_z"): "3*GM + QN",
    **{("mtig", f"{sensor}_{axis}"): "4*GM + WN + RW" for sensor in ("gyro", "accel") for axis in "xyz"},
}

pytestmark = [
    pytest.mark.skipif(not DATA.exists(), reason=f"the published wavelet variances are not at {DATA}"),
    pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning"),
]


def published(sensor: str, axis: str) -> tuple[gmwm.WaveletVariance, np.ndarray]:
    record = json.loads((DATA / f"{sensor}.json").read_text())
    lower, upper = np.array(record["lower_95"][axis]), np.array(record["upper_95"][axis])
    wv = gmwm.WaveletVariance.from_values(
        record["variance"][axis], samples=record["samples"], rate=record["rate_hz"], lower=lower, upper=upper, axis=axis
    )
    return wv, (upper - lower) ** -2.0


@pytest.mark.parametrize(("sensor", "axis"), MODELS)
def test_certificate(sensor, axis):
    wv, omega = published(sensor, axis)
    fit = gmwm.fit(MODELS[sensor, axis], wv, weighting=omega)
    assert fit.relaxed_bound <= fit.lower_bound <= fit.objective
    assert fit.lower_bound >= 0.999 * fit.objective


@pytest.mark.parametrize(("sensor", "axis"), MODELS)
def test_limits_are_those_published(sensor, axis):
    wv, _ = published(sensor, axis)
    ours = gmwm.WaveletVariance.from_values(wv.variance, samples=wv.samples, rate=wv.rate)
    np.testing.assert_allclose(ours.lower, wv.lower, rtol=1e-9)
    np.testing.assert_allclose(ours.upper, wv.upper, rtol=1e-9)


def test_navchip_gyro_y():
    wv, omega = published("navchip", "gyro_y")
    fit = gmwm.fit("3*GM + WN + QN + RW", wv, weighting=omega)
    assert fit.objective <= 7.3021
    assert fit.relaxed_bound == pytest.approx(7.264932, rel=1e-5)
    expected = {
        "GM[1].beta": 4.594, "GM[2].beta": 0.3912, "GM[3].beta": 0.01887,
        "GM[1].sigma2": 4.5928e-9, "GM[2].sigma2": 5.4342e-9, "GM[3].sigma2": 8.4888e-9,
        "WN.sigma2": 7.1123e-7, "QN.q2": 2.2802e-6, "RW.gamma2": 1.0914e-13,
    }  # fmt: skip
    for name, value in expected.items():
        assert fit.parameters[name] == pytest.approx(value, rel=3e-4)
