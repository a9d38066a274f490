import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Remark

TRUTH = {
    "gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)",
    "gyro_y": "WN(sigma2=4e-7) + GM(beta=4.0, sigma2=3e-7)",
    "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)",
}
HOSTILE = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
TEMPLATE = "{{ 7 * 7 }}{% raw %} %{x} <a href='https://example.org'>link</a>"


@pytest.fixture(scope="session")
def imu():
    """Three axes, 1000 s at 100 Hz; gyro_y was shaken too often to be repaired, for 2 s each time."""
    clean = gmwm.simulate(TRUTH, rate=100.0, samples=100_000, rng=4)
    values = {axis: clean[axis].values.copy() for axis in clean}
    rng = np.random.default_rng(3)
    for start in range(10_000, 94_000, 1000):
        values["gyro_y"][start : start + 200] += 0.006 * rng.standard_normal(200)
    return gmwm.Imu.from_arrays(values, 100.0, source="knocked.csv")


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
