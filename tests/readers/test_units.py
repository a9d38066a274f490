"""Who decides a unit: the user, the header, the format, gravity; in this order, and never nobody."""

from __future__ import annotations

import re
import warnings

import numpy as np
import polars as pl
import pytest

from gmwm.base.errors import InferredUnitWarning, UnitError
from gmwm.files.readers import read
from tests.helpers import codes, only, raises, warns

REST = np.random.default_rng(8).normal((0.1, -0.2, 1.0), 0.01, (64, 3))


def saved(folder, values, names):
    path = folder / "static.csv"
    pl.DataFrame(dict(zip(names, values.T, strict=True))).write_csv(path)
    return path


@pytest.mark.parametrize(("name", "factor"), [("g", 1.0), ("m/s²", 9.80665), ("mg", 1000.0)])
def test_gravity_tells_the_unit_and_it_is_said(tmp_path, name, factor):
    path = saved(tmp_path, REST * factor, ["ax", "ay", "az"])
    with pytest.warns(InferredUnitWarning) as warned:
        imu = read(path, rate=100)
    np.testing.assert_allclose(imu["accel_z"].values, REST[:, 2] * 9.80665, rtol=1e-12)
    remark = only(imu.remarks, "unit-inferred", str(path))
    assert remark.facts["unit"] == name
    assert [one.message.remark for one in warned] == [remark]


@pytest.mark.parametrize("factor", [0.2, 3.0, 100.0])
def test_gravity_that_tells_nothing_is_an_error(tmp_path, factor):
    with raises(UnitError, code="unit-implausible"):
        read(saved(tmp_path, REST * factor, ["ax", "ay", "az"]), rate=100)


def test_two_accelerometers_tell_nothing(tmp_path):
    with raises(UnitError, code="unit-needs-three-axes"):
        read(saved(tmp_path, REST[:, 1:], ["ay", "az"]), rate=100)


def test_declared_goes_before_named_and_is_noted(tmp_path):
    path = saved(tmp_path, REST, ["gx [rad/s]", "gy [rad/s]", "gz [rad/s]"])
    imu = read(path, rate=100, units={"gyro": "dps"})
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians(REST[:, 0]), rtol=1e-15)
    assert only(imu.remarks, "unit-contradicted:declared", "gyro").facts == {
        "case": "declared",
        "unit": "deg/s",
        "stated": "rad/s",
    }


def test_named_goes_before_gravity_and_gravity_objects(tmp_path):
    with warns("unit-doubtful:stated", likely="g"):
        imu = read(saved(tmp_path, REST, ["ax_mps2", "ay_mps2", "az_mps2"]), rate=100)
    assert imu["accel_z"].values.tolist() == REST[:, 2].tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(saved(tmp_path, REST, ["ax_g", "ay_g", "az_g"]), rate=100)


def test_each_axis_may_have_its_own_unit(tmp_path):
    imu = read(saved(tmp_path, REST, ["gx [deg/s]", "gy [rad/s]", "gz [mdps]"]), rate=100)
    factors = [np.pi / 180, 1.0, np.pi / 180e3]
    for axis, column, factor in zip(imu, REST.T, factors, strict=True):
        np.testing.assert_allclose(imu[axis].values, column * factor, rtol=1e-15)


def test_a_gyroscope_without_unit_shows_its_noise_in_both(tmp_path):
    sigma, rate = 0.5, 400.0
    values = np.random.default_rng(1).normal(3.0, sigma, (20000, 1))
    with pytest.raises(UnitError) as caught:
        read(saved(tmp_path, values, ["gyro_z"]), rate=rate)
    pairs = re.findall(r"([\d.e+-]+) deg/s/√Hz \(([\d.e+-]+) deg/√h\)", str(caught.value))
    density = sigma / np.sqrt(rate)
    truth = [[density, 60 * density], [np.degrees(density), 60 * np.degrees(density)]]
    np.testing.assert_allclose([list(map(float, pair)) for pair in pairs], truth, rtol=0.06)


def test_unknown_units(tmp_path):
    path = saved(tmp_path, REST, ["gx", "gy", "gz"])
    with raises(UnitError, "'furlong'", "gyro", "rad/s, deg/s"):
        read(path, rate=1, units={"gyro": "furlong"})
    with raises(UnitError, "'g'", argument="unit"):
        read(path, rate=1, units={"gyro": "g"})


@pytest.mark.parametrize(
    ("named", "size"),
    [
        ("[mrad/s]", 1e-3), ("_mrad_s", 1e-3), ("[deg/min]", np.pi / 180 / 60), ("(arcsec/s)", np.pi / 648000),
        ("[rpm]", 2 * np.pi / 60),
    ],
)  # fmt: skip
def test_less_usual_units_of_rate(tmp_path, named, size):
    imu = read(saved(tmp_path, REST, [f"{axis}{named}" for axis in ("gyro_x", "gyro_y", "gyro_z")]), rate=100)
    np.testing.assert_allclose(imu["gyro_y"].values, REST[:, 1] * size, rtol=1e-14)


def test_less_usual_units_of_force(tmp_path):
    for unit, size in (("mm/s²", 1e-3), ("cm/s^2", 1e-2)):
        imu = read(saved(tmp_path, REST * 9.80665 / size, [f"a{axis} [{unit}]" for axis in "xyz"]), rate=100)
        np.testing.assert_allclose(imu["accel_z"].values, REST[:, 2] * 9.80665, rtol=1e-14)


@pytest.mark.parametrize("sensor", ["gyro", "accel"])
def test_a_unit_that_is_named_but_not_known_is_called_by_its_name(tmp_path, sensor):
    path = saved(tmp_path, REST, [f"{sensor}_{axis} [furlong/s]" for axis in "xyz"])
    with raises(UnitError, "'furlong/s'", f"{sensor}_x", advises=["units=", "scale="]):
        read(path, rate=100)
    si = {"gyro": "rad/s", "accel": "m/s²"}[sensor]
    imu = read(path, rate=100, units={sensor: si}, scale={sensor: 3.0})
    np.testing.assert_allclose(imu[f"{sensor}_y"].values, 3 * REST[:, 1], rtol=1e-15)
    assert only(imu.remarks, "unit-contradicted:declared", sensor).facts == {
        "case": "declared",
        "unit": si,
        "stated": "furlong/s",
    }


def test_units_of_increments_point_to_them(tmp_path):
    for sensor, unit, of_rate in (("gyro", "deg", "deg/s"), ("accel", "m/s", "m/s²")):
        path = saved(tmp_path, REST * 9.80665 / 100, [f"{sensor}_{axis} [{unit}]" for axis in "xyz"])
        with raises(UnitError, f"'{unit}'", advises=[f"increments=['{sensor}']", f"units={{'{sensor}': '{of_rate}'}}"]):
            read(path, rate=100)
        imu = read(path, rate=100, units={sensor: of_rate}, increments=[sensor])
        assert only(imu.remarks, "unit-named:unit", sensor).facts == {
            "case": "unit",
            "unit": of_rate,
            "source": "declared",
        }
        overruled = only(read(path, rate=100, units={sensor: of_rate}).remarks, "unit-contradicted:declared", sensor)
        assert overruled.facts == {"case": "declared", "unit": of_rate, "stated": unit}


def test_what_stands_in_brackets_and_is_no_unit_leaves_it_to_gravity(tmp_path):
    with pytest.warns(InferredUnitWarning) as warned:
        read(saved(tmp_path, REST, ["ax (raw)", "ay (raw)", "az (raw)"]), rate=100)
    assert warned[0].message.remark.facts["unit"] == "g"


def moving(unit, size=2000, rate=100.0, seed=4):
    """Rows of gyroscopes and accelerometers that turn by hand for 5 s, with 0.005 deg/s/√Hz before and after."""
    rng = np.random.default_rng(seed)
    turn = np.zeros((size, 3))
    turn[600:1100] = np.sin(np.arange(500) / 40)[:, None] * [0.8, -0.5, 0.3]
    gravity, down = np.empty((size, 3)), np.array([0.0, 0.0, 1.0])
    for k in range(size):
        down = down - np.cross(turn[k], down) / rate
        down /= np.linalg.norm(down)
        gravity[k] = down
    gyro = turn + np.radians(0.005) * np.sqrt(rate) * rng.normal(size=(size, 3))
    return np.column_stack(
        [gyro / {"rad/s": 1.0, "deg/s": np.pi / 180}[unit], gravity + 1e-3 * rng.normal(size=(size, 3))]
    )


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["rad/s", "deg/s"])
@pytest.mark.parametrize("seed", range(5))
def test_the_question_for_the_unit_of_gyroscopes_is_judged_on_quiet_parts_and_turns(tmp_path, unit, seed):
    table = moving(unit, seed=seed)
    with raises(UnitError, f"agree with {unit}", code="unit-unnamed", advises=[f"'gyro': '{unit}'"]) as caught:
        read(saved(tmp_path, table, ["wx", "wy", "wz", "ax", "ay", "az"]), rate=100)
    density = re.findall(rf"([\d.e-]+) deg/s/√Hz \([^)]*\) if it is {unit}", str(caught.value))
    assert float(density[0]) == pytest.approx(0.005, rel=0.2)
    assert "MPU-6050" in str(caught.value)
    # Without accelerometers, the noise of the quiet part comes first; both units are shown.
    with raises(UnitError, "if it is rad/s", "if it is deg/s", advises=[f"probably units={{'gyro': '{unit}'}}"]):
        read(saved(tmp_path, table[:, :3], ["wx", "wy", "wz"]), rate=100)


def test_a_recording_at_rest_is_no_witness(tmp_path):
    table = np.random.default_rng(2).normal(size=(2000, 6)) * 1e-3 + [0, 0, 0, 0, 0, 1]
    with raises(UnitError, code="unit-unnamed") as caught:
        read(saved(tmp_path, table, ["wx", "wy", "wz", "ax", "ay", "az"]), rate=100)
    assert "agree with" not in str(caught.value)


def test_counts_around_the_middle_of_their_range_are_named(tmp_path):
    counts = np.rint(2**15 + np.random.default_rng(3).normal(size=(500, 6)) * 20 + [0, 0, 0, 0, 0, 8192])
    path = saved(tmp_path, counts, ["wx", "wy", "wz", "ax", "ay", "az"])
    with raises(UnitError, "offset of 32768", code="unit-unnamed"):
        read(path, rate=100)
    imu = read(path, rate=100, units={"gyro": "deg/s", "accel": "g"}, scale={"gyro": 1 / 131, "accel": 1 / 8192})
    assert [remark.subject for remark in imu.remarks if remark.code == "counts-offset"] == ["gyro", "accel"]
    signed = saved(tmp_path, counts - 2**15, ["wx", "wy", "wz", "ax", "ay", "az"])
    imu = read(signed, rate=100, units={"gyro": "deg/s", "accel": "g"}, scale={"gyro": 1 / 131, "accel": 1 / 8192})
    assert "counts-offset" not in codes(imu.remarks)
    with raises(UnitError, "whole, as counts are", code="unit-unnamed", advises=["gyro=1/131", "'gyro': 'deg/s'"]):
        read(signed, rate=100)
    with raises(UnitError, code="unit-implausible", advises=["accel=1/16384"]):
        read(signed, rate=100, units={"gyro": "deg/s"})
