"""Export for LIO-SAM: the noise parameters in params.yaml."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written


@register
class LioSam(TwoNumbers):
    """File for LIO-SAM with four continuous-time noise densities, which the program squares for GTSAM.

    Source: `config/params.yaml` and `imuPreintegration.cpp` of LIO-SAM.
    """

    name = "liosam"
    title = "LIO-SAM (params.yaml)"
    extension = ".yaml"
    meaning = (
        "Units: continuous-time densities, one-sigma. imuGyrNoise rad/s/√Hz, imuAccNoise m/s²/√Hz, imuGyrBiasN "
        "rad/s/√s, imuAccBiasN m/s²/√s.",
    )
    usage = ("Replace these keys in your params.yaml. For ROS 2, they are under /**: ros__parameters:.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return [
            "lio_sam:",
            f"  imuAccNoise: {written(accel.N[0])}  # m/s^2/sqrt(Hz){limit_mark(accel.N[0])}",
            f"  imuGyrNoise: {written(gyro.N[0])}  # rad/s/sqrt(Hz){limit_mark(gyro.N[0])}",
            f"  imuAccBiasN: {written(accel.K[0])}  # m/s^2/sqrt(s){limit_mark(accel.K[0])}",
            f"  imuGyrBiasN: {written(gyro.K[0])}  # rad/s/sqrt(s){limit_mark(gyro.K[0])}",
        ]
