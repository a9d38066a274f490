"""The error of a thermometer that is correlated in time: the effect is too small, and a remark says so.

All series are simulated with NumPy.
"""

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import Imu, Signal
from tests.helpers import codes, only

pytestmark = pytest.mark.slow

RATE, N = 10.0, 40_000
SLOPE = 1e-3


def reading_error(rng, seconds, sd=0.3):
    """An error of a standard deviation (°C) with a correlation time; white for 0 s."""
    pulls = rng.normal(size=N)
    if seconds == 0:
        return sd * pulls
    decay = np.exp(-1 / (seconds * RATE))
    error = lfilter([np.sqrt(1 - decay**2)], [1.0, -decay], pulls)
    return sd * error


def recorded(seed, seconds):
    rng = np.random.default_rng([11, seed])
    heat = 25 + 2 * np.sin(np.arange(N) / RATE / 240 + seed) + np.cumsum(4e-3 * rng.normal(size=N))
    x = 1e-3 * rng.normal(size=N) + np.cumsum(2e-6 * rng.normal(size=N)) + SLOPE * heat
    axes = {"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")}
    return Imu(axes, temperature=heat + (0.0 if seconds is None else reading_error(rng, seconds)))


@pytest.mark.parametrize(("seconds", "most"), [(2.0, 0.3), (10.0, 0.4), (60.0, 0.8)])
def test_an_error_that_is_correlated_in_time_has_a_remark(seconds, most):
    found = 0
    for seed in range(3):
        inspection = gmwm.inspect(recorded(seed, seconds), against="temperature")
        slope = inspection.regressions["gyro_x"]["temperature"].value / SLOPE
        assert slope < most
        if "conditions-attenuated" in codes(inspection.remarks):
            found += 1
            assert only(inspection.remarks, "conditions-attenuated", "gyro_x").facts["ratio"] < 1
    assert found == 3


@pytest.mark.parametrize("seconds", [None, 0])
def test_an_exact_or_white_reading_has_none(seconds):
    for seed in range(4):
        inspection = gmwm.inspect(recorded(seed, seconds), against="temperature")
        assert inspection.regressions["gyro_x"]["temperature"].value == pytest.approx(SLOPE, rel=0.05)
        assert "conditions-attenuated" not in codes(inspection.remarks)


def test_a_document_keeps_it():
    found = gmwm.inspect(recorded(0, 2.0), against="temperature").regressions["gyro_x"]
    again = type(found).from_dict(found.to_dict())
    assert again.coarse == found.coarse is not None
