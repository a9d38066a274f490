"""Redundant units at rest: which one has changed?"""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

import gmwm
from gmwm.applications.monitor import UnitEvent, redundant
from gmwm.base.errors import DataError, OptionError

RATE = 100.0
SIGMA = 4.4e-4
MODEL = f"GM(beta=0.02, sigma2={1.4e-4**2}) + WN(sigma2={SIGMA**2}) + RW(gamma2=5.9e-18)"
AXES = ("gyro_x", "gyro_y", "gyro_z")
N, START = 60_000, 40_000


def units(seed: int, axes: tuple[str, ...] = ("gyro_x",)) -> dict[str, dict[str, np.ndarray]]:
    """Three units on one table, whose temperature changes."""
    shared = 1e-3 * np.sin(np.arange(N) / 3000.0)
    model = gmwm.Model.parse(MODEL)
    return {
        name: {axis: shared + model.simulate(N, RATE, rng=1000 * seed + 10 * k + j) for j, axis in enumerate(axes)}
        for k, name in enumerate("abc")
    }


def events(made: dict[str, dict[str, np.ndarray]]) -> list[UnitEvent]:
    axes = next(iter(made.values())).keys()
    recordings = {name: gmwm.Imu.from_arrays(x, rate=RATE) for name, x in made.items()}
    return list(redundant(dict.fromkeys(axes, MODEL), recordings, every="30d"))


@pytest.mark.slow
def test_the_unit_with_the_fault_is_named() -> None:
    named: Counter[tuple[str, str]] = Counter()
    for seed in range(5):
        made = units(seed)
        made["b"]["gyro_x"][START:] += 2 * SIGMA
        (found,) = events(made)
        named[found.name, found.event.kind] += 1
        assert found.event.time == pytest.approx(START / RATE, abs=1.0)
        made = units(100 + seed)
        made["c"]["gyro_x"][START:] += 1.1 * SIGMA * np.random.default_rng(seed).standard_normal(N - START)
        found = events(made)[0]
        named[found.name, found.event.kind] += 1
        assert str(found).startswith("c: ")
    assert named == {("b", "jump"): 5, ("c", "noise-up"): 5}


@pytest.mark.slow
def test_a_large_jump_is_the_fault_of_one_unit_only() -> None:
    made = units(1, AXES)
    made["a"]["gyro_y"][START:] += 200 * SIGMA
    (found,) = events(made)
    assert (found.name, found.event.axis) == ("a", "gyro_y")
    assert found.to_dict()["source"] == "a"


@pytest.mark.slow
def test_a_knock_of_the_table_is_no_fault_and_motion_is_refused() -> None:
    made = units(2, AXES)
    for k, x in enumerate(made.values()):
        for j, axis in enumerate(AXES):
            x[axis][START : START + 500] += (1 + 0.001 * k) * 0.5 * np.sin(np.arange(500) / (5.0 + j))
    assert [(one.name, one.event.kind) for one in events(made)] == [("", "moved"), ("", "still")]
    for k, x in enumerate(made.values()):
        for j, axis in enumerate(AXES):
            x[axis][START:] += (1 + 0.001 * k) * 0.5 * np.sin(np.arange(N - START) / (5.0 + j))
    with pytest.raises(DataError):
        events(made)


@pytest.mark.slow
def test_wrong_recordings_are_refused() -> None:
    made = {name: gmwm.Imu.from_arrays(x, rate=RATE) for name, x in units(3).items()}
    with pytest.raises(OptionError):
        redundant({"gyro_x": MODEL}, {name: made[name] for name in "ab"})
    with pytest.raises(OptionError):
        redundant({"gyro_x": MODEL}, made, axes=["gyro_y"])
    gaps = made["a"]["gyro_x"].values.copy()
    gaps[30_000:30_100] = np.nan
    made["a"] = gmwm.Imu({"gyro_x": gmwm.Signal.from_missing(gaps, RATE, "rad/s", "gyro_x")})
    with pytest.raises(DataError):
        list(redundant({"gyro_x": MODEL}, made))
