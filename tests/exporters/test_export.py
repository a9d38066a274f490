"""The front door: options, sensors that are missing, files that are whole, texts from elsewhere that stay comments."""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import gmwm
from gmwm.errors import DataError, FitWarning, OptionError
from gmwm.exporters import export_all, export_formats
from gmwm.exporters.text import plain, unended

from .conftest import RATE, TRUTHS, calibrated, exact_curve
from .consumers import CONSUMERS, PER_AXIS, yaml


def only(calibration, *axes, failed=()):
    return replace(
        calibration,
        axes={axis: found for axis, found in calibration.axes.items() if axis in axes},
        failed=dict.fromkeys(failed, "constant"),
    )


def test_it_writes_what_it_gives_and_kalibr_by_default(units, tmp_path):
    calibration = units["quantized"]
    text = calibration.export(tmp_path / "imu.yaml")
    assert (tmp_path / "imu.yaml").read_text(encoding="utf-8") == text == calibration.export(format="kalibr")


@pytest.mark.parametrize("format", sorted(set(CONSUMERS) - {"matlab", "gazebo"}))
def test_consumers_of_both_sensors_say_which_is_missing(units, tmp_path, format):
    gyro = only(units["quantized"], "gyro_x", "gyro_y", "gyro_z")
    path = tmp_path / "old"
    path.write_text("kept")
    with pytest.raises(DataError, match=f"{format} needs gyroscopes and accelerometers.*accelerometers are not"):
        gyro.export(path, format)
    # Whole or not at all.
    assert path.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("format", ["matlab", "gazebo", "ros", "json", "csv", "latex", "state-space"])
def test_others_take_one_sensor(units, format):
    text = only(units["quantized"], "gyro_x", "gyro_y", "gyro_z").export(format=format)
    head = {"matlab": "%", "gazebo": " "}.get(format, "#")
    body = "\n".join(line for line in text.splitlines() if not line.startswith(head))
    assert "gyro" in text
    assert not re.search(r"accel_|accelparams|imuSensor|linear_acceleration", body)


def test_an_axis_that_failed_is_told_and_left_out(units):
    two = only(units["quantized"], *(a for a in TRUTHS["quantized"] if a != "gyro_y"), failed=["gyro_y"])
    text = two.export()
    assert "the largest of gyro_x, gyro_z." in text
    assert "Not calibrated: gyro_y." in text
    walk = CONSUMERS["kalibr"](text)["gyro"][1]
    assert walk == pytest.approx((2e-11 * RATE) ** 0.5, rel=2e-6)
    for format in ("ros", *PER_AXIS):
        with pytest.raises(DataError, match="gyro_y is not calibrated; take axes='worst'"):
            two.export(format=format, axes="each")
        assert two.export(format=format, axes="worst")


def test_units_must_be_known(units):
    wv = replace(exact_curve("gyro_x", "WN(sigma2=1e-6)"), unit="")
    unknown = gmwm.calibrate({"gyro_x": wv, "accel_x": exact_curve("accel_x", "WN(sigma2=1e-6)")}, "WN + RW")
    with pytest.raises(DataError, match="gyro_x is in no known unit, where rad/s is expected"):
        unknown.export()
    assert "not known" in json.loads(unknown.export(format="json"))["axes"]["gyro_x"]["filter"]["none_because"]
    nameless = gmwm.calibrate({"signal": wv}, "WN")
    with pytest.raises(DataError, match="as gyro_x and accel_x"):
        nameless.export()
    with pytest.raises(DataError, match="as gyro_x and accel_x"):
        nameless.export(format="ros")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"format": "kalib"}, "format must be one of .*kalibr.*got 'kalib'"),
        ({"axes": "best"}, "axes must be one of 'worst', 'mean', 'each'; got 'best'"),
        ({"inflation": 0.0}, "inflation must be a positive number, got 0.0"),
        ({"inflation": float("nan")}, "inflation must be a positive number"),
        ({"inflation": True}, "inflation must be a positive number"),
        ({"horizon": -1.0}, "horizon must be a positive time"),
        ({"rate": float("inf")}, "rate must be a positive number"),
        ({"format": "csv", "inflation": 2.0}, "inflation has no meaning for 'csv': it takes no options"),
        ({"format": "ros", "horizon": 2.0}, "horizon has no meaning for 'ros': it takes axes, inflation"),
        ({"format": "px4", "rate": 200.0}, "rate has no meaning for 'px4'"),
        ({"format": "state-space", "axes": "worst"}, "axes has no meaning"),
    ],
)
def test_options_are_checked(units, options, said):
    with pytest.raises(OptionError, match=said):
        units["quantized"].export(**options)


HOSTILE = 'a\nrostopic: evil\r\n--><x/>*/ int main(){}\\\n"""\n%YAML é√\u2028b: 1 \x1b[31m\\'


@pytest.mark.parametrize("format", CONSUMERS)
def test_texts_from_elsewhere_stay_in_the_head(units, format):
    calibration = units["quantized"]
    text = replace(calibration, source=HOSTILE).export(format=format)
    assert text.isascii()
    assert "\x1b" not in text
    wanted, found = (CONSUMERS[format](one) for one in (calibration.export(format=format), text))
    for sensor, pair in wanted.items():
        assert np.array_equal(pair, found[sensor])
    body = calibration.export(format=format).split("\n\n", 1)[-1]
    assert text.endswith(body.split("-->\n", 1)[-1] if format == "gazebo" else body)
    assert not any(line.endswith("\\") for line in text.splitlines())


def test_hostile_texts_do_no_harm_elsewhere(units):
    calibration = replace(units["quantized"], source=HOSTILE)
    assert json.loads(calibration.export(format="json"))["source"] == HOSTILE
    assert list(yaml(calibration.export(format="ros"))) == [
        "angular_velocity_covariance", "linear_acceleration_covariance"
    ]  # fmt: skip
    for format in ("csv", "latex"):
        known = units["quantized"].export(format=format)
        lines = calibration.export(format=format).splitlines()
        mark = {"csv": "#", "latex": "%"}[format]
        assert [line for line in lines if not line.startswith(mark)] == [
            line for line in known.splitlines() if not line.startswith(mark)
        ]
    names = {}
    exec(compile(calibration.export(format="state-space"), "noise.py", "exec"), names)
    assert list(names["AXES"]) == list(calibration)
    ElementTree.fromstring(calibration.export(format="gazebo"))


def test_a_plain_text_stays_so_when_it_is_made_plain_again():
    for text in (HOSTILE, "---", "-- -", "*/*/", "√Hz", "\\\\"):
        once = plain(text)
        assert once == plain(once)
        assert "--" not in unended(once)
        assert unended(once) == unended(unended(once))
        assert "*/" not in once
        assert "\n" not in once


def test_only_xml_breaks_double_hyphens(units):
    assert "to inflate by 10 to 20: --inflation 10." in units["quantized"].export(format="openvins")
    told = replace(units["quantized"], source="a--b.csv")
    assert "a--b.csv" in told.export(format="kalibr")
    text = told.export(format="gazebo")
    assert "a- -b.csv" in text
    ElementTree.fromstring(text)


def test_doubts_of_the_recording_stand_in_every_head(units):
    doubt = "gyro_x: the unit was declared against the file: deg/s -->"
    told = replace(units["quantized"], cautions=(doubt, "2 knocks"))
    for format in export_formats():
        # Without the marks of comments, as words.
        text = " ".join(re.sub(r"^\s*(#|%|//|;)", " ", told.export(format=format), flags=re.MULTILINE).split())
        assert "the unit was declared against the file: deg/s" in text, format
        assert "knocks" not in text, format
    ElementTree.fromstring(told.export(format="gazebo"))
    assert "CAUTION" not in units["quantized"].export()


def test_all_formats_at_once(units, tmp_path):
    written, left = export_all(units["quantized"], tmp_path, axes="each", inflation=3.0, rate=400.0)
    assert list(written) == list(export_formats())
    assert left == {}
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in written.values()}
    assert "Inflation factor: 3." in written["kalibr"].read_text(encoding="utf-8")
    assert CONSUMERS["vins"](written["vins"].read_text(encoding="utf-8"), rate=400.0)
    assert written["csv"].read_text(encoding="utf-8") == units["quantized"].export(format="csv")


def test_what_cannot_be_is_left_and_told(units, tmp_path):
    written, left = export_all(only(units["quantized"], "gyro_x", "gyro_y", "gyro_z"), tmp_path)
    assert set(left) == set(CONSUMERS) - {"matlab", "gazebo"}
    assert set(written) == set(export_formats()) - set(left)
    assert all("accelerometers are not in this calibration" in why for why in left.values())


def test_sensors_of_two_rates_are_told(units):
    calibration = units["quantized"]
    slow = {}
    for axis in ("accel_x", "accel_y", "accel_z"):
        found = calibration.axes[axis]
        wv = replace(found.fit.wavelet_variance, rate=50.0)
        slow[axis] = replace(found, fit=replace(found.fit, wavelet_variance=wv))
    text = replace(calibration, axes={**calibration.axes, **slow}).export()
    assert "gyroscopes 200 Hz, accelerometers 50 Hz" in text
    assert yaml(text)["update_rate"] == 200.0


def test_a_time_near_the_horizon_is_told(units):
    assert "near the horizon" not in units["quantized"].export()
    assert "A correlation time of accel_y is near the horizon" in units["gauss-markov"].export(horizon=1.2)


def test_terms_that_act_as_others_are_counted_to_these(units):
    curve = exact_curve("gyro_x", "WN(sigma2=6e-7) + RW(gamma2=1e-11)")
    found = calibrated(TRUTHS["quantized"])
    with pytest.warns(FitWarning, match="acts as RW"):
        fit = gmwm.fit("GM + WN", curve)
    axes = {**found.axes, "gyro_x": replace(found.axes["gyro_x"], fit=fit)}
    walk = CONSUMERS["matlab"](replace(found, axes=axes).export(format="matlab"))["gyro"][1]
    assert walk[0] == pytest.approx((1e-11 * RATE) ** 0.5, rel=1e-3)
