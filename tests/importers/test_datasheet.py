"""Datasheets as text."""

import math

import pytest

from gmwm.base.errors import GmwmError, OptionError, UnitError
from gmwm.files.importers import given_noise
from gmwm.theory.processes import Model
from tests.helpers import each, raises

DEG = math.pi / 180


def test_units_and_sensors():
    found = given_noise("gyro: N=0.15deg/√h, K=2 deg/h/sqrt(h); accel_z: N=60µg/√Hz, B=0.02 mg", rate=100.0)
    assert list(found.values) == ["gyro_x", "gyro_y", "gyro_z", "accel_z"]
    assert pytest.approx(0.15 * DEG / 60) == found.values["gyro_y"].N
    assert pytest.approx(2 * DEG / 3600 / 60) == found.values["gyro_y"].K
    assert pytest.approx(60e-6 * 9.80665) == found.values["accel_z"].N
    assert pytest.approx(0.02e-3 * 9.80665) == found.values["accel_z"].B
    assert found.models["accel_z"].structure == "WN + FN"


@pytest.mark.parametrize(
    "text", ["gyro_x: B=3deg/h over 100s", "gyro_x: B=3°/h, T_c=100s", "gyro_x: T=100 s, B = 3 deg/hr"]
)
def test_a_correlation_time(text):
    values = given_noise(text, 100.0).values["gyro_x"]
    assert (values.time, values.B) == (100.0, pytest.approx(3 * DEG / 3600))
    assert given_noise(text, 100.0).models["gyro_x"].structure == "GM"


def test_a_model_with_values():
    found = given_noise("gyro: WN(sigma2=4e-8) + RW(gamma2=1e-12); accel: N=1e-3m/s²/√Hz", 100.0)
    assert found.models["gyro_z"] == Model.parse("WN(sigma2=4e-8) + RW(gamma2=1e-12)")
    assert set(found.values) == {"accel_x", "accel_y", "accel_z"}


@each(
    ("text", "error", "argument"),
    [
        ("gyro: N=0.15", UnitError, "source"),
        ("gyro: N=0.15deg/h", UnitError, "source"),
        ("gyro: X=3deg/h", OptionError, "source"),
        ("gyr: N=1deg/√h", OptionError, "source"),
        ("nothing.yaml", OptionError, "source"),
        ("gyro: N=1deg/√h over 3s", OptionError, "source"),
        ("gyro: sigma=3deg/h", OptionError, "source"),
        ("gyro: T_c=3s", OptionError, "source"),
        ("gyro: B=3deg/h, sigma=2deg/h over 3s", OptionError, "source"),
        ("gyro: N=1deg/√h, N=2deg/√h", OptionError, "source"),
        ("gyro: N=1deg/√h; gyro_x: N=2deg/√h", OptionError, "source"),
        ("gyro: N=0deg/√h", OptionError, "source"),
        ("gyro: N=-1deg/√h", OptionError, "source"),
        ("gyro: N=1e400deg/√h", OptionError, "source"),
        ("gyro: WN(sigma2=1) + RW", OptionError, "source"),
        ("gyro: B=3deg/h over soon", OptionError, "source"),
    ],
)
def test_bad_text_is_named(text, error, argument):
    with raises(error, argument=argument):
        given_noise(text, 100.0)


def test_the_rate_is_needed():
    with raises(OptionError, argument="rate"):
        given_noise("gyro: N=1deg/√h")
    with pytest.raises(GmwmError):
        given_noise("gyro: N=1deg/√h", rate=-1.0)


@pytest.mark.parametrize(
    "text",
    ["gyro: N=0.1...deg/√h", "gyro: N=..deg/√h", "gyro: N=1e-4rad/s/√Hz, K=1e308rad/s/√s",
     "gyro: N=1e200rad/s/√Hz", "gyro: N=1e-300rad/s/√Hz", "gyro: N=1e-4rad/s/√Hz, K=1e-300rad/s/√s"],
)  # fmt: skip
def test_numbers_that_are_none_or_out_of_range_end_in_one_clear_error(text):
    with pytest.raises(GmwmError):
        given_noise(text, 100.0)
