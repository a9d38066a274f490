"""MATLAB: gyroparams and accelparams of imuSensor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gmwm.exporters.base import Noise, TwoNumbers, register
from gmwm.exporters.reduction import Number
from gmwm.exporters.text import written

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


_FLICKER = "BiasInstability"
_LASTING = 100.0
"""Time lag (s) up to which the filter of imuSensor produces flicker noise: its default, which the head states."""


@register
class Matlab(TwoNumbers):
    """MATLAB: N and K of each axis for the simulator imuSensor.

    With the NoiseType "single-sided", a sample has the standard deviation NoiseDensity √f and a step of the random walk
    RandomWalk/√f, as N and K are defined. With the default "double-sided", f/2 replaces f.

    BiasInstability drives a filter whose output has the density B²/(2π|f|) of flicker noise at time lags up to the
    number of its poles, in samples, and is white noise at longer lags. The default filter has one pole.

    Source: reference pages of imuSensor, gyroparams, accelparams and fractalcoef, and the simulator's code.
    """

    name = "matlab"
    title = "MATLAB (imuSensor with gyroparams and accelparams)"
    extension = ".m"
    comment = "%"
    default_axes = "each"
    both = False
    per_axis = True
    flicker = _FLICKER
    meaning = (
        "Units: continuous-time densities, one-sigma. NoiseDensity (rad/s)/√Hz and (m/s²)/√Hz; RandomWalk is the rate "
        "and acceleration random walk K in (rad/s)/√s and (m/s²)/√s, which MATLAB writes as (rad/s)√Hz and (m/s²)√Hz.",
        "NoiseType is single-sided, so that a sample has the standard deviation N √f. With MATLAB's default, "
        "double-sided, it is smaller by √2, and the random walk is larger by √2.",
    )

    def head(self, calibration: Calibration, noise: Noise) -> list[str]:
        """Return the head, with the meaning of BiasInstability."""
        head = super().head(calibration, noise)
        if not _has_flicker(noise):
            return [
                *head,
                "BiasInstability stays 0. In MATLAB it is another process in addition to N and K, which already "
                "describe the whole model.",
            ]
        return [
            *head,
            "BiasInstability is the coefficient B of the flicker noise in rad/s and m/s². N and K do not include it. "
            f"Its filter produces flicker noise up to a time lag of as many samples as it has poles, here {_LASTING:g} "
            "s, and white noise at longer lags: increase poles for longer simulations. The default filter of MATLAB "
            "has one pole and does not produce flicker noise. fractalcoef needs R2023b or later.",
        ]

    def body(self, noise: Noise) -> Sequence[str]:
        """Return one call for each sensor."""
        lines = [f"poles = {math.ceil(_LASTING * noise.rate)};"] if _has_flicker(noise) else []
        for sensor, maker in ((noise.gyro, "gyro"), (noise.accel, "accel")):
            if sensor is not None:
                lines += [
                    f"{maker} = {maker}params( ...", f"    'NoiseDensity', {_row(sensor.N)}, ...",
                    f"    'RandomWalk', {_row(sensor.K)}, ...",
                ]  # fmt: skip
                if _has_flicker(noise):
                    lines += [
                        f"    '{_FLICKER}', {_row(sensor.B)}, ...",
                        f"    '{_FLICKER}Coefficients', fractalcoef(poles, 1), ...",
                    ]
                lines.append("    'NoiseType', 'single-sided');")
        if len(noise.sensors) == 2:
            lines.append(
                f"imu = imuSensor('accel-gyro', 'SampleRate', {noise.written_rate}, "
                "'Gyroscope', gyro, 'Accelerometer', accel);"
            )
        return lines


def _has_flicker(noise: Noise) -> bool:
    return any(number.value > 0 for sensor in noise.sensors for number in sensor.B)


def _row(numbers: Sequence[Number]) -> str:
    return f"[{' '.join(written(number) for number in numbers)}]"
