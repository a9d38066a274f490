"""Export for GLIM: config_sensors.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.biases import three
from gmwm.showing.exporters.jsonfile import JsonFile

FRAME_RATE_HZ = 10.0
"""Number of lidar frames per second (Hz). The value is the usual rate of a spinning lidar."""


@register
class Glim(JsonFile):
    """File for GLIM with continuous-time noise densities N, one random walk for all biases, and the biases at rest.

    The random walk is the standard deviation of the change of a bias between two lidar frames.

    Source: `config/config_sensors.json`, `odometry_estimation_imu.cpp` and `imu_integration.cpp` of GLIM.
    """

    name = "glim"
    title = "GLIM (config_sensors.json)"
    takes = frozenset({"axes", "inflation", "horizon"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: imu_acc_noise m/s²/√Hz and imu_gyro_noise rad/s/√Hz, continuous-time densities, one-sigma. "
        "imu_bias_noise is discrete: the standard deviation of the change of the bias between two frames at "
        f"{FRAME_RATE_HZ:g} Hz, K √0.1 s, m/s² and rad/s. GLIM has one number for both sensors: it is the larger "
        "one, almost always that of the accelerometers. imu_bias: accelerometers x, y, z (m/s²), gyroscopes x, y, z "
        "(rad/s).",
    )
    usage = (
        "Copy these keys into sensors of your config_sensors.json. For another lidar rate, change imu_bias_noise.",
    )

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the entry "sensors" of the configuration."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return {
            "sensors": {
                "imu_acc_noise": accel.N[0].value,
                "imu_gyro_noise": gyro.N[0].value,
                "imu_bias_noise": max(gyro.K[0].value, accel.K[0].value) / math.sqrt(FRAME_RATE_HZ),
                "imu_bias": [*three(noise.rest, "accel"), *three(noise.rest, "gyro")],
            }
        }
