"""Exports for filters whose YAML or JSON file has keys for the noise parameters: Kalibr, VINS, AirSim, …"""

from __future__ import annotations

import json
import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.exporters.base import QUANTITIES, Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import Number, prior, three
from gmwm.showing.exporters.text import commented, commented_notes, limit_mark, shortened, written

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
    """Kalibr's four continuous-time noise densities, all positive (`ConfigReader.py`; pages on IMU noise and YAML)."""

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
    """Kimera-VIO's noise densities, as Kalibr's, and sampling rate (`params/Euroc/ImuParams.yaml`)."""

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
    """OpenVINS's noise densities, as Kalibr's, and other keys (`config/euroc_mav/kalibr_imu_chain.yaml`)."""

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
    """LIO-SAM's noise densities, which it squares for GTSAM (`config/params.yaml`, `imuPreintegration.cpp`)."""

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
    """FAST-LIO's discrete variances: a step Δt adds Δt² times them to the covariance. Source: `config/velodyne.yaml`
    and `IMU_Processing.hpp` of FAST-LIO."""

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
    """ORB-SLAM3's continuous-time noise densities, which it converts, and the sampling rate. Source:
    `Examples/Stereo-Inertial/EuRoC.yaml` and `Tracking.cc` of ORB-SLAM3."""

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
    """VINS's discrete standard deviations N√f and K√f at the sampling rate f.

    A step adds (Δt σ)² to a variance: N² Δt = Δt² acc_n² for white noise, K² Δt = Δt² acc_w² for the walk. Source:
    `config/euroc` and `integration_base.h` of VINS-Mono and VINS-Fusion."""

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
    """OKVIS 2's continuous-time noise densities, and biases at rest with standard deviations. Source:
    `config/euroc.yaml` and `ImuParameters` of `okvis/Parameters.hpp`."""

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


HEAD, NOTES = "gmwm", "gmwm_notes"  # Keys of the head and of the notes. Programs ignore keys that they do not know.


class JsonFile(TwoNumbers):
    """Base class of JSON formats with N and K of each sensor."""

    extension = ".json"
    head_first: ClassVar[bool] = True
    """Whether the verdict may be the first entry of the document."""

    @abstractmethod
    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the JSON document without its head."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the JSON document without its head."""
        return json.dumps(_round_numbers(self.content(noise)), indent=2).splitlines()

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the JSON document with its head and its notes."""
        lines = {HEAD: commented(shortened(head), ""), NOTES: commented_notes(notes, "")}
        texts = {key: [line.strip() for line in each] for key, each in lines.items()}
        content = _round_numbers(self.content(noise))
        entries = (
            [(HEAD, texts[HEAD]), *content.items()] if self.head_first else [*content.items(), (HEAD, texts[HEAD])]
        )
        return json.dumps(dict([*entries, (NOTES, texts[NOTES])]), indent=2, allow_nan=False) + "\n"


def _round_numbers(value: Any) -> Any:
    """Round all numbers of a document to seven digits, as in the other formats."""
    if isinstance(value, Mapping):
        return {key: _round_numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_round_numbers(item) for item in value]
    return float(f"{value:.7g}") if isinstance(value, float) else value


_DEGREE = math.pi / 180
TIMES = {"gyro": 500.0, "accel": 800.0}
"""Times τ (s) that AirSim uses by default. Only the ratio of bias stability to √τ affects the simulation."""


@register
class AirSim(JsonFile):
    """AirSim's N and random walk K = bias stability / √τ (`ImuSimpleParams.hpp`, `ImuSimple.hpp`)."""

    name = "airsim"
    title = "AirSim (Imu of settings.json)"
    takes = frozenset({"axes", "inflation", "horizon"})
    meaning = (
        "Units: continuous in time. AngularRandomWalk deg/√h, VelocityRandomWalk mg/√Hz; GyroBiasStability deg/h and "
        "AccelBiasStability µg are K √τ for the times τ in s. They are not the bias instability of a datasheet: the "
        "simulated bias is a random walk without limit. AirSim has no constant bias in its settings.",
    )
    usage = ("Copy the entry Imu into the Sensors of your vehicle.",)

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the entry "Sensors" of the settings."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        root = {sensor: math.sqrt(time) for sensor, time in TIMES.items()}
        return {
            "Sensors": {
                "Imu": {
                    "SensorType": 2, "Enabled": True, "AngularRandomWalk": gyro.N[0].value * 60 / _DEGREE,
                    "GyroBiasStabilityTau": TIMES["gyro"],
                    "GyroBiasStability": gyro.K[0].value * root["gyro"] * 3600 / _DEGREE,
                    "VelocityRandomWalk": accel.N[0].value * 1e3 / STANDARD_GRAVITY,
                    "AccelBiasStabilityTau": TIMES["accel"],
                    "AccelBiasStability": accel.K[0].value * root["accel"] * 1e6 / STANDARD_GRAVITY,
                }
            }
        }  # fmt: skip


FRAME_RATE_HZ = 10.0  # Number of lidar frames per second (Hz). The value is the usual rate of a spinning lidar.


@register
class Glim(JsonFile):
    """GLIM's noise densities N, biases at rest, and one random walk: the change of a bias between two lidar frames.
    Source: `config/config_sensors.json`, `odometry_estimation_imu.cpp` and `imu_integration.cpp` of GLIM."""

    name = "glim"
    title = "GLIM (config_sensors.json)"
    takes = frozenset({"axes", "inflation", "horizon"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: imu_acc_noise m/s²/√Hz and imu_gyro_noise rad/s/√Hz, continuous-time densities, one-sigma. "
        "imu_bias_noise is discrete: the standard deviation of the change of the bias between two frames at "
        f"{FRAME_RATE_HZ:g} Hz, K √0.1 s, m/s² and rad/s. GLIM has one number for both sensors: it is the larger "
        "one, almost always that of the accelerometers. imu_bias: accelerometers x, y, z (m/s²), gyroscopes x, y, z "
        "(rad/s).",
    )
    usage = (
        "Copy these keys into sensors of your config_sensors.json. For another lidar rate, change imu_bias_noise.",
    )

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the entry "sensors" of the configuration."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return {
            "sensors": {
                "imu_acc_noise": accel.N[0].value,
                "imu_gyro_noise": gyro.N[0].value,
                "imu_bias_noise": max(gyro.K[0].value, accel.K[0].value) / math.sqrt(FRAME_RATE_HZ),
                "imu_bias": [*three(noise.rest, "accel"), *three(noise.rest, "gyro")],
            }
        }


@register
class Basalt(JsonFile):
    """Basalt's noise densities of each axis and constant biases: calibrated = (I + scale) raw − bias. Source:
    `calibration.hpp` and `calib_bias.hpp` of basalt-headers."""

    name = "basalt"
    title = "Basalt (value0 of calibration.json)"
    default_axes = "each"
    per_axis = True
    biases_of = ("gyro", "accel")
    head_first = False  # Basalt reads the first entry
    meaning = (
        "Units: continuous-time densities, one-sigma, of x, y and z. gyro_noise_std rad/s/√Hz, accel_noise_std "
        "m/s²/√Hz, gyro_bias_std rad/s²/√Hz, accel_bias_std m/s³/√Hz. The first three numbers of calib_gyro_bias "
        "(rad/s) and calib_accel_bias (m/s²) are the biases; the others are scale and misalignment, here zero, which "
        "a recording at rest does not show.",
    )
    usage = (
        "Copy these keys into value0 of your calibration.json, and keep the cameras of your file. Keep the scale and "
        "misalignment of your file if it has any.",
    )

    def content(self, noise: Noise) -> Mapping[str, Any]:
        """Return the document with the keys of the IMU."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        return {
            "value0": {
                "calib_accel_bias": [*three(noise.rest, "accel"), *[0.0] * 6],
                "calib_gyro_bias": [*three(noise.rest, "gyro"), *[0.0] * 9],
                "imu_update_rate": float(noise.written_rate),
                "accel_noise_std": [number.value for number in accel.N],
                "gyro_noise_std": [number.value for number in gyro.N],
                "accel_bias_std": [number.value for number in accel.K],
                "gyro_bias_std": [number.value for number in gyro.K],
            }
        }
