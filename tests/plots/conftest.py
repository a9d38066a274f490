import numpy as np
import pytest

import gmwm
from gmwm.measuring.variance.result import WaveletVariance


@pytest.fixture(scope="session")
def wv():
    """Twenty levels at 250 Hz with every noise of a MEMS gyroscope, exact values: nothing random."""
    model = gmwm.Model.parse("GM(beta=0.5, sigma2=6e-9) + WN(sigma2=7e-7) + QN(q2=2e-6) + RW(gamma2=1e-13)")
    variance = model.wavelet_variance(20, 250.0)
    return WaveletVariance.from_values(variance, samples=3_000_000, rate=250.0, unit="rad/s", axis="gyro_y")


@pytest.fixture(scope="session")
def fit(wv):
    return gmwm.fit("GM + WN + QN + RW", wv)


@pytest.fixture(scope="session")
def scaled():
    """A function: the same curve under other names, units or values."""

    def change(wv, **changes):
        fields = {"unit": wv.unit, "axis": wv.axis, "samples": wv.samples, "rate": wv.rate}
        values = np.asarray(changes.pop("variance", wv.variance))
        return WaveletVariance.from_values(values, **(fields | changes))

    return change


@pytest.fixture(scope="session")
def six(wv, scaled):
    """The same curve on six axes."""
    units = {"gyro": "rad/s", "accel": "m/s²"}
    axes = [(sensor, letter) for sensor in units for letter in "xyz"]
    return {f"{s}_{k}": scaled(wv, axis=f"{s}_{k}", unit=units[s]) for s, k in axes}
