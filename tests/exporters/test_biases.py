"""The bias at rest in files: read back by the rule of each program, and never a zero without a word."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gmwm.base.errors import DataError
from gmwm.calibration.rest import BiasAtRest
from gmwm.showing.exporters import export_formats
from gmwm.showing.exporters.base import find_exporter
from tests.helpers import only, raises

from .conftest import remarks_in, words
from .consumers import BIASES, yaml

GYRO, ACCEL = (1e-3, -2e-3, 3e-3), (0.05, -0.02, 0.1)


def rest(unit, bias, gravity=0.0, **more):
    mean = bias + (gravity or 0.0)
    given = {
        "mean": mean, "error": 1e-5, "low": mean - 2e-5, "high": mean + 2e-5, "gravity": gravity, "gravity_error": 0.0,
        "recordings": 1, "rms": 2e-5, "rms_low": 1e-5, "rms_high": 4e-5, "duration": 1000.0, "level": 0.95,
        "unit": unit,
    }  # fmt: skip
    return BiasAtRest(**given | more)


def with_biases(calibration, tilt_known=True):
    found = {f"gyro_{letter}": rest("rad/s", bias) for letter, bias in zip("xyz", GYRO, strict=True)}
    for letter, bias in zip("xyz", ACCEL, strict=True):
        gravity = 9.806 if letter == "z" else 0.0 if tilt_known else None
        found[f"accel_{letter}"] = rest("m/s²", bias, gravity)
    axes = {axis: replace(one, rest=found[axis]) for axis, one in calibration.axes.items()}
    return replace(calibration, axes=axes)


@pytest.mark.slow
@pytest.mark.parametrize("format", BIASES)
def test_the_program_reads_the_biases_back(units, format):
    unit = with_biases(units["quantized"])
    gyro, accel = BIASES[format](unit.export(format=format))
    # NaveGo draws a bias between minus and plus its number.
    sign = np.abs if format == "navego" else np.asarray
    assert gyro == pytest.approx(sign(GYRO), rel=2e-6)
    if accel is not None:
        assert accel == pytest.approx(sign(ACCEL), rel=2e-6)
    assert "bias-not-known" not in {remark.code for remark in remarks_in(unit, format)}
    assert "gyro_y -0.002 +- 1e-05" in words(unit.export(format=format))


@pytest.mark.parametrize("format", BIASES)
def test_a_bias_that_is_not_known_is_never_a_measured_zero(units, format):
    unit = with_biases(units["quantized"], tilt_known=False)
    found = [remark for remark in remarks_in(unit, format) if remark.code == "bias-not-known"]
    if format == "autoware":  # it has no bias of accelerometers
        assert not found
        return
    remark = only(found, "bias-not-known")
    assert (remark.subject, remark.facts["why"]) == ("accel_x, accel_y", "tilt")
    text = unit.export(format=format)
    assert "NOT MEASURED: the bias of accel_x, accel_y" in words(text)
    if format == "okvis2":
        assert "a0" not in yaml(text, "%YAML:1.0")["imu_parameters"]
        return
    assert BIASES[format](text)[1] == pytest.approx([0.0, 0.0, 0.1], rel=2e-6)


def test_the_prior_of_okvis_is_error_rms_and_turn_on_together(units):
    unit = with_biases(units["quantized"])
    axes = dict(unit.axes)
    spread = rest("rad/s", 3e-3, turn_on=3e-4, turn_on_low=1e-4, turn_on_high=9e-4)
    axes["gyro_z"] = replace(axes["gyro_z"], rest=spread)
    content = yaml(replace(unit, axes=axes).export(format="okvis2"), "%YAML:1.0")["imu_parameters"]
    assert content["sigma_bg"] == pytest.approx(math.hypot(1e-5, 2e-5, 3e-4), rel=1e-6)
    assert content["sigma_ba"] == pytest.approx(math.hypot(1e-5, 2e-5), rel=1e-6)


def test_curves_have_no_bias_and_files_say_so(units):
    with raises(DataError, "dlio"):
        units["quantized"].export(format="dlio")
    for format in set(BIASES) - {"dlio"}:
        found = [remark for remark in remarks_in(units["quantized"], format) if remark.code == "bias-not-known"]
        assert {remark.facts["why"] for remark in found} == {"recording"}, format


def test_all_other_formats_are_without_biases(units):
    for format in set(export_formats()) - set(BIASES) - {"json"}:
        assert "Bias at rest" not in words(with_biases(units["quantized"]).export(format=format)), format
        assert not getattr(find_exporter(format), "biases_of", ()), format


def test_autoware_has_the_standard_deviations_of_samples(units):
    unit = with_biases(units["no-walk"])
    one = yaml(unit.export(format="autoware", inflation=2.0))["/**"]["ros__parameters"]
    assert one["angular_velocity_stddev_yy"] == pytest.approx(2 * math.sqrt(4e-7), rel=1e-4)
    assert one["acceleration_stddev"] == pytest.approx(2 * math.sqrt(4e-5), rel=1e-4)
    assert one["angular_velocity_offset_y"] == pytest.approx(-2e-3)
