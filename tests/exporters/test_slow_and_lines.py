"""Slow terms without a driving noise, and lines, in the files of other programs."""

import math
import re

import pytest

from .conftest import RATE, calibrated
from .consumers import CONSUMERS

SLOW = {"gyro": (4e-8, 6e-7), "accel": (4e-6, 6e-5)}
PHI = math.exp(-0.05 / RATE)
LINES = {"gyro": "SIN(frequency=0.7, power=4e-8) + WN(sigma2=6e-7) + RW(gamma2=1e-11)",
         "accel": "SIN(frequency=0.7, power=4e-6) + SIN(frequency=20.0, power=4e-6) + WN(sigma2=6e-5)"}  # fmt: skip


def words(text):
    return " ".join(re.sub(r"^\s*(#|%|//|;)", " ", text, flags=re.MULTILINE).split())


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


@pytest.mark.parametrize("format", CONSUMERS)
def test_a_slow_term_is_never_lost(slow, format):
    text = slow.export(format=format)
    for sensor, (s2, _) in SLOW.items():
        # As the Gauss-Markov process of the same law; nearly so at a horizon that is no mere moment to it.
        assert CONSUMERS[format](text)[sensor][1] == pytest.approx(math.sqrt(2 * 0.05 * s2), rel=0.03)
    assert "UPPER LIMIT" not in text
    assert "K: AR(1) (by its Allan deviation)" in words(text)


@pytest.mark.parametrize("format", CONSUMERS)
def test_lines_are_named_and_not_counted(lines, format):
    text = lines.export(format=format)
    white, walk = CONSUMERS[format](text)["gyro"]
    assert white == pytest.approx(math.sqrt(6e-7 / RATE), rel=1e-4)
    assert walk == pytest.approx(math.sqrt(1e-11 * RATE), rel=1e-3)
    said = words(text)
    assert "Not in these numbers: a line at 0.700 Hz of amplitude 2.83e-04 rad/s, on gyro_x." in said
    assert "a line at 20.0 Hz of amplitude 0.00283 m/s^2, on accel_y." in said
    assert "In neither" not in said


def test_ros_leaves_lines_out(lines):
    text = lines.export(format="ros")
    (variance,) = re.findall(r"^angular_velocity_covariance: \[(\S+),", text, re.MULTILINE)
    assert float(variance) == pytest.approx(6e-7, rel=1e-4)
    assert "a line at 0.700 Hz of amplitude 2.83e-04 rad/s, on gyro_x" in words(text)


def test_tables_have_frequency_and_amplitude(lines):
    rows = [line.split(",") for line in lines.export(format="csv").splitlines() if not line.startswith("#")]
    found = {row[2]: (float(row[5]), row[8]) for row in rows if row[0] == "accel_x"}
    assert found["f_0[2]"] == (pytest.approx(20.0, rel=1e-3), "Hz")
    assert found["A[2]"] == (pytest.approx(math.sqrt(8e-6), rel=1e-3), "m/s²")
    assert r"f\_0[2] (Hz)" in lines.export(format="latex")
    assert "f_0 frequency of a line; A amplitude of a line" in words(lines.summary())
