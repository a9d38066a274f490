"""Export for gnss-ins-sim: a Python dictionary that describes an IMU."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.biases import three
from gmwm.showing.exporters.markov import Bias, GaussMarkov, of_sensor
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import row_mark, written

_DEGREE = math.pi / 180


@register
class GnssInsSim(GaussMarkov):
    """File for gnss-ins-sim with the constant bias, N and a Gauss-Markov bias for each axis.

    The Gauss-Markov bias has the standard deviation σ and the correlation time T.

    Source: `imu_model.py` and `pathgen.py` (`bias_drift`) of gnss-ins-sim.
    """

    name = "gnss-ins-sim"
    title = "gnss-ins-sim (dictionary for imu_model.IMU)"
    extension = ".py"
    default_axes = "each"
    takes = frozenset({"axes", "inflation", "horizon", "duration"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous in time, of x, y and z. gyro_b deg/h, gyro_arw deg/√h, gyro_b_stability deg/h and "
        "gyro_b_corr s; accel_b m/s², accel_vrw m/s/√h, accel_b_stability m/s² and accel_b_corr s. b_stability and "
        "b_corr are σ and the correlation time of a Gauss-Markov process, not the bias instability of a datasheet.",
    )
    usage = ("Pass the dictionary: imu_model.IMU(accuracy=imu_err, axis=6, gps=False).",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the Python code of the dictionary."""
        lines = ["import numpy as np", "", "imu_err = {"]
        for name, walk, sensor, factor in (
            ("gyro", "arw", noise.of("gyro"), 1 / _DEGREE), ("accel", "vrw", noise.of("accel"), 1.0)
        ):  # fmt: skip
            rate = 3600 * factor if name == "gyro" else 1.0
            bias = of_sensor(sensor, found, noise)
            sigmas = [sigma for sigma, _ in bias]
            lines += [
                _row(f"{name}_b", [Number(rate * x, False) for x in three(noise.rest, sensor.quantity)], ""),
                _row(f"{name}_{walk}", [n.scaled(60 * factor) for n in sensor.N], row_mark(sensor.N)),
                _row(f"{name}_b_stability", [sigma.scaled(rate) for sigma in sigmas], row_mark(sigmas)),
                _row(f"{name}_b_corr", [Number(time, False) for _, time in bias], ""),
            ]
        return [*lines, "}"]


def _row(key: str, numbers: Sequence[Number], mark: str) -> str:
    comment = f"  #{mark[1:]}" if mark else ""
    return f"    '{key}': np.array([{', '.join(map(written, numbers))}]),{comment}"
