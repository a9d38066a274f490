"""How each consumer reads its file, after its own published sources; what comes out is N and K in SI of each axis.

Independent of the exporters: a number that these rules do not give back is wrong in the file.
"""

import math
import re
from io import StringIO
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
from ruamel.yaml import YAML

D2R = math.pi / 180


def yaml(text, first=""):
    """A YAML document; OpenCV's directive, which is no YAML, must be the first line where it is wanted."""
    lines = text.splitlines()
    if first:
        assert lines[0] == first
        lines = lines[1:]
    return YAML(typ="safe").load(StringIO("\n".join(lines)))


def both(gyro, accel):
    """N and K of three axes of each sensor."""
    return {
        sensor: tuple(np.broadcast_to(np.asarray(values, dtype=float), 3) for values in pair)
        for sensor, pair in (("gyro", gyro), ("accel", accel))
    }


def four(content):
    keys = ("noise_density", "random_walk")
    values = {s: [content[f"{s}_{key}"] for key in keys] for s in ("gyroscope", "accelerometer")}
    # ConfigReader.py: each must be a float, and positive.
    assert all(isinstance(value, float) and value > 0 for pair in values.values() for value in pair)
    return both(values["gyroscope"], values["accelerometer"])


def kalibr(text):
    content = yaml(text)
    assert isinstance(content["rostopic"], str)
    assert content["update_rate"] > 0
    return four(content)


def openvins(text):
    content = yaml(text, "%YAML:1.0")["imu0"]
    assert np.array_equal(content["T_i_b"], np.eye(4))
    assert content["model"] == "kalibr"
    assert content["update_rate"] == 200.0
    for key in ("Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC"):
        assert np.array_equal(content[key], np.eye(3))
    assert np.array_equal(content["Tg"], np.zeros((3, 3)))
    assert content["time_offset"] == 0.0
    return four(content)


def kimera(text):
    content = yaml(text, "%YAML:1.0")
    assert content["rate_hz"] == 200.0
    return four(content)


def vins(text, rate=200.0):
    content = yaml(text, "%YAML:1.0")
    # integration_base.h: a step of Δt adds (Δt σ)² of noise; that of a density is N² Δt.
    density = {key: content[key] * math.sqrt(1 / rate) for key in ("acc_n", "gyr_n", "acc_w", "gyr_w")}
    return both((density["gyr_n"], density["gyr_w"]), (density["acc_n"], density["acc_w"]))


def orbslam3(text):
    content = yaml(text, "%YAML:1.0")
    root = math.sqrt(content["IMU.Frequency"])
    # Tracking.cc and ImuTypes.cc: σ of a sample is Ng √f, of a step of the bias Ngw / √f.
    discrete = {
        "gyro": (content["IMU.NoiseGyro"] * root, content["IMU.GyroWalk"] / root),
        "accel": (content["IMU.NoiseAcc"] * root, content["IMU.AccWalk"] / root),
    }
    return both(*((noise / math.sqrt(200.0), walk * math.sqrt(200.0)) for noise, walk in discrete.values()))


def liosam(text):
    content = yaml(text)["lio_sam"]
    return both((content["imuGyrNoise"], content["imuGyrBiasN"]), (content["imuAccNoise"], content["imuAccBiasN"]))


def fastlio(text, rate=200.0):
    content = yaml(text)["mapping"]
    # The covariance grows by Δt² Q in a step, and should by N² Δt.
    density = {key: math.sqrt(content[key] / rate) for key in ("acc_cov", "gyr_cov", "b_acc_cov", "b_gyr_cov")}
    return both((density["gyr_cov"], density["b_gyr_cov"]), (density["acc_cov"], density["b_acc_cov"]))


def gtsam(text):
    found = {}
    code = "\n".join(line for line in text.splitlines() if not line.startswith("//"))
    statement = r"params->(\w+) = gtsam::Vector3\(([^)]*)\)\.asDiagonal\(\);(?:  // upper limit)?\s*"
    assert re.fullmatch(rf"\s*(?:{statement})+", code)
    for key, values in re.findall(statement, code):
        found[key] = np.sqrt([float(value) for value in values.split(",")])
    return both(
        (found["gyroscopeCovariance"], found["biasOmegaCovariance"]),
        (found["accelerometerCovariance"], found["biasAccCovariance"]),
    )


def gtsam_python(text):
    kept = {}

    class Params(SimpleNamespace):
        def __getattr__(self, name):
            return lambda matrix: kept.__setitem__(name, np.sqrt(np.diag(matrix)))

    names = {}
    exec(compile(text, "noise.py", "exec"), names)
    names["set_noise"](Params())
    return both(
        (kept["setGyroscopeCovariance"], kept["setBiasOmegaCovariance"]),
        (kept["setAccelerometerCovariance"], kept["setBiasAccCovariance"]),
    )


def matlab(text, rate=200.0):
    code = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    found = {}
    for sensor, body in re.findall(r"(\w+) = \w+params\(([^;]*)\);", code.replace("...\n", "")):
        given = dict(re.findall(r"'(\w+)', (\[[^\]]*\]|'[^']*')", body))
        density, walk = (np.array(given[key][1:-1].split(), dtype=float) for key in ("NoiseDensity", "RandomWalk"))
        assert "BiasInstability" not in given
        # The simulator: white noise of NoiseDensity √bandwidth, steps of RandomWalk / √bandwidth.
        bandwidth = {"'single-sided'": rate, "'double-sided'": rate / 2}[given["NoiseType"]]
        noise, step = density * math.sqrt(bandwidth), walk / math.sqrt(bandwidth)
        found[sensor] = (noise / math.sqrt(rate), step * math.sqrt(rate))
    assert f"'SampleRate', {rate}" in code
    return both(found["gyro"], found["accel"])


def kfgins(text):
    content = yaml(text)["imunoise"]
    time = content["corrtime"] * 3600
    arw = np.array(content["arw"]) * D2R / 60
    vrw = np.array(content["vrw"]) / 60
    gyro, accel = np.array(content["gbstd"]) * D2R / 3600, np.array(content["abstd"]) * 1e-5
    # kf_gins: the bias is driven with a density of 2 σ² / T.
    return both((arw, gyro * math.sqrt(2 / time)), (vrw, accel * math.sqrt(2 / time)))


def gazebo(text, rate=200.0):
    imu = ElementTree.fromstring(re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL))
    found = {}
    for sensor, name in (("gyro", "angular_velocity"), ("accel", "linear_acceleration")):
        noises = [imu.find(f"{name}/{letter}/noise") for letter in "xyz"]
        assert {noise.get("type") for noise in noises} == {"gaussian"}
        values = {key: np.array([float(noise.find(key).text) for noise in noises]) for key in (
            "mean", "stddev", "dynamic_bias_stddev", "dynamic_bias_correlation_time")}  # fmt: skip
        assert not values["mean"].any()
        time = values["dynamic_bias_correlation_time"]
        # GaussianNoiseModel.cc: what a step adds to the bias; a walk adds K² Δt.
        step = -(values["dynamic_bias_stddev"] ** 2) * time / 2 * np.expm1(-2 / (rate * time))
        walk = np.sqrt(step / (-time / 2 * np.expm1(-2 / (rate * time))))
        found[sensor] = (values["stddev"] / math.sqrt(rate), walk)
    return both(found["gyro"], found["accel"])


def _autopilot(text, pattern, keys, step):
    assert all(line.startswith("#") or not line for line in text.splitlines())
    found = {key: float(value) for key, value in re.findall(pattern, text, re.MULTILINE)}
    assert list(found) == keys
    # The filter adds (Δt p)² to variances in a step.
    gyro, accel, gyro_bias, accel_bias = (value * math.sqrt(step) for value in found.values())
    return both((gyro, gyro_bias), (accel, accel_bias))


def px4(text):
    keys = ["EKF2_GYR_NOISE", "EKF2_ACC_NOISE", "EKF2_GYR_B_NOISE", "EKF2_ACC_B_NOISE"]
    return _autopilot(text, r"^# 1\t1\t(\w+)\t(\S+)\t9(?:  upper limit)?$", keys, 0.010)


def ardupilot(text):
    keys = ["EK3_GYRO_P_NSE", "EK3_ACC_P_NSE", "EK3_GBIAS_P_NSE", "EK3_ABIAS_P_NSE"]
    return _autopilot(text, r"^# (EK3_\w+),(\S+?)(?:  upper limit)?$", keys, 0.012)


CONSUMERS = {
    "kalibr": kalibr, "openvins": openvins, "kimera": kimera, "vins": vins, "orbslam3": orbslam3, "gtsam": gtsam,
    "gtsam-python": gtsam_python, "liosam": liosam, "fastlio": fastlio, "matlab": matlab, "kfgins": kfgins,
    "gazebo": gazebo, "px4": px4, "ardupilot": ardupilot,
}  # fmt: skip
PER_AXIS = ("gtsam", "gtsam-python", "matlab", "kfgins", "gazebo")
