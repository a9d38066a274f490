"""A fault of one axis changes no number of another axis."""

from collections.abc import Callable

import numpy as np
import pytest

import gmwm
from tests.helpers import each

SIZE, RATE = 12_000, 100.0
Samples = np.ndarray


def _recording() -> dict[str, Samples]:
    """Simulate three axes of two sensors, white noise with a random walk."""
    rng = np.random.default_rng(11)
    means = {"gyro_x": 0.0, "gyro_y": 0.0, "accel_z": 9.81}
    return {
        axis: 1e-3 * (rng.normal(size=SIZE) + 3e-3 * np.cumsum(rng.normal(size=SIZE))) + mean
        for axis, mean in means.items()
    }


def _with(x: Samples, rows: object, values: object) -> Samples:
    y = x.copy()
    y[rows] = values  # type: ignore[index]
    return y


def _straight(x: Samples) -> Samples:
    y = x.copy()
    for first in range(200, SIZE - 20, 600):
        y[first : first + 11] = np.linspace(x[first], x[first + 10], 11)
    return y


RANDOM = np.random.default_rng(12)
FAULTS: dict[str, Callable[[Samples], Samples]] = {
    "dead": lambda x: np.full(SIZE, x[0]),
    "dead at first": lambda x: _with(x, slice(300), x[0]),
    "dead from the middle": lambda x: _with(x, slice(SIZE // 2, None), x[SIZE // 2]),
    "frozen": lambda x: _with(x, slice(3000, 3400), x[3000]),
    "straight lines": _straight,
    "clipped": lambda x: np.clip(x, x.mean() - 1e-3, x.mean() + 1e-3),
    "jump": lambda x: x + 0.05 * (np.arange(SIZE) > SIZE // 2),
    "jumps": lambda x: x + 0.03 * np.searchsorted([1000, 2500, 2600, 7000, 9000, 9100, 9800, 11000], np.arange(SIZE)),
    "spikes": lambda x: x + np.where(RANDOM.random(SIZE) < 2e-3, 1.0, 0.0),
    "motion": lambda x: x + 0.1 * np.sin(np.arange(SIZE) / 20) * (np.arange(SIZE) // 1000 == 5),
    "line": lambda x: x + 3e-3 * np.sin(np.arange(SIZE) * 0.7),
    "warm-up": lambda x: x + 0.1 * np.exp(-np.arange(SIZE) / 800),
    "half the rate": lambda x: np.repeat(x[::2], 2),
    "half the rate of a coarse output": lambda x: np.round(np.repeat(x[::2], 2) / 1e-4) * 1e-4,
    "a tenth of the rate": lambda x: np.repeat(x[::10], 10),
    "lost samples repeat": lambda x: np.where(RANDOM.random(SIZE) < 0.03, np.roll(x, 1), x),
    "steep filter": lambda x: np.convolve(x, np.ones(12) / 12, "same"),
    "wrapped": lambda x: np.mod(x, 4e-3),
    "wrong unit": lambda x: 1e4 * x,
    "tiny": lambda x: 1e-160 * x,
}
FELT_BY_ALL = ("dead", "frozen", "jump", "half the rate", "wrong unit")
"""Faults that another sensor could feel: by the segments, the samples that are lost, gravity or the unit."""


def _numbers(arrays: dict[str, Samples]) -> dict[str, object]:
    imu = gmwm.Imu.from_arrays(arrays, rate=RATE)
    calibration = gmwm.calibrate(imu, models=dict.fromkeys(arrays, "WN + RW"), threads=1)
    return {axis: calibration.datasheets[axis].to_dict() for axis in calibration}


@pytest.fixture(scope="module")
def clean() -> tuple[dict[str, Samples], dict[str, object]]:
    """A recording without a fault, and its numbers."""
    arrays = _recording()
    return arrays, _numbers(arrays)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.base.errors.GmwmWarning")
@each(("axis", "fault"), [*(("gyro_y", fault) for fault in FAULTS), *(("accel_z", fault) for fault in FELT_BY_ALL)])
def test_a_fault_of_one_axis_changes_no_number_of_another(clean: object, fault: str, axis: str) -> None:
    arrays, numbers = clean  # type: ignore[misc]
    faulty = _numbers({**arrays, axis: FAULTS[fault](arrays[axis])})
    for other in set(numbers) - {axis}:
        assert faulty[other] == numbers[other], other


@pytest.mark.filterwarnings("ignore::gmwm.base.errors.GmwmWarning")
def test_axes_that_freeze_together_stay_one_recording() -> None:
    arrays = {axis: _with(x, slice(3000, 3400), x[3000]) for axis, x in _recording().items()}
    inspection = gmwm.inspect(gmwm.Imu.from_arrays(arrays, rate=RATE))
    frozen = [remark.subject for remark in inspection.remarks if remark.facts.get("case") == "frozen"]
    assert frozen == list(arrays)
    assert inspection.segments == 2


@pytest.mark.filterwarnings("ignore::gmwm.base.errors.GmwmWarning")
def test_gravity_is_checked_if_one_accelerometer_has_a_fault_that_is_undone() -> None:
    rng = np.random.default_rng(13)
    arrays = {f"accel_{k}": 5e-3 * rng.normal(size=SIZE) + 4.0 for k in "xyz"}
    arrays["accel_y"] = FAULTS["half the rate"](arrays["accel_y"])
    inspection = gmwm.inspect(gmwm.Imu.from_arrays(arrays, rate=RATE))
    assert inspection.gravity == pytest.approx(4 * np.sqrt(3), rel=1e-3)
    assert any(remark.facts.get("case") == "gravity" for remark in inspection.remarks)
