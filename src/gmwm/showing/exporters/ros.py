"""Export for ROS: the covariances of sensor_msgs/Imu messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark
from gmwm.fitting.estimation.result import Fit
from gmwm.showing.exporters.base import QUANTITIES, Exporter, ExportOptions, register, top
from gmwm.showing.exporters.findings import of_lines
from gmwm.showing.exporters.reduction import RULES, Number, axes_of, require_unit, ruled
from gmwm.showing.exporters.text import cautions, laid_out, paragraphs, recording, written
from gmwm.theory.processes import registry
from gmwm.theory.processes.base import Process

if TYPE_CHECKING:
    from gmwm.base.units import Quantity
    from gmwm.calibration import Calibration

_KEYS: dict[Quantity, str] = {"gyro": "angular_velocity_covariance", "accel": "linear_acceleration_covariance"}


@register
class Ros(Exporter):
    """Covariances of ROS messages, with the variance of one sample on the diagonal.

    The variance is the sum over all stationary noise of the model, σ² + 2Q² + Σ σ²_GM, without sinusoids.

    Source: `sensor_msgs/msg/Imu.msg`.
    """

    name = "ros"
    title = "the covariances of ROS messages (sensor_msgs/Imu)"
    extension = ".yaml"
    default_axes = "each"
    takes = frozenset({"axes", "inflation"})
    per_axis = True

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the file, with a list of nine numbers for each calibrated sensor."""
        notes = [
            recording(calibration),
            *paragraphs(self.remarks(calibration, options)),
            "Units: discrete, variances of one sample at the rate of the recording, row by row: angular_velocity "
            "(rad/s)², linear_acceleration (m/s²)².",
            f"Inflation factor: {options.inflation:g}, squared. Horizon: none.",
        ]  # fmt: skip
        lines = []
        for quantity in QUANTITIES:
            if not (names := axes_of(calibration, quantity)):
                continue
            notes.append(f"{_KEYS[quantity]}: {RULES[options.axes]} {', '.join(names)}.")
            for axis in names:
                require_unit(axis, calibration[axis], quantity)
            deviations = [(axis, Number(math.sqrt(sample_variance(calibration[axis])), False)) for axis in names]
            three = [number.value**2 for number in ruled(deviations, options.axes, options.inflation)]
            nine = ", ".join(written(three[k // 4]) if k % 4 == 0 else "0.0" for k in range(9))
            lines.append(f"{_KEYS[quantity]}: [{nine}]")
        if not lines:
            raise DataError(
                f"ros needs gyroscopes or accelerometers, but this calibration has only {', '.join(calibration)}",
                advice="Calibrate a recording with axes such as gyro_x and accel_x.",
            )
        notes += [
            "The covariances are the variances of all stationary noise: white noise, quantization noise, and "
            "Gauss-Markov and other correlated terms. The covariance of the orientation is not noise of the sensors.",
        ]
        return laid_out(top(self, calibration), lines, notes, "#")

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on terms without a finite variance and on sinusoids."""
        found = cautions(calibration)
        for axis, fit in calibration.items():
            if terms := terms_without_variance(fit):
                found.append(Remark.of("not-in-file", axis, case="variance", terms=terms))
            found += of_lines(axis, fit)
        return tuple(found)


def terms_without_variance(fit: Fit) -> tuple[str, ...]:
    """Return the terms of a fit whose variance grows with time."""
    return tuple(term for term, process in _noises(fit) if _grows(fit, term, process))


def sample_variance(fit: Fit) -> float:
    """Return the variance (SI) of one sample of the stationary noise of a fit. Sinusoids and terms that act as a random
    walk are left out."""
    rate = fit.wavelet_variance.rate
    stationary = [process for term, process in _noises(fit) if not _grows(fit, term, process)]
    return sum(float(process.autocovariance([0], rate)[0]) for process in stationary)


def _noises(fit: Fit) -> list[tuple[str, Process]]:
    pairs = zip(fit.model.terms, fit.model.processes, strict=True)
    return [(term, p) for term, p in pairs if p.scale > 0 and p.oscillation() is None]


def _grows(fit: Fit, term: str, process: Process) -> bool:
    """Return whether the variance of a term grows with time, or the data do not distinguish it from such noise."""
    acts = registry.get(fit.diagnostics.acts_as.get(term, ""))
    infinite = process.correlation_time(fit.wavelet_variance.rate) == math.inf
    return not process.stationary or infinite or (acts is not None and not acts.stationary)
