"""The quantization step and the noise before rounding are right, and outputs that are too coarse get a remark."""

from __future__ import annotations

import numpy as np
import pytest

from gmwm.base.remarks import Severity
from gmwm.measuring.inspection import inspect
from gmwm.recording.resolution import before_rounding, lsb
from gmwm.recording.signals import Imu, Signal
from tests.helpers import each, only

RATE = 100.0
SAMPLES = 60_000


def look(x):
    return inspect(Imu({"gyro_x": Signal(x, RATE, "rad/s", "gyro_x")}))


def recorded(ratio, offset, step, seed, wander=0.0):
    """White noise with a step of `ratio` standard deviations, and a slow wander, as the sensor writes it."""
    rng = np.random.default_rng(seed)
    walk = np.cumsum(rng.normal(size=SAMPLES)) / np.sqrt(SAMPLES) * wander
    return step * np.round(rng.normal(size=SAMPLES) / ratio + walk + offset)


@pytest.mark.slow
@each(("step", "offset", "wander"), [(1.0, 0.0, 0.0), (np.radians(0.05), 0.5, 2.0), (1 / 131, 0.3, 0.0)])
@each("ratio", [0.5, 1.5, 2.0, 2.5, 3.0, 4.0])
def test_the_noise_before_rounding(step, offset, wander, ratio):
    axis = look(recorded(ratio, offset, step, 1, wander)).axes["gyro_x"]
    assert axis.lsb == pytest.approx(step, rel=1e-6)
    # A wander over several steps moves the mean by a small part of the noise within a run.
    assert axis.before_rounding == pytest.approx(step / ratio, rel=0.06)


def test_noise_far_below_a_step_is_an_upper_limit():
    # At the edge of a step only two values occur, and any small noise has them equally often.
    runs = [np.round(np.random.default_rng(1).normal(0.5, 0.02, 256)) for _ in range(8)]
    assert before_rounding(runs, 1.0) < 0.4
    assert before_rounding([np.ones(256)] * 8, 1.0) < 0.2


@pytest.mark.slow
def test_held_samples_and_spikes_do_not_change_the_noise():
    x = recorded(1.5, 0.2, 1.0, 2)
    held = x.copy()
    held[: SAMPLES // 4] = x[0]
    held[::997] = 400.0
    assert look(held).axes["gyro_x"].before_rounding == pytest.approx(1 / 1.5, rel=0.06)
    assert look(np.repeat(x[: SAMPLES // 4], 4)).axes["gyro_x"].before_rounding == pytest.approx(1 / 1.5, rel=0.08)


@pytest.mark.parametrize(("step", "digits"), [(0.0076, 3), (2.44, 0), (1.5, 0), (0.00244, 3)])
def test_a_step_that_was_written_with_few_digits(step, digits):
    counts = np.round(np.random.default_rng(3).normal(0.2, 3, 40_000))
    assert lsb(np.round(counts * step, digits)) == pytest.approx(step, rel=0.05)


def test_two_means_have_the_same_step():
    rng = np.random.default_rng(4)
    x = np.concatenate([np.round(rng.normal(0, 4, 20_000)), np.round(rng.normal(500, 4, 20_000))])
    assert lsb(0.02 * x) == pytest.approx(0.02)


def test_an_average_of_rounded_samples_has_the_step_of_the_average():
    x = recorded(1.0, 0.1, 1.0, 5).reshape(-1, 4).mean(axis=1)
    assert lsb(x) == 0.25
    assert look(x).axes["gyro_x"].before_rounding == pytest.approx(np.sqrt((1 + 1 / 12) / 4), rel=0.06)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ratio", "code"), [(0.5, None), (1.4, "output-rounded"), (2.4, "coarse-output"), (8, "coarse-output")]
)
def test_remarks(ratio, code):
    found = look(recorded(ratio, 0.3, np.radians(0.05), 6))
    codes = [remark.code for remark in found.remarks if remark.code in ("output-rounded", "coarse-output")]
    assert codes == ([code] if code else [])
    if code is None:
        return
    remark = only(found.remarks, "output-rounded:rounded" if code == "output-rounded" else code)
    assert remark.severity is (Severity.WRONG if code == "coarse-output" else Severity.INFO)
    assert (round(remark.facts["step"].value, 6), remark.facts["step"].unit) == (180.0, "deg/h")
    if ratio < 5:
        assert remark.facts["ratio"] == pytest.approx(ratio, rel=0.06)
    if code == "output-rounded":
        # 0.05 deg/s/√(12 · 100 Hz) in deg/√h.
        assert remark.facts["density"].value == pytest.approx(0.05 / np.sqrt(1200) * 60)
        assert remark.facts["density"].unit == "deg/√h"
