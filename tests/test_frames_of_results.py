"""Results as data frames hold the numbers of the results."""

import numpy as np
import pytest

import gmwm

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
RNG = np.random.default_rng(1)
IMU = gmwm.Imu.from_arrays({"gyro_x": RNG.normal(size=4000), "gyro_y": RNG.normal(size=4000)}, 100.0)


def test_curves():
    curves = gmwm.wavelet_variance(IMU)
    frame = curves.to_frame()
    assert frame.height == sum(map(len, curves.values()))
    assert frame["axis"].unique(maintain_order=True).to_list() == ["gyro_x", "gyro_y"]
    own = curves["gyro_y"].to_frame()
    np.testing.assert_array_equal(own["variance"], curves["gyro_y"].variance)
    np.testing.assert_array_equal(own["tau"], curves["gyro_y"].tau)


def test_fits_and_rankings():
    curve = gmwm.wavelet_variance(IMU["gyro_x"])
    fit = gmwm.fit("WN + RW", curve)
    rows = {row["parameter"]: row for row in fit.to_frame(0.9).to_dicts()}
    limits = fit.confidence_intervals(0.9)
    assert set(rows) == set(fit.parameters)
    for name, (low, high) in limits.items():
        assert (rows[name]["value"], rows[name]["low"], rows[name]["high"]) == (fit.parameters[name], low, high)
    ranking = gmwm.select("WN + RW + QN", curve)
    frame = ranking.to_frame()
    assert frame["model"].to_list() == [one.structure for one in ranking]
    assert frame.filter(frame["recommended"])["model"].to_list() == [ranking.recommended.structure]


@pytest.mark.slow
def test_calibrations():
    calibration = gmwm.calibrate(IMU, within="WN + RW", robust=False)
    frame = calibration.to_frame("si")
    for axis, sheet in calibration.datasheets.items():
        assert frame.filter(frame["axis"] == axis).drop("axis").to_dicts() == sheet.to_frame("si").to_dicts()
    assert "N" in frame["symbol"].to_list()
