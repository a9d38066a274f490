"""Export for MATLAB: gyroparams and accelparams of imuSensor."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import written

_FLICKER = "BiasInstability"
_LASTING = 100.0
"""Time lag (s) up to which the filter of imuSensor produces flicker noise in an exported file. The head states it."""


@register
class Matlab(TwoNumbers):
    """File for MATLAB's simulator imuSensor with N, K and flicker noise of each axis.

    f is the sampling rate. With the NoiseType "single-sided", a sample has the standard deviation NoiseDensity √f and a
    step of the random walk has RandomWalk/√f, which agrees with the definitions of N and K. With the default
    "double-sided", MATLAB uses f/2 instead of f.

    BiasInstability is the coefficient B of white noise that drives a filter. The output of the filter is flicker noise
    with the spectral density B²/(2π|f|) at time lags up to as many samples as the filter has poles. At longer lags, it
    is white noise. The default filter has one pole.

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

    def advice(self, noise: Noise) -> tuple[str, ...]:
        """Return sentences on BiasInstability."""
        if not _has_flicker(noise):
            return ("BiasInstability stays 0: it is another process in addition to N and K, which describe all noise.",)
        return (
            "BiasInstability is the coefficient B of the flicker noise in rad/s and m/s². N and K do not include it. "
            f"Its filter produces flicker noise up to a time lag of as many samples as it has poles, here {_LASTING:g} "
            "s: increase poles for longer simulations. fractalcoef needs R2023b or later.",
        )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return MATLAB code with one call for each sensor."""
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
