"""Export for PX4 and ArduPilot: lower bounds for the noise parameters of their filters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.text import limit_mark, written


class _Floor(TwoNumbers):
    """Base of formats with lower bounds for the noise parameters p of a filter with the time step Δt.

    In each step, the filter adds (Δt p)² to its variances, so p = N/√Δt or p = K/√Δt.
    """

    takes = frozenset({"axes", "inflation", "horizon"})
    step: ClassVar[float]
    """Time step Δt of the filter (s)."""
    keys: ClassVar[tuple[str, str, str, str]]
    """Names of the parameters: noise of gyroscopes, noise of accelerometers, and the same for their biases."""
    row: ClassVar[str]
    """Template of a line of the file."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four parameters as comment lines, so that loading the file changes nothing."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        factor = 1 / math.sqrt(self.step)
        found = (gyro.N[0], accel.N[0], gyro.K[0], accel.K[0])
        return [
            f"# {self.row.format(key=key, value=written(number.scaled(factor)))}{limit_mark(number)}"
            for key, number in zip(self.keys, found, strict=True)
        ]


def _meaning(step: float, keys: Sequence[str]) -> tuple[str, ...]:
    return (
        "A LOWER BOUND, NOT A RECOMMENDATION: the noise of the sensor at rest. The defaults are about 100 times larger "
        "because they include vibration, timing, misalignment and linearisation. A vehicle with these values may "
        "crash. Never set a parameter below its bound; an upper limit is no bound. All lines are comments.",
        f"Units: discrete, standard deviations for a filter step of {1000 * step:g} ms: {keys[0]} rad/s, "
        f"{keys[1]} m/s², {keys[2]} rad/s², {keys[3]} m/s³.",
    )


_PX4 = ("EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE")
_ARDUPILOT = ("EK3_GYRO_P_NSE", "EK3_ACC_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE")


@register
class Px4(_Floor):
    """Lower bounds for the noise parameters of PX4.

    Source: `EKF/covariance.cpp` and the parameters of the module ekf2 of PX4; EKF2_PREDICT_US is 10 ms.
    """

    name = "px4"
    title = "PX4 EKF2, lower bounds"
    extension = ".params"
    step = 0.010
    keys = _PX4
    # The columns are vehicle, component, name, value and type 9 (a float), separated by tabs.
    row = "1\t1\t{key}\t{value}\t9"
    meaning = _meaning(0.010, _PX4)


@register
class ArduPilot(_Floor):
    """Lower bounds for the noise parameters of ArduPilot.

    Source: `AP_NavEKF3_core.cpp` and `.h` of ArduPilot; EKF_TARGET_DT is 12 ms.
    """

    name = "ardupilot"
    title = "ArduPilot EKF3, lower bounds"
    extension = ".parm"
    step = 0.012
    keys = _ARDUPILOT
    row = "{key},{value}"
    meaning = _meaning(0.012, _ARDUPILOT)
