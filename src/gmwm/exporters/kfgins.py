"""KF-GINS: imunoise in kf-gins.yaml."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm.exporters.base import ExportOptions, Noise, TwoNumbers, register
from gmwm.exporters.reduction import Number
from gmwm.exporters.text import written

_DEGREE = math.pi / 180
_MILLIGAL = 1e-5


@register
class KfGins(TwoNumbers):
    """KF-GINS: N, and a Gauss-Markov bias with σ and one correlation time T for all axes.

    The filter drives the bias with 2σ²/T, so σ = K√(T/2) has the random walk K. For a single slow Gauss-Markov term and
    its correlation time, it is the σ of the term.

    Source: `dataset/kf-gins.yaml`, `kf_gins.cpp` and `gi_engine.cpp` of KF-GINS.
    """

    name = "kfgins"
    title = "KF-GINS (kf-gins.yaml)"
    extension = ".yaml"
    per_axis = True
    takes = frozenset({"axes", "inflation", "horizon"})
    meaning = (
        "Units: continuous in time. arw deg/√h, vrw m/s/√h; gbstd deg/h and abstd mGal are the standard deviations of "
        "Gauss-Markov biases with the correlation time corrtime in h.",
        "corrtime is the longest correlation time T of all axes: that of the slowest Gauss-Markov term, or the length "
        "of the recording for an axis with a random walk. The standard deviations are K √(T/2), so that each axis has "
        "its random walk K over times far below T.",
    )
    usage = ("Keep gsstd and asstd of your file: a recording at rest does not show scale factors.",)

    def time_of(self, axis: str, times: Mapping[str, float], options: ExportOptions) -> float:
        """Return the longest correlation time, for all axes."""
        return max(times.values())

    def body(self, noise: Noise) -> Sequence[str]:
        """Return five keys with three numbers each."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        time = max(one.time for sensor in noise.sensors for one in sensor.axes)
        deviation = math.sqrt(time / 2)
        return [
            "imunoise:",
            f"  arw: {_row(gyro.N, 60 / _DEGREE)}  # deg/sqrt(h)",
            f"  vrw: {_row(accel.N, 60)}  # m/s/sqrt(h)",
            f"  gbstd: {_row(gyro.K, deviation * 3600 / _DEGREE)}  # deg/h",
            f"  abstd: {_row(accel.K, deviation / _MILLIGAL)}  # mGal",
            f"  corrtime: {written(time / 3600)}  # h",
        ]


def _row(numbers: Sequence[Number], factor: float) -> str:
    return f"[{', '.join(written(number.scaled(factor)) for number in numbers)}]"
