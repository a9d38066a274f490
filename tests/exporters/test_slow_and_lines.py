"""Slow terms without a driving noise, and lines, in the files of other programs."""

import math
import re

import pytest

from gmwm import Model
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from tests.helpers import code_of, each

from .conftest import RATE, calibrated, remarks_in, words
from .consumers import CONSUMERS, MARKOV

pytestmark = pytest.mark.slow

SLOW = {"gyro": (4e-8, 6e-7), "accel": (4e-6, 6e-5)}
PHI = math.exp(-0.05 / RATE)
LINES = {"gyro": "SIN(frequency=0.7, power=4e-8) + WN(sigma2=6e-7) + RW(gamma2=1e-11)",
         "accel": "SIN(frequency=0.7, power=4e-6) + SIN(frequency=20.0, power=4e-6) + WN(sigma2=6e-5)"}  # fmt: skip


@pytest.fixture(scope="module")
def slow():
    return calibrated(
        {
            f"{sensor}_{letter}": f"AR(1, phi1={PHI!r}, sigma2={s2 * (1 - PHI**2)!r}) + WN(sigma2={white!r})"
            for sensor, (s2, white) in SLOW.items()
            for letter in "xyz"
        },
        "AR(1) + WN",
    )


@pytest.fixture(scope="module")
def lines():
    truths = {f"{sensor}_{letter}": text for sensor, text in LINES.items() for letter in "xyz"}
    return calibrated(truths, "2*SIN + WN + RW")


@each("format", CONSUMERS)
def test_a_slow_term_is_never_lost(slow, format):
    text = slow.export(format=format)
    for sensor, (s2, _) in list(SLOW.items())[format == "glim" :]:  # GLIM has one number for both sensors
        # Nearly as the Gauss-Markov process of the same law.
        walk = CONSUMERS[format](text)[sensor][1]
        assert walk == pytest.approx(math.sqrt(2 * 0.05 * s2), rel=0.01 if format in MARKOV else 0.15)
    assert not {remark.code for remark in remarks_in(slow, format)} - {"bias-not-known"}


@each("format", CONSUMERS)
def test_lines_are_named_and_their_error_is_counted(lines, format):
    text = lines.export(format=format)
    white, walk = CONSUMERS[format](text)["gyro"]
    numbers = filter_numbers(Model.parse(LINES["gyro"]).processes, RATE)
    assert 1.5 * math.sqrt(6e-7 / RATE) < numbers.N
    assert white == pytest.approx(numbers.N, rel=2e-3)
    if format not in (*MARKOV, "glim"):
        assert walk == pytest.approx(numbers.K, rel=5e-3)
    found = [remark for remark in remarks_in(lines, format) if code_of(remark) == "lines:file"]
    of_axes = {axis: [r.facts for r in found if r.subject == axis] for axis in ("gyro_x", "accel_y")}
    assert [facts["frequency"].value for facts in of_axes["gyro_x"]] == pytest.approx([0.7], rel=1e-3)
    assert of_axes["gyro_x"][0]["amplitude"].value == pytest.approx(math.sqrt(8e-8), rel=1e-3)
    assert of_axes["gyro_x"][0]["amplitude"].unit == "rad/s"
    assert sorted(facts["frequency"].value for facts in of_axes["accel_y"]) == pytest.approx([0.7, 20.0], rel=1e-3)
    assert "3 times the horizon: gyro_x 0.7 Hz (0.00028 rad/s)" in words(text)


def test_ros_leaves_lines_out(lines):
    text = lines.export(format="ros")
    (variance,) = re.findall(r"^angular_velocity_covariance: \[(\S+),", text, re.MULTILINE)
    assert float(variance) == pytest.approx(6e-7, rel=1e-4)
    axes = [remark.subject for remark in remarks_in(lines, "ros") if code_of(remark) == "lines:file"]
    assert axes == [*(f"gyro_{k}" for k in "xyz"), *(f"accel_{k}" for k in "xyz" for _ in range(2))]


def test_tables_have_frequency_and_amplitude(lines):
    rows = [line.split(",") for line in lines.export(format="csv").splitlines() if not line.startswith("#")]
    found = {row[2]: (float(row[5]), row[8]) for row in rows if row[0] == "accel_x"}
    assert found["f_0[2]"] == (pytest.approx(20.0, rel=1e-3), "Hz")
    assert found["A[2]"] == (pytest.approx(math.sqrt(8e-6), rel=1e-3), "m/s²")
    assert {row[2]: row[3] for row in rows}["A[2]"] == "amplitude of a line at 20 Hz"
    assert {r"A at 20 Hz", r"f\_0 at 20 Hz"} <= {
        cell[: cell.find(" (")] for cell in lines.export(format="latex").split("\n")
    }
    assert "line: amplitude at this frequency" in words(lines.summary(details=True))
