"""Export for NaveGo: a MATLAB structure that describes an IMU."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.biases import three
from gmwm.showing.exporters.markov import Bias, GaussMarkov, of_sensor
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import row_mark, written

_DEGREE = math.pi / 180


@register
class NaveGo(GaussMarkov):
    """File for NaveGo with N, the range of the constant bias, and a Gauss-Markov bias for each axis.

    The Gauss-Markov bias has the standard deviation σ and the correlation time T.

    Source: `imu_si_errors.m`, `noise_b_sta.m` and `noise_b_dyn.m` of NaveGo, and its examples.
    """

    name = "navego"
    title = "NaveGo (structure for imu_si_errors)"
    extension = ".m"
    comment = "%"
    default_axes = "each"
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous in time, of x, y and z. arw deg/√h, vrw m/s/√h; gb_sta deg/s and ab_sta mg are sizes of the "
        "bias at rest: NaveGo draws a bias between minus and plus this size. gb_dyn deg/s and ab_dyn mg are the "
        "standard deviations of Gauss-Markov biases with the correlation times gb_corr and ab_corr in s, not the bias "
        "instability of a datasheet. arrw and vrrw are zero, because these biases include the random walk.",
    )
    usage = ("Convert to SI units: imu1 = imu_si_errors(imu, 1/imu.freq). Magnetometers: add m_psd of your file.",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return MATLAB code that sets the fields of the structure."""
        lines = []
        for sensor, prefix, density, walk, factor, unit in (
            (noise.of("gyro"), "gb", "arw", "arrw", 1 / _DEGREE, 60 / _DEGREE),
            (noise.of("accel"), "ab", "vrw", "vrrw", 1e3 / STANDARD_GRAVITY, 60.0),
        ):
            bias = of_sensor(sensor, found, noise)
            sigmas = [sigma for sigma, _ in bias]
            lines += [
                _row(density, [number.scaled(unit) for number in sensor.N], row_mark(sensor.N)),
                f"imu.{walk} = zeros(1, 3);",
                _row(f"{prefix}_sta", [Number(factor * abs(x), False) for x in three(noise.rest, sensor.quantity)], ""),
                _row(f"{prefix}_dyn", [sigma.scaled(factor) for sigma in sigmas], row_mark(sigmas)),
                _row(f"{prefix}_corr", [Number(time, False) for _, time in bias], ""),
            ]
        return [*lines, f"imu.freq = {noise.written_rate};"]


def _row(key: str, numbers: Sequence[Number], mark: str) -> str:
    comment = f"  %{mark[1:]}" if mark else ""
    return f"imu.{key} = [{' '.join(map(written, numbers))}];{comment}"
