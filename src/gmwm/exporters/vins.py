"""VINS-Mono and VINS-Fusion: the noise in their configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gmwm.exporters.base import Noise, TwoNumbers, register
from gmwm.exporters.text import limit_mark, written


@register
class Vins(TwoNumbers):
    """Discrete standard deviations, as σ√f.

    A step adds (Δt σ)² to the variances of angle, velocity and biases, so that N²Δt = Δt²·acc_n² and likewise for K.

    Source: `config/euroc` and `integration_base.h` of VINS-Mono and VINS-Fusion.
    """

    name = "vins"
    title = "VINS-Mono, VINS-Fusion and GVINS"
    extension = ".yaml"
    first = "%YAML:1.0"
    meaning = (
        "Units: discrete, standard deviations of a step at the rate below: N √f and K √f. acc_n m/s², gyr_n rad/s, "
        "acc_w m/s³, gyr_w rad/s². At another rate they are others.",
    )
    advice = (
        "These keys replace their namesakes in your configuration. The mean of two samples that it integrates is taken "
        "for one of half the variance, where successive steps share a sample: acc_n and gyr_n larger by √2 make up for "
        "that; it is not done here. Users commonly take 10 to 100 times more.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Four keys."""
        root = math.sqrt(noise.rate)
        lines = [f"# for an IMU at {noise.written_rate} Hz"]
        for symbol, tail in (("N", "n"), ("K", "w")):
            for quantity, key in (("accel", "acc"), ("gyro", "gyr")):
                sensor = noise.accel if quantity == "accel" else noise.gyro
                assert sensor is not None
                number = (sensor.N if symbol == "N" else sensor.K)[0].scaled(root)
                unit = {"accn": "m/s^2", "gyrn": "rad/s", "accw": "m/s^3", "gyrw": "rad/s^2"}[key + tail]
                lines.append(f"{key}_{tail}: {written(number)}  # {unit}{limit_mark(number)}")
        return lines
