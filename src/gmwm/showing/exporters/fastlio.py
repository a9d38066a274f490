"""Export for FAST-LIO: the noise parameters in its YAML file."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written


@register
class FastLio(TwoNumbers):
    """File for FAST-LIO with discrete variances.

    A filter step of length Δt adds Δt² times these variances to the covariance.

    Source: `config/velodyne.yaml` and `IMU_Processing.hpp` of FAST-LIO.
    """

    name = "fastlio"
    title = "FAST-LIO and FAST-LIO2"
    extension = ".yaml"
    meaning = (
        "Units: discrete, variances of a step at the rate below: N² f and K² f. acc_cov (m/s²)², gyr_cov (rad/s)², "
        "b_acc_cov (m/s³)², b_gyr_cov (rad/s²)². Another rate needs other values. The inflation factor is squared.",
    )
    usage = (
        "Replace the keys under mapping: in your file. The usual values, 0.1 and 0.0001, are far larger than the noise "
        "of any sensor because they include other errors.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
        lines = [f"# for an IMU at {noise.written_rate} Hz", "mapping:"]
        gyro, accel = noise.of("gyro"), noise.of("accel")
        for key, number, unit in (
            ("acc_cov", accel.N[0], "(m/s^2)^2"), ("gyr_cov", gyro.N[0], "(rad/s)^2"),
            ("b_acc_cov", accel.K[0], "(m/s^3)^2"), ("b_gyr_cov", gyro.K[0], "(rad/s^2)^2"),
        ):  # fmt: skip
            lines.append(f"    {key}: {written(number.value**2 * noise.rate)}  # {unit}{limit_mark(number)}")
        return lines
