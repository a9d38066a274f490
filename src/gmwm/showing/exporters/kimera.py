"""Export for Kimera-VIO: the noise parameters in ImuParams.yaml."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.kalibr import CONTINUOUS, four_numbers


@register
class Kimera(TwoNumbers):
    """File for Kimera-VIO with the four continuous-time noise densities of Kalibr and the sampling rate.

    Source: `params/Euroc/ImuParams.yaml` of Kimera-VIO.
    """

    name = "kimera"
    title = "Kimera-VIO (ImuParams.yaml)"
    extension = ".yaml"
    first = "%YAML:1.0"
    meaning = CONTINUOUS
    usage = (
        "Replace these keys in your ImuParams.yaml. Keep T_BS, imu_preintegration_type, imu_integration_sigma, "
        "imu_time_shift and n_gravity.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines with Kimera's keys."""
        return [f"rate_hz: {noise.written_rate}  # Hz", *four_numbers(noise)]
