import pytest

import gmwm

TRUTH = {
    "gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)",
    "gyro_y": "WN(sigma2=4e-7) + GM(beta=4.0, sigma2=3e-7)",
    "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)",
}
HOSTILE = "</script><script>document.title='owned'</script><img src=x onerror=\"document.title='owned'\">"
TEMPLATE = "{{ 7 * 7 }}{% raw %} %{x} <a href='https://example.org'>link</a>"


@pytest.fixture(scope="session")
def imu():
    """Three axes, 1000 s at 100 Hz; gyro_y was knocked again and again."""
    clean = gmwm.simulate(TRUTH, rate=100.0, samples=100_000, rng=4)
    values = {axis: clean[axis].values.copy() for axis in clean}
    values["gyro_y"][10_000:80_000:7000] += 0.2
    return gmwm.Imu.from_arrays(values, 100.0, source="knocked.csv")


@pytest.fixture(scope="session")
def calibration(imu):
    return gmwm.calibrate(imu, "GM + WN + RW")


@pytest.fixture(scope="session")
def hostile(imu):
    """Names, unit and source as an enemy would write them."""
    values = imu["gyro_x"].values
    signals = {name: gmwm.Signal(values, 100.0, f"V {HOSTILE}", name) for name in (f"a {HOSTILE}", f"b {TEMPLATE}")}
    noted = gmwm.Imu(signals, f"{HOSTILE}{TEMPLATE}.csv", (f"note {HOSTILE}",))
    return gmwm.calibrate(noted, "WN + RW")
