"""What a file says of numbers that are not what they look like: models that fail, limits among measured values."""

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.calibration.misfit import undescribed
from gmwm.calibration.summary_text import rejected
from gmwm.exporters import export_all, export_formats
from gmwm.exporters.base import find_exporter
from gmwm.reports.verdict import verdict

from .conftest import TRUTHS, calibrated, exact_curve
from .consumers import CONSUMERS, PER_AXIS

HUMP = "GM(beta=20.0, sigma2=1e-5) + WN(sigma2=6e-7)"
"""No sum of white noise and a random walk has such a curve."""


def words(text):
    return " ".join(re.sub(r"^\s*(#|%|//)", " ", text, flags=re.MULTILINE).split())


@pytest.fixture(scope="module")
def bad():
    return calibrated({**TRUTHS["no-walk"], "gyro_z": HUMP, "accel_x": HUMP}, "WN + RW")


@pytest.mark.parametrize("format", sorted(export_formats()))
def test_axes_that_their_models_do_not_describe_stand_in_every_file(bad, format):
    said = words(bad.export(format=format))
    (caution,) = re.findall(r"the models? of ([^:]*) data; numbers of (?:this axis|these axes) may be wrong", said)
    assert re.findall(r"(?:gyro|accel)_\w", caution) == ["gyro_z", "accel_x"]
    assert caution.endswith("do not describe their")
    assert ("CAUTION: the models of gyro_z (its variance at " in said) == (format != "json")


def test_they_are_those_that_the_report_says_cannot_be_used(bad):
    far = undescribed({axis: bad.axes[axis] for axis in rejected(bad)})
    assert list(far) == ["gyro_z", "accel_x"]
    assert "2 of 6 axes cannot be used (gyro_z, accel_x)" in verdict(bad)["headline"]
    said = words(bad.export())
    for axis, at in far.items():
        much = f"{at.times:.2g} times too {'large' if at.ratio > 1 else 'small'}"
        assert f"{axis} (its variance at {at.tau:.3g} s is {much})" in said
    (text,) = json.loads(bad.export(format="json"))["cautions"]
    assert text in said


def test_one_axis_is_told_as_one():
    said = words(calibrated({**TRUTHS["no-walk"], "gyro_z": HUMP}, "WN + RW").export())
    assert re.search(r"CAUTION: the model of gyro_z \(its [^()]*\) does not describe its data; numbers of this", said)


def test_a_rejected_model_that_describes_its_curve_is_no_caution():
    # Off by a fifth: far beyond chance, near enough to be used.
    curve = exact_curve("gyro_z", TRUTHS["no-walk"]["gyro_x"])
    factor = np.where(curve.levels % 2, 1.2, 1.0)
    wave = replace(curve, **{name: getattr(curve, name) * factor for name in ("variance", "lower", "upper")})
    found = calibrated(TRUTHS["no-walk"], "WN + RW")
    axes = {**found.axes, "gyro_z": gmwm.calibrate({"gyro_z": wave}, "WN + RW").axes["gyro_z"]}
    found = replace(found, axes=axes)
    assert rejected(found) == ["gyro_z"]
    assert "CAUTION" not in found.export()
    assert json.loads(found.export(format="json"))["cautions"] == []


# White noise so large on gyro_z that its limit of K lies above what the others have; on accel_x it lies far below.
MIXED = {**TRUTHS["quantized"], "gyro_z": "WN(sigma2=5e-2)", "accel_x": "WN(sigma2=2e-5)"}


@pytest.fixture(scope="module")
def mixed():
    return calibrated(MIXED)


@pytest.mark.parametrize("format", CONSUMERS)
def test_a_limit_among_measured_values_names_its_axis(mixed, format):
    said = words(mixed.export(format=format, axes="worst"))
    limit = mixed.export(format="matlab").split("'RandomWalk', [")[1].split("]")[0].split()[2]
    assert said.count("UPPER LIMIT") == 1
    assert (
        "UPPER LIMIT, not a measured value: K of the gyroscopes is the upper limit of gyro_z, whose data cannot tell "
        "it from zero (97.5 %). Axis by axis, before inflation, in rad/s/sqrt(s): gyro_x 4.47e-05 (measured), gyro_y "
        f"7.75e-05 (measured), gyro_z <= {float(limit):.2e}."
    ) in said
    walk = CONSUMERS[format](mixed.export(format=format, axes="worst"))["gyro"][1]
    assert walk == pytest.approx(float(limit), rel=2e-6)


def test_what_is_said_is_not_inflated(mixed):
    plain, inflated = (words(mixed.export(inflation=factor)) for factor in (1.0, 10.0))
    told = [text[text.index("UPPER LIMIT") : text.index(" rostopic")] for text in (plain, inflated)]
    assert told[0] == told[1]


@pytest.mark.parametrize("format", CONSUMERS)
def test_a_mean_with_a_limit_names_the_axes(mixed, format):
    said = words(mixed.export(format=format, axes="mean"))
    assert "K of the gyroscopes is a root mean square with the upper limit of gyro_z, whose data" in said
    assert "K of the accelerometers is a root mean square with the upper limit of accel_x, whose data" in said
    assert re.search(r"in m/s\^2/sqrt\(s\): accel_x <= \S+, accel_y 1.41e-04 \(measured\), accel_z", said)
    assert "The data cannot tell" not in said


def test_limits_of_all_axes_and_of_some_are_told_apart():
    said = words(calibrated({**MIXED, "accel_y": "WN(sigma2=3e-5)", "accel_z": "WN(sigma2=4e-5)"}).export())
    assert (
        "K of the accelerometers. The data cannot tell it from zero; they only say that it is not larger (97.5 %, "
    ) in said
    assert "K of the gyroscopes is the upper limit of gyro_z" in said


@pytest.mark.parametrize("format", PER_AXIS)
def test_each_axis_has_its_own(mixed, format):
    said = words(mixed.export(format=format, axes="each"))
    assert "UPPER LIMIT, not a measured value: K of gyro_z, K of accel_x. The data cannot tell these from zero;" in said
    assert "Axis by axis" not in said


RATE = 200.00116000672804


@pytest.mark.parametrize("format", sorted(f for f in CONSUMERS if "rate" in find_exporter(f).takes))
def test_rates_have_six_digits_and_numbers_the_rate_itself(units, format):
    text = units["quantized"].export(format=format, rate=RATE)
    assert "200.0011" not in text
    has_none = format in ("gtsam", "gtsam-python", "liosam")
    assert len(re.findall(r"\b200\.001\b", text)) == (0 if has_none else 1)
    if format in ("vins", "fastlio"):
        key, power = {"vins": ("acc_n", 0.5), "fastlio": ("acc_cov", 1.0)}[format]
        ratio = [float(re.search(rf"{key}: (\S+)", one)[1]) for one in (text, units["quantized"].export(format=format))]
        assert ratio[0] / ratio[1] == pytest.approx((RATE / 200.0) ** power, rel=1e-6)


def test_json_keeps_all_digits_of_a_rate(units):
    calibration = units["quantized"]
    found = calibration.axes["gyro_x"]
    wave = replace(found.fit.wavelet_variance, rate=RATE)
    told = replace(
        calibration, axes={**calibration.axes, "gyro_x": replace(found, fit=replace(found.fit, wavelet_variance=wave))}
    )
    assert json.loads(told.export(format="json"))["axes"]["gyro_x"]["rate"] == RATE


def test_all_at_once_has_them_too(bad, tmp_path):
    written, left = export_all(bad, tmp_path)
    assert not left
    for format, path in written.items():
        assert "gyro_z (its variance at" in words(path.read_text(encoding="utf-8")), format
    assert math.isfinite(json.loads(written["json"].read_text(encoding="utf-8"))["horizon"])


def test_a_ramp_in_matrices_is_told():
    drifting = {**TRUTHS["no-walk"], "gyro_z": "WN(sigma2=1e-6) + DR(omega=1e-6)"}
    said = words(calibrated(drifting, "WN + DR").export(format="state-space"))
    assert "CAUTION: DR of gyro_z: the ramp of this recording, known without error here (P0 = 0)." in said
    assert "P0 = 0" not in words(calibrated(TRUTHS["no-walk"], "WN + RW").export(format="state-space"))
