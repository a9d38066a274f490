"""The report page is complete, self-contained, small, and safe against names from files."""

import hashlib
import re
from html.parser import HTMLParser
from importlib.resources import files

import pytest

import gmwm
from gmwm.base.errors import OptionError
from tests.helpers import raises
from tests.reports.conftest import HOSTILE

MOST = 2_500_000
"""Bytes of a report."""


class Tags(HTMLParser):
    """Every tag with its attributes, and the text outside of scripts and styles."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.text, self._inside = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside not in ("script", "style"):
            self.text.append(data)


@pytest.fixture(scope="module")
def page(calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    assert calibration.report(path) == path
    assert path.stat().st_size <= MOST
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_it_says_all_of_it(page, calibration):
    text = " ".join(" ".join(Tags(page).text).split())
    data = gmwm.reports.report_data(calibration)
    assert data["verdict"]["headline"] in text
    for axis in data["axes"]:
        for row in axis["numbers"]:
            assert row["datasheet"] in text
            assert row["si"] in text
        for row in axis["parameters"]:
            assert row["value"] in text
        assert axis["test"] in text
    plain = [Tags(point["text"]) for point in (*data["verdict"]["points"], *data["notes"])]
    assert plain
    for tags in plain:
        assert " ".join(" ".join(tags.text).split()) in text
    for point in data["verdict"]["points"]:
        shown = f'<span class="code">{point["code"]}</span>' in page
        assert shown is (point["state"] != "good")
    assert "arXiv:1603.05297" in text
    assert "gyroscope_noise_density:" in text


def test_it_stands_alone(page):
    tags = Tags(page).tags
    assert [attrs for tag, attrs in tags if "src" in attrs or tag == "link"] == []
    assert all(attrs["href"].startswith("#") for tag, attrs in tags if tag == "a")
    identifiers = {attrs["id"] for _, attrs in tags if "id" in attrs}
    assert {attrs["href"][1:] for tag, attrs in tags if tag == "a"} <= identifiers
    policy = next(attrs["content"] for tag, attrs in tags if attrs.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-eval" not in policy
    assert "http" not in policy


@pytest.mark.slow
def test_the_same_calibration_gives_the_same_bytes(page, calibration, tmp_path):
    calibration.save(tmp_path / "calibration.json")
    again = gmwm.Calibration.load(tmp_path / "calibration.json").report(tmp_path / "again.html")
    assert again.read_text(encoding="utf-8") == page


@pytest.mark.slow
def test_hostile_names_are_text(hostile, page, tmp_path):
    written = hostile.report(tmp_path / "hostile.html").read_text(encoding="utf-8")
    found, clean = Tags(written), Tags(page)
    # Not a tag more than in a report of good names: what is in the names is text.
    assert {tag for tag, _ in found.tags} <= {tag for tag, _ in clean.tags}
    assert all(attrs["href"].startswith("#") for tag, attrs in found.tags if tag == "a")
    count = sum(tag == "script" for tag, _ in found.tags)
    assert count == sum(tag == "script" for tag, _ in clean.tags)
    assert not any(name.startswith("on") for _, attrs in found.tags for name in attrs)
    text = " ".join(found.text)
    assert HOSTILE in text
    assert "{{ 7 * 7 }}" in text


@pytest.mark.parametrize("name", ["report.txt", "report"])
def test_another_ending_is_refused(calibration, tmp_path, name):
    with raises(
        OptionError, argument="path", expected="a file name that ends in .html or .pdf", got=str(tmp_path / name)
    ):
        calibration.report(tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_what_it_carries_is_what_was_fetched():
    folder = files("gmwm.showing.reports").joinpath("vendor")
    sums = dict(reversed(line.split("  ")) for line in folder.joinpath("SHA256SUMS").read_text().splitlines())
    assert {"plotly-basic.min.js", "plotly-basic.LICENSE", "VERSION"} == set(sums)
    for name, expected in sums.items():
        assert hashlib.sha256(folder.joinpath(name).read_bytes()).hexdigest() == expected
    version = re.search(r"@([\d.]+)", folder.joinpath("VERSION").read_text())[1]
    assert f"v{version}" in folder.joinpath("plotly-basic.min.js").read_text(encoding="utf-8")[:200]
    assert folder.joinpath("plotly-basic.LICENSE").read_text().startswith("MIT License")


def test_negative_numbers_have_a_minus_sign_except_in_files(page):
    """The signs of numbers are minus signs; the files between <pre> are as programs read them."""
    assert re.search(r"<td>[^<]*\(?−\d", page)
    shown = " ".join(Tags(re.sub(r"<pre.*?</pre>", "", page, flags=re.DOTALL)).text)
    assert not re.findall(r"(?<![\w.=−-])-\.?\d", shown)
