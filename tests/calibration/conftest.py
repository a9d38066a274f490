import pytest

import gmwm
from tests.knocked import knocked_imu

WITHIN = "GM + WN + RW"


@pytest.fixture(scope="session")
def imu():
    return knocked_imu()


@pytest.fixture(scope="session")
def calibration(imu):
    return gmwm.calibrate(imu, WITHIN)
