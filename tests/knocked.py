"""A recording of three axes, one of which was shaken."""

import numpy as np

import gmwm

TRUTH = {
    "gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)",
    "gyro_y": "WN(sigma2=4e-7) + GM(beta=4.0, sigma2=3e-7)",
    "accel_x": "WN(sigma2=2e-5) + RW(gamma2=1e-9)",
}


def knocked_imu():
    """Three axes, 1000 s at 100 Hz; gyro_y was shaken too often to be repaired, for 2 s each time."""
    clean = gmwm.simulate(TRUTH, rate=100.0, samples=100_000, rng=4)
    values = {axis: clean[axis].values.copy() for axis in clean}
    rng = np.random.default_rng(3)
    for start in range(10_000, 94_000, 1000):
        values["gyro_y"][start : start + 200] += 0.006 * rng.standard_normal(200)
    return gmwm.Imu.from_arrays(values, 100.0, source="knocked.csv")
