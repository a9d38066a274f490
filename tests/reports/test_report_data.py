"""The data of a report: the dictionary, and the figures for Plotly."""

import dataclasses
import hashlib
import json
import re
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.base import extras
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.showing.plots.axes import signed_axis, time_axis, value_axis
from gmwm.showing.plots.figure import Band, Foot, Panel, Polyline, Stroke, Text
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.reports import Section, report_data
from gmwm.showing.reports import content as report_content
from gmwm.showing.reports.content import citation
from gmwm.showing.reports.figures import Scale, plotly_panel
from gmwm.showing.reports.verdict import verdict
from gmwm.showing.reports.write import one_page_data, page, template
from tests.helpers import raises

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def data(calibration):
    return report_data(calibration)


@pytest.mark.slow
def test_it_is_plain(data):
    assert json.loads(json.dumps(data, allow_nan=False))["title"] == "Calibration of knocked.csv"


def points_of(data, code):
    return [point for point in data["verdict"]["points"] if point["code"] == code]


@pytest.mark.slow
def test_the_verdict_has_the_outliers_and_the_axes(data, calibration):
    assert calibration.verdicts["gyro_y"].contaminated
    assert (data["verdict"]["code"], data["verdict"]["state"]) == ("verdict", "bad")
    assert [point["state"] for point in points_of(data, "robust-depends-on-efficiency")] == ["bad"]
    (outliers,) = [note for note in data["notes"] if note["code"] == "outliers-left-out"]
    assert outliers["state"] == "good"
    assert "gyro_y" in outliers["text"]
    assert sum("finds no outliers" in text for text in data["outlier_tests"]) == 1  # once for two axes
    results = points_of(data, "results")[0]  # of the axes whose numbers can be used
    assert results["state"] == "good"
    assert "Gyroscopes" in results["text"]


def test_the_most_severe_points_come_first(data):
    order = ["bad", "look", "good"]
    places = [order.index(point["state"]) for point in data["verdict"]["points"]]
    assert places == sorted(places)
    assert {"bad", "good"} <= {point["state"] for point in data["verdict"]["points"]}


@pytest.mark.slow
def test_the_verdict_of_a_lost_axis_and_of_a_moved_unit(calibration):
    lost = dataclasses.replace(calibration, failed={"accel_y": "the signal is constant"})
    verdict = report_data(lost)["verdict"]
    assert (verdict["code"], verdict["state"]) == ("verdict", "bad")
    assert (verdict["points"][0]["code"], verdict["points"][0]["state"]) == ("not-calibrated", "bad")
    assert "accel_y" in verdict["points"][0]["text"]
    assert "the signal is constant" in verdict["points"][0]["text"]
    moved = Remark.of(
        "recording-moved", "gyro_x", case="moved", parts=("9 s to 27 s",), ranges=((9.0, 27.0),), ratio=7.0
    )
    recording = dataclasses.replace(calibration.recording, static=False)
    verdict = report_data(dataclasses.replace(calibration, recording=recording, recording_remarks=(moved,)))["verdict"]
    assert (verdict["code"], verdict["state"]) == ("verdict", "bad")
    assert not [point for point in verdict["points"] if "did not move" in point["text"]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("remarks", "state"),
    [
        ((Remark.of("file-content", "imu.csv", case="layout", format="Kalibr"),), "good"),
        (
            (Remark.of("unit-contradicted", case="gravity", norm=Quantity(9.5), expected=Quantity(9.81), share=-3.0),),
            "look",
        ),
        ((Remark.of("unit-contradicted", "gyro", case="declared", unit="rad/s", stated="deg/s"),), "look"),
        (
            (Remark.of("level-steps", "gyro_x", case="clear", count=1, places=("3 s",), first=Quantity(3.0, "s")),),
            "look",
        ),
        ((Remark.of("unit-doubtful", "accel", case="gravity", norm=Quantity(19.6), expected=Quantity(9.81)),), "look"),
        ((Remark.of("unit-doubtful", "gyro_x", case="density", density=Quantity(1.0), limit=Quantity(0.1)),), "bad"),
    ],
)
def test_remarks_on_the_recording_reach_the_verdict(remarks, state):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    found = dataclasses.replace(gmwm.calibrate(imu, "WN + RW"), recording_remarks=remarks)
    data = report_data(found)
    assert data["verdict"]["state"] == state
    where = data["notes"] if state == "good" else data["verdict"]["points"]
    assert remarks[0].code in [point["code"] for point in where]


@pytest.mark.slow
def test_a_gyroscope_that_is_too_noisy_gets_a_bad_verdict():
    noisy = gmwm.simulate({"gyro_x": "WN(sigma2=1e-2)"}, rate=100.0, samples=20_000, rng=1)
    data = report_data(gmwm.calibrate(noisy, "WN + RW"))
    assert data["verdict"]["state"] == "bad"
    (point,) = points_of(data, "unit-doubtful")
    assert "gyro_x" in point["text"]


@pytest.mark.slow
def test_the_points_about_numbers_leave_out_unusable_axes():
    truth = {"gyro_x": "WN(sigma2=4e-7)", "gyro_y": "WN(sigma2=4e-7) + RW(gamma2=2e-9)"}
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=50_000, rng=4), "WN")
    data = report_data(found)
    first = data["verdict"]["points"][0]
    assert (data["verdict"]["code"], data["verdict"]["state"]) == ("verdict", "look")
    refused = {symbol for symbol, one in found.number_verdicts["gyro_y"].items() if one.usability.value == "do not use"}
    assert "B" in refused
    assert found.verdict.facts["axes"] == 2
    assert (first["code"], first["state"]) == ("model-misfit", "bad")
    assert "gyro_y" in first["text"]
    numbers = points_of(data, "results")[-1]
    for symbol in refused & {"N", "K", "B"}:
        value = found.datasheets["gyro_y"][symbol].in_units("datasheet")[0]
        assert f"{value:.3g}" not in numbers["text"]


@pytest.mark.slow
def test_a_good_recording_gets_a_good_verdict():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    data = report_data(gmwm.calibrate(imu, "WN + RW"))
    assert {point["state"] for point in data["verdict"]["points"]} == {"good"}
    assert data["verdict"]["state"] == "good"


def test_three_unit_systems_say_the_same(data, calibration):
    for axis in data["axes"]:
        sheet = {**calibration.datasheets[axis["axis"]]}
        sheet |= {entry.symbol: entry for entry in calibration.rest[axis["axis"]].entries}
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


@pytest.mark.slow
def test_the_recording_and_its_file(calibration, tmp_path):
    file = tmp_path / "unit 7.csv"
    file.write_bytes(b"what was recorded")
    facts = dict(report_data(calibration.of_file(file))["recording"]["facts"])
    assert facts["SHA-256"] == hashlib.sha256(b"what was recorded").hexdigest()
    assert facts["File"] == "unit 7.csv, 17 bytes"
    assert (facts["Sampling rate"], facts["Gaps"], facts["At rest"]) == ("100 Hz", "none", "yes")
    assert facts["Units"] == "rad/s: gyro_x, gyro_y; m/s²: accel_x"
    assert "SHA-256" not in dict(report_data(calibration)["recording"]["facts"])


@pytest.mark.slow
def test_gaps_and_temperature_are_in_the_recording(calibration):
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
    assert (data["outliers"][0]["found"], data["outlier_tests"]) == ("not tested", [])


@pytest.mark.slow
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


def test_the_first_table_has_every_axis_and_a_reason_for_each_limit(calibration):
    lost = dataclasses.replace(calibration, failed={"accel_y": "the signal is constant"})
    tables = report_data(lost)["sensors"]
    assert [row["axis"] for table in tables for row in table["rows"]] == ["gyro_x", "gyro_y", "accel_x", "accel_y"]
    assert tables[1]["rows"][-1]["failed"] == "the signal is constant"
    for table in tables:
        for row in table["rows"]:
            for head, cell in zip(table["heads"], row["cells"], strict=bool(row["cells"])):
                limited = any(f"{head[0]} of" in r["numbers"] and row["axis"] in r["numbers"] for r in table["reasons"])
                assert limited is (cell["state"] in ("look", "bad"))


def test_folders_stay_out_of_the_report(calibration):
    moved = dataclasses.replace(calibration, source="/home/someone/private/unit 7.csv")
    assert "/home/" not in json.dumps(report_data(moved)) + str(one_page_data(moved))


def test_configuration_files(data):
    files = {file["name"]: file["text"] for file in data["configurations"]}
    assert "gyroscope_noise_density:" in files["kalibr"]
    assert len(files) + len(data["left_out"]) == len(gmwm.exporters.export_formats())


@pytest.mark.slow
def test_what_cannot_be_exported_says_why(imu):
    data = report_data(gmwm.calibrate(imu, "WN + RW", axes=["gyro_x"]))
    assert any("needs gyroscopes and accelerometers" in text for text in data["left_out"])


def test_something_else_is_refused():
    with raises(OptionError, "dict", argument="calibration", advises=["calibrate(recording)"]):
        report_data({})


def test_the_citation_is_that_of_the_repository():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = citation()
    titles = re.findall(r"title: (.+)", text)
    names = re.findall(r"family-names: (.+)", text)
    assert titles[1] in cited["method"]
    assert all(name in cited["method"] and name in cited["bibtex"] for name in names)
    assert re.search(r"doi: 10.48550/arXiv.([\d.]+)", text)[1] in cited["method"]
    assert f"version {gmwm.__version__}" in cited["software"]
    assert re.search(r"abstract: (.+)\.", text)[1] in cited["software"].replace("\n", " ")


@pytest.mark.slow
def test_a_test_is_judged_among_those_of_all_axes(calibration):
    found = calibration.axes["gyro_x"]

    def of(pvalue):
        test = dataclasses.replace(found.test, pvalue=pvalue)
        misfit = dataclasses.replace(found.misfit, largest=0.2)
        axes = {**calibration.axes, "gyro_x": dataclasses.replace(found, test=test, misfit=misfit)}
        data = report_data(dataclasses.replace(calibration, axes=axes))
        return data["axes"][0], points_of(data, "model-rejected")

    axis, points = of(0.03)
    assert (axis["rejected"], points) == (False, [])
    assert axis["test"].endswith("the model is not rejected at the 5 % level for all axes together")
    axis, (point,) = of(1e-5)
    assert axis["rejected"]
    assert "gyro_x" in point["text"]


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
    named = Polyline(x, x, Stroke("#000000"), "data")
    rings = Polyline(x, x, Stroke("#000000", 0.0, symbol="circle", filled=False))
    foot = Foot(x, Stroke("#D55E00", 0.0, symbol="down"), "zero")
    picture = plotly_panel(panel_of(named, rings, foot))
    groups = [trace["legendgroup"] for trace in picture["data"]]
    assert sorted(groups) == ["data", "data", "zero"]
    assert next(t for t in picture["data"] if t["name"] == "zero")["y"][0] == pytest.approx(100**0.03, rel=1e-4)


def test_an_axis_that_is_even_about_zero():
    axis = signed_axis(np.array([-0.4, 37.0]), "Distance", linear=1.0, even=5.0)
    scale = Scale(axis)
    assert scale.of(np.array([-10.0, -0.5, 0.0, 1.0, 10.0, 100.0])) == pytest.approx([-2, -0.5, 0, 1, 2, 3])
    line = Polyline(np.array([1.0, 10.0]), np.array([-0.4, 37.0]), Stroke("#000000"), "model")
    (trace,) = plotly_panel(panel_of(line, y=axis))["data"]
    assert [row[0] for row in trace["customdata"]] == [-0.4, 37.0]


def test_names_stay_names():
    line = Polyline(np.array([1.0]), np.array([2.0]), Stroke("#000000"), "<a href='https://example.org'>%{x}</a>")
    text = json.dumps(plotly_panel(panel_of(line)))
    assert "<a" not in text
    assert "<i>" not in text
    assert "%{x}</a" not in text
    assert text.count("%{x") == text.count("%{x:.4~g}") == 1


def test_names_between_backticks_are_code_and_nothing_else_is():
    worded = template("report.html").environment.filters["worded"]
    assert str(worded("see `gmwm info` <b>`a<b`</b>")) == (
        "see <code>gmwm info</code> &lt;b&gt;<code>a&lt;b</code>&lt;/b&gt;"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("remark", "words"),
    [
        (Remark.of("recording-settles", angle=Quantity(0.4, "°")), "did not move"),
        (Remark.of("samples-replaced", "gyro_x", case="spikes", count=189, largest=20.0), "no outliers"),
    ],
)
def test_there_is_one_statement_about_one_thing(remark, words):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    clean = gmwm.calibrate(imu, "WN + RW")
    doubtful = dataclasses.replace(clean, recording_remarks=(remark,))
    found = [any(words in point["text"] for point in verdict(one)["points"]) for one in (clean, doubtful)]
    assert found == [True, False]


@pytest.mark.slow
def test_outliers_that_were_not_tested_on_all_axes_get_no_tick():
    rng = np.random.default_rng(1)
    fine, coarse = rng.normal(0.0, 1e-3, 20_000), np.round(rng.normal(0.0, 0.3, 20_000)) * 1e-3
    for name, axes in (("some", {"gyro_x": fine, "gyro_y": coarse}), ("none", {"gyro_y": coarse})):
        imu = gmwm.Imu.from_arrays(axes, 100.0, units={"gyro": "rad/s"})
        points = verdict(gmwm.calibrate(imu, "WN"))["points"]
        (point,) = [point for point in points if "outliers" in point["text"]]
        assert (point["code"], point["state"]) == ("outliers-not-tested", "look")
        assert ("gyro_y" in point["text"], "gyro_x" in point["text"]) == (True, False), name


@pytest.mark.slow
@pytest.mark.parametrize(("pvalue", "rejected"), [(0.5, False), (0.005, True)])
def test_a_model_is_rejected_by_the_test_for_all_axes_alone(calibration, monkeypatch, pvalue, rejected):
    axis = calibration.axes["gyro_x"]
    monkeypatch.setitem(vars(axis.ranking.recommended), "pvalue", 0.005)
    axis = dataclasses.replace(axis, test=dataclasses.replace(axis.test, pvalue=pvalue))
    section, *_ = report_data(dataclasses.replace(calibration, axes={**calibration.axes, "gyro_x": axis}))["axes"]
    assert (section["rejected"], "rejects" in " ".join(section["ranking"]["remarks"])) == (rejected, rejected)
    assert section["search"] == [step.text() for step in axis.search] != []


@pytest.mark.slow
def test_the_error_budget_is_that_of_the_calibration():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)", "accel_y": "WN(sigma2=4e-5)"}, rate=100.0, samples=20_000, rng=1)
    calibration = gmwm.calibrate(imu, within="WN + RW")
    found = report_data(calibration)["sections"]["budget"]
    budget = calibration.budget(60.0)
    assert [row[0] for row in found["rows"][1:]] == [one.title for one in budget.growths.values()]
    assert found["rows"][1][1].startswith(f"{budget['tilt_x'].error[-1]:.3g}"[:5])
    counts = gmwm.calibrate({"x": gmwm.wavelet_variance(imu["gyro_x"])}, within="WN + RW")
    assert report_data(counts)["sections"] == {}


def test_another_package_adds_a_section(monkeypatch):
    def drift_section(calibration):
        return Section(title="Drift <b>", text="Use `gmwm wv`.", remarks=[f"{len(calibration)} axis"])

    entry = metadata.EntryPoint("drift", "somewhere:drift_section", "gmwm.reports")
    monkeypatch.setattr(type(entry), "load", lambda self: drift_section)
    monkeypatch.setattr(extras, "entry_points", lambda *, group: [entry] if group == entry.group else [])
    calibration = gmwm.calibrate(gmwm.simulate({"gyro_x": "WN(sigma2=1)"}, rate=100.0, samples=2000, rng=1), "WN")
    for registry in (extras.admit_guests, report_content._registry):
        registry.cache_clear()
    try:
        data = report_data(calibration)
    finally:
        for registry in (extras.admit_guests, report_content._registry):
            registry.cache_clear()
    assert data["sections"]["drift"]["title"] == "Drift <b>"
    text = page(data)
    assert "<h2>Drift &lt;b&gt;</h2></summary>\n<p>Use <code>gmwm wv</code>.</p>\n<p>1 axis</p>" in text
