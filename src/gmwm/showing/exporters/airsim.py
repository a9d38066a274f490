"""Export for AirSim: the entry of the IMU in settings.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.jsonfile import JsonFile

_DEGREE = math.pi / 180
TIMES = {"gyro": 500.0, "accel": 800.0}
"""Times τ (s) that AirSim uses by default. Only the ratio of bias stability to √τ affects the simulation."""


@register
class AirSim(JsonFile):
    """File for AirSim with white noise N and a bias that is a random walk with K = bias stability / √τ.

    Source: `ImuSimpleParams.hpp` and `ImuSimple.hpp` of AirSim.
    """

    name = "airsim"
    title = "AirSim (Imu of settings.json)"
    takes = frozenset({"axes", "inflation", "horizon"})
    meaning = (
        "Units: continuous in time. AngularRandomWalk deg/√h, VelocityRandomWalk mg/√Hz; GyroBiasStability deg/h and "
        "AccelBiasStability µg are K √τ for the times τ in s. They are not the bias instability of a datasheet: the "
        "simulated bias is a random walk without limit. AirSim has no constant bias in its settings.",
    )
    usage = ("Copy the entry Imu into the Sensors of your vehicle.",)

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the entry "Sensors" of the settings."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        root = {sensor: math.sqrt(time) for sensor, time in TIMES.items()}
        return {
            "Sensors": {
                "Imu": {
                    "SensorType": 2, "Enabled": True, "AngularRandomWalk": gyro.N[0].value * 60 / _DEGREE,
                    "GyroBiasStabilityTau": TIMES["gyro"],
                    "GyroBiasStability": gyro.K[0].value * root["gyro"] * 3600 / _DEGREE,
                    "VelocityRandomWalk": accel.N[0].value * 1e3 / STANDARD_GRAVITY,
                    "AccelBiasStabilityTau": TIMES["accel"],
                    "AccelBiasStability": accel.K[0].value * root["accel"] * 1e6 / STANDARD_GRAVITY,
                }
            }
        }  # fmt: skip
