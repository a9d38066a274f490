"""Exports with lower bounds for filters of autopilots (PX4, ArduPilot), and the source code for GTSAM."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import limit_mark, written


class _Floor(TwoNumbers):
    """Lower bounds for noise parameters p of a filter that adds (Δt p)² per step: p = N/√Δt or p = K/√Δt."""

    takes = frozenset({"axes", "inflation", "horizon"})
    step: ClassVar[float]  # time step Δt of the filter (s)
    keys: ClassVar[tuple[str, str, str, str]]
    """Names of the parameters: noise of gyroscopes and accelerometers, and the same for their biases."""
    row: ClassVar[str]  # template of a line of the file

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four parameters as comment lines, so that loading the file changes nothing."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        factor = 1 / math.sqrt(self.step)
        numbers = (gyro.N[0], accel.N[0], gyro.K[0], accel.K[0])
        return [
            f"# {self.row.format(key=key, value=written(number.scaled(factor)))}{limit_mark(number)}"
            for key, number in zip(self.keys, numbers, strict=True)
        ]


def _meaning(step: float, keys: Sequence[str], defaults: str) -> tuple[str, ...]:
    return (
        "A LOWER BOUND, NOT A RECOMMENDATION: the noise of the sensor at rest. A vehicle with these values may crash. "
        f"The defaults, {defaults}, also cover vibration, timing and misalignment: keep the larger value. An upper "
        "limit is no bound. All lines are comments.",
        f"Units: discrete, standard deviations for a filter step of {1000 * step:g} ms: {keys[0]} rad/s, "
        f"{keys[1]} m/s², {keys[2]} rad/s², {keys[3]} m/s³.",
    )


_PX4 = ("EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE")
_ARDUPILOT = ("EK3_GYRO_P_NSE", "EK3_ACC_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE")


@register
class Px4(_Floor):
    """Lower bounds for PX4: `EKF/covariance.cpp` and parameters of ekf2; EKF2_PREDICT_US is 10 ms."""

    name = "px4"
    title = "PX4 EKF2, lower bounds"
    extension = ".params"
    step = 0.010
    keys = _PX4
    # The columns are vehicle, component, name, value and type 9 (a float), separated by tabs.
    row = "1\t1\t{key}\t{value}\t9"
    meaning = _meaning(0.010, _PX4, "0.015, 0.35, 0.001 and 0.003")


@register
class ArduPilot(_Floor):
    """Lower bounds for ArduPilot: `AP_NavEKF3_core.cpp` and `.h`; EKF_TARGET_DT is 12 ms."""

    name = "ardupilot"
    title = "ArduPilot EKF3, lower bounds"
    extension = ".parm"
    step = 0.012
    keys = _ARDUPILOT
    row = "{key},{value}"
    meaning = _meaning(0.012, _ARDUPILOT, "0.015, 0.35, 0.001 and 0.02")


class _Gtsam(TwoNumbers):
    """Base class of GTSAM's formats with four 3 × 3 continuous-time covariances. Source: `PreintegrationParams.h`,
    `PreintegrationCombinedParams.h` and `CombinedImuFactorsExample.cpp` of GTSAM."""

    meaning = (
        "Units: continuous-time power spectral densities, the squares of N and K: accelerometer (m/s²)²/Hz, gyroscope "
        "(rad/s)²/Hz, bias of the accelerometer (m/s³)²/Hz, bias of the gyroscope (rad/s²)²/Hz. The inflation "
        "factor is squared.",
    )
    usage = ("Keep your covariances of the integration and of the initial bias: they are not noise of the sensor.",)
    per_axis = True

    def _four(self, noise: Noise) -> list[tuple[str, tuple[Number, ...]]]:
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return [
            ("gyroscopeCovariance", gyro.N), ("accelerometerCovariance", accel.N), ("biasOmegaCovariance", gyro.K),
            ("biasAccCovariance", accel.K),
        ]  # fmt: skip


@register
class GtsamCpp(_Gtsam):
    """C++ code for the variable `std::shared_ptr<gtsam::PreintegrationCombinedParams> params`."""

    name = "gtsam"
    title = "GTSAM, PreintegrationCombinedParams in C++"
    extension = ".cpp"
    comment = "//"

    def body(self, noise: Noise) -> Sequence[str]:
        """Return one C++ assignment for each covariance."""
        return [
            f"params->{key} = gtsam::Vector3({_squares(numbers)}).asDiagonal();{_mark(numbers, '//')}"
            for key, numbers in self._four(noise)
        ]


@register
class GtsamPython(_Gtsam):
    """Python code for an object `params` of the class `gtsam.PreintegrationCombinedParams`."""

    name = "gtsam-python"
    title = "GTSAM, PreintegrationCombinedParams in Python"
    extension = ".py"

    def body(self, noise: Noise) -> Sequence[str]:
        """Return a Python function with one call for each covariance."""
        calls = [
            f"    params.set{key[0].upper()}{key[1:]}(np.diag([{_squares(numbers)}])){_mark(numbers, '#')}"
            for key, numbers in self._four(noise)
        ]
        return [
            "import numpy as np", "", "", "def set_noise(params):",
            '    """Set the noise of a gtsam.PreintegrationCombinedParams."""', *calls,
        ]  # fmt: skip


def _squares(numbers: Sequence[Number]) -> str:
    return ", ".join(written(number.value**2) for number in numbers)


def _mark(numbers: Sequence[Number], comment: str) -> str:
    marks = [limit_mark(number) for number in numbers if number.upper]
    return f"  {comment}{marks[0][1:]}" if marks else ""
