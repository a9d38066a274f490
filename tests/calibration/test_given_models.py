"""Models that the user gives are fitted as they are; gmwm chooses the models of the other axes."""

import json

import pytest

import gmwm
from gmwm.base.errors import ModelError, OptionError
from gmwm.calibration.options import CalibrationOptions
from tests.helpers import raises

pytestmark = pytest.mark.slow

HELD = "WN(sigma2=fixed(4e-7)) + RW"


@pytest.fixture(scope="module")
def given(imu):
    return gmwm.calibrate(imu, "GM + WN + RW", models={"gyro_x": HELD, "accel": "GM + WN"})


def test_the_given_models_are_fitted_and_no_others(given, calibration):
    assert given.axes["gyro_y"].fit.to_dict() == calibration.axes["gyro_y"].fit.to_dict()
    assert given["gyro_x"].model.structure == gmwm.Model.parse(HELD).structure
    assert given["gyro_x"].parameters["WN.sigma2"] == 4e-7
    assert given["accel_x"].model.structure == "GM + WN"
    for axis in ("gyro_x", "accel_x"):
        found = given.axes[axis]
        assert [candidate.recommended for candidate in found.ranking] == [True]
        assert found.tried == ()
        assert found.fit.gap is not None
        assert found.fit.gap <= 1e-3


def test_the_chosen_model_given_again_has_the_same_numbers(imu, calibration):
    chosen = calibration["gyro_x"].model.structure
    again = gmwm.calibrate(imu, axes="gyro_x", models={"gyro_x": chosen}).axes["gyro_x"]
    before = calibration.axes["gyro_x"]
    assert again.fit.to_dict() == before.fit.to_dict()
    assert list(again.datasheet) == list(before.datasheet)
    assert again.datasheet["N"].value == before.datasheet["N"].value


def test_it_survives_json(given):
    again = gmwm.Calibration.from_dict(json.loads(json.dumps(given.to_dict())))
    assert again.to_dict() == given.to_dict()
    assert {axis: str(model) for axis, model in again.settings.models.items()} == {
        "gyro_x": "WN(sigma2=fixed(4e-07)) + RW", "accel": "GM + WN",
    }  # fmt: skip


def test_wrong_models_are_refused_before_anything_is_measured(imu):
    with raises(OptionError, argument="models", got="gyro_z"):
        gmwm.calibrate(imu, models={"gyro_z": "WN"})
    with raises(OptionError, argument="models", got="accel"):
        gmwm.calibrate(imu, models={"accel": "WN"}, axes="gyro")
    with raises(OptionError, argument="within", got="GM + WN"):
        gmwm.calibrate(imu, "GM + WN", models={"gyro": "WN", "accel": "WN"})
    with raises(OptionError, argument="models", got="WN"):
        CalibrationOptions(models="WN")
    with pytest.raises(ModelError):
        CalibrationOptions(models={"gyro_x": "WN + VN"})
