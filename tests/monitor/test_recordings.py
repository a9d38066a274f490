"""The monitor on real recordings of ADIS16405 units: the baseline of the first 4000 s, the rest monitored."""

from __future__ import annotations

from pathlib import Path

import pytest

import gmwm
from gmwm.applications.monitor import Monitor, baselines

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
GYROS = ("gyro_x", "gyro_y", "gyro_z")
WITHIN = "GM + MA(1) + RW"
"""A model without the resonance of gyro_z, so that the baseline has to account for it."""


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is missing")
def test_six_gyro_axes_at_rest_give_at_most_one_event() -> None:
    events = []
    for number in (1, 3):
        imu = gmwm.read(DATA / f"adis16405_static_{number}.parquet", rate=100.0, units={"gyro": "deg/s", "accel": "g"})
        good = imu.between(0.0, 4000.0)
        fits = {axis: gmwm.fit(WITHIN, gmwm.wavelet_variance(good[axis]), certify=False) for axis in GYROS}
        monitor = Monitor(fits, "30d", baseline=baselines(fits, good))
        events += [(number, str(event)) for event in monitor.watch(imu.between(4000.0, 10_000.0))]
    assert len(events) <= 1, events
