"""Export for Gazebo: the noise of an IMU in SDF."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from gmwm.showing.exporters.base import Noise, register
from gmwm.showing.exporters.markov import Bias, GaussMarkov, of_sensor
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import commented, commented_notes, shortened, unended, written


@register
class Gazebo(GaussMarkov):
    """File for Gazebo with the standard deviation N√f of a sample and a Gauss-Markov bias.

    f is the sampling rate, and σ and T are the standard deviation and the correlation time of the bias. Its driving
    noise is q = σ√(2/T).

    In each step Δt, the simulator computes the bias as b ← e^(−Δt/T) b + w with Var w = q² T (1 − e^(−2Δt/T))/2.

    Source: SDFormat's description of noise, and `GaussianNoiseModel.cc` of Gazebo.
    """

    name = "gazebo"
    title = "Gazebo (SDF)"
    extension = ".sdf"
    comment = ""
    default_axes = "each"
    both = False
    meaning = (
        "Units: stddev is discrete, the standard deviation of a sample, N √f: rad/s and m/s². dynamic_bias_stddev is "
        "continuous, the driving noise of a Gauss-Markov bias: rad/s/√s and m/s²/√s; "
        "dynamic_bias_correlation_time s.",
    )
    usage = ("Put this element into <sensor type='imu'>. Its update_rate must be the rate of stddev.",)

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the file, with the head and the notes as XML comments."""
        above, below = commented(shortened(head), ""), commented_notes(notes, "")
        return "\n".join([*_comment(above), *self.body(noise), *_comment(below)]) + "\n"

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the XML element "imu" with the noise of each axis."""
        names = {"gyro": "angular_velocity", "accel": "linear_acceleration"}
        lines = [f"<!-- stddev for {noise.written_rate} Hz -->", "<imu>"]
        for sensor in noise.sensors:
            lines.append(f"  <{names[sensor.quantity]}>")
            for letter, white, (sigma, time) in zip("xyz", sensor.N, of_sensor(sensor, found, noise), strict=True):
                lines += _axis(letter, white.scaled(math.sqrt(noise.rate)), sigma.scaled(math.sqrt(2 / time)), time)
            lines.append(f"  </{names[sensor.quantity]}>")
        return [*lines, "</imu>"]


def _comment(lines: Sequence[str]) -> list[str]:
    return ["<!--", *(f"  {unended(line.strip())}" for line in lines), "-->"]


def _axis(letter: str, stddev: Number, drive: Number, time: float) -> list[str]:
    upper = [key for key, number in (("stddev", stddev), ("dynamic_bias_stddev", drive)) if number.upper]
    return [
        f"    <{letter}>", '      <noise type="gaussian">',
        *([f"        <!-- upper limit: {', '.join(upper)} -->"] if upper else []), "        <mean>0.0</mean>",
        f"        <stddev>{written(stddev)}</stddev>",
        f"        <dynamic_bias_stddev>{written(drive)}</dynamic_bias_stddev>",
        f"        <dynamic_bias_correlation_time>{written(time)}</dynamic_bias_correlation_time>", "      </noise>",
        f"    </{letter}>",
    ]  # fmt: skip
