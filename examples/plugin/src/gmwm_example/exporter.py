"""An export format: the INI file of a filter."""

import math
from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written

PER_ROOT_HOUR = 60.0  # 1/√s = 60/√h


@register
class MyFilter(TwoNumbers):
    """Two numbers of each sensor in an INI file.

    Source: the manual of the filter, section "IMU".
    """

    name = "myfilter"
    title = "my filter (imu.ini)"
    extension = ".ini"
    comment = ";"
    meaning = (
        "Units: continuous in time, one-sigma. arw deg/√h, vrw m/s/√h; gyro_walk rad/s²/√Hz, accel_walk m/s³/√Hz.",
    )
    usage = ("Keep the section [camera] of your own file.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """The section [imu]; a number that is only an upper limit is marked."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        numbers = {
            "arw": (gyro.N[0].scaled(math.degrees(PER_ROOT_HOUR)), "deg/sqrt(h)"),
            "vrw": (accel.N[0].scaled(PER_ROOT_HOUR), "m/s/sqrt(h)"),
            "gyro_walk": (gyro.K[0], "rad/s^2/sqrt(Hz)"),
            "accel_walk": (accel.K[0], "m/s^3/sqrt(Hz)"),
        }
        lines = [f"{key} = {written(one)}  ; {unit}{limit_mark(one)}" for key, (one, unit) in numbers.items()]
        return ["[imu]", *lines, f"rate = {noise.written_rate}"]
