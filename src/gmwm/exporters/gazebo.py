"""Gazebo: the noise of an IMU in SDF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm.axis_names import letter_of, sensor_of
from gmwm.exporters.base import ExportOptions, Noise, TwoNumbers, register
from gmwm.exporters.reduction import SensorNoise
from gmwm.exporters.text import unended, written

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


@register
class Gazebo(TwoNumbers):
    """Gazebo: standard deviation σ = N√f of a sample, and a Gauss-Markov bias driven by K.

    The bias of the simulator is b ← e^(−Δt/T) b + w, Var w = K² T (1 − e^(−2Δt/T))/2.

    Source: SDFormat's description of noise, and `GaussianNoiseModel.cc` of Gazebo.
    """

    name = "gazebo"
    title = "Gazebo (SDF)"
    extension = ".sdf"
    comment = ""
    default_axes = "each"
    both = False
    per_axis = True
    meaning = (
        "Units: stddev is discrete, the standard deviation of a sample, N √f: rad/s and m/s². dynamic_bias_stddev is "
        "continuous, the random walk K: rad/s/√s and m/s²/√s; dynamic_bias_correlation_time s.",
        "The correlation time is that of the slowest Gauss-Markov term, or the length of the recording for an axis "
        "with a random walk.",
    )
    usage = ("Put this element into <sensor type='imu'>. Its update_rate must be the rate of stddev.",)

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Write the head as one XML comment."""
        text = super().export(calibration, options)
        head, _, body = text.partition("\n\n")
        lines = "\n".join(f"  {unended(line.strip())}" for line in head.splitlines())
        return f"<!--\n{lines}\n-->\n{body}"

    def time_of(self, axis: str, times: Mapping[str, float], options: ExportOptions) -> float:
        """Correlation time (s) of the axis. If the file has one number for all axes, the longest correlation time of
        the sensor."""
        if options.axes == "each":
            return times[axis]
        return max(time for other, time in times.items() if sensor_of(other) == sensor_of(axis))

    def body(self, noise: Noise) -> Sequence[str]:
        """Return an element for each axis."""
        names = {"gyro": "angular_velocity", "accel": "linear_acceleration"}
        lines = [f"<!-- stddev for {noise.written_rate} Hz -->", "<imu>"]
        for sensor in noise.sensors:
            lines.append(f"  <{names[sensor.quantity]}>")
            for k, letter in enumerate("xyz"):
                lines += _axis(sensor, k, letter, noise)
            lines.append(f"  </{names[sensor.quantity]}>")
        return [*lines, "</imu>"]


def _axis(sensor: SensorNoise, k: int, letter: str, noise: Noise) -> list[str]:
    times = {letter_of(one.axis): one.time for one in sensor.axes}
    time = times[letter] if noise.options.axes == "each" else sensor.axes[0].time
    stddev = sensor.N[k].scaled(math.sqrt(noise.rate))
    upper = [s for s, number in (("stddev", stddev), ("dynamic_bias_stddev", sensor.K[k])) if number.upper]
    return [
        f"    <{letter}>",
        '      <noise type="gaussian">',
        *([f"        <!-- upper limit: {', '.join(upper)} -->"] if upper else []),
        "        <mean>0.0</mean>",
        f"        <stddev>{written(stddev)}</stddev>",
        f"        <dynamic_bias_stddev>{written(sensor.K[k])}</dynamic_bias_stddev>",
        f"        <dynamic_bias_correlation_time>{written(time)}</dynamic_bias_correlation_time>",
        "      </noise>",
        f"    </{letter}>",
    ]
