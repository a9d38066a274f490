"""Export for Autoware: imu_corrector.param.yaml."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gmwm.base.remarks import Remark
from gmwm.showing.exporters.base import Exporter, ExportOptions, register, sensor_missing, top
from gmwm.showing.exporters.biases import stated, three, unknown
from gmwm.showing.exporters.findings import of_lines
from gmwm.showing.exporters.reduction import Number, axes_of, require_unit, ruled
from gmwm.showing.exporters.ros import sample_variance, terms_without_variance
from gmwm.showing.exporters.text import cautions, laid_out, paragraphs, recording, written

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


@register
class Autoware(Exporter):
    """File for the node imu_corrector of Autoware with gyroscope offsets and standard deviations.

    The node subtracts the offsets, and writes the squared standard deviations into the covariances of its messages.

    Source: `imu_corrector_core.cpp` and `imu_corrector.param.yaml` of Autoware.
    """

    name = "autoware"
    title = "Autoware (imu_corrector.param.yaml)"
    extension = ".yaml"
    default_axes = "each"
    takes = frozenset({"axes", "inflation"})
    both = True
    per_axis = True

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the YAML file with the parameters of the node."""
        gyro, accel = (axes_of(calibration, quantity) for quantity in ("gyro", "accel"))
        if not gyro or not accel:
            raise sensor_missing(calibration, "accel" if gyro else "gyro", self.name)
        for axis in (*gyro, *accel):
            require_unit(axis, calibration[axis], "gyro" if axis in gyro else "accel")
        deviations = {axis: Number(math.sqrt(sample_variance(calibration[axis])), False) for axis in (*gyro, *accel)}
        rotation = ruled([(axis, deviations[axis]) for axis in gyro], options.axes, options.inflation)
        force = ruled([(axis, deviations[axis]) for axis in accel], "worst", options.inflation)[0]
        notes = [
            recording(calibration),
            *paragraphs(self.remarks(calibration, options)),
            "Units: discrete, standard deviations of one sample at the rate of the recording: rad/s, and m/s² for "
            "acceleration_stddev, the largest of the accelerometers. angular_velocity_offset rad/s is the bias at "
            "rest, which Autoware subtracts.",
            f"Inflation factor: {options.inflation:g} for standard deviations, not for offsets. Horizon: none.",
            *stated(calibration, ("gyro",)),
            "Autoware's defaults, 0.03 rad/s and 10000 m/s², are far larger than the noise of a sensor.",
        ]
        lines = ["/**:", "  ros__parameters:"]
        for letter, value in zip("xyz", three(calibration.rest, "gyro"), strict=True):
            lines.append(f"    angular_velocity_offset_{letter}: {written(value)}  # rad/s")
        for letter, number in zip("xyz", rotation, strict=True):
            lines.append(f"    angular_velocity_stddev_{2 * letter}: {written(number)}  # rad/s")
        lines.append(f"    acceleration_stddev: {written(force)}  # m/s^2")
        return laid_out(top(self, calibration), lines, notes, "#")

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on noise that the standard deviations do not include."""
        found = [*cautions(calibration), *unknown(calibration, ("gyro",))]
        for axis, fit in calibration.items():
            if terms := terms_without_variance(fit):
                found.append(Remark.of("not-in-file", axis, case="variance", terms=terms))
            found += of_lines(axis, fit)
        return tuple(found)
