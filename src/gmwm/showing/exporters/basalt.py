"""Export for Basalt: the entries of the IMU in calibration.json."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.biases import three
from gmwm.showing.exporters.jsonfile import JsonFile


@register
class Basalt(JsonFile):
    """File for Basalt with continuous-time noise densities of each axis and constant biases.

    Basalt computes calibrated = (I + scale) raw − bias.

    Source: `calibration.hpp` and `calib_bias.hpp` of basalt-headers.
    """

    name = "basalt"
    title = "Basalt (value0 of calibration.json)"
    default_axes = "each"
    per_axis = True
    biases_of = ("gyro", "accel")
    head_first = False  # Basalt reads the first entry
    meaning = (
        "Units: continuous-time densities, one-sigma, of x, y and z. gyro_noise_std rad/s/√Hz, accel_noise_std "
        "m/s²/√Hz, gyro_bias_std rad/s²/√Hz, accel_bias_std m/s³/√Hz. The first three numbers of calib_gyro_bias "
        "(rad/s) and calib_accel_bias (m/s²) are the biases; the others are scale and misalignment, here zero, which "
        "a recording at rest does not show.",
    )
    usage = (
        "Copy these keys into value0 of your calibration.json, and keep the cameras of your file. Keep the scale and "
        "misalignment of your file if it has any.",
    )

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the document with the keys of the IMU."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return {
            "value0": {
                "calib_accel_bias": [*three(noise.rest, "accel"), *[0.0] * 6],
                "calib_gyro_bias": [*three(noise.rest, "gyro"), *[0.0] * 9],
                "imu_update_rate": float(noise.written_rate),
                "accel_noise_std": [number.value for number in accel.N],
                "gyro_noise_std": [number.value for number in gyro.N],
                "accel_bias_std": [number.value for number in accel.K],
                "gyro_bias_std": [number.value for number in gyro.K],
            }
        }
