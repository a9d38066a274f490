"""Read the noise numbers in the files of other programs, and convert each by the rule of the program that uses it.

A file is recognised by its keys. Only the values of these keys are read, so that a whole configuration can be passed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from gmwm.base.errors import ReadError
from gmwm.base.units import SI_UNIT, Quantity, noise_unit
from gmwm.files.importers.documents import ParameterFile, each_axis
from gmwm.files.importers.values import FLOOR, Values

_DEGREE = math.pi / 180
Found = dict[str, Values]
Reader = Callable[[ParameterFile, float | None], Found]
_QUANTITIES: tuple[Quantity, ...] = ("gyro", "accel")


@dataclass(frozen=True)
class Format:
    """A format of files with noise numbers.

    Attributes
    ----------
    name : str
        Name of the program.
    keys : tuple of str
        Keys by which a file is recognised: every file has at least one of them.
    read : callable
        Function that returns the values of each axis, from the text of the file and the sampling rate (Hz). The rate is
        None if neither the file nor the user states it.
    names : mapping of sensor to mapping of symbol to str
        The key in the file for each number of `Values`.
    rate_key : str
        Key of the sampling rate (Hz); "" if the file has none.
    needs_rate : bool
        Whether the numbers depend on the sampling rate.
    one : bool
        Whether a file has each key once.
    density : bool
        Whether the numbers are N and K in SI units. They may then be written with another unit.
    """

    name: str
    keys: tuple[str, ...]
    read: Reader
    names: Mapping[Quantity, Mapping[str, str]]
    rate_key: str = ""
    needs_rate: bool = False
    one: bool = True
    density: bool = False

    def matches(self, document: ParameterFile) -> bool:
        """Return whether a file has a key of the format."""
        return any(document.has(key) for key in self.keys)

    def written(self, document: ParameterFile, axis: str) -> dict[str, tuple[str, float | None]]:
        """Return the key and the value in the file for each number of an axis. The value is None if a file has each key
        several times."""
        quantity: Quantity = "gyro" if axis.startswith("gyro") else "accel"
        entries: dict[str, tuple[str, float | None]] = {}
        for symbol, key in self.names.get(quantity, {}).items():
            values = document.numbers(key, _unit(self.density, symbol, quantity)) if self.one else None
            value = None if not values else values["xyz".index(axis[-1])] if len(values) == 3 else values[0]
            entries[symbol] = (key, value)
        return entries

    def rate(self, document: ParameterFile) -> float | None:
        """Return the sampling rate in a file, if there is one."""
        numbers = document.numbers(self.rate_key) if self.rate_key else None
        return numbers[0] if numbers else None


def _required(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    """Return the numbers of a key that every file has."""
    numbers = document.numbers(key, unit)
    if numbers is None:
        raise ReadError(f"the file has no number for {key}", advice="Add it, or write the numbers as text.")
    return numbers


def _unit(density: bool, symbol: str, quantity: Quantity) -> str:
    """Return the SI unit of N or K if the numbers of the file are densities, which may be written with a unit."""
    power = {"N": 0.5, "K": -0.5}.get(symbol)
    return noise_unit(power, SI_UNIT[quantity])[0] if density and power else ""


def _two(keys: Mapping[Quantity, tuple[str, str]], change: Callable[[float, float | None], float]) -> Reader:
    """Return a function that reads N and K of each sensor, or of each axis from lists of three. `change` converts a
    number in the file, given the sampling rate, to a density."""

    def read(document: ParameterFile, rate: float | None) -> Found:
        axes: Found = {}
        for sensor, pair in keys.items():
            if all(document.find(key) is None for key in pair):
                continue
            white = _white(document, pair[0], _unit(change is _density, "N", sensor))
            walk = _three(document, pair[1], _unit(change is _density, "K", sensor))
            for k, letter in enumerate("xyz"):
                axes[f"{sensor}_{letter}"] = Values(N=change(white[k], rate), K=change(walk[k], rate))
        return axes

    return read


def _density(value: float, rate: float | None) -> float:
    return value


def _per_step(value: float, rate: float | None) -> float:
    """Convert the standard deviation σ of one step to a density: a step of Δt = 1/f adds (Δt σ)², and noise of density
    N adds N² Δt, so N = σ/√f."""
    assert rate is not None
    return value / math.sqrt(rate)


def _variance_per_step(value: float, rate: float | None) -> float:
    return _per_step(math.sqrt(value), rate)


def _for_step(step: float) -> Callable[[float, float | None], float]:
    """Return the conversion for a filter with a fixed step Δt (s), which adds (Δt p)² in each step, so N = p √Δt."""
    return lambda value, rate: value * math.sqrt(step)


def _imu_utils(document: ParameterFile, rate: float | None) -> Found:
    """Read a file of imu_utils: gyr_n is √f times the Allan deviation at 1 s, and gyr_w is its minimum."""
    axes: Found = {}
    for sensor, short in (("gyro", "gyr"), ("accel", "acc")):
        for letter in "xyz":
            axis = f"{letter}-axis"
            entries = tuple(entry for entry in document.entries if axis in entry.above)
            white, floor = (ParameterFile(entries).numbers(f"{short}_{symbol}") for symbol in "nw")
            if white and floor:
                axes[f"{sensor}_{letter}"] = Values(N=_per_step(white[0], rate), B=floor[0] / FLOOR)
    if not axes:
        raise ReadError("the file has no numbers of the axes x, y and z", advice="Use the file that imu_utils wrote.")
    return axes


def _kf_gins(document: ParameterFile, rate: float | None) -> Found:
    """Read a file of KF-GINS, in deg/√h, m/s/√h, deg/h, mGal and h. The bias is a Gauss-Markov process."""
    time = 3600.0 * _required(document, "corrtime")[0]
    sizes = {"arw": _DEGREE / 60, "vrw": 1 / 60, "gbstd": _DEGREE / 3600, "abstd": 1e-5}
    axes: Found = {}
    values = {key: _three(document, key) for key in sizes}
    for sensor, white, bias in (("gyro", "arw", "gbstd"), ("accel", "vrw", "abstd")):
        for k, letter in enumerate("xyz"):
            axes[f"{sensor}_{letter}"] = Values(
                N=values[white][k] * sizes[white], sigma=values[bias][k] * sizes[bias], time=time
            )
    return axes


def _three(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    return each_axis(_required(document, key, unit), key)


def _white(document: ParameterFile, key: str, unit: str = "") -> list[float]:
    """Return the white noise of three axes, which is larger than zero."""
    white = _three(document, key, unit)
    if 0 in white:
        entry = document.find(key)
        raise ReadError(
            f"line {entry.line if entry else 0}: {key} is 0, but every sensor has white noise",
            advice="Write the number, or remove the keys of this sensor.",
        )
    return white


def _matlab(document: ParameterFile, rate: float | None) -> Found:
    """Read MATLAB code that sets the parameters of imuSensor. With the default NoiseType, N and B are smaller than the
    numbers in the code by the factor √2, and K is larger by this factor. K and B are 0 by default."""
    axes: Found = {}
    for sensor in _QUANTITIES:
        call = ParameterFile(tuple(entry for entry in document.entries if f"{sensor}params" in entry.above))
        if not any(call.find(key) for key in ("NoiseDensity", "RandomWalk", "BiasInstability")):
            continue
        kind = call.find("NoiseType")
        if kind is not None and kind.cells not in (("single-sided",), ("double-sided",)):
            raise ReadError(f"line {kind.line}: NoiseType must be single-sided or double-sided")
        factor = 1.0 if kind is not None and kind.cells == ("single-sided",) else math.sqrt(2)
        white = _white(call, "NoiseDensity")
        walk, flicker = (each_axis(call.numbers(key) or [0.0], key) for key in ("RandomWalk", "BiasInstability"))
        for k, letter in enumerate("xyz"):
            axes[f"{sensor}_{letter}"] = Values(N=white[k] / factor, K=walk[k] * factor, B=flicker[k] / factor)
    return axes


def _format(
    name: str, keys: tuple[str, str, str, str], change: Callable[[float, float | None], float],
    *, rate_key: str = "", needs_rate: bool = False,
) -> Format:  # fmt: skip
    """Return a format with keys for N and K of gyroscopes, and for N and K of accelerometers."""
    gyro_n, gyro_k, accel_n, accel_k = keys
    pairs: dict[Quantity, tuple[str, str]] = {"gyro": (gyro_n, gyro_k), "accel": (accel_n, accel_k)}
    names: dict[Quantity, dict[str, str]] = {q: {"N": white, "K": walk} for q, (white, walk) in pairs.items()}
    return Format(
        name, (gyro_n, accel_n), _two(pairs, change), names=names, rate_key=rate_key, needs_rate=needs_rate,
        density=change is _density,
    )  # fmt: skip


_KALIBR = ("gyroscope_noise_density", "gyroscope_random_walk", "accelerometer_noise_density",
           "accelerometer_random_walk")  # fmt: skip
FORMATS = (
    Format("imu_utils", ("avg-axis",), _imu_utils, needs_rate=True,
           names={"gyro": {"N": "gyr_n", "B": "gyr_w"}, "accel": {"N": "acc_n", "B": "acc_w"}}, one=False),
    _format("Kalibr, allan_variance_ros, OpenVINS or Kimera", _KALIBR, _density, rate_key="update_rate"),
    _format("ORB-SLAM3", ("IMU.NoiseGyro", "IMU.GyroWalk", "IMU.NoiseAcc", "IMU.AccWalk"), _density,
            rate_key="IMU.Frequency"),
    _format("VINS", ("gyr_n", "gyr_w", "acc_n", "acc_w"), _per_step, needs_rate=True),
    _format("LIO-SAM", ("imuGyrNoise", "imuGyrBiasN", "imuAccNoise", "imuAccBiasN"), _density),
    _format("FAST-LIO", ("gyr_cov", "b_gyr_cov", "acc_cov", "b_acc_cov"), _variance_per_step, needs_rate=True),
    Format("KF-GINS", ("arw",), _kf_gins,
           names={"gyro": {"N": "arw", "sigma": "gbstd"}, "accel": {"N": "vrw", "sigma": "abstd"}}),
    _format("PX4", ("EKF2_GYR_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_NOISE", "EKF2_ACC_B_NOISE"), _for_step(0.010)),
    _format("ArduPilot", ("EK3_GYRO_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ACC_P_NSE", "EK3_ABIAS_P_NSE"),
            _for_step(0.012)),
    Format("MATLAB imuSensor", ("NoiseDensity",), _matlab, one=False,
           names={q: {"N": "NoiseDensity", "K": "RandomWalk", "B": "BiasInstability"} for q in _QUANTITIES}),
)  # fmt: skip
"""The formats, in the order in which they are tried."""
