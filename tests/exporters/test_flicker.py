"""Flicker noise in the files of other programs: never lost, never white without a word."""

import math
import re

import pytest

from gmwm import export, export_formats
from gmwm.errors import MissingTheoryError

from .conftest import calibrated
from .consumers import CONSUMERS

B2 = {"gyro": 4e-10, "accel": 4e-7}
TRUTHS = {
    f"{sensor}_{letter}": f"WN(sigma2={1000 * b2!r}) + FN(b2={b2!r})" for sensor, b2 in B2.items() for letter in "xyz"
}


@pytest.fixture(scope="module")
def unit():
    return calibrated(TRUTHS, "WN + FN")


def words(text):
    return " ".join(re.sub(r"^\s*(#|%|//|;)", " ", text, flags=re.MULTILINE).split())


@pytest.mark.parametrize("format", CONSUMERS)
def test_the_walk_has_its_allan_deviation_at_the_horizon(unit, format):
    text = export(unit, format=format, horizon=2.0)
    read = CONSUMERS[format](text)
    for sensor, b2 in B2.items():
        assert read[sensor][1] == pytest.approx(math.sqrt(3 * 2 * math.log(2) / math.pi * b2 / 2.0), rel=1e-4)
    said = words(text)
    assert "K: FN (by its Allan deviation at the horizon)" in said
    assert "have no correlation time: they are counted as what has their Allan deviation at 2 s" in said
    assert "In neither" not in said


def test_ros_leaves_it_out_and_says_so(unit):
    assert "Flicker and power-law noise have none either, and are left out too." in words(export(unit, format="ros"))


def test_matrices_name_the_axis_and_the_way_out(unit):
    with pytest.raises(
        MissingTheoryError, match=r"gyro_x: FN has no state space .* Gauss-Markov processes in its place"
    ):
        export(unit, format="state-space")
    assert '"matrices": null' in export(unit, format="json")
    for format in set(export_formats()) - {"state-space"}:
        assert export(unit, format=format)
