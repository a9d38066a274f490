"""MATLAB: gyroparams and accelparams of imuSensor."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.exporters.base import Noise, TwoNumbers, register
from gmwm.exporters.reduction import Number
from gmwm.exporters.words import written


@register
class Matlab(TwoNumbers):
    """N and K of each axis for the simulator imuSensor.

    With NoiseType "single-sided" a sample has the standard deviation NoiseDensity √f and a step of the walk
    RandomWalk/√f, which is what N and K mean; with "double-sided", its default, f/2 stands in the place of f.

    Source: reference pages of imuSensor, gyroparams and accelparams, and the simulator's code.
    """

    name = "matlab"
    title = "MATLAB (imuSensor with gyroparams and accelparams)"
    extension = ".m"
    comment = "%"
    default_axes = "each"
    both = False
    per_axis = True
    meaning = (
        "Units: continuous-time densities, one-sigma. NoiseDensity (rad/s)/√Hz and (m/s²)/√Hz; RandomWalk is the rate "
        "and acceleration random walk K in (rad/s)/√s and (m/s²)/√s, which MATLAB calls (rad/s)√Hz and (m/s²)√Hz.",
        "NoiseType is single-sided: then a sample has the standard deviation N √f. MATLAB's default, double-sided, "
        "makes it smaller by √2, and the walk larger by √2.",
    )
    advice = (
        "BiasInstability stays at 0: it is a process of its own there, on top of N and K, which already stand for "
        "the whole model.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """One call each."""
        lines = []
        for sensor, maker in ((noise.gyro, "gyro"), (noise.accel, "accel")):
            if sensor is not None:
                lines += [
                    f"{maker} = {maker}params( ...", f"    'NoiseDensity', {_row(sensor.N)}, ...",
                    f"    'RandomWalk', {_row(sensor.K)}, ...", "    'NoiseType', 'single-sided');",
                ]  # fmt: skip
        if len(noise.sensors) == 2:
            lines.append(
                f"imu = imuSensor('accel-gyro', 'SampleRate', {noise.rate!r}, "
                "'Gyroscope', gyro, 'Accelerometer', accel);"
            )
        return lines


def _row(numbers: Sequence[Number]) -> str:
    return f"[{' '.join(written(number) for number in numbers)}]"
