"""Base class of JSON formats, whose verdict and notes are lists under own keys, and AirSim, GLIM and Basalt."""

from __future__ import annotations

import json
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import three
from gmwm.showing.exporters.text import commented, commented_notes, shortened

HEAD, NOTES = "gmwm", "gmwm_notes"
"""Keys of the head and of the notes. Programs ignore keys that they do not know."""


class JsonFile(TwoNumbers):
    """Base class of JSON formats with N and K of each sensor."""

    extension = ".json"
    head_first: ClassVar[bool] = True
    """Whether the verdict may be the first entry of the document."""

    @abstractmethod
    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the JSON document without its head."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the JSON document without its head."""
        return json.dumps(_rounded(self.content(noise)), indent=2).splitlines()

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the JSON document with its head and its notes."""
        lines = {HEAD: commented(shortened(head), ""), NOTES: commented_notes(notes, "")}
        texts = {key: [line.strip() for line in each] for key, each in lines.items()}
        content = _rounded(self.content(noise))
        entries = (
            [(HEAD, texts[HEAD]), *content.items()] if self.head_first else [*content.items(), (HEAD, texts[HEAD])]
        )
        return json.dumps(dict([*entries, (NOTES, texts[NOTES])]), indent=2, allow_nan=False) + "\n"


def _rounded(value: Any) -> Any:
    """Round all numbers of a document to seven digits, as in the other formats."""
    if isinstance(value, Mapping):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


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
