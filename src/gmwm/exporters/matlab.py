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
_HELD = 100.0
"""How long (s) the filter is to hold flicker noise for."""


@register
class Matlab(TwoNumbers):
    """N and K of each axis for the simulator imuSensor.

    With NoiseType "single-sided" a sample has the standard deviation NoiseDensity √f and a step of the walk
    RandomWalk/√f, which is what N and K mean; with "double-sided", its default, f/2 stands in the place of f.

    BiasInstability drives a filter whose output has the density B²/(2π|f|) of flicker noise at time lags up to as many
    samples as the filter has poles, and is white beyond; the default has one pole.

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
        "and acceleration random walk K in (rad/s)/√s and (m/s²)/√s, which MATLAB calls (rad/s)√Hz and (m/s²)√Hz.",
        "NoiseType is single-sided: then a sample has the standard deviation N √f. MATLAB's default, double-sided, "
        "makes it smaller by √2, and the walk larger by √2.",
    )

    def head(self, calibration: Calibration, noise: Noise) -> list[str]:
        """With what BiasInstability holds."""
        said = super().head(calibration, noise)
        if not _has_flicker(noise):
            return [
                *said,
                "BiasInstability stays at 0: it is a process of its own there, on top of N and K, which already stand "
                "for the whole model.",
            ]
        return [
            *said,
            "BiasInstability is the coefficient B of the flicker noise, rad/s and m/s², which is in none of the other "
            f"numbers. Its filter holds it over as many samples as it has poles, here {_HELD:g} s; beyond it is white: "
            "raise poles for longer simulations. MATLAB's default filter has one pole, which is no flicker noise. "
            "fractalcoef needs R2023b or later.",
        ]

    def body(self, noise: Noise) -> Sequence[str]:
        """One call each."""
        lines = [f"poles = {math.ceil(_HELD * noise.rate)};"] if _has_flicker(noise) else []
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
