"""How each consumer reads its file, after its own published sources; what comes out is N and K in SI of each axis.

Independent of the exporters: a number that these rules do not give back is wrong in the file.
"""

import json
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


def gnss_ins_sim(text):
    names = {}
    exec(compile(text, "imu.py", "exec"), names)
    found = names["imu_err"]
    # imu_model.py: deg/h, deg/√h and m/s/√h; pathgen.py: a Gauss-Markov bias of the standard deviation b_drift.
    gyro = found["gyro_arw"] * D2R / 60, found["gyro_b_stability"] * D2R / 3600 * np.sqrt(2 / found["gyro_b_corr"])
    accel = found["accel_vrw"] / 60, found["accel_b_stability"] * np.sqrt(2 / found["accel_b_corr"])
    return both(gyro, accel)


def navego(text):
    code = re.sub(r"%.*", "", text)
    found = {key: np.array(row.split(), dtype=float) for key, row in re.findall(r"imu\.(\w+) = \[([^\]]*)\];", code)}
    assert re.findall(r"imu\.(\w+) = zeros\(1, 3\);", code) == ["arrw", "vrrw"]
    assert "imu.freq = 200.0;" in code
    # imu_si_errors.m: deg/√h, m/s/√h, deg/s and mg; noise_b_dyn.m: a Gauss-Markov bias.
    gyro = found["arw"] / 60 * D2R, found["gb_dyn"] * D2R * np.sqrt(2 / found["gb_corr"])
    accel = found["vrw"] / 60, found["ab_dyn"] * 1e-3 * 9.80665 * np.sqrt(2 / found["ab_corr"])
    return both(gyro, accel)


def okvis2(text):
    content = yaml(text, "%YAML:1.0")["imu_parameters"]
    return both((content["sigma_g_c"], content["sigma_gw_c"]), (content["sigma_a_c"], content["sigma_aw_c"]))


def basalt(text):
    content = json.loads(text)
    assert next(iter(content)) == "value0"  # cereal reads the first entry
    one = content["value0"]
    assert (len(one["calib_accel_bias"]), len(one["calib_gyro_bias"]), one["imu_update_rate"]) == (9, 12, 200.0)
    # calibration.hpp: the discrete standard deviation is the continuous one times √f.
    root = math.sqrt(one["imu_update_rate"])
    white = {key: np.array(one[f"{key}_noise_std"]) * root / math.sqrt(200.0) for key in ("gyro", "accel")}
    return both((white["gyro"], one["gyro_bias_std"]), (white["accel"], one["accel_bias_std"]))


def glim(text):
    one = json.loads(text)["sensors"]
    assert len(one["imu_bias"]) == 6
    # odometry_estimation_imu.cpp: the bias changes by imu_bias_noise between two frames, here 0.1 s apart.
    walk = one["imu_bias_noise"] / math.sqrt(0.1)
    return both((one["imu_gyro_noise"], walk), (one["imu_acc_noise"], walk))


def airsim(text):
    one = json.loads(text)["Sensors"]["Imu"]
    assert (one["SensorType"], one["Enabled"]) == (2, True)
    # ImuSimpleParams.hpp and ImuSimple.hpp: a step adds (bias stability / √τ)² Δt to the variance of the bias.
    gyro = (
        one["AngularRandomWalk"] / 60 * D2R,
        one["GyroBiasStability"] / 3600 * D2R / one["GyroBiasStabilityTau"] ** 0.5,
    )
    accel = (one["VelocityRandomWalk"] * 9.80665 / 1e3,
             one["AccelBiasStability"] * 1e-6 * 9.80665 / one["AccelBiasStabilityTau"] ** 0.5)  # fmt: skip
    return both(gyro, accel)


# --- biases at rest, in rad/s and m/s²: what the program takes as the bias of a sample -----------------


def okvis2_bias(text):
    content = yaml(text, "%YAML:1.0")["imu_parameters"]
    return content["g0"], content["a0"]


def basalt_bias(text):
    # calib_bias.hpp: calibrated = raw + scale raw − bias.
    one = json.loads(text)["value0"]
    assert not any(one["calib_gyro_bias"][3:] + one["calib_accel_bias"][3:])
    return one["calib_gyro_bias"][:3], one["calib_accel_bias"][:3]


def dlio_bias(text):
    imu = yaml(text)["dlio"]["imu"]
    # odom.cc: the prior biases are used if imu/calibration is false.
    assert imu["calibration"] is False
    assert np.array_equal(np.reshape(imu["intrinsics"]["accel"]["sm"], (3, 3)), np.eye(3))
    return imu["intrinsics"]["gyro"]["bias"], imu["intrinsics"]["accel"]["bias"]


def glim_bias(text):
    # gtsam::imuBias::ConstantBias: the accelerometers first.
    both_of = json.loads(text)["sensors"]["imu_bias"]
    return both_of[3:], both_of[:3]


def autoware_bias(text):
    one = yaml(text)["/**"]["ros__parameters"]
    return [one[f"angular_velocity_offset_{letter}"] for letter in "xyz"], None


def gnss_ins_sim_bias(text):
    names = {}
    exec(compile(text, "imu.py", "exec"), names)
    return names["imu_err"]["gyro_b"] * D2R / 3600, names["imu_err"]["accel_b"]


def navego_bias(text):
    found = {key: np.array(row.split(), dtype=float) for key, row in re.findall(r"imu\.(\w+) = \[([^\]]*)\];", text)}
    return found["gb_sta"] * D2R, found["ab_sta"] * 1e-3 * 9.80665


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
    "gazebo": gazebo, "px4": px4, "ardupilot": ardupilot, "okvis2": okvis2, "basalt": basalt, "glim": glim,
    "airsim": airsim, "gnss-ins-sim": gnss_ins_sim, "navego": navego,
}  # fmt: skip
PER_AXIS = ("gtsam", "gtsam-python", "matlab", "kfgins", "gazebo", "basalt", "gnss-ins-sim", "navego")
MARKOV = ("kfgins", "gazebo", "gnss-ins-sim", "navego")
"""Formats with a Gauss-Markov bias. K is that of the slow terms only if these are one Gauss-Markov process."""
BIASES = {
    "okvis2": okvis2_bias, "basalt": basalt_bias, "dlio": dlio_bias, "glim": glim_bias, "autoware": autoware_bias,
    "gnss-ins-sim": gnss_ins_sim_bias, "navego": navego_bias,
}  # fmt: skip
