"""Export for GTSAM: code that sets the noise of PreintegrationCombinedParams, in C++ and in Python."""

from __future__ import annotations

from collections.abc import Sequence

from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import limit_mark, written

_MEANING = (
    "Units: continuous-time power spectral densities, the squares of N and K: accelerometer (m/s²)²/Hz, gyroscope "
    "(rad/s)²/Hz, bias of the accelerometer (m/s³)²/Hz, bias of the gyroscope (rad/s²)²/Hz. The inflation "
    "factor is squared.",
)
_ADVICE = ("Keep your covariances of the integration and of the initial bias: they are not noise of the sensor.",)


class _Gtsam(TwoNumbers):
    """Base class of the formats for GTSAM, which have four 3 × 3 continuous-time covariances.

    Source: `PreintegrationParams.h`, `PreintegrationCombinedParams.h` and `CombinedImuFactorsExample.cpp` of GTSAM.
    """

    meaning = _MEANING
    usage = _ADVICE
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
