"""A calibration names the numbers that a trend or a coarse output affects."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.calibration.number_verdicts import Usability
from gmwm.recording.signals import Imu, Signal
from tests.helpers import code_of, only

RATE, SAMPLES = 20.0, 40_000
AT = np.arange(SAMPLES) / RATE


def calibrated(course, within, step=0.0):
    x = np.random.default_rng(1).normal(size=SAMPLES) * 1e-3 + course
    x = np.round(x / step) * step if step else x
    return gmwm.calibrate(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")}), within=within)


@pytest.mark.slow
@pytest.mark.parametrize(("within", "codes"), [("WN + RW", ["linear-trend"]), ("WN + DR", [])])
def test_a_line_is_reported_unless_the_model_has_a_drift(within, codes):
    found = calibrated(1e-3 * AT / AT[-1], within)
    assert [r.code for r in found.remarks if r.code.endswith("trend")] == codes


@pytest.mark.slow
def test_the_numbers_are_those_of_the_datasheet():
    found = calibrated(2e-3 * np.exp(-AT / 300.0), "WN + RW")
    numbers = only(found.remarks, "warm-up").facts["numbers"]
    assert "K" in numbers
    assert set(numbers) <= set(found.datasheets["gyro_x"])
    assert found.number_verdicts["gyro_x"]["K"].usability is Usability.BOUND
    assert (code_of(found.verdict), found.verdict.facts["reasons"]) == ("verdict:usable", ("warm-up",))


@pytest.mark.slow
def test_a_coarse_output_is_not_a_usable_calibration():
    found = calibrated(0.0, "WN + RW", step=3e-3)
    numbers = only(found.remarks, "coarse-output").facts["numbers"]
    assert "N" in numbers
    assert code_of(found.verdict) == "verdict:wrong"


@pytest.mark.slow
def test_a_model_without_such_numbers_has_its_terms_named():
    found = calibrated(2e-3 * np.exp(-AT / 300.0), "GM + WN")
    assert only(found.remarks, "warm-up").facts["numbers"]
