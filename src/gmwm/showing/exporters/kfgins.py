"""Export for KF-GINS: the entry imunoise in kf-gins.yaml."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.markov import Bias, GaussMarkov, of_sensor
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import row_mark, written

_DEGREE = math.pi / 180


@register
class KfGins(GaussMarkov):
    """File for KF-GINS with N and a Gauss-Markov bias with σ for each axis, and one correlation time T for all axes.

    The filter uses the spectral density 2σ²/T for the driving noise of the bias. If a model has a single slow
    Gauss-Markov term, σ and T are the parameters of this term.

    Source: `dataset/kf-gins.yaml`, `kf_gins.cpp` and `gi_engine.cpp` of KF-GINS.
    """

    name = "kfgins"
    title = "KF-GINS (kf-gins.yaml)"
    extension = ".yaml"
    common = True
    default_axes = "each"
    takes = frozenset({"axes", "inflation", "horizon", "duration"})
    meaning = (
        "Units: continuous in time. arw deg/√h, vrw m/s/√h; gbstd deg/h and abstd mGal are the standard deviations of "
        "Gauss-Markov biases with the correlation time corrtime in h, one for all axes.",
    )
    usage = ("Keep gsstd and asstd of your file: a recording at rest does not show scale factors.",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the entry with its five keys."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        sigmas = [[sigma for sigma, _ in of_sensor(sensor, found, noise)] for sensor in (gyro, accel)]
        time = next(iter(found.values())).time
        measured = not all(bias.sigma.upper for bias in found.values())
        return [
            "imunoise:", _row("arw", gyro.N, 60 / _DEGREE, "deg/sqrt(h)"), _row("vrw", accel.N, 60, "m/s/sqrt(h)"),
            _row("gbstd", sigmas[0], 3600 / _DEGREE, "deg/h"), _row("abstd", sigmas[1], 1e5, "mGal"),
            f"  corrtime: {written(time / 3600)}  # h{'' if measured else '  not measured'}",
        ]  # fmt: skip


def _row(key: str, numbers: Sequence[Number], factor: float, unit: str) -> str:
    shown = ", ".join(written(number.scaled(factor)) for number in numbers)
    return f"  {key}: [{shown}]  # {unit}{row_mark(numbers)}"
