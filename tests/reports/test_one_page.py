"""The page to hand over, and PDFs: one page, the verdict first, and never a verdict that contradicts another."""

import dataclasses
import re

import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.calibration.findings import unusable
from gmwm.showing.reports import report_data, write
from gmwm.showing.reports.write import MOST, one_page_data, one_page_html, page
from tests.helpers import raises

PAGES = re.compile(rb"/Type\s*/Page\b(?!s)")
needs_browser = pytest.mark.skipif(write.browser() is None, reason="needs Chromium")


@pytest.mark.slow
def test_it_has_the_verdict_four_numbers_a_plot_and_the_data(calibration):
    data = one_page_data(calibration)
    assert data["headline"] == report_data(calibration)["verdict"]["headline"]
    rows = {row["axis"]: row for table in data["tables"] for row in table["rows"]}
    assert list(rows) == list(calibration)
    for axis, row in rows.items():
        assert row["cells"][0]["text"].startswith(f"{calibration.datasheets[axis]['N'].in_units()[0]:.3g}")
        assert row["bias"] == "tilt unknown" or calibration.rest[axis].bias is not None
    assert len(data["cautions"]) <= MOST + 1
    html = one_page_html(calibration)
    assert html.index(data["headline"]) < html.index("<table") < html.index("data:image/png;base64,")
    assert "<script" not in html


def test_cautions_are_three_of_two_sentences_and_a_count(calibration, monkeypatch):
    texts = [f"Axis {k} drifts by 3.7 deg/h. Use `--detrend`. N is not affected." for k in range(5)]
    monkeypatch.setattr("gmwm.showing.reports.write.with_groups", lambda *_: [("drift", text) for text in texts])
    cautions = one_page_data(calibration)["cautions"]
    assert cautions[:MOST] == [f"Axis {k} drifts by 3.7 deg/h. Use `--detrend`." for k in range(3)]
    assert cautions[MOST:] == ["2 more cautions are in the report."]


@pytest.mark.slow
def test_what_all_recordings_share_is_stated_once(calibration):
    named = {name: dataclasses.replace(calibration.recording, file=f"{name}.csv", sha256=name) for name in ("a", "b")}
    facts = dict(one_page_data(dataclasses.replace(calibration, recording=None, recordings=named))["facts"])
    assert facts["Sampling rate"] == f"{calibration.recording.rate:g} Hz"
    assert facts["SHA-256"] == "a; b"


@pytest.mark.slow
def test_the_column_of_the_bias_is_left_out_without_one(calibration):
    axes = {axis: dataclasses.replace(found, rest=None) for axis, found in calibration.axes.items()}
    data = one_page_data(dataclasses.replace(calibration, axes=axes))
    assert not any(table["bias"] for table in data["tables"])
    assert "at rest</th>" not in one_page_html(dataclasses.replace(calibration, axes=axes))


@pytest.mark.slow
def test_names_from_files_are_escaped(hostile):
    html = one_page_html(hostile)
    assert "<script" not in html
    assert "onerror=" not in html.replace("onerror=&", "")


@pytest.mark.slow
def test_matplotlib_draws_the_page_without_a_browser(calibration, tmp_path, monkeypatch):
    monkeypatch.setattr("gmwm.showing.reports.write.browser", lambda: None)
    monkeypatch.setattr("gmwm.showing.reports.write.browser", lambda: None)
    file = calibration.report(tmp_path / "unit.pdf", one_page=True)
    content = file.read_bytes()
    assert content.startswith(b"%PDF")
    assert len(PAGES.findall(content)) == 1
    with raises(OptionError, "Chromium", argument="path"):
        calibration.report(tmp_path / "long.pdf")
    assert [one.name for one in tmp_path.iterdir()] == ["unit.pdf"]


@needs_browser
@pytest.mark.slow
@pytest.mark.browser
def test_a_browser_prints_one_page_and_a_short_report(calibration, tmp_path):
    assert len(PAGES.findall(calibration.report(tmp_path / "one.pdf", one_page=True).read_bytes())) == 1
    long = len(PAGES.findall(calibration.report(tmp_path / "long.pdf").read_bytes()))
    # A page for each axis, two for the summary and one for the rest: ten for six axes.
    assert long <= len(calibration) + 4


@needs_browser
@pytest.mark.slow
@pytest.mark.browser
def test_many_axes_and_long_cautions_are_still_one_page(calibration, tmp_path, monkeypatch):
    one = "The mean settles over the first hour: " + ", ".join(f"gyro_{k} (149.2 deg/h, 33 min)" for k in range(20))
    monkeypatch.setattr("gmwm.showing.reports.write.with_groups", lambda *_: [("a", f"{one}, {k}.") for k in range(6)])
    lost = {f"sensor_{k}": "the signal is constant" for k in range(12)}
    many = dataclasses.replace(calibration, failed=lost)
    content = many.report(tmp_path / "one.pdf", one_page=True).read_bytes()
    assert len(PAGES.findall(content)) == 1


@pytest.mark.slow
def test_no_verdict_contradicts_another():
    truth = {"gyro_x": "WN(sigma2=4e-7)", "gyro_y": "WN(sigma2=4e-7) + RW(gamma2=2e-9)"}
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=50_000, rng=4), "WN")
    moved = Remark.of(
        "recording-moved", "gyro_y", case="moved", parts=("9 s to 27 s",), ranges=((9.0, 27.0),), ratio=7.0
    )
    found = dataclasses.replace(found, recording_remarks=(moved,))
    assert unusable(found) == ["gyro_y"]
    data = report_data(found)
    assert not any("axes are calibrated" in point["text"] for point in data["verdict"]["points"])
    # The same words come first on the page, on the terminal and in the report.
    first = found.summary().split("\n\n")[0].replace("\n", " ")
    assert first == found.verdict.text()
    (table,) = one_page_data(found)["tables"]
    assert {cell["mark"] for cell in table["rows"][1]["cells"]} == {"✗"}
    assert page(data).index("Do not use gyro_y") < page(data).index("The recording")
    failed = dataclasses.replace(found, failed={"gyro_z": "the signal is constant"})
    (table,) = one_page_data(failed)["tables"]
    assert (table["rows"][-1]["axis"], table["rows"][-1]["failed"]) == ("gyro_z", "the signal is constant")
