"""The budget of a calibration says when the calibration must not be used."""

from dataclasses import replace

import pytest

import gmwm
from gmwm.base.remarks import Remark
from tests.helpers import only


@pytest.mark.slow
def test_the_budget_of_a_wrong_calibration_names_the_cause():
    truth = {"gyro_x": "WN(sigma2=4e-7)", "accel_x": "WN(sigma2=2e-5)"}
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=20_000, rng=1), "WN")
    assert "budget-of-wrong" not in {remark.code for remark in found.budget(60.0).remarks}
    moved = replace(
        found,
        recording_remarks=(
            Remark.of("recording-moved", case="moved", ratio=9.0, parts=("60 s to 70 s",), ranges=((60.0, 70.0),)),
        ),
    )
    assert only(moved.budget(60.0).remarks, "budget-of-wrong").facts["causes"] == ("motion of the unit",)
