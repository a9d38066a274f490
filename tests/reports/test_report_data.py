"""What a report says: the dictionary, and the pictures as Plotly takes them."""

import dataclasses
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from gmwm.cautions import about_declared, about_steps, about_values

import gmwm
from gmwm._text import OVERRULED
from gmwm.errors import OptionError
from gmwm.inspection.knocks import Step
from gmwm.plots.axes import signed_axis, time_axis, value_axis
from gmwm.plots.figure import Band, Foot, Line, Panel, Stroke, Text
from gmwm.plots.fit import fit_panel
from gmwm.reports import report_data
from gmwm.reports.citation import citation
from gmwm.reports.plotly import Scale, plotly_panel
from gmwm.reports.verdict import verdict
from gmwm.reports.write import _worded

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def data(calibration):
    return report_data(calibration)


def test_it_is_plain(data):
    assert json.loads(json.dumps(data, allow_nan=False))["title"] == "Calibration of knocked.csv"


def test_the_verdict_says_what_is_wrong(data, calibration):
    points = data["verdict"]["points"]
    assert calibration.verdicts["gyro_y"].contaminated
    said = [point for point in points if "outliers" in point["text"]]
    assert [point["state"] for point in said] == ["look"]
    assert "left out of gyro_y" in said[0]["text"]
    assert data["verdict"]["state"] == "look"
    assert points[0] == {"state": "good", "text": "All 3 axes are calibrated, from 17 min of recording at 100 Hz."}


def test_the_verdict_of_a_lost_axis_and_of_a_moved_unit(calibration):
    lost = dataclasses.replace(calibration, failed={"accel_y": "the signal is constant"})
    assert report_data(lost)["verdict"]["state"] == "bad"
    assert "accel_y: the signal is constant" in report_data(lost)["verdict"]["points"][0]["text"]
    moved = dataclasses.replace(calibration, recording=dataclasses.replace(calibration.recording, static=False))
    assert report_data(moved)["verdict"]["state"] == "bad"


def test_doubts_of_the_recording_reach_the_verdict():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    good = gmwm.calibrate(imu, "WN + RW")

    def state(*cautions):
        verdict = report_data(dataclasses.replace(good, cautions=cautions))["verdict"]
        assert verdict["state"] == "good" or "as it stands" not in verdict["headline"]
        return verdict["state"]

    def force(gravity):
        return about_values({}, gravity)

    noisy = gmwm.simulate({"gyro_x": "WN(sigma2=1e-2)"}, rate=100.0, samples=20_000, rng=1)
    step = Step(time=3.0, axis="gyro_x", size=1e-3, times=9.0)
    note = f"accel_x in g as declared; {OVERRULED} m/s²"
    assert state(*force(9.80665), *force(9.7), *about_declared(["columns as named"]), "2 knocks") == "good"
    assert state(*force(9.5)) == state(*about_declared([note])) == state(*about_steps((step,))) == "look"
    points = report_data(dataclasses.replace(good, cautions=gmwm.inspect(noisy).warnings))["verdict"]["points"]
    assert any(point["text"].startswith("gyro_x: a noise of") for point in points)
    assert state(*force(19.6)) == state(*force(0.23)) == state(*gmwm.inspect(noisy).warnings) == "bad"


def test_axes_that_cannot_be_used_are_left_out_of_what_is_said_of_the_others():
    truth = {"gyro_x": "WN(sigma2=4e-7)", "gyro_y": "WN(sigma2=4e-7) + RW(gamma2=2e-9)"}
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=50_000, rng=4), "WN")
    verdict = report_data(found)["verdict"]
    texts = [point["text"] for point in verdict["points"]]
    assert verdict["headline"].startswith("1 of 2 axes cannot be used (gyro_y); the others can be used")
    assert verdict["state"] == verdict["points"][0]["state"] == "bad"
    assert "gyro_y" in texts[0]
    assert "times too small" in texts[0]
    assert "does not describe the curve" in texts[0]
    assert any(text.startswith("Gyroscopes (gyro_x only): white noise density N") for text in texts)
    assert not any("the values describe the curve" in text for text in texts)
    alone = dataclasses.replace(found, axes={"gyro_y": found.axes["gyro_y"]})
    said = report_data(alone)["verdict"]
    assert said["headline"] == "The calibration cannot be used."
    assert not any("Gyroscopes" in point["text"] for point in said["points"])


def test_a_good_recording_gets_a_good_verdict():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    data = report_data(gmwm.calibrate(imu, "WN + RW"))
    assert {point["state"] for point in data["verdict"]["points"]} == {"good"}
    assert data["verdict"]["state"] == "good"


def test_three_unit_systems_say_the_same(data, calibration):
    for axis in data["axes"]:
        sheet = calibration.datasheets[axis["axis"]]
        assert [row["symbol"] for row in axis["numbers"]] == list(sheet)
        for row in axis["numbers"]:
            entry = sheet[row["symbol"]]
            assert row["datasheet"] == entry.text()
            assert row["si"] == entry.text("si")
        fit = calibration[axis["axis"]]
        values = {row["name"]: row["value"] for row in axis["parameters"]}
        for name, value in fit.parameters.items():
            assert float(values[name]) == pytest.approx(value, rel=1e-4)
        assert {row["name"]: row["unit"] for row in axis["parameters"]} == fit.units()
    white = {row["name"]: row for row in data["axes"][0]["parameters"]}["WN.sigma2"]
    density = calibration.datasheets["gyro_x"]["N"]
    assert float(white["value"]) / 100 == pytest.approx(density.in_units("si")[0] ** 2, rel=1e-4)
    assert density.in_units("deg/√h")[0] == pytest.approx(np.degrees(density.value) * 60)


def test_the_recording_and_its_file(calibration, tmp_path):
    file = tmp_path / "unit 7.csv"
    file.write_bytes(b"what was recorded")
    facts = dict(report_data(calibration.of_file(file))["recording"]["facts"])
    assert facts["SHA-256"] == hashlib.sha256(b"what was recorded").hexdigest()
    assert facts["File"] == "unit 7.csv, 17 bytes"
    assert (facts["Sampling rate"], facts["Gaps"], facts["At rest"]) == ("100 Hz", "none", "yes")
    assert facts["Units"] == "rad/s: gyro_x, gyro_y; m/s²: accel_x"
    assert "SHA-256" not in dict(report_data(calibration)["recording"]["facts"])


def test_gaps_and_temperature_are_told(calibration):
    recording = dataclasses.replace(
        calibration.recording, segments=3, missing=7.5, temperature=(21.0, 24.5), jitter=2e-4
    )
    facts = dict(report_data(dataclasses.replace(calibration, recording=recording))["recording"]["facts"])
    assert facts["Gaps"].startswith("2, 7.5 s missing")
    assert facts["Temperature"] == "21 to 24.5 °C"
    assert "0.000200" in facts["Time stamps"] or "2.00e-04" in facts["Time stamps"]


def test_a_calibration_of_wavelet_variances_has_no_recording(imu):
    bare = gmwm.calibrate({"gyro_x": gmwm.wavelet_variance(imu["gyro_x"])}, "WN + RW")
    assert bare.recording is None
    data = report_data(bare)
    assert data["title"] == "Calibration"
    assert dict(data["recording"]["facts"])["Sampling rate"] == "100 Hz"
    assert data["outliers"][0]["words"] == ["not looked for"]


def test_recording_goes_through_the_file(calibration, tmp_path):
    file = tmp_path / "x.csv"
    file.write_text("1\n")
    whole = calibration.of_file(file)
    whole = dataclasses.replace(whole, recording=dataclasses.replace(whole.recording, temperature=(1.0, 2.0)))
    whole.save(tmp_path / "calibration.json")
    again = gmwm.Calibration.load(tmp_path / "calibration.json")
    assert again.recording == whole.recording
    assert report_data(again) == report_data(whole)


def test_a_document_without_recording_is_read(calibration):
    content = calibration.to_dict()
    del content["recording"]
    assert gmwm.Calibration.from_dict(content).recording is None


def test_configuration_files(data):
    files = {file["name"]: file["text"] for file in data["configurations"]}
    assert "gyroscope_noise_density:" in files["kalibr"]
    assert len(files) + len(data["left_out"]) == len(gmwm.exporters.export_formats())


def test_what_cannot_be_exported_says_why(imu):
    data = report_data(gmwm.calibrate(imu, "WN + RW", axes=["gyro_x"]))
    assert any("needs gyroscopes and accelerometers" in text for text in data["left_out"])


def test_something_else_is_refused():
    with pytest.raises(OptionError, match="calibration must be a Calibration, got dict"):
        report_data({})


def test_the_citation_is_that_of_the_repository():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    said = citation()
    titles = re.findall(r"title: (.+)", text)
    names = re.findall(r"family-names: (.+)", text)
    assert titles[1] in said["method"]
    assert all(name in said["method"] and name in said["bibtex"] for name in names)
    assert re.search(r"arXiv:[\d.]+", text)[0] in said["method"]
    assert f"version {gmwm.__version__}" in said["software"]
    assert re.search(r"abstract: (.+)\.", text)[1] in said["software"].replace("\n", " ")


def test_a_test_is_judged_among_those_of_all_axes(calibration):
    found = calibration.axes["gyro_x"]

    def of(pvalue):
        test = dataclasses.replace(found.test, pvalue=pvalue)
        axes = {**calibration.axes, "gyro_x": dataclasses.replace(found, test=test)}
        data = report_data(dataclasses.replace(calibration, axes=axes))
        return data["axes"][0], [p["text"] for p in data["verdict"]["points"] if "by more than chance" in p["text"]]

    axis, said = of(0.03)
    assert (axis["rejected"], said) == (False, [])
    assert axis["test"].endswith("rejected at the 5 % level by itself, but not as one of several axes")
    axis, said = of(1e-5)
    assert axis["rejected"]
    assert len(said) == 1
    assert said[0].startswith("On gyro_x")


# --- pictures ---------------------------------------------------------------------------------------


def test_every_line_is_drawn_with_its_numbers(calibration):
    panel = fit_panel(calibration["gyro_y"], view="allan", units="datasheet")
    picture = plotly_panel(panel)
    traces = {trace["name"]: trace for trace in picture["data"]}
    for line in panel.lines:
        y = np.array([np.nan if v is None else v for v in traces[line.label]["y"]])
        np.testing.assert_allclose(y, line.y, rtol=1e-5)
        np.testing.assert_allclose(traces[line.label]["x"], line.x, rtol=1e-5)
    low, high = picture["layout"]["yaxis"]["range"]
    assert (10**low, 10**high) == pytest.approx(panel.y.limits, rel=1e-4)
    assert picture["layout"]["yaxis"]["ticktext"] == [tick.label for tick in panel.y.ticks]
    assert picture["entries"] == len(panel.labels)
    assert sum(trace["showlegend"] for trace in picture["data"]) == len(panel.labels)


def panel_of(*marks, y=None):
    y = y or value_axis((1.0, 100.0), "Deviation (mg)")
    return Panel(time_axis(np.array([1.0, 10.0]), "τ (s)"), y, marks, texts=(Text("<i>said</i>"),))


def test_a_band_with_a_hole_and_a_point_alone():
    x = np.array([1.0, 2.0, 4.0, 8.0])
    band = Band(x, np.array([0.0, 2.0, np.nan, 3.0]), np.array([5.0, np.inf, np.nan, 6.0]), "#0072B2", 0.25, "limits")
    (trace,) = plotly_panel(panel_of(band))["data"]
    assert trace["x"].count(None) == 1
    first = trace["y"][: trace["y"].index(None)]
    assert (min(first), max(first)) == pytest.approx((0.01, 10_000.0))
    alone = trace["x"][trace["x"].index(None) + 1 :]
    assert min(alone) < 8 < max(alone)
    assert trace["fillcolor"] == "rgba(0,114,178,0.25)"


def test_marks_without_a_name_go_with_those_of_their_colour():
    x = np.array([1.0, 10.0])
    named = Line(x, x, Stroke("#000000"), "data")
    rings = Line(x, x, Stroke("#000000", 0.0, symbol="circle", filled=False))
    foot = Foot(x, Stroke("#D55E00", 0.0, symbol="down"), "zero")
    picture = plotly_panel(panel_of(named, rings, foot))
    groups = [trace["legendgroup"] for trace in picture["data"]]
    assert sorted(groups) == ["data", "data", "zero"]
    assert next(t for t in picture["data"] if t["name"] == "zero")["y"][0] == pytest.approx(100**0.03, rel=1e-4)


def test_an_axis_that_is_even_about_zero():
    axis = signed_axis(np.array([-0.4, 37.0]), "Distance", linear=1.0, even=5.0)
    scale = Scale(axis)
    assert scale.of(np.array([-10.0, -0.5, 0.0, 1.0, 10.0, 100.0])) == pytest.approx([-2, -0.5, 0, 1, 2, 3])
    line = Line(np.array([1.0, 10.0]), np.array([-0.4, 37.0]), Stroke("#000000"), "model")
    (trace,) = plotly_panel(panel_of(line, y=axis))["data"]
    assert [row[0] for row in trace["customdata"]] == [-0.4, 37.0]


def test_names_stay_names():
    line = Line(np.array([1.0]), np.array([2.0]), Stroke("#000000"), "<a href='https://example.org'>%{x}</a>")
    text = json.dumps(plotly_panel(panel_of(line)))
    assert "<a" not in text
    assert "<i>" not in text
    assert "%{x}</a" not in text
    assert text.count("%{x") == text.count("%{x:.4~g}") == 1


def test_names_between_backticks_are_code_and_nothing_else_is():
    assert str(_worded("see `gmwm info` <b>`a<b`</b>")) == (
        "see <code>gmwm info</code> &lt;b&gt;<code>a&lt;b</code>&lt;/b&gt;"
    )


def test_outliers_that_were_not_looked_for_on_all_axes_get_no_tick():
    rng = np.random.default_rng(1)
    fine, coarse = rng.normal(0.0, 1e-3, 20_000), np.round(rng.normal(0.0, 0.3, 20_000)) * 1e-3
    said = {}
    for name, axes in (("some", {"gyro_x": fine, "gyro_y": coarse}), ("none", {"gyro_y": coarse})):
        imu = gmwm.Imu.from_arrays(axes, 100.0, units={"gyro": "rad/s"})
        points = verdict(gmwm.calibrate(imu, "WN"))["points"]
        (said[name],) = [point for point in points if "utliers" in point["text"]]
    assert said["some"] == {"state": "look", "text": "No outliers raise the curves; not tested: gyro_y."}
    assert said["none"] == {"state": "look", "text": "Whether outliers raise the curves could not be tested."}
