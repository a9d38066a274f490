"""Export for ORB-SLAM3: the noise parameters in the settings file."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written


@register
class OrbSlam3(TwoNumbers):
    """File for ORB-SLAM3 with four continuous-time noise densities and the sampling rate.

    The program computes discrete-time values from them.

    Source: `Examples/Stereo-Inertial/EuRoC.yaml` and `Tracking.cc` of ORB-SLAM3.
    """

    name = "orbslam3"
    title = "ORB-SLAM3"
    extension = ".yaml"
    first = "%YAML:1.0"
    meaning = (
        "Units: continuous-time densities, one-sigma. NoiseGyro rad/s/√Hz, NoiseAcc m/s²/√Hz, GyroWalk rad/s²/√Hz, "
        "AccWalk m/s³/√Hz, Frequency Hz. ORB-SLAM3 computes the discrete numbers.",
    )
    usage = ("Replace these keys in your settings file.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the five keys of the file."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return [
            f"IMU.NoiseGyro: {written(gyro.N[0])}  # rad/s/sqrt(Hz){limit_mark(gyro.N[0])}",
            f"IMU.NoiseAcc: {written(accel.N[0])}  # m/s^2/sqrt(Hz){limit_mark(accel.N[0])}",
            f"IMU.GyroWalk: {written(gyro.K[0])}  # rad/s^2/sqrt(Hz){limit_mark(gyro.K[0])}",
            f"IMU.AccWalk: {written(accel.K[0])}  # m/s^3/sqrt(Hz){limit_mark(accel.K[0])}",
            f"IMU.Frequency: {noise.written_rate}  # Hz",
        ]
