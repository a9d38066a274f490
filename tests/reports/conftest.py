import pytest

import gmwm
from gmwm.base.remarks import Remark
from tests.knocked import knocked_imu

HOSTILE = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
TEMPLATE = "{{ 7 * 7 }}{% raw %} %{x} <a href='https://example.org'>link</a>"


@pytest.fixture(scope="session")
def imu():
    return knocked_imu()


@pytest.fixture(scope="session")
def calibration(imu):
    return gmwm.calibrate(imu, "GM + WN + RW")


@pytest.fixture(scope="session")
def hostile(imu):
    """Names, unit, source and remarks with text that tries to run as HTML, script or template."""
    values = imu["gyro_x"].values, imu["accel_x"].values
    names = f"a {HOSTILE}", f"b {TEMPLATE}"
    signals = {name: gmwm.Signal(x, 100.0, f"V {HOSTILE}", name) for name, x in zip(names, values, strict=True)}
    named = gmwm.Imu(
        signals, f"{HOSTILE}{TEMPLATE}.csv", (Remark.of("file-content", "file.csv", case="sensor", name=HOSTILE),)
    )
    return gmwm.calibrate(named, "WN + RW")
