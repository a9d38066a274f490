"""Exports for ROS: covariances of sensor_msgs/Imu messages, and the files of Autoware and DLIO."""

from __future__ import annotations

import math
from collections.abc import Iterator

from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark
from gmwm.base.units import Quantity
from gmwm.calibration import Calibration
from gmwm.fitting.estimation.result import Fit
from gmwm.showing.exporters.base import QUANTITIES, Exporter, ExportOptions, register, sensor_missing, top
from gmwm.showing.exporters.quality import of_lines
from gmwm.showing.exporters.reduction import (
    RULES,
    Number,
    axes_of,
    known_axes,
    require_unit,
    ruled,
    stated,
    three,
    unknown,
)
from gmwm.showing.exporters.text import cautions, laid_out, paragraphs, recording, written
from gmwm.theory.processes import registry
from gmwm.theory.processes.base import Process

_KEYS: dict[Quantity, str] = {"gyro": "angular_velocity_covariance", "accel": "linear_acceleration_covariance"}


@register
class Ros(Exporter):
    """Covariances of ROS messages (`sensor_msgs/msg/Imu.msg`): the variance of one sample on the diagonal, over
    stationary noise, σ² + 2Q² + Σ σ²_GM, without sinusoids."""

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
            "Gauss-Markov and other correlated terms. The covariance of the orientation is not noise of the sensors."
        ]
        return laid_out(top(self, calibration), lines, notes, "#")

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on terms without a finite variance and on sinusoids."""
        return (*cautions(calibration), *_not_in_variances(calibration))


def sample_variance(fit: Fit) -> float:
    """Return the variance (SI) of a sample's stationary noise, without sinusoids and terms that act as walks."""
    rate = fit.wavelet_variance.rate
    stationary = [process for term, process in _noises(fit) if not _grows(fit, term, process)]
    return sum(float(process.autocovariance([0], rate)[0]) for process in stationary)


def _noises(fit: Fit) -> list[tuple[str, Process]]:
    pairs = fit.model.by_term.items()
    return [(term, p) for term, p in pairs if p.scale > 0 and p.oscillation() is None]


def _grows(fit: Fit, term: str, process: Process) -> bool:
    """Return whether the variance of a term grows with time, or the data do not distinguish it from such noise."""
    acts = registry.get(fit.diagnostics.acts_as.get(term, ""))
    infinite = process.correlation_time(fit.wavelet_variance.rate) == math.inf
    return not process.stationary or infinite or (acts is not None and not acts.stationary)


def _not_in_variances(calibration: Calibration) -> Iterator[Remark]:
    for axis, fit in calibration.items():
        if terms := tuple(term for term, process in _noises(fit) if _grows(fit, term, process)):
            yield Remark.of("not-in-file", axis, case="variance", terms=terms)
        yield from of_lines(axis, fit)


@register
class Autoware(Exporter):
    """Gyroscope offsets, which Autoware's imu_corrector subtracts, and standard deviations, squared in its messages.
    Source: `imu_corrector_core.cpp` and `imu_corrector.param.yaml` of Autoware."""

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
        return (*cautions(calibration), *unknown(calibration, ("gyro",)), *_not_in_variances(calibration))


@register
class Dlio(Exporter):
    """DLIO's biases at rest: corrected = sm · raw − bias, with the scale matrix sm; it has no noise parameters. Source:
    `cfg/dlio.yaml` and `odom.cc` of direct_lidar_inertial_odometry."""

    name = "dlio"
    title = "DLIO (dlio.yaml)"
    extension = ".yaml"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the YAML file with the intrinsic parameters of the IMU."""
        if not known_axes(calibration.rest, "gyro"):
            raise DataError(
                "dlio needs the biases of the gyroscopes, but this calibration has none",
                advice="Calibrate a recording with gyroscopes, and not a wavelet variance.",
            )
        notes = [
            recording(calibration),
            *paragraphs(self.remarks(calibration, options)),
            "Units: biases at rest, accelerometers m/s², gyroscopes rad/s, in the order x, y, z. DLIO has no "
            "parameters for N and K. Inflation factor: none. Horizon: none.",
            *stated(calibration, ("gyro", "accel")),
            "With calibration: false, DLIO starts with these biases. With true, it estimates them in its first seconds "
            "and ignores them. Keep sm of your file if you have calibrated scale factors.",
        ]
        lines = ["dlio:", "  imu:", "    calibration: false", "    intrinsics:"]
        for key, quantity, extra in (("accel", "accel", True), ("gyro", "gyro", False)):
            values = three(calibration.rest, "accel" if quantity == "accel" else "gyro")
            lines += [f"      {key}:", f"        bias: [{', '.join(map(written, values))}]"]
            lines += ["        sm: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]"] if extra else []
        return laid_out(top(self, calibration), lines, notes, "#")

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on axes whose bias is not known."""
        return (*cautions(calibration), *unknown(calibration, ("gyro", "accel")))
