"""ROS: the covariances of sensor_msgs/Imu, for a driver to fill in."""

from __future__ import annotations

import math
from importlib import metadata
from typing import TYPE_CHECKING

from gmwm.datasheets.effective import is_scale_free
from gmwm.datasheets.equivalent_terms import translated
from gmwm.errors import DataError
from gmwm.estimation.result import Fit
from gmwm.exporters.base import QUANTITIES, Exporter, ExportOptions, register
from gmwm.exporters.reduction import RULES, Number, axes_of, lines_of, require_unit, ruled
from gmwm.exporters.text import commented, recording, written

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.units import Quantity

_KEYS: dict[Quantity, str] = {"gyro": "angular_velocity_covariance", "accel": "linear_acceleration_covariance"}


@register
class Ros(Exporter):
    """Variance of a sample: all stationary noise of the model, σ² + 2Q² + Σ σ²_GM, on the diagonal; lines are none.

    Source: `sensor_msgs/msg/Imu.msg`.
    """

    name = "ros"
    title = "the covariances of ROS messages (sensor_msgs/Imu)"
    extension = ".yaml"
    default_axes = "each"
    takes = frozenset({"axes", "inflation"})
    per_axis = True

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """A list of nine numbers for each sensor there is."""
        head = [
            f"Noise of an IMU for {self.title}. Written by gmwm {metadata.version('gmwm')}.",
            *recording(calibration),
            "Units: discrete, variances of one sample at the rate of the recording, row by row: angular_velocity "
            "(rad/s)², linear_acceleration (m/s²)².",
            f"Inflation factor: {options.inflation:g}, which enters squared. Horizon: none.",
        ]
        lines = []
        for quantity in QUANTITIES:
            if not (names := axes_of(calibration, quantity)):
                continue
            head.append(f"{_KEYS[quantity]}: {RULES[options.axes]} {', '.join(names)}.")
            for axis in names:
                require_unit(axis, calibration[axis], quantity)
                head.append(f"Model of {axis}: {calibration[axis].model.structure}.")
            deviations = [(axis, Number(math.sqrt(sample_variance(calibration[axis])), False)) for axis in names]
            three = [number.value**2 for number in ruled(deviations, options.axes, options.inflation)]
            nine = ", ".join(written(three[k // 4]) if k % 4 == 0 else "0.0" for k in range(9))
            lines.append(f"{_KEYS[quantity]}: [{nine}]")
        if not lines:
            raise DataError(
                f"ros needs gyroscopes or accelerometers, as gyro_x and accel_x; got {', '.join(calibration)}"
            )
        head.append(
            "They are the variances of all stationary noise: white noise, quantization noise, Gauss-Markov and other "
            "correlated terms. Random walks and ramps have no variance and are left out; the message has no place for "
            "them. The covariance of the orientation is not the sensors' noise."
        )
        if any(not p.stationary and is_scale_free(p, fit.wavelet_variance.rate) and p.scale > 0
               for fit in calibration.values() for p in fit.model.processes):  # fmt: skip
            head.append("Flicker and power-law noise have none either, and are left out too.")
        lines_there = [(axis, line) for axis in calibration for line in lines_of(calibration[axis])]
        head += [f"Not in these numbers: {line}, on {axis}." for axis, line in lines_there]
        return "\n".join([*commented(head, "#"), "", *lines]) + "\n"


def sample_variance(fit: Fit) -> float:
    """Variance (SI) of one sample of the stationary noise of a model; terms that act as a walk are none, lines too."""
    model, wv = translated(fit)[0].model, fit.wavelet_variance
    stationary = [p for p in model.processes if p.stationary and p.scale > 0 and p.line(wv.rate) is None]
    lasting = [p for p in stationary if p.correlation_time(wv.rate) != math.inf]
    return sum(float(p.autocovariance([0], wv.rate)[0]) for p in lasting)
