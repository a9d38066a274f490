"""Export for OKVIS 2: the entry imu_parameters of its configuration."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.biases import prior, three
from gmwm.showing.exporters.text import limit_mark, written


@register
class Okvis2(TwoNumbers):
    """File for OKVIS 2 with four continuous-time noise densities, the biases at rest and their standard deviations.

    Source: `config/euroc.yaml` of OKVIS 2 and `ImuParameters` of `okvis/Parameters.hpp`.
    """

    name = "okvis2"
    title = "OKVIS 2 (imu_parameters)"
    extension = ".yaml"
    first = "%YAML:1.0"
    takes = frozenset({"axes", "inflation", "horizon"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous-time densities, one-sigma. sigma_g_c rad/s/√Hz, sigma_a_c m/s²/√Hz, sigma_gw_c rad/s²/√Hz, "
        "sigma_aw_c m/s³/√Hz. g0 rad/s and a0 m/s² are the initial biases, sigma_bg and sigma_ba their standard "
        "deviations: error, rms and turn-on spread together, of the axis with the largest.",
    )
    usage = (
        "Replace these keys under imu_parameters of your file, and keep its a_max, g_max, g and T_BS. A bias that is "
        "not known for all axes of a sensor is left out: keep your value.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the entry imu_parameters."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        lines = [
            "imu_parameters:",
            f"    sigma_g_c: {written(gyro.N[0])}  # rad/s/sqrt(Hz){limit_mark(gyro.N[0])}",
            f"    sigma_a_c: {written(accel.N[0])}  # m/s^2/sqrt(Hz){limit_mark(accel.N[0])}",
            f"    sigma_gw_c: {written(gyro.K[0])}  # rad/s^2/sqrt(Hz){limit_mark(gyro.K[0])}",
            f"    sigma_aw_c: {written(accel.K[0])}  # m/s^3/sqrt(Hz){limit_mark(accel.K[0])}",
        ]
        for quantity, sigma, start, unit in (("gyro", "sigma_bg", "g0", "rad/s"), ("accel", "sigma_ba", "a0", "m/s^2")):
            deviation = prior(noise.rest, "gyro" if quantity == "gyro" else "accel")
            if deviation is not None:
                values = ", ".join(written(x) for x in three(noise.rest, "gyro" if quantity == "gyro" else "accel"))
                lines += [f"    {sigma}: {written(deviation)}  # {unit}", f"    {start}: [{values}]  # {unit}"]
        return lines
