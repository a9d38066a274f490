"""Export for OpenVINS: kalibr_imu_chain.yaml."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.kalibr import CONTINUOUS, four_numbers

_UNIT = ("[1.0, 0.0, 0.0]", "[0.0, 1.0, 0.0]", "[0.0, 0.0, 1.0]")
_POSE = ("[1.0, 0.0, 0.0, 0.0]", "[0.0, 1.0, 0.0, 0.0]", "[0.0, 0.0, 1.0, 0.0]", "[0.0, 0.0, 0.0, 1.0]")
_ZERO = ("[0.0, 0.0, 0.0]",) * 3


@register
class OpenVins(TwoNumbers):
    """File for OpenVINS with the four continuous-time noise densities of Kalibr and the other keys of its IMU file.

    Source: `config/euroc_mav/kalibr_imu_chain.yaml` of OpenVINS.
    """

    name = "openvins"
    title = "OpenVINS (kalibr_imu_chain.yaml)"
    extension = ".yaml"
    first = "%YAML:1.0"
    meaning = CONTINUOUS
    usage = (
        "OpenVINS recommends an inflation factor of 10 to 20. Everything but the four numbers and the rate is a "
        "placeholder for a perfect sensor: replace it by your own calibration.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the entry of one IMU."""
        lines = ["imu0:", *_matrix("T_i_b", _POSE), *(f"  {line}" for line in four_numbers(noise))]
        lines += [
            f"  rostopic: {noise.topic or '/imu0'}", "  time_offset: 0.0", f"  update_rate: {noise.written_rate}  # Hz",
            '  model: "kalibr"',
        ]  # fmt: skip
        for key, rows in (
            ("Tw", _UNIT), ("R_IMUtoGYRO", _UNIT), ("Ta", _UNIT), ("R_IMUtoACC", _UNIT), ("Tg", _ZERO)
        ):  # fmt: skip
            lines += _matrix(key, rows)
        return lines


def _matrix(key: str, rows: Sequence[str]) -> list[str]:
    return [f"  {key}:", *(f"    - {row}" for row in rows)]
