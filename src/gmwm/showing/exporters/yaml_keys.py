"""Export for filters whose YAML file has a key for each of the four noise parameters: Kalibr, OpenVINS, VINS, …"""

from __future__ import annotations

import math
from collections.abc import Sequence

from gmwm.showing.exporters.base import QUANTITIES, Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import Number, prior, three
from gmwm.showing.exporters.text import limit_mark, written

_KALIBR = (
    "Units: continuous-time densities, one-sigma. Noise density N: gyroscope rad/s/√Hz, accelerometer m/s²/√Hz. "
    "Random walk K: gyroscope rad/s²/√Hz, accelerometer m/s³/√Hz.",
)
_WHITE, _WALK = ("m/s^2/sqrt(Hz)", "rad/s/sqrt(Hz)"), ("m/s^3/sqrt(Hz)", "rad/s^2/sqrt(Hz)")


def _line(key: str, number: Number, unit: str) -> str:
    return f"{key}: {written(number)}  # {unit}{limit_mark(number)}"


def _four(noise: Noise, keys: Sequence[str], units: Sequence[str] = (*_WHITE, *_WALK)) -> list[str]:
    """Return four lines for N of the accelerometers and of the gyroscopes, and for their K."""
    gyro, accel = noise.of("gyro"), noise.of("accel")
    return list(map(_line, keys, (accel.N[0], gyro.N[0], accel.K[0], gyro.K[0]), units))


def _kalibr_lines(noise: Noise) -> list[str]:
    """Return four lines with Kalibr's keys, in its order."""
    names = ("accelerometer", "gyroscope")
    keys = [f"{name}_{kind}" for kind in ("noise_density", "random_walk") for name in names]
    white_a, white_g, walk_a, walk_g = _four(noise, keys)
    return [white_a, walk_a, white_g, walk_g]


class _YamlKeys(TwoNumbers):
    extension = ".yaml"
    first = "%YAML:1.0"


@register
class Kalibr(_YamlKeys):
    """File for Kalibr with four continuous-time noise densities, all of which must be positive.

    Source: `ConfigReader.py` of Kalibr, and its pages on the IMU noise model and on YAML formats.
    """

    name = "kalibr"
    title = "Kalibr (imu.yaml)"
    first = ""
    meaning = _KALIBR

    def advice(self, noise: Noise) -> tuple[str, ...]:
        """Return a sentence on the ROS topic in the file."""
        if noise.topic:
            return ("rostopic is the topic that was calibrated.",)
        return ("Replace rostopic, which is a placeholder, by the topic of your recordings.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines with Kalibr's keys."""
        topic = noise.topic or "/imu0"
        return [*_kalibr_lines(noise), "", f"rostopic: {topic}", f"update_rate: {noise.written_rate}  # Hz"]


@register
class Kimera(_YamlKeys):
    """File for Kimera-VIO with the four continuous-time noise densities of Kalibr and the sampling rate.

    Source: `params/Euroc/ImuParams.yaml` of Kimera-VIO.
    """

    name = "kimera"
    title = "Kimera-VIO (ImuParams.yaml)"
    meaning = _KALIBR
    usage = (
        "Replace these keys in your ImuParams.yaml. Keep T_BS, imu_preintegration_type, imu_integration_sigma, "
        "imu_time_shift and n_gravity.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines with Kimera's keys."""
        return [f"rate_hz: {noise.written_rate}  # Hz", *_kalibr_lines(noise)]


@register
class OpenVins(_YamlKeys):
    """File for OpenVINS with the four continuous-time noise densities of Kalibr and the other keys of its IMU file.

    Source: `config/euroc_mav/kalibr_imu_chain.yaml` of OpenVINS.
    """

    name = "openvins"
    title = "OpenVINS (kalibr_imu_chain.yaml)"
    meaning = _KALIBR
    usage = (
        "OpenVINS recommends an inflation factor of 10 to 20. Everything but the four numbers and the rate is a "
        "placeholder for a perfect sensor: replace it by your own calibration.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the entry of one IMU."""
        lines = ["imu0:", *_matrix("T_i_b", 4), *(f"  {line}" for line in _kalibr_lines(noise))]
        lines += [
            f"  rostopic: {noise.topic or '/imu0'}", "  time_offset: 0.0", f"  update_rate: {noise.written_rate}  # Hz",
            '  model: "kalibr"',
        ]  # fmt: skip
        for key in ("Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC"):
            lines += _matrix(key, 3)
        return [*lines, "  Tg:", *["    - [0.0, 0.0, 0.0]"] * 3]


def _matrix(key: str, size: int) -> list[str]:
    """Return the lines of an identity matrix."""
    return [f"  {key}:", *(f"    - {[float(k == row) for k in range(size)]}" for row in range(size))]


@register
class LioSam(_YamlKeys):
    """File for LIO-SAM with four continuous-time noise densities, which the program squares for GTSAM.

    Source: `config/params.yaml` and `imuPreintegration.cpp` of LIO-SAM.
    """

    name = "liosam"
    title = "LIO-SAM (params.yaml)"
    first = ""
    meaning = (
        "Units: continuous-time densities, one-sigma. imuGyrNoise rad/s/√Hz, imuAccNoise m/s²/√Hz, imuGyrBiasN "
        "rad/s/√s, imuAccBiasN m/s²/√s.",
    )
    usage = ("Replace these keys in your params.yaml. For ROS 2, they are under /**: ros__parameters:.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
        keys = ("  imuAccNoise", "  imuGyrNoise", "  imuAccBiasN", "  imuGyrBiasN")
        return ["lio_sam:", *_four(noise, keys, (*_WHITE, "m/s^2/sqrt(s)", "rad/s/sqrt(s)"))]


@register
class FastLio(_YamlKeys):
    """File for FAST-LIO with discrete variances.

    A filter step of length Δt adds Δt² times these variances to the covariance.

    Source: `config/velodyne.yaml` and `IMU_Processing.hpp` of FAST-LIO.
    """

    name = "fastlio"
    title = "FAST-LIO and FAST-LIO2"
    first = ""
    meaning = (
        "Units: discrete, variances of a step at the rate below: N² f and K² f. acc_cov (m/s²)², gyr_cov (rad/s)², "
        "b_acc_cov (m/s³)², b_gyr_cov (rad/s²)². Another rate needs other values. The inflation factor is squared.",
    )
    usage = (
        "Replace the keys under mapping: in your file. The usual values, 0.1 and 0.0001, are far larger than the noise "
        "of any sensor because they include other errors.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        rows = (
            ("acc_cov", accel.N[0], "(m/s^2)^2"), ("gyr_cov", gyro.N[0], "(rad/s)^2"),
            ("b_acc_cov", accel.K[0], "(m/s^3)^2"), ("b_gyr_cov", gyro.K[0], "(rad/s^2)^2"),
        )  # fmt: skip
        variances = [(key, Number(number.value**2 * noise.rate, number.upper), unit) for key, number, unit in rows]
        head = [f"# for an IMU at {noise.written_rate} Hz", "mapping:"]
        return [*head, *(f"    {_line(*row)}" for row in variances)]


@register
class OrbSlam3(_YamlKeys):
    """File for ORB-SLAM3 with four continuous-time noise densities and the sampling rate.

    The program computes discrete-time values from them.

    Source: `Examples/Stereo-Inertial/EuRoC.yaml` and `Tracking.cc` of ORB-SLAM3.
    """

    name = "orbslam3"
    title = "ORB-SLAM3"
    meaning = (
        "Units: continuous-time densities, one-sigma. NoiseGyro rad/s/√Hz, NoiseAcc m/s²/√Hz, GyroWalk rad/s²/√Hz, "
        "AccWalk m/s³/√Hz, Frequency Hz. ORB-SLAM3 computes the discrete numbers.",
    )
    usage = ("Replace these keys in your settings file.",)

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the five keys of the file."""
        accel, gyro, slow_accel, slow_gyro = _four(
            noise, ("IMU.NoiseAcc", "IMU.NoiseGyro", "IMU.AccWalk", "IMU.GyroWalk")
        )
        return [gyro, accel, slow_gyro, slow_accel, f"IMU.Frequency: {noise.written_rate}  # Hz"]


@register
class Vins(_YamlKeys):
    """File for VINS with the discrete standard deviations N√f and K√f at the sampling rate f.

    In a step Δt, VINS adds (Δt σ)² to the variance of the angle, the velocity or a bias, where σ is the parameter. For
    white noise, N² Δt = Δt² acc_n², and for the random walk, K² Δt = Δt² acc_w².

    Source: `config/euroc` and `integration_base.h` of VINS-Mono and VINS-Fusion.
    """

    name = "vins"
    title = "VINS-Mono, VINS-Fusion and GVINS"
    meaning = (
        "Units: discrete, standard deviations of a step at the rate below: N √f and K √f. acc_n m/s², gyr_n rad/s, "
        "acc_w m/s³, gyr_w rad/s². Another rate needs other values.",
    )
    usage = (
        "Replace these keys in your configuration. VINS integrates the mean of two samples and assumes half the "
        "variance, although successive steps share a sample. Multiply acc_n and gyr_n by √2 to correct for this; the "
        "numbers here are not corrected. Users commonly set 10 to 100 times larger values.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the four keys of the file."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        numbers = [number.scaled(math.sqrt(noise.rate)) for number in (accel.N[0], gyro.N[0], accel.K[0], gyro.K[0])]
        units = ("m/s^2", "rad/s", "m/s^3", "rad/s^2")
        lines = map(_line, ("acc_n", "gyr_n", "acc_w", "gyr_w"), numbers, units)
        return [f"# for an IMU at {noise.written_rate} Hz", *lines]


@register
class Okvis2(_YamlKeys):
    """File for OKVIS 2 with four continuous-time noise densities, the biases at rest and their standard deviations.

    Source: `config/euroc.yaml` of OKVIS 2 and `ImuParameters` of `okvis/Parameters.hpp`.
    """

    name = "okvis2"
    title = "OKVIS 2 (imu_parameters)"
    takes = frozenset({"axes", "inflation", "horizon"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous-time densities, one-sigma. sigma_g_c rad/s/√Hz, sigma_a_c m/s²/√Hz, sigma_gw_c rad/s²/√Hz, "
        "sigma_aw_c m/s³/√Hz. g0 rad/s and a0 m/s² are the initial biases, sigma_bg and sigma_ba their standard "
        "deviations: error, rms and turn-on spread together, of the axis with the largest.",
    )
    usage = (
        "Replace these keys under imu_parameters of your file, and keep its a_max, g_max, g and T_BS. A bias that is "
        "not known for all axes of a sensor is left out: keep your value.",
    )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the entry imu_parameters."""
        accel, gyro, slow_accel, slow_gyro = _four(noise, ("sigma_a_c", "sigma_g_c", "sigma_aw_c", "sigma_gw_c"))
        lines = [gyro, accel, slow_gyro, slow_accel]
        keys = (("sigma_bg", "g0", "rad/s"), ("sigma_ba", "a0", "m/s^2"))
        for quantity, (sigma, start, unit) in zip(QUANTITIES, keys, strict=True):
            deviation = prior(noise.rest, quantity)
            if deviation is not None:
                values = ", ".join(written(x) for x in three(noise.rest, quantity))
                lines += [f"{sigma}: {written(deviation)}  # {unit}", f"{start}: [{values}]  # {unit}"]
        return ["imu_parameters:", *(f"    {line}" for line in lines)]
