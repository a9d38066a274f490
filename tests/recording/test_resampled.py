"""A log that was resampled by straight lines is named, and noise, lines and filters are not."""

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from gmwm.recording.repairs.patterns import slower_rate
from tests.helpers import only
from validation import faults

SIZE = 30_000


def _resampled(share, seed=0):
    rng = np.random.default_rng(seed)
    x = faults.base(SIZE, rng)
    return np.interp((np.arange(SIZE) + rng.uniform()) * share, np.arange(SIZE), x)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1234, 0.3, 0.48, 0.625, 0.7071, 0.94])
def test_the_rate_of_the_slower_log_is_found(share):
    assert slower_rate(_resampled(share)) == pytest.approx(share, abs=1e-4)


@pytest.mark.slow
def test_a_rounded_output_does_not_hide_the_straight_lines():
    x = _resampled(0.625)
    assert slower_rate(np.round(x / 2e-4) * 2e-4) == pytest.approx(0.625, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*faults.CLEAN, "dithered", "cic", "student_2.5", "telegraph"])
def test_other_recordings_were_not_resampled(kind):
    make = {**faults.CLEAN, **faults.FAULTS}[kind]
    assert not any(slower_rate(make(8_000, np.random.default_rng(seed))) for seed in range(3))


@pytest.mark.slow
def test_a_remark_names_the_rate_and_n_is_right():
    share = 0.625
    calibration = gmwm.calibrate(Imu({"gyro_x": Signal(_resampled(share), 100.0, "rad/s", axis="gyro_x")}))
    remark = only(calibration.remarks, "fault-undone:resampled", "gyro_x")
    assert remark.facts["rate"].value == pytest.approx(62.5, abs=0.01)
    number = calibration.datasheets["gyro_x"]["N"]
    assert number.low < faults.WHITE / (share * 100.0) ** 0.5 < number.high
