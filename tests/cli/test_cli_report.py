"""gmwm report: the page of a calibration, from its file."""

import shutil

import pytest


@pytest.fixture(scope="module")
def results(calibrated):
    return calibrated[0]


@pytest.mark.slow
def test_the_page_of_the_file_is_that_of_the_calibration(gmwm, results, recording, tmp_path):
    copy = shutil.copy(results / "calibration.json", tmp_path)
    outcome = gmwm("report", copy)
    assert outcome.code == 0
    assert str(tmp_path / "report.html") in outcome.out
    page = (tmp_path / "report.html").read_bytes()
    assert page == (results / "report.html").read_bytes()
    assert f"Calibration of {recording.name}".encode() in page


@pytest.mark.slow
def test_json_says_where_it_is(gmwm, results, tmp_path):
    content = gmwm("report", results / "calibration.json", "--output", tmp_path / "unit7.html", "--json").json
    assert content["command"] == "report"
    assert content["written"] == [str(tmp_path / "unit7.html")]
    assert (tmp_path / "unit7.html").stat().st_size < 2_500_000


@pytest.mark.slow
def test_the_folder_of_a_calibration_stands_for_it(gmwm, results, tmp_path):
    shutil.copy(results / "calibration.json", tmp_path)
    outcome = gmwm("report", tmp_path)
    assert outcome.code == 0
    assert (tmp_path / "report.html").read_bytes() == (results / "report.html").read_bytes()
    (tmp_path / "empty").mkdir()
    assert str(tmp_path / "empty" / "calibration.json") in gmwm("report", tmp_path / "empty").err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "output", "fact"),
    [
        ("results/report.html", "x.html", "results/report.html"),
        ("results/none.json", "x.html", "none.json"),
        ("results/calibration.json", "x.txt", ".html"),
        ("results/calibration.json", "none/x.html", "none"),
    ],
)
def test_errors_take_one_line(gmwm, results, tmp_path, file, output, fact):
    gmwm("report", results.parent / file, "--output", tmp_path / output).require_refusal(fact)
    assert list(tmp_path.iterdir()) == []
