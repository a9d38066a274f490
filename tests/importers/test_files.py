"""Files of other programs: written by gmwm, read by the rule of each consumer and by the importer, with one result."""

import math

import numpy as np
import pytest

from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.files.importers import given_noise
from gmwm.files.importers.files import FORMATS
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.given import given_calibration
from tests.exporters.consumers import CONSUMERS, PER_AXIS
from tests.helpers import raises

RATE = 200.0
DATASHEET = "gyro: N=0.15deg/√h, K=2deg/h/√h; accel: N=60µg/√Hz, K=1e-4m/s²/√s"
WRITTEN = (
    "kalibr",
    "openvins",
    "kimera",
    "vins",
    "orbslam3",
    "liosam",
    "fastlio",
    "kfgins",
    "px4",
    "ardupilot",
    "matlab",
)
NUMBERS = {"gyro": (0.15 * math.pi / 180 / 60, 2 * math.pi / 180 / 3600 / 60), "accel": (60e-6 * 9.80665, 1e-4)}


@pytest.fixture(scope="module")
def calibration():
    return given_calibration(given_noise(DATASHEET, RATE))


@pytest.mark.parametrize("format", WRITTEN)
def test_a_datasheet_through_a_file_and_back(calibration, format, tmp_path):
    text = calibration.export(format=format, axes="each" if format in PER_AXIS else None)
    file = tmp_path / "file.txt"
    file.write_text(text, encoding="utf-8")
    consumed = CONSUMERS[format](text)
    found = given_noise(file, RATE)
    for sensor, (white, walk) in NUMBERS.items():
        # What the consumer makes of the file …
        assert consumed[sensor][0] == pytest.approx(white, rel=2e-6)
        if format != "kfgins":
            assert consumed[sensor][1] == pytest.approx(walk, rel=2e-6)
        for k, letter in enumerate("xyz"):
            values = found.values[f"{sensor}_{letter}"]
            # … is what the importer reads.
            assert pytest.approx(consumed[sensor][0][k], rel=1e-6) == values.N
            if format == "kfgins":
                assert values.sigma * math.sqrt(2 / values.time) == pytest.approx(consumed[sensor][1][k], rel=1e-6)
            else:
                assert pytest.approx(consumed[sensor][1][k], rel=1e-6) == values.K


def test_every_format_is_read_or_known_not_to_be():
    others = {"csv", "latex", "json", "state-space", "ros", "gtsam", "gtsam-python", "gazebo"}
    assert set(WRITTEN) | others <= set(export_formats())
    assert len(FORMATS) == len(WRITTEN) - 2 + 1  # Kalibr, OpenVINS and Kimera share their keys; imu_utils is read only


def test_rates_in_files(calibration, tmp_path):
    for format in ("kalibr", "openvins", "kimera", "orbslam3", "vins", "fastlio"):
        (tmp_path / "f").write_text(calibration.export(format=format), encoding="utf-8")
        assert given_noise(tmp_path / "f").rate == RATE
        assert given_noise(tmp_path / "f", 400.0).rate == 400.0
    for format in ("vins", "fastlio"):
        text = calibration.export(format=format).replace("for an IMU at", "at")
        (tmp_path / "f").write_text(text, encoding="utf-8")
        with raises(OptionError, argument="rate"):
            given_noise(tmp_path / "f")


def test_imu_utils(tmp_path):
    """gyr_n is √f σ(1 s), gyr_w the minimum of the Allan deviation: FitAllanGyr of imu_utils."""
    n, floor = 2e-4, 3e-6
    lines = ["%YAML:1.0", "---", "type: IMU", 'name: "unit"']
    for name, key, unit in (("Gyr", "gyr", "rad/s"), ("Acc", "acc", "m/s^2")):
        lines += [f"{name}:", f'   unit: " {unit}"']
        for k, axis in enumerate(("avg", "x", "y", "z")):
            lines += [
                f"   {axis}-axis:",
                f"      {key}_n: {n * (k + 1) * math.sqrt(RATE):.16e}",
                f"      {key}_w: {floor:.16e}",
            ]
    (tmp_path / "unit_imu_param.yaml").write_text("\n".join(lines), encoding="utf-8")
    found = given_noise(tmp_path / "unit_imu_param.yaml", RATE)
    assert [found.values[f"gyro_{x}"].N for x in "xyz"] == pytest.approx([2 * n, 3 * n, 4 * n])
    assert found.values["accel_y"].B * math.sqrt(2 * math.log(2) / math.pi) == pytest.approx(floor)
    assert found.models["gyro_x"].structure == "WN + FN"
    assert found.format == "imu_utils"


def test_matlab_with_its_default_noise_type_and_its_flicker_noise(tmp_path):
    text = """% a comment with 'NoiseDensity', 7
gyro = gyroparams( ...
    'NoiseDensity', 1e-4, ...
    'BiasInstability', [2e-5 3e-5 4e-5], 'RandomWalk', 1e-6);
"""
    (tmp_path / "f.m").write_text(text)
    values = given_noise(tmp_path / "f.m", RATE).values
    assert list(values) == ["gyro_x", "gyro_y", "gyro_z"]
    # double-sided: the bandwidth is f/2.
    assert pytest.approx(1e-4 / math.sqrt(2)) == values["gyro_x"].N
    assert pytest.approx(1e-6 * math.sqrt(2)) == values["gyro_x"].K
    assert pytest.approx(4e-5 / math.sqrt(2)) == values["gyro_z"].B


@pytest.mark.parametrize(
    "written", ["EKF2_GYR_NOISE\t{}", "1\t1\tEKF2_GYR_NOISE\t{}\t9", "param set EKF2_GYR_NOISE {}", "EKF2_GYR_NOISE,{}"]
)
def test_parameter_files_in_any_notation(written, tmp_path):
    others = "\nEKF2_GYR_B_NOISE 0.001\nEKF2_ACC_NOISE 0.35\nEKF2_ACC_B_NOISE 0.003\n"
    (tmp_path / "f").write_text(written.format(0.015) + others)
    assert pytest.approx(0.015 * math.sqrt(0.010)) == given_noise(tmp_path / "f", 250.0).values["gyro_x"].N


def test_unknown_and_incomplete_files(tmp_path):
    (tmp_path / "a").write_text("nothing: 1\n")
    with raises(ReadError, "Kalibr"):
        given_noise(tmp_path / "a", 100.0)
    (tmp_path / "b").write_text("gyroscope_noise_density: 1.0e-4\n")
    with raises(ReadError, "gyroscope_random_walk", str(tmp_path / "b")):
        given_noise(tmp_path / "b", 100.0)
    (tmp_path / "c").write_text("gyroscope_noise_density: soon\ngyroscope_random_walk: 1\n")
    with pytest.raises(ReadError):
        given_noise(tmp_path / "c", 100.0)
    (tmp_path / "d").write_text('{"format": "gmwm-calibration", "version": 2}\n')
    with raises(ReadError, "a result of gmwm", advises=["from_fits"]):
        given_noise(tmp_path / "d", 100.0)


def test_a_number_that_is_missing_is_not_invented():
    only_white = given_calibration(given_noise("gyro: N=0.15deg/√h; accel: N=60µg/√Hz", RATE))
    with raises(DataError, "gyro_x", "random walk"):
        only_white.export()


def test_flicker_noise_for_a_program_that_has_it():
    found = given_calibration(given_noise("gyro: N=0.15deg/√h, B=3deg/h; accel: N=60µg/√Hz, B=20µg", RATE))
    text = found.export(format="matlab")
    assert f"'BiasInstability', [{3 * math.pi / 180 / 3600:.6e}" in text
    assert "'RandomWalk', [0.000000e+00" in text


def test_the_head_says_that_nothing_was_measured(calibration):
    text = " ".join(calibration.export().replace("#", " ").split())
    assert "given, and not measured" in text
    assert "N=0.15deg/sqrt(h)" in text
    assert "samples" not in text


def test_state_space_and_numbers_of_a_datasheet(calibration):
    names = {}
    exec(calibration.export(format="state-space"), names)
    found = names["matrices"]("gyro_x")
    assert found["R"][0, 0] == pytest.approx(NUMBERS["gyro"][0] ** 2 * RATE)
    assert np.sqrt(found["Q"][0, 0] * RATE) == pytest.approx(NUMBERS["gyro"][1])


KALIBR = """imu0:
  # gyroscope_noise_density: 5.0e-2   # before the upgrade
  gyroscope_noise_density: [1.0e-4, 2.0e-4, 3.0e-4]
  gyroscope_random_walk: 1.0e-6  # gyroscope_random_walk: 2
  accelerometer_noise_density: 1.0e-3
  accelerometer_random_walk: 1.0e-4
"""


def test_a_comment_is_not_a_value_and_a_list_has_one_value_for_each_axis(tmp_path):
    (tmp_path / "kalibr.yaml").write_text(KALIBR)
    found = given_noise(tmp_path / "kalibr.yaml", RATE)
    assert [found.values[f"gyro_{x}"].N for x in "xyz"] == [1e-4, 2e-4, 3e-4]
    assert found.values["gyro_z"].K == 1e-6
    assert found.written["gyro_y"]["N"] == ("gyroscope_noise_density", 2e-4)
    (tmp_path / "vins.yaml").write_text(
        "%YAML:1.0\n# acc_n: 0.1 old\nacc_n: 0.02\ngyr_n: 0.001\nacc_w: 1e-4\ngyr_w: 1e-5\n"
    )
    assert pytest.approx(0.002) == given_noise(tmp_path / "vins.yaml", 100.0).values["accel_x"].N
    (tmp_path / "only.yaml").write_text("# gyroscope_noise_density: 5.0e-2\nrate: 3\n")
    with raises(ReadError, "no noise numbers"):
        given_noise(tmp_path / "only.yaml", 100.0)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("1.0e-3", "1.0e-3x", "line 5"),
        ("1.0e-3", "1.0e-3.5", "line 5"),
        ("1.0e-3", "-1.0e-3", "0 or larger"),
        ("1.0e-3", "1e999", "finite"),
        ("1.0e-3", "", "accelerometer_noise_density"),
        (", 3.0e-4", "", "2 numbers"),
        ("3.0e-4", "soon", "'soon'"),
        ("1.0e-4, 2.0e-4, 3.0e-4", "", "line 3"),
        ("1.0e-4\n", "1.0e-4\nimu1:\n  gyroscope_noise_density: 1.0e-3\n", "lines 3 and 8"),
    ],
)
def test_a_value_is_read_whole_or_refused(old, new, part, tmp_path):
    assert old in KALIBR
    (tmp_path / "kalibr.yaml").write_text(KALIBR.replace(old, new))
    with raises(ReadError, part):
        given_noise(tmp_path / "kalibr.yaml", RATE)


@pytest.mark.parametrize("row", ["[]", "[1e-4 2e-4]", "[1e-4 x 2]", "soon"])
def test_a_row_of_matlab_is_read_whole_or_refused(row, tmp_path):
    (tmp_path / "f.m").write_text(f"gyro = gyroparams('NoiseDensity', {row});\n")
    with raises(ReadError, "NoiseDensity"):
        given_noise(tmp_path / "f.m", RATE)


CALL = "gyro = gyroparams('NoiseDensity', 1e-4, 'RandomWalk', 1e-6);\n"


@pytest.mark.parametrize(
    "code",
    [
        CALL, "%{\ngyro = gyroparams('NoiseDensity', 7)\n%}\n" + CALL,
        "disp('gyroparams(''NoiseDensity'', 7)'); x = a';\n" + CALL,
        'gyroparams("noisedensity", [1e-4 1e-4, 1e-4], "RandomWalk", 1e-6, "AxesMisalignment", [1 2; 3 4])',
        "imuSensor('Gyroscope', gyroparams(RandomWalk=1e-6, NoiseDensity=... % old: 7\n 1e-4));",
    ],
)  # fmt: skip
def test_the_grammar_of_matlab(code, tmp_path):
    (tmp_path / "f.m").write_text(code)
    values = given_noise(tmp_path / "f.m", RATE).values
    assert pytest.approx(1e-4 / math.sqrt(2)) == values["gyro_z"].N
    assert pytest.approx(1e-6 * math.sqrt(2)) == values["gyro_z"].K


@pytest.mark.parametrize(
    ("code", "part"),
    [
        (CALL + CALL, "lines 1 and 2"), (CALL + "imu.Gyroscope.NoiseDensity = 2e-4;", "line 2"),
        (CALL.replace("1e-4", "1e-4*2"), "line 1"), (CALL.replace("1e-4", "deg2rad(0.1)"), "line 1"),
        (CALL.replace("1e-4", "0"), "NoiseDensity is 0"), (CALL.replace(");", ""), "no closing parenthesis"),
        (CALL.replace("'RandomWalk', 1e-6", "'NoiseType', 'pink'"), "single-sided"),
        (CALL.replace("'NoiseDensity', 1e-4, ", ""), "no noise numbers"),
    ],
)  # fmt: skip
def test_code_of_matlab_that_is_not_plain_numbers_is_refused(code, part, tmp_path):
    (tmp_path / "f.m").write_text(code)
    with raises(ReadError, part):
        given_noise(tmp_path / "f.m", RATE)


ALIASES = "a: &a [x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefghij", "bcdefghijk", strict=True)
)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", [ALIASES, "a: &a [[*a]]\n", "[" * 10_000, "".join(f"{' ' * k}a:\n" for k in range(1200))]
)
def test_yaml_that_is_larger_than_its_file_is_refused(text, tmp_path):
    (tmp_path / "kalibr.yaml").write_text(KALIBR + text)
    with raises(ReadError, "kalibr.yaml"):
        given_noise(tmp_path / "kalibr.yaml", RATE)


@pytest.mark.parametrize(
    ("written", "number"),
    [
        ("0.15 deg/sqrt(h)", 0.15 * math.pi / 180 / 60), ("'1.0e-3'", 1e-3), ("0.2 deg/s/√Hz", 0.2 * math.pi / 180),
        ("1.0e-3  # 5.0", 1e-3), ("1", 1.0), (".5", 0.5),
    ],
)  # fmt: skip
def test_values_with_units_quotes_and_comments(written, number, tmp_path):
    for name in ("kalibr.yaml", "plain.txt"):
        (tmp_path / name).write_text(KALIBR.replace("[1.0e-4, 2.0e-4, 3.0e-4]", written))
        found = given_noise(tmp_path / name, RATE)
        assert pytest.approx(number, rel=1e-12) == found.values["gyro_x"].N
        assert pytest.approx(number, rel=1e-12) == found.written["gyro_x"]["N"][1]


@pytest.mark.parametrize(
    "written",
    [
        "1,0e-4",
        "1.0 e-4",
        "2*1.0e-4",
        "190:20:30",
        "0.15 deg/h",
        "0",
        "0.0",
        "0x10",
        "[]",
        "[1, [2, 3]]",
        "~",
        "{a: 1}",
    ],
)
def test_what_is_not_one_number_is_refused_with_its_line(written, tmp_path):
    (tmp_path / "kalibr.yaml").write_text(KALIBR.replace("[1.0e-4, 2.0e-4, 3.0e-4]", written))
    with pytest.raises(ReadError) as caught:
        given_noise(tmp_path / "kalibr.yaml", RATE)
    assert "gyroscope_noise_density" in str(caught.value)
    assert "line 3" in str(caught.value) or "no number for" in str(caught.value)


def test_numbers_per_step_have_no_other_unit(tmp_path):
    text = "%YAML:1.0\n---\nacc_n: 0.02\ngyr_n: 0.1 deg/s\nacc_w: 1e-4\ngyr_w: 1e-5\n"
    (tmp_path / "vins.yaml").write_text(text)
    with raises(ReadError, "line 4", "deg/s"):
        given_noise(tmp_path / "vins.yaml", RATE)


def test_one_of_several_imus_is_a_choice(tmp_path):
    body = KALIBR.split("\n", 1)[1]
    path = tmp_path / "chain.yaml"
    path.write_text(f"imu0:\n{body}imu1:\n{body.replace('1.0e-4, 2.0', '7.0e-4, 2.0')}")
    with raises(ReadError, "lines 3 and 9", advises=["imu0", "imu1"]):
        given_noise(path, RATE)
    assert given_noise(f"{path}:imu0", RATE).values["gyro_x"].N == 1e-4
    assert given_noise(f"{path}:imu1", RATE).values["gyro_x"].N == 7e-4
    with raises(ReadError, "imu2", "imu0, imu1"):
        given_noise(f"{path}:imu2", RATE)


def test_yaml_that_is_damaged_is_refused_with_its_line(tmp_path):
    (tmp_path / "kalibr.yaml").write_text(KALIBR.replace("1.0e-6", "[1.0e-6"))
    with raises(ReadError, "line"):
        given_noise(tmp_path / "kalibr.yaml", RATE)


def test_nested_files_of_ros(tmp_path):
    """LIO-SAM for ROS 2 and ROS 1 has its keys below others."""
    for head in ("/**:\n  ros__parameters:\n", "lio_sam:\n"):
        indent = "    " if "ros__" in head else "  "
        keys = ("imuAccNoise: 4.0e-3", "imuGyrNoise: 1.6e-3", "imuAccBiasN: 6.4e-5", "imuGyrBiasN: 3.6e-5")
        (tmp_path / "params.yaml").write_text(head + "".join(f"{indent}{key}\n" for key in keys))
        assert given_noise(tmp_path / "params.yaml", 500.0).values["gyro_y"].N == 1.6e-3
