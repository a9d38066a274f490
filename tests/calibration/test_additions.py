"""Additions to a calibration: one registry for the package and for guests; values are stored under their name."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import gmwm
from gmwm.base.errors import GmwmWarning, ReadError
from gmwm.base.extras import admit_guests
from gmwm.calibration.additions import ENTRY_POINTS, _registry, axis_additions, recording_additions
from tests.helpers import only, raises

GUEST = """
from gmwm.base.remarks import Remark
from gmwm.calibration.additions import AxisAddition, RecordingAddition

class Peak(AxisAddition):
    name, beginning = "peak", 5_000
    def of_axis(self, fit, beginnings):
        return max(float(abs(signal.values[:5_000]).max()) for signal in beginnings)
    def summary(self, values):
        return "Largest samples: " + ", ".join(values) + "."

class Means(RecordingAddition):
    def needs(self, axes):
        return True
    def of_recording(self, signals, *, threads=None):
        return sum(1 for _ in signals)
    def remarks(self, finding, axes, size):
        yield Remark.of("recommended", "guest", case="reduced", count=finding)

class Twice(AxisAddition):
    name = "peak"
"""
POINTS = (
    "[gmwm.additions]\na = guest_addition:Peak\nb = guest_addition:Means\nc = guest_addition:Twice\nd = json:dumps\n"
)


@pytest.fixture
def guest(tmp_path, monkeypatch):
    """An installed package with two additions, a third whose name is taken, and an object of a wrong type."""
    (tmp_path / "guest_addition.py").write_text(GUEST)
    metadata = tmp_path / "guest_addition-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: guest-addition\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(tmp_path)
    for cache in (_registry, admit_guests):
        cache.cache_clear()
    yield
    for cache in (_registry, admit_guests):
        cache.cache_clear()


def test_the_registry_has_the_additions_of_the_package_once():
    assert [addition.name for addition in axis_additions()] == ["baseline"]
    assert len(recording_additions()) == 1
    assert len(ENTRY_POINTS) == 2
    assert axis_additions()[0] is axis_additions()[0]


@pytest.mark.slow
def test_the_core_loads_no_application_before_a_calibration():
    program = "import sys, gmwm; gmwm.calibrate; print(*(n for n in sys.modules if 'applications' in n))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.slow
def test_a_guest_adds_values_remarks_and_a_paragraph(guest):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=20_000, rng=1)
    with pytest.warns(GmwmWarning) as warnings:
        calibration = gmwm.calibrate(imu, within="WN")
    assert [warning.message.remark.facts["name"] for warning in warnings] == ["c", "d"]
    largest = abs(imu["gyro_x"].values[:5_000]).max()
    assert calibration.axes["gyro_x"].additions["peak"] == largest
    assert calibration.addition("peak") == {"gyro_x": largest}
    assert only(calibration.recording_remarks, "recommended:reduced", "guest").facts["count"] == 1
    assert "Largest samples: gyro_x." in calibration.summary(details=True)
    document = json.loads(json.dumps(calibration.to_dict()))
    assert document["axes"]["gyro_x"]["peak"] == largest
    assert gmwm.Calibration.from_dict(document).to_dict() == calibration.to_dict()


@pytest.mark.slow
def test_a_document_without_the_guest_loses_its_value_only(calibration):
    content = calibration.to_dict()
    content["axes"]["gyro_x"]["peak"] = 1.0
    assert gmwm.Calibration.from_dict(content).to_dict() == calibration.to_dict()


def test_a_damaged_value_is_an_error_that_names_it(calibration):
    content = calibration.to_dict()
    content["axes"]["gyro_x"]["baseline"] = {"samples": 3}
    with raises(ReadError, "gyro_x.baseline"):
        gmwm.Calibration.from_dict(content)
