"""Export for Kalibr: imu.yaml for the camera-IMU calibration."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written

CONTINUOUS = (
    "Units: continuous-time densities, one-sigma. Noise density N: gyroscope rad/s/√Hz, accelerometer m/s²/√Hz. "
    "Random walk K: gyroscope rad/s²/√Hz, accelerometer m/s³/√Hz.",
)
"""Units of Kalibr's four parameters, which other programs use too."""


def four_numbers(noise: Noise) -> list[str]:
    """Return four lines with Kalibr's keys, values and units."""
    lines = []
    for quantity, key, unit in (("accel", "accelerometer", "m/s"), ("gyro", "gyroscope", "rad/s")):
        sensor = noise.accel if quantity == "accel" else noise.gyro
        assert sensor is not None
        squared, cubed = (f"{unit}^2", f"{unit}^3") if quantity == "accel" else (unit, f"{unit}^2")
        lines += [
            f"{key}_noise_density: {written(sensor.N[0])}  # {squared}/sqrt(Hz){limit_mark(sensor.N[0])}",
            f"{key}_random_walk: {written(sensor.K[0])}  # {cubed}/sqrt(Hz){limit_mark(sensor.K[0])}",
        ]
    return lines


@register
class Kalibr(TwoNumbers):
    """File for Kalibr with four continuous-time noise densities, all of which must be positive.

    Source: `ConfigReader.py` of Kalibr, and its pages on the IMU noise model and on YAML formats.
    """

    name = "kalibr"
    title = "Kalibr (imu.yaml)"
    extension = ".yaml"
    meaning = CONTINUOUS

    def advice(self, noise: Noise) -> tuple[str, ...]:
        """Return a sentence on the ROS topic in the file."""
        if noise.topic:
            return ("rostopic is the topic that was calibrated.",)
        return ("Replace rostopic, which is a placeholder, by the topic of your recordings.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines with Kalibr's keys."""
        topic = noise.topic or "/imu0"
        return [*four_numbers(noise), "", f"rostopic: {topic}", f"update_rate: {noise.written_rate}  # Hz"]
