"""The front door: options, sensors that are missing, files that are whole, texts from elsewhere that stay comments."""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.calibration.recording_info import Recording
from gmwm.showing.exporters import export_all, export_formats
from gmwm.showing.exporters.text import plain, unended
from tests.helpers import code_of, each, only, raises, warns

from .conftest import RATE, TRUTHS, calibrated, exact_curve, remarks_in, words
from .consumers import CONSUMERS, PER_AXIS, yaml


def with_axes(calibration, *axes, failed=()):
    return replace(
        calibration,
        axes={axis: found for axis, found in calibration.axes.items() if axis in axes},
        failed=dict.fromkeys(failed, "constant"),
    )


def test_it_writes_what_it_gives_and_kalibr_by_default(units, tmp_path):
    calibration = units["quantized"]
    text = calibration.export(tmp_path / "imu.yaml")
    assert (tmp_path / "imu.yaml").read_text(encoding="utf-8") == text == calibration.export(format="kalibr")


def test_a_file_has_the_extension_of_its_format(units, tmp_path):
    for name, format in (("imu.yaml", "gtsam"), ("noise.csv", "kalibr"), ("x.json", "csv")):
        with raises(OptionError, name, argument="path"):
            units["quantized"].export(tmp_path / name, format)
    assert not list(tmp_path.iterdir())
    units["quantized"].export(tmp_path / "imu.yml", "kalibr")


@pytest.mark.parametrize("format", sorted(set(CONSUMERS) - {"matlab", "gazebo"}))
def test_consumers_of_both_sensors_say_which_is_missing(units, tmp_path, format):
    gyro = with_axes(units["quantized"], "gyro_x", "gyro_y", "gyro_z")
    path = tmp_path / "old"
    path.write_text("kept")
    with raises(DataError, format, "gyro_x", "gyro_y", "gyro_z"):
        gyro.export(path, format)
    # Whole or not at all.
    assert path.read_text() == "kept"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("format", ["matlab", "gazebo", "ros", "json", "csv", "latex", "state-space"])
def test_others_take_one_sensor(units, format):
    text = with_axes(units["quantized"], "gyro_x", "gyro_y", "gyro_z").export(format=format)
    head = {"matlab": "%", "gazebo": " "}.get(format, "#")
    body = "\n".join(line for line in text.splitlines() if not line.startswith(head))
    assert "gyro" in text
    assert not re.search(r"accel_|accelparams|imuSensor|linear_acceleration", body)


def test_an_axis_that_failed_is_told_and_left_out(units):
    two = with_axes(units["quantized"], *(a for a in TRUTHS["quantized"] if a != "gyro_y"), failed=["gyro_y"])
    text = two.export()
    assert "of gyro_x, gyro_z" in words(text)
    assert [r.subject for r in remarks_in(two, "kalibr") if code_of(r) == "not-calibrated:calibration"] == ["gyro_y"]
    walk = CONSUMERS["kalibr"](text)["gyro"][1]
    assert walk == pytest.approx((2e-11 * RATE) ** 0.5, rel=0.01)
    for format in ("ros", *PER_AXIS):
        with raises(DataError, "gyro_y"):
            two.export(format=format, axes="each")
        assert two.export(format=format, axes="worst")


def test_units_must_be_known(units):
    wv = replace(exact_curve("gyro_x", "WN(sigma2=1e-6)"), unit="")
    unknown = gmwm.calibrate({"gyro_x": wv, "accel_x": exact_curve("accel_x", "WN(sigma2=1e-6)")}, "WN + RW")
    with raises(DataError, "gyro_x", "rad/s"):
        unknown.export()
    assert "unknown" in json.loads(unknown.export(format="json"))["axes"]["gyro_x"]["filter"]["none_because"]
    nameless = gmwm.calibrate({"signal": wv}, "WN")
    for format in ("kalibr", "ros"):
        with raises(DataError, format):
            nameless.export(format=format)


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"format": "kalib"}, "format"),
        ({"axes": "best"}, "axes"),
        ({"inflation": 0.0}, "inflation"),
        ({"inflation": float("nan")}, "inflation"),
        ({"inflation": True}, "inflation"),
        ({"rate": float("inf")}, "rate"),
        ({"format": "csv", "inflation": 2.0}, "inflation"),
        ({"format": "ros", "horizon": 2.0}, "horizon"),
        ({"format": "px4", "rate": 200.0}, "rate"),
        ({"format": "state-space", "axes": "worst"}, "axes"),
    ],
)
def test_options_are_checked(units, options, argument):
    with pytest.raises(OptionError) as caught:
        units["quantized"].export(**options)
    assert caught.value.argument == argument
    assert repr(caught.value.got) == repr(options[argument])


def test_the_horizon_is_checked(units):
    with raises(OptionError, argument="horizon"):
        units["quantized"].export(horizon=-1.0)


HOSTILE = 'a\nrostopic: evil\r\n--><x/>*/ int main(){}\\\n"""\n%YAML é√\u2028b: 1 \x1b[31m\\'


def _body(text):
    """The lines of a file that are no comments."""
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    return [line for line in text.splitlines() if line and not line.lstrip().startswith(("#", "//", "%", ";"))]


@each("format", CONSUMERS)
def test_texts_from_elsewhere_stay_in_the_head(units, format):
    calibration = units["quantized"]
    text = replace(calibration, source=HOSTILE).export(format=format)
    assert text.isascii()
    assert "\x1b" not in text
    wanted, found = (CONSUMERS[format](one) for one in (calibration.export(format=format), text))
    for sensor, pair in wanted.items():
        assert np.array_equal(pair, found[sensor])
    body = _body(calibration.export(format=format))
    assert text.startswith("{") or _body(text) == body
    assert not any(line.endswith("\\") for line in text.splitlines())


@pytest.mark.slow
@each("format", sorted(CONSUMERS))
def test_files_name_a_recording_without_its_folders(units, format):
    """A file that is handed on shows the name and the SHA-256 of a recording, and not where it was stored."""
    unit = units["quantized"]
    recording = Recording(
        samples=1000, rate=100.0, duration=10.0, segments=1, missing=0.0, jitter=None, static=True, knocks=0,
        gravity=None, temperature=None, file="run_7.csv", sha256="5ec0" * 16,
    )  # fmt: skip
    for source in ("/home/alice/secret/run_7.csv", r"C:\Users\alice\secret\run_7.csv"):
        text = replace(unit, source=source, recording=recording).export(format=format)
        assert "run_7.csv, " in text
        assert "5ec05ec0" in text
        assert "alice" not in text
    pair = replace(unit, source="/home/alice/gyro.csv and /home/alice/accel.csv")
    assert "gyro.csv and accel.csv" in " ".join(pair.export(format=format).split())
    assert "alice" not in pair.export(format=format)


def test_hostile_texts_do_no_harm_elsewhere(units):
    calibration = replace(units["quantized"], source=HOSTILE)
    assert json.loads(calibration.export(format="json"))["source"] in HOSTILE
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
    told = replace(units["quantized"], source="a--b.csv")
    assert "a--b.csv" in told.export(format="kalibr")
    text = told.export(format="gazebo")
    assert "a- -b.csv" in text
    ElementTree.fromstring(text)


def test_doubts_of_the_recording_stand_in_every_head(units):
    off = {"norm": Quantity(9.52, "m/s²"), "expected": Quantity(9.80665, "m/s²"), "share": -2.9}
    doubt = Remark.of("unit-contradicted", "accel -->", case="gravity", **off)
    knocks = Remark.of("knocks", count=2, first=Quantity(7.0, "s"))
    told = replace(units["quantized"], recording_remarks=(doubt, knocks))
    for format in set(export_formats()) - {"dlio"}:
        assert [
            code_of(r) for r in remarks_in(told, format) if code_of(r) in ("unit-contradicted:gravity", "knocks")
        ] == ["unit-contradicted:gravity"]
        text = words(told.export(format=format))
        assert f"CAUTION: {words(doubt.text())}".replace("--", "- -" if format == "gazebo" else "--") in text or (
            format == "json" and "unit-contradicted" in text
        ), format
        assert "knocks" not in text, format
    ElementTree.fromstring(told.export(format="gazebo"))
    assert "CAUTION" not in units["quantized"].export()


def test_all_formats_at_once(units, tmp_path):
    written, left = export_all(units["quantized"], tmp_path, axes="each", inflation=3.0, rate=400.0)
    assert list(written) == [name for name in export_formats() if name != "dlio"]
    assert set(left) == {"dlio"}
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in written.values()}
    assert "Inflation factor: 3." in written["kalibr"].read_text(encoding="utf-8")
    assert CONSUMERS["vins"](written["vins"].read_text(encoding="utf-8"), rate=400.0)
    assert written["csv"].read_text(encoding="utf-8") == units["quantized"].export(format="csv")


def test_what_cannot_be_is_left_and_told(units, tmp_path):
    written, left = export_all(with_axes(units["quantized"], "gyro_x", "gyro_y", "gyro_z"), tmp_path)
    assert set(left) == {*CONSUMERS, "autoware", "dlio"} - {"matlab", "gazebo"}
    assert set(written) == set(export_formats()) - set(left)
    assert all("accelerometers" in why for name, why in left.items() if name != "dlio")


def test_sensors_of_two_rates_are_told(units):
    calibration = units["quantized"]
    slow = {}
    for axis in ("accel_x", "accel_y", "accel_z"):
        found = calibration.axes[axis]
        wv = replace(found.fit.wavelet_variance, rate=50.0)
        slow[axis] = replace(found, fit=replace(found.fit, wavelet_variance=wv))
    mixed = replace(calibration, axes={**calibration.axes, **slow})
    remark = only(remarks_in(mixed, "kalibr"), "rates-differ")
    assert remark.facts == {"gyro": Quantity(200.0, "Hz"), "accel": Quantity(50.0, "Hz")}
    text = mixed.export()
    assert words(remark.text()) in words(text)
    assert yaml(text)["update_rate"] == 200.0


@pytest.mark.slow
def test_terms_that_act_as_others_are_counted_to_these(units):
    curve = exact_curve("gyro_x", "WN(sigma2=6e-7) + RW(gamma2=1e-11)")
    found = calibrated(TRUTHS["quantized"])
    with warns("correlation-time-unknown:fit", process="RW"):
        fit = gmwm.fit("GM + WN", curve)
    axes = {**found.axes, "gyro_x": replace(found.axes["gyro_x"], fit=fit, datasheet=fit.datasheet())}
    walk = CONSUMERS["matlab"](replace(found, axes=axes).export(format="matlab"))["gyro"][1]
    assert walk[0] == pytest.approx((1e-11 * RATE) ** 0.5, rel=1e-3)
