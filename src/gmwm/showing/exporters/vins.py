"""Export for VINS-Mono and VINS-Fusion: the noise parameters of their configuration."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written


@register
class Vins(TwoNumbers):
    """File for VINS with the discrete standard deviations N√f and K√f at the sampling rate f.

    In a step Δt, VINS adds (Δt σ)² to the variance of the angle, the velocity or a bias, where σ is the parameter. For
    white noise, N² Δt = Δt² acc_n², and for the random walk, K² Δt = Δt² acc_w².

    Source: `config/euroc` and `integration_base.h` of VINS-Mono and VINS-Fusion.
    """

    name = "vins"
    title = "VINS-Mono, VINS-Fusion and GVINS"
    extension = ".yaml"
    first = "%YAML:1.0"
    meaning = (
        "Units: discrete, standard deviations of a step at the rate below: N √f and K √f. acc_n m/s², gyr_n rad/s, "
        "acc_w m/s³, gyr_w rad/s². Another rate needs other values.",
    )
    usage = (
        "Replace these keys in your configuration. VINS integrates the mean of two samples and assumes half the "
        "variance, although successive steps share a sample. Multiply acc_n and gyr_n by √2 to correct for this; the "
        "numbers here are not corrected. Users commonly set 10 to 100 times larger values.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
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
